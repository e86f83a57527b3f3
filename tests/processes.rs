//! Every node as a process of its own: samples reach the trainer, weights reach running and late
//! planners, no plan mixes two versions, and a recorder has it all.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use nodes::System;
use swath_bridge::msg::header::Header;
use swath_bridge::msg::nav::{OccupancyGrid, Path as PathMessage};
use swath_bridge::msg::swath::{PlanReport, Sample, Weights};
use swath_bridge::poses::path_message;
use swath_bridge::recording::Reader;
use swath_bridge::{
    Cell, FREE, GridSpec, OCCUPIED, Occupancy, Pose2, Publisher, Session, Subscriber, Vehicle, keys,
};
use swath_planner::network::Network;
use swath_planner::{
    FrameInput, FramePlanner, Method, MotionModel, ObstacleConfig, PlanConfig, Start, TargetConfig,
    sample_targets,
};

mod nodes;

/// Longer than anything here takes, so that a test that would hang fails.
const PATIENCE: Duration = Duration::from_mins(20);
/// Time between two grids; a plan takes less.
const GRID_PERIOD: Duration = Duration::from_millis(100);
/// Speed of planners without odometry, m/s.
const SPEED_M_PER_S: f64 = 1.4;
/// Small steps and frequent weights.
const TRAINING: [&str; 6] = ["--size", "half", "--batch", "4", "--publish-every", "3"];
/// A vehicle that sends the same surroundings again and again.
struct Surroundings {
    occupancy: Occupancy,
    reference: Vec<Pose2>,
    stamp: u64,
    grids: Publisher<OccupancyGrid>,
    references: Publisher<PathMessage>,
    plans: Subscriber<PlanReport>,
}

impl Surroundings {
    async fn of(session: &Session, vehicle: &str) -> Self {
        let mut occupancy = Occupancy::filled(GridSpec::default(), FREE);
        for col in 60..80 {
            occupancy.set(Cell::new(220, col), OCCUPIED);
        }
        Self {
            occupancy,
            reference: (0..50)
                .map(|k| Pose2::new(f64::from(k), 0.0, 0.0))
                .collect(),
            stamp: 0,
            grids: session.publisher(&keys::grid(vehicle)).await.unwrap(),
            references: session.publisher(&keys::reference(vehicle)).await.unwrap(),
            plans: session.subscriber(&keys::plan(vehicle), 64).await.unwrap(),
        }
    }

    /// Sends grids until a plan comes that was made for a reference.
    async fn next_plan(&mut self) -> PlanReport {
        loop {
            self.stamp += 1;
            let header = Header::at(self.stamp, "base_link");
            let reference = path_message(&header, &self.reference);
            self.references.put(&reference).await.unwrap();
            self.grids
                .put(&self.occupancy.to_message(header))
                .await
                .unwrap();
            if let Ok(plan) = tokio::time::timeout(GRID_PERIOD, self.plans.recv()).await {
                let plan = plan.unwrap().message;
                if !plan.targets.is_empty() {
                    return plan;
                }
            }
        }
    }

    /// Plans as a planner with this network should have.
    fn steps_with(&self, network: &Network) -> Vec<u64> {
        let spec = self.occupancy.spec;
        let model = MotionModel::new(&Vehicle::default(), spec.resolution_m).unwrap();
        let targets = TargetConfig {
            count: 3,
            ..TargetConfig::default()
        };
        let goals = sample_targets(&self.reference, &spec, &targets);
        let obstacles = ObstacleConfig::default().obstacles(&self.occupancy);
        let input = FrameInput {
            spec,
            obstacles: &obstacles,
            reference: &self.reference,
            goals: &goals,
            start: Start::default(),
        };
        let config = PlanConfig {
            method: Method::TievFcn,
            speed_m_per_s: SPEED_M_PER_S,
            ..PlanConfig::default()
        };
        let plan = FramePlanner::new(Arc::new(model))
            .plan(&input, Some(network), &config)
            .unwrap();
        plan.targets
            .iter()
            .map(|target| target.result.steps)
            .collect()
    }
}

fn steps_of(plan: &PlanReport) -> Vec<u64> {
    plan.targets.iter().map(|target| target.steps).collect()
}

/// Waits until two generators were heard.
async fn hear_two_generators(session: &Session) {
    let mut samples: Subscriber<Sample> =
        session.subscriber(&keys::sample("*"), 512).await.unwrap();
    let mut heard = BTreeSet::new();
    while heard.len() < 2 {
        heard.insert(samples.recv().await.unwrap().message.generator);
    }
}

/// Checks that a running planner takes up three versions, never an older one again, and that what it
/// plans with each is what that version alone gives. Returns the newest.
async fn follow_three_versions(
    vehicle: &mut Surroundings,
    published: &mut Subscriber<Weights>,
) -> u64 {
    let mut networks = BTreeMap::new();
    let mut checked = BTreeSet::new();
    while checked.len() < 3 {
        let plan = vehicle.next_plan().await;
        while let Some(weights) = published.try_recv() {
            let weights = weights.message;
            networks.insert(
                weights.version,
                Network::load(&weights.safetensors).unwrap(),
            );
        }
        let version = plan.weights_version;
        if let Some(network) = networks.get(&version) {
            assert_eq!(plan.method, "tiev-fcn");
            assert_eq!(
                steps_of(&plan),
                vehicle.steps_with(network),
                "version {version}"
            );
            checked.insert(version);
        }
        let newest = checked.last().copied().unwrap_or(0);
        assert!(
            version == 0 || version >= newest,
            "an older version came back"
        );
    }
    checked.last().copied().unwrap()
}

/// Checks that a planner plans with given weights at once, without any publisher of them.
async fn plan_late(session: &Session, weights: &Path, at_least: u64) {
    let network = Network::load(&std::fs::read(weights).unwrap()).unwrap();
    let mut vehicle = Surroundings::of(session, "late").await;
    let mut plan = vehicle.next_plan().await;
    while plan.weights_version == 0 {
        plan = vehicle.next_plan().await;
    }
    assert!(plan.weights_version >= at_least);
    assert_eq!(steps_of(&plan), vehicle.steps_with(&network));
}

fn holds_everything(recording: &Path) {
    let messages = Reader::open(recording).unwrap();
    let topics: BTreeSet<String> = messages
        .map(|message| message.unwrap().topic.to_string())
        .collect();
    for topic in [
        "/swath/sample/a",
        "/swath/sample/b",
        "/swath/weights/main",
        "/swath/train/main",
        "/swath/vehicle/v0/plan",
        "/swath/vehicle/late/plan",
        "/swath/vehicle/v0/path",
    ] {
        assert!(topics.contains(topic), "{topic} is not in {topics:?}");
    }
}

async fn all_together(folder: &Path) {
    let (recording, train) = (folder.join("run.mcap"), folder.join("train"));
    let system = System::new(folder, "[targets]\ncount = 3\n");
    let start = |arguments: &[&str]| system.start(arguments);
    let session = system.session().await;
    let mut published = session.subscriber(&keys::weights("*"), 64).await.unwrap();
    let mut vehicle = Surroundings::of(&session, "v0").await;

    let recorder = start(&["bridge", "record", "--out", recording.to_str().unwrap()]);
    let trainer = start(
        &[
            &["train", "--out", train.to_str().unwrap()][..],
            &TRAINING[..],
        ]
        .concat(),
    );
    let in_regions = ["--method", "tiev-fcn", "--deadline-ms", "0"];
    let planner = start(&[&["plan"][..], &in_regions].concat());
    let generators = ["a", "b"].map(|id| start(&["generate", "--id", id, "--workers", "1"]));

    hear_two_generators(&session).await;
    let newest = follow_three_versions(&mut vehicle, &mut published).await;
    for node in generators.into_iter().chain([trainer]) {
        assert!(node.stop().success());
    }
    let late = start(&[&["plan", "--vehicle", "late"][..], &in_regions].concat());
    plan_late(&session, &train.join("weights.safetensors"), newest).await;
    for node in [late, planner, recorder] {
        assert!(node.stop().success());
    }
    holds_everything(&recording);
}

#[test]
fn two_generators_a_trainer_two_planners_and_a_recorder_work_as_processes() {
    let folder = tempfile::tempdir().unwrap();
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let ended = runtime
        .block_on(async { tokio::time::timeout(PATIENCE, all_together(folder.path())).await });
    assert!(ended.is_ok(), "not done within {PATIENCE:?}");
}
