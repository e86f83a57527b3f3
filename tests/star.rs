//! A star of processes: one listens, all others connect to it alone, and each hears all of them.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::collections::BTreeMap;
use std::net::TcpListener;
use std::path::Path;
use std::time::Duration;

use nodes::{Node, System};
use swath_bridge::msg::header::Header;
use swath_bridge::msg::nav::{OccupancyGrid, Path as PathMessage};
use swath_bridge::msg::swath::{PlanReport, Sample, TrainStatus};
use swath_bridge::poses::path_message;
use swath_bridge::recording::Reader;
use swath_bridge::{
    FREE, GridSpec, Occupancy, Pose2, Publisher, Session, SessionConfig, Subscriber, keys,
};

mod nodes;

/// Longer than anything here takes, so that a test that would hang fails.
const PATIENCE: Duration = Duration::from_mins(8);
/// Time between two grids.
const PERIOD: Duration = Duration::from_millis(200);

/// Nodes that meet at one endpoint.
struct Star {
    system: System,
    endpoint: String,
}

impl Star {
    fn new(folder: &Path) -> Self {
        let free = TcpListener::bind("127.0.0.1:0").unwrap();
        Self {
            system: System::new(folder, "[targets]\ncount = 3\n"),
            endpoint: format!("tcp/{}", free.local_addr().unwrap()),
        }
    }

    /// Starts the node in the middle.
    fn listen(&self, arguments: &[&str]) -> Node {
        let place = ["--listen", &self.endpoint];
        self.system.start(&[&place[..], arguments].concat())
    }

    /// Starts a node at the end of a ray.
    fn connect(&self, arguments: &[&str]) -> Node {
        let place = ["--connect", &self.endpoint];
        self.system.start(&[&place[..], arguments].concat())
    }

    async fn session(&self) -> Session {
        let config = SessionConfig {
            connect: vec![self.endpoint.clone()],
            namespace: Some(self.system.namespace.clone()),
            ..SessionConfig::default()
        };
        Session::open(&config).await.unwrap()
    }
}

/// A vehicle on an open field.
struct Field {
    grids: Publisher<OccupancyGrid>,
    references: Publisher<PathMessage>,
    plans: Subscriber<PlanReport>,
    stamp: u64,
}

impl Field {
    async fn new(session: &Session, vehicle: &str) -> Self {
        Self {
            grids: session.publisher(&keys::grid(vehicle)).await.unwrap(),
            references: session.publisher(&keys::reference(vehicle)).await.unwrap(),
            plans: session.subscriber(&keys::plan(vehicle), 64).await.unwrap(),
            stamp: 0,
        }
    }

    /// Sends grids until a plan comes that is as it should be.
    async fn plan(&mut self, is_wanted: impl Fn(&PlanReport) -> bool) -> PlanReport {
        let open = Occupancy::filled(GridSpec::default(), FREE);
        let road: Vec<Pose2> = (0..60)
            .map(|k| Pose2::new(f64::from(k), 0.0, 0.0))
            .collect();
        loop {
            self.stamp += 1;
            let header = Header::at(self.stamp, "base_link");
            let reference = path_message(&header, &road);
            self.references.put(&reference).await.unwrap();
            self.grids.put(&open.to_message(header)).await.unwrap();
            let came = tokio::time::timeout(PERIOD, self.plans.recv()).await;
            if let Ok(Some(came)) = came
                && is_wanted(&came.message)
            {
                return came.message;
            }
        }
    }
}

async fn next<M: swath_bridge::msg::Message>(subscriber: &mut Subscriber<M>) -> M {
    subscriber.recv().await.unwrap().message
}

/// How many messages a recording has on each topic.
fn topics(recording: &Path) -> BTreeMap<String, u64> {
    let mut topics = BTreeMap::new();
    for message in Reader::open(recording).unwrap() {
        *topics
            .entry(message.unwrap().topic.to_string())
            .or_default() += 1;
    }
    topics
}

/// A trainer of small steps and frequent weights; the folder comes behind it.
const TRAIN: [&str; 9] = [
    "train",
    "--scratch",
    "--size",
    "half",
    "--batch",
    "4",
    "--publish-every",
    "3",
    "--out",
];
/// A planner in the regions of the network; the vehicle comes behind it.
const IN_REGIONS: [&str; 6] = [
    "plan",
    "--method",
    "tiev-fcn",
    "--deadline-ms",
    "0",
    "--vehicle",
];

async fn all(folder: &Path) {
    let (out, recording) = (folder.join("run"), folder.join("run.mcap"));
    let (out, file) = (out.to_str().unwrap(), recording.to_str().unwrap());
    let star = Star::new(folder);
    let train = [&TRAIN[..], &[out]].concat();
    let plan = |vehicle| star.connect(&[&IN_REGIONS[..], &[vehicle]].concat());

    // Those that connect do not mind being first.
    let recorder = star.connect(&["bridge", "record", "--out", file]);
    let generator = star.connect(&["generate", "--id", "g", "--workers", "1"]);
    let planner = plan("v0");
    let trainer = star.listen(&train);
    let session = star.session().await;
    let mut statuses = session
        .subscriber(&keys::train_status("*"), 64)
        .await
        .unwrap();
    let mut samples: Subscriber<Sample> =
        session.subscriber(&keys::sample("*"), 512).await.unwrap();
    let mut field = Field::new(&session, "v0").await;

    // Samples of one that connects reach others that do; so do weights and plans.
    assert_eq!(next(&mut samples).await.generator, "g");
    let planned = field.plan(|plan| plan.weights_version > 0).await;
    let status: TrainStatus = next(&mut statuses).await;
    assert!(status.received > 0);

    // The one that listens is killed, and comes back; nobody else is started again.
    drop(trainer);
    let trainer = star.listen(&train);
    while statuses.try_recv().is_some() {}
    let mut status: TrainStatus = next(&mut statuses).await;
    while status.received == 0 {
        status = next(&mut statuses).await;
    }
    let version = planned.weights_version;
    field.plan(|plan| plan.weights_version > version).await;

    // A planner that joins late has weights without waiting for the next ones.
    assert!(generator.stop().success());
    let late = plan("late");
    let mut late_field = Field::new(&session, "late").await;
    late_field.plan(|plan| plan.weights_version > version).await;

    // Who stays on loopback is not part of the star.
    let apart = star.system.session().await;
    assert!(apart.stored_weights("*", &[]).await.unwrap().is_empty());
    assert!(!session.stored_weights("*", &[]).await.unwrap().is_empty());

    for node in [late, planner, trainer] {
        assert!(node.stop().success());
    }
    // It may have missed messages while the middle was gone, and says so; but it ends in order.
    assert!(matches!(recorder.stop().code(), Some(0 | 3)));
    let topics = topics(&recording);
    for topic in [
        "/swath/sample/g",
        "/swath/weights/main",
        "/swath/train/main",
        "/swath/vehicle/v0/plan",
        "/swath/vehicle/v0/path",
        "/swath/vehicle/late/plan",
    ] {
        assert!(topics.contains_key(topic), "{topic} is not in {topics:?}");
    }
}

#[test]
fn a_star_of_processes_works_and_comes_back_when_its_middle_does() {
    let folder = tempfile::tempdir().unwrap();
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let ended =
        runtime.block_on(async { tokio::time::timeout(PATIENCE, all(folder.path())).await });
    assert!(ended.is_ok(), "not done within {PATIENCE:?}");
}
