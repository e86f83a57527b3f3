//! Messages between sessions of this process: what each quality of service promises.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::time::Duration;

use swath_bridge::keys::{self, Qos, Topic};
use swath_bridge::msg::header::Header;
use swath_bridge::msg::nav::Path;
use swath_bridge::msg::swath::{TrainStatus, Weights};
use swath_bridge::{Ports, Session, SessionConfig};

/// Longer than anything here takes, so that a test that would hang fails.
const PATIENCE: Duration = Duration::from_mins(10);

async fn soon<T>(what: impl Future<Output = T>) -> T {
    tokio::time::timeout(PATIENCE, what).await.unwrap()
}

/// Two sessions that are connected to each other and to nobody else.
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

fn status(number: u64) -> TrainStatus {
    TrainStatus {
        header: Header::at(number, ""),
        run: "r".to_owned(),
        step: number,
        epoch: 0,
        epochs: 1,
        samples: 0,
        samples_per_s: 0.0,
        received: 0,
        gaps: 0,
        duplicates: 0,
        rejected: 0,
        buffered: 0,
        learning_rate: 0.0,
        loss: 0.5,
        miou: 0.5,
        weights_version: 0,
        eta_s: 0.0,
    }
}

fn weights(version: u64) -> Weights {
    Weights {
        header: Header::at(version, ""),
        run: "r".to_owned(),
        version,
        step: 0,
        epoch: 0,
        architecture: "enet".to_owned(),
        input_rows: 8,
        input_cols: 8,
        vehicle: String::new(),
        loss: 0.0,
        miou: 0.5,
        iou_path: 0.5,
        iou_background: 0.5,
        digest: [0; 32],
        public_key: vec![0; 32],
        signature: vec![0; 64],
        safetensors: vec![7; 2_000_000],
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn messages_arrive_in_order_with_key_and_times() {
    let (a, b) = pair().await;
    let mut subscriber = b.subscriber(&keys::train_status("*"), 64).await.unwrap();
    // Carried as samples are, since a status may be dropped.
    let topic = keys::train_status("r");
    let publisher = a.raw_publisher(topic.key(), Qos::Block).await.unwrap();
    soon(publisher.wait_for_subscribers()).await.unwrap();
    for number in 0..20 {
        let payload = swath_bridge::cdr::to_vec(&status(number)).unwrap();
        publisher.put(payload).await.unwrap();
    }
    for number in 0..20 {
        let received = soon(subscriber.recv()).await.unwrap();
        assert_eq!(received.message, status(number));
        assert_eq!(received.key, "swath/train/r");
        assert!(received.sent_nanos.is_some());
        assert!(received.received_nanos > 0);
    }
    assert_eq!(subscriber.counts().received, 20);
    assert_eq!(subscriber.counts().dropped, 0);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_late_joiner_gets_the_last_reference_and_the_newest_weights() {
    let (a, b) = pair().await;
    let references = a.publisher(&keys::reference("v")).await.unwrap();
    let trainer = a.publisher(&keys::weights("r")).await.unwrap();
    for number in 1..=3 {
        references.put(&path(number)).await.unwrap();
        trainer.put(&weights(number)).await.unwrap();
    }
    let mut reference = b.subscriber(&keys::reference("v"), 4).await.unwrap();
    let mut newest = b.subscriber(&keys::weights("*"), 4).await.unwrap();
    assert_eq!(soon(reference.recv()).await.unwrap().message, path(3));
    assert_eq!(soon(newest.recv()).await.unwrap().message, weights(3));
    // And what comes later, each exactly once.
    trainer.put(&weights(4)).await.unwrap();
    assert_eq!(soon(newest.recv()).await.unwrap().message, weights(4));
    assert_eq!(newest.counts().received, 2);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_subscriber_gets_what_was_published_before_its_publisher_was_found() {
    let (a, b) = pair().await;
    let mut reference = b.subscriber(&keys::reference("*"), 4).await.unwrap();
    let publisher = a.publisher(&keys::reference("v")).await.unwrap();
    publisher.put(&path(1)).await.unwrap();
    assert_eq!(soon(reference.recv()).await.unwrap().message, path(1));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn only_the_newest_reference_waits() {
    let (a, b) = pair().await;
    let mut reference = b.subscriber(&keys::reference("v"), 1).await.unwrap();
    let publisher = a.publisher(&keys::reference("v")).await.unwrap();
    soon(publisher.wait_for_subscribers()).await.unwrap();
    for number in 1..=50 {
        publisher.put(&path(number)).await.unwrap();
    }
    // Nothing is taken until all have arrived; then one is left.
    soon(async {
        while reference.counts().received < 50 {
            tokio::task::yield_now().await;
        }
    })
    .await;
    assert_eq!(soon(reference.recv()).await.unwrap().message, path(50));
    assert!(reference.try_recv().is_none());
    assert_eq!(reference.counts().dropped, 49);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_does_not_decode_is_counted_and_left_out() {
    let (a, b) = pair().await;
    let topic = keys::train_status("r");
    let mut subscriber = b.subscriber(&topic, 16).await.unwrap();
    let publisher = a.raw_publisher(topic.key(), Qos::Block).await.unwrap();
    soon(publisher.wait_for_subscribers()).await.unwrap();
    // Nothing, a sequence that claims 2^32 - 1 elements, and something of another type.
    publisher.put(Vec::new()).await.unwrap();
    publisher
        .put([[0, 1, 0, 0], [255; 4]].concat())
        .await
        .unwrap();
    publisher.put(vec![0, 1, 0, 0, 1, 2, 3]).await.unwrap();
    let good = swath_bridge::cdr::to_vec(&status(9)).unwrap();
    publisher.put(good).await.unwrap();
    assert_eq!(soon(subscriber.recv()).await.unwrap().message, status(9));
    assert_eq!(subscriber.counts().undecodable, 3);
    assert_eq!(subscriber.counts().received, 4);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn nodes_are_seen_to_come_and_go() {
    let (a, b) = pair().await;
    let before = a.declare_node("trainer", "r").await.unwrap();
    let mut nodes = b.watch_nodes().await.unwrap();
    let change = soon(nodes.recv()).await.unwrap();
    assert_eq!((&*change.kind, &*change.id), ("trainer", "r"));
    assert!(change.is_alive);
    let after = a.declare_node("planner", "v").await.unwrap();
    let change = soon(nodes.recv()).await.unwrap();
    assert_eq!((&*change.kind, change.is_alive), ("planner", true));
    drop(after);
    let change = soon(nodes.recv()).await.unwrap();
    assert_eq!((&*change.kind, change.is_alive), ("planner", false));
    drop(before);
    let change = soon(nodes.recv()).await.unwrap();
    assert_eq!((&*change.kind, change.is_alive), ("trainer", false));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn sessions_of_different_namespaces_do_not_hear_each_other() {
    let listening = SessionConfig {
        listen: vec!["tcp/127.0.0.1:0".to_owned()],
        namespace: Some("one".to_owned()),
        ..SessionConfig::default()
    };
    let a = Session::open(&listening).await.unwrap();
    let named = |namespace: &str| SessionConfig {
        namespace: Some(namespace.to_owned()),
        ..SessionConfig::default()
    };
    let mut same = named("one");
    let mut other = named("two");
    same.connect = a.endpoints().await;
    other.connect = a.endpoints().await;
    let [b, c] = [
        Session::open(&same).await.unwrap(),
        Session::open(&other).await.unwrap(),
    ];
    let mut heard = b.subscriber(&keys::reference("v"), 4).await.unwrap();
    let mut unheard = c.subscriber(&keys::reference("v"), 4).await.unwrap();
    let publisher = a.publisher(&keys::reference("v")).await.unwrap();
    soon(publisher.wait_for_subscribers()).await.unwrap();
    publisher.put(&path(1)).await.unwrap();
    assert_eq!(
        soon(heard.recv()).await.unwrap().key,
        "swath/vehicle/v/reference"
    );
    assert!(unheard.try_recv().is_none());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_publisher_needs_a_key_without_wildcards() {
    let (a, _b) = pair().await;
    let topic: Topic<Path> = keys::reference("*");
    let error = a.publisher(&topic).await.unwrap_err().to_string();
    assert!(error.contains("swath/vehicle/*/reference"), "{error}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_configuration_file_opens_what_it_says_and_endpoints_override_it() {
    let dir = tempfile::TempDir::new().unwrap();
    let file = dir.path().join("zenoh.json5");
    let text = r#"{
        // A comment, as JSON5 has them.
        mode: "peer",
        listen: { endpoints: ["tcp/127.0.0.1:0", "tcp/127.0.0.1:0"] },
        scouting: { multicast: { enabled: false } },
    }"#;
    std::fs::write(&file, text).unwrap();
    let mut config = SessionConfig {
        file: Some(file.clone()),
        ..SessionConfig::default()
    };
    let session = Session::open(&config).await.unwrap();
    assert_eq!(session.endpoints().await.len(), 2);
    config.listen = vec!["tcp/127.0.0.1:0".to_owned()];
    let session = Session::open(&config).await.unwrap();
    assert_eq!(session.endpoints().await.len(), 1);

    std::fs::write(&file, "{ listen: 7 }").unwrap();
    let error = Session::open(&config).await.unwrap_err().to_string();
    assert!(error.contains("zenoh.json5"), "{error}");
    is_plain(&error);
    config.file = Some(dir.path().join("none.json5"));
    let error = Session::open(&config).await.unwrap_err().to_string();
    assert!(error.contains("none.json5"), "{error}");
    is_plain(&error);
}

/// Checks that an error has no place in a source file, and says nothing twice.
fn is_plain(error: &str) {
    assert!(!error.contains(".rs:"), "{error}");
    for cause in ["No such file", "Address already in use", "os error"] {
        assert!(error.matches(cause).count() <= 1, "{error}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_endpoint_that_cannot_be_opened_is_named_once_with_its_cause() {
    let holder = SessionConfig {
        listen: vec!["tcp/127.0.0.1:0".to_owned()],
        ..SessionConfig::default()
    };
    let holder = Session::open(&holder).await.unwrap();
    let taken = holder.endpoints().await.remove(0);
    for (listen, cause) in [
        (taken.as_str(), "in use"),
        ("tcp/192.0.2.1:7447", "assign"),
        ("tcp/127.0.0.1", "127.0.0.1"),
        ("nonsense", "nonsense"),
        ("carrier-pigeon/127.0.0.1:1", "carrier-pigeon"),
    ] {
        let config = SessionConfig {
            listen: vec![listen.to_owned()],
            ..SessionConfig::default()
        };
        let error = Session::open(&config).await.unwrap_err().to_string();
        assert!(error.contains(listen) && error.contains(cause), "{error}");
        is_plain(&error);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn without_configuration_nothing_but_loopback_is_opened() {
    // Other runs of this test take other ports.
    let of_this_process = u16::try_from(std::process::id() % 4000).unwrap();
    let first = 20_000 + 2 * of_this_process;
    let config = SessionConfig {
        ports: Ports { first, count: 2 },
        ..SessionConfig::default()
    };
    let sessions = [
        Session::open(&config).await.unwrap(),
        Session::open(&config).await.unwrap(),
    ];
    for session in &sessions {
        for endpoint in session.endpoints().await {
            assert!(endpoint.starts_with("tcp/127.0.0.1:"), "{endpoint}");
        }
    }
    assert_eq!(sessions[1].peers().await.len(), 1);
    // The range is full; who comes now is told what to do.
    let error = Session::open(&config).await.unwrap_err().to_string();
    let range = format!("{first} to {}", first + 1);
    assert!(error.contains(&range), "{error}");
}
