//! Recording what is on the wire and publishing it again.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::time::Duration;

use swath_bridge::keys;
use swath_bridge::msg::geometry::PoseArray;
use swath_bridge::msg::header::Header;
use swath_bridge::msg::nav::Path;
use swath_bridge::recording::{
    RawMessage, Reader, RecordOptions, Recorder, ReplayOptions, Stamps, Writer, replay,
};
use swath_bridge::{Session, SessionConfig};
use tempfile::TempDir;

/// Longer than anything here takes, so that a test that would hang fails.
const PATIENCE: Duration = Duration::from_mins(10);

async fn soon<T>(what: impl Future<Output = T>) -> T {
    tokio::time::timeout(PATIENCE, what).await.unwrap()
}

async fn pair() -> (Session, Session) {
    let listening = SessionConfig {
        listen: vec!["tcp/127.0.0.1:0".to_owned()],
        ..SessionConfig::default()
    };
    let a = Session::open(&listening).await.unwrap();
    let connecting = SessionConfig {
        connect: a.endpoints().await,
        ..SessionConfig::default()
    };
    let b = Session::open(&connecting).await.unwrap();
    (a, b)
}

fn path(number: u64) -> Path {
    Path {
        header: Header::at(number, "base_link"),
        poses: Vec::new(),
    }
}

fn read(path: &std::path::Path) -> Vec<RawMessage> {
    Reader::open(path).unwrap().map(Result::unwrap).collect()
}

async fn written(recorder: &Recorder, count: u64) {
    let waiting = async {
        while recorder.counts().written < count {
            tokio::task::yield_now().await;
        }
    };
    let waited = tokio::time::timeout(PATIENCE, waiting).await;
    assert!(waited.is_ok(), "{:?}, expected {count}", recorder.counts());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_recorder_writes_every_topic_with_type_and_times() {
    let dir = TempDir::new().unwrap();
    let file = dir.path().join("run.mcap");
    let (a, b) = pair().await;
    // What was published before the recorder came and is kept for late ones is recorded too.
    let reference = a.publisher(&keys::reference("v")).await.unwrap();
    reference.put(&path(7)).await.unwrap();
    let options = RecordOptions {
        path: file.clone(),
        keys: Vec::new(),
    };
    let recorder = Recorder::start(&b, &options).await.unwrap();
    let plans = a.publisher(&keys::path("v")).await.unwrap();
    soon(plans.wait_for_subscribers()).await.unwrap();
    for number in 0..30 {
        plans.put(&path(number)).await.unwrap();
        // Plans are dropped when the network is behind, so it is given time.
        written(&recorder, number + 2).await;
    }
    let counts = soon(recorder.finish()).await.unwrap();
    assert_eq!((counts.written, counts.dropped), (31, 0));
    let messages = read(&file);
    let on = |topic: &str| -> Vec<Path> {
        let of_topic = messages.iter().filter(|message| *message.topic == *topic);
        of_topic.map(|message| message.decode().unwrap()).collect()
    };
    assert_eq!(on("/swath/vehicle/v/reference"), [path(7)]);
    let expected: Vec<Path> = (0..30).map(path).collect();
    assert_eq!(on("/swath/vehicle/v/path"), expected);
    for message in &messages {
        assert_eq!(&*message.type_name, "nav_msgs/msg/Path");
        assert!(message.publish_nanos <= message.log_nanos + 1_000_000_000);
        let qos = &message.channel.metadata["offered_qos_profiles"];
        assert!(qos.contains("reliability: "), "{qos}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_recorder_that_was_never_finished_leaves_what_was_flushed() {
    let dir = TempDir::new().unwrap();
    let file = dir.path().join("run.mcap");
    let (a, b) = pair().await;
    let options = RecordOptions {
        path: file.clone(),
        keys: vec!["swath/vehicle/v/".to_owned()],
    };
    let recorder = Recorder::start(&b, &options).await.unwrap();
    let plans = a.publisher(&keys::path("v")).await.unwrap();
    let others = a.publisher(&keys::path("w")).await.unwrap();
    soon(plans.wait_for_subscribers()).await.unwrap();
    others.put(&path(1)).await.unwrap();
    plans.put(&path(2)).await.unwrap();
    written(&recorder, 1).await;
    // Nothing more comes, and still the message gets to the file.
    soon(async {
        let flushed = || {
            let mut reader = Reader::open(&file).ok()?;
            reader.next()?.ok()
        };
        while flushed().is_none() {
            tokio::task::yield_now().await;
        }
    })
    .await;
    let first = Reader::open(&file).unwrap().next().unwrap().unwrap();
    assert_eq!(first.decode::<Path>().unwrap(), path(2));
    soon(recorder.finish()).await.unwrap();
}

/// A recording of 0.5 s: a path every 50 ms, and targets with the first of them.
fn recording(dir: &TempDir) -> std::path::PathBuf {
    let file = dir.path().join("log.mcap");
    let mut writer = Writer::create(&file).unwrap();
    let begin = 1_000_000_000_000;
    let targets = PoseArray {
        header: Header::at(0, "base_link"),
        poses: Vec::new(),
    };
    writer
        .write(&keys::targets("v"), &targets, begin, begin)
        .unwrap();
    for number in 0..=10 {
        let nanos = begin + number * 50_000_000;
        writer
            .write(&keys::path("v"), &path(number), nanos, nanos)
            .unwrap();
    }
    let stamps = Stamps {
        log_nanos: begin + 500_000_000,
        publish_nanos: 0,
    };
    writer
        .write_raw("/not/for/a/key//", "a_msgs/msg/A", &[0, 1, 0, 0], stamps)
        .unwrap();
    writer.finish().unwrap();
    file
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_replay_publishes_what_was_chosen_and_keeps_the_spacing() {
    let dir = TempDir::new().unwrap();
    let file = recording(&dir);
    let (a, b) = pair().await;
    let mut subscriber = b.subscriber(&keys::path("v"), 64).await.unwrap();
    let publisher = a.publisher(&keys::path("v")).await.unwrap();
    soon(publisher.wait_for_subscribers()).await.unwrap();
    let options = ReplayOptions {
        rate: 2.0,
        start_s: 0.1,
        end_s: 0.4,
        topics: vec!["swath/vehicle/v/path".to_owned()],
        ..ReplayOptions::all_of(&file)
    };
    let mut done = (0, 1);
    let mut progress = |now, total| done = (now, total);
    let report = soon(replay(&a, &options, &mut progress)).await.unwrap();
    assert_eq!((report.messages, report.rounds), (7, 1));
    assert!(done.0 > 0 && done.0 <= done.1);
    for number in 2..=8 {
        let received = soon(subscriber.recv()).await.unwrap();
        assert_eq!(received.message, path(number));
    }
    // 0.3 s at twice the speed, never quicker; a busy machine may be late.
    assert!(report.elapsed_s >= 0.15, "{report:?}");
    assert!(report.worst_late_ms >= report.mean_late_ms);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_replay_that_cannot_be_says_why() {
    let dir = TempDir::new().unwrap();
    let (a, _b) = pair().await;
    let mut quiet = |_, _| {};
    let missing = ReplayOptions::all_of(dir.path().join("none.mcap"));
    let error = replay(&a, &missing, &mut quiet).await.unwrap_err();
    assert!(error.to_string().contains("none.mcap"), "{error}");
    let file = recording(&dir);
    let mut still = ReplayOptions::all_of(&file);
    still.rate = 0.0;
    let error = replay(&a, &still, &mut quiet).await.unwrap_err();
    assert!(error.to_string().contains("rate"), "{error}");
    let whole = ReplayOptions {
        rate: f64::INFINITY,
        ..ReplayOptions::all_of(&file)
    };
    let error = soon(replay(&a, &whole, &mut quiet)).await.unwrap_err();
    assert!(error.to_string().contains("not/for/a/key"), "{error}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_endless_replay_begins_again() {
    let dir = TempDir::new().unwrap();
    let file = recording(&dir);
    let (a, b) = pair().await;
    let mut subscriber = b.subscriber(&keys::path("v"), 64).await.unwrap();
    let options = ReplayOptions {
        rate: 100.0,
        is_endless: true,
        topics: vec!["/swath/*".to_owned()],
        ..ReplayOptions::all_of(&file)
    };
    let mut quiet = |_, _| {};
    let mut seen_first = 0;
    soon(async {
        let playing = replay(&a, &options, &mut quiet);
        tokio::pin!(playing);
        while seen_first < 3 {
            tokio::select! {
                report = &mut playing => panic!("it ended: {report:?}"),
                received = subscriber.recv() => {
                    seen_first += u32::from(received.unwrap().message == path(0));
                }
            }
        }
    })
    .await;
}
