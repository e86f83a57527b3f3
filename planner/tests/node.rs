//! The planner node between real sessions: grids in, plans out, weights swapped between two plans.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::time::Duration;

use swath_bridge::msg::header::Header;
use swath_bridge::msg::nav::OccupancyGrid;
use swath_bridge::msg::swath::{PlanReport, Weights};
use swath_bridge::signature::{SigningKey, sign};
use swath_bridge::{
    Cell, FREE, GridSpec, OCCUPIED, Occupancy, Outcome, Pose2, Publisher, Session, SessionConfig,
    Subscriber, Vehicle, keys,
};
use swath_planner::network::{Network, NetworkInfo, Parameters};
use swath_planner::node::{self, NodeConfig, NodeSummary};
use swath_planner::report::{path_message, poses_of_path};
use swath_planner::{ObstacleConfig, PlanConfig, TargetConfig};
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

/// Longer than anything here takes, so that a test that would hang fails.
const PATIENCE: Duration = Duration::from_secs(30);
const VEHICLE: &str = "v0";

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

fn config() -> NodeConfig {
    NodeConfig {
        vehicle_id: VEHICLE.to_owned(),
        vehicle: Vehicle::default(),
        grid: GridSpec::default(),
        obstacles: ObstacleConfig::default(),
        targets: TargetConfig {
            count: 3,
            ..TargetConfig::default()
        },
        plan: PlanConfig::default(),
        method: None,
        run: "*".to_owned(),
        trusted: Vec::new(),
    }
}

/// A node on one session, and the world around it on another.
struct World {
    session: Session,
    grids: Publisher<OccupancyGrid>,
    plans: Subscriber<PlanReport>,
    paths: Subscriber<swath_bridge::msg::nav::Path>,
    stamp: u64,
    stop: oneshot::Sender<()>,
    node: JoinHandle<NodeSummary>,
}

impl World {
    async fn start() -> Self {
        let (session, node_session) = pair().await;
        let plans = session.subscriber(&keys::plan(VEHICLE), 16).await.unwrap();
        let paths = session.subscriber(&keys::path(VEHICLE), 16).await.unwrap();
        let grids = session.publisher(&keys::grid(VEHICLE)).await.unwrap();
        let (stop, stopped) = oneshot::channel();
        let node = tokio::spawn(async move {
            let stopped = async { drop(stopped.await) };
            node::run(&node_session, config(), None, stopped, |_| ())
                .await
                .unwrap()
        });
        soon(grids.wait_for_subscribers()).await.unwrap();
        Self {
            session,
            grids,
            plans,
            paths,
            stamp: 0,
            stop,
            node,
        }
    }

    /// Sends a grid until its plan comes, since a grid may be dropped.
    async fn plan_on(&mut self, occupancy: &Occupancy) -> PlanReport {
        self.stamp += 1;
        let grid = occupancy.to_message(Header::at(self.stamp, "base_link"));
        soon(async {
            loop {
                self.grids.put(&grid).await.unwrap();
                let waited = tokio::time::timeout(Duration::from_secs(5), self.plans.recv()).await;
                match waited {
                    Ok(Some(plan)) if plan.message.header == grid.header => return plan.message,
                    _ => {}
                }
            }
        })
        .await
    }

    /// The path for the grid that was sent last.
    async fn newest_path(&mut self) -> Vec<Pose2> {
        let wanted = Header::at(self.stamp, "base_link");
        soon(async {
            loop {
                let path = self.paths.recv().await.unwrap().message;
                if path.header == wanted {
                    return poses_of_path(&path);
                }
            }
        })
        .await
    }

    async fn end(self) -> NodeSummary {
        self.stop.send(()).unwrap();
        soon(self.node).await.unwrap()
    }

    async fn give_reference(&self) {
        let reference = self
            .session
            .publisher(&keys::reference(VEHICLE))
            .await
            .unwrap();
        soon(reference.wait_for_subscribers()).await.unwrap();
        let ahead: Vec<Pose2> = (0..40)
            .map(|k| Pose2::new(f64::from(k), 0.0, 0.0))
            .collect();
        reference
            .put(&path_message(&Header::at(1, "base_link"), &ahead))
            .await
            .unwrap();
        // The cache that late joiners ask goes with its publisher; the node has asked by then.
        std::mem::forget(reference);
    }
}

fn weights(version: u64) -> Weights {
    let info = NetworkInfo::default();
    let safetensors = Network::save(&info, &Parameters::initial(info.architecture, version));
    let mut weights = Weights {
        header: Header::at(version * 1000, ""),
        run: "test".to_owned(),
        version,
        step: version,
        epoch: 0,
        architecture: "enet".to_owned(),
        input_rows: 0,
        input_cols: 0,
        vehicle: info.vehicle,
        loss: 0.0,
        miou: f32::NAN,
        iou_path: f32::NAN,
        iou_background: f32::NAN,
        digest: [0; 32],
        public_key: Vec::new(),
        signature: Vec::new(),
        safetensors,
    };
    sign(&mut weights, &SigningKey::from_bytes(&[7; 32])).unwrap();
    weights
}

#[tokio::test(flavor = "multi_thread")]
async fn a_grid_gives_a_plan_and_a_path_and_a_blocked_one_an_empty_path() {
    let mut world = World::start().await;
    world.give_reference().await;
    let open = Occupancy::filled(GridSpec::default(), FREE);
    let mut plan = world.plan_on(&open).await;
    while plan.targets.is_empty() {
        plan = world.plan_on(&open).await;
    }
    assert_eq!(plan.method, "tiev");
    assert_eq!(plan.targets.len(), 3);
    assert!(
        plan.targets
            .iter()
            .all(|target| target.status == Outcome::Solved.code())
    );
    let path = world.newest_path().await;
    assert!(path.len() > 10 && path[0] == Pose2::default());

    let mut blocked = open.clone();
    blocked.set(blocked.spec.ego(), OCCUPIED);
    let plan = world.plan_on(&blocked).await;
    assert!(
        plan.targets
            .iter()
            .all(|target| target.status == Outcome::StartOccupied.code())
    );
    assert!(
        world.newest_path().await.is_empty(),
        "nothing is solved: stop"
    );
    world.end().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn newer_weights_are_used_and_old_damaged_or_forged_ones_are_not() {
    let mut world = World::start().await;
    world.give_reference().await;
    let open = Occupancy::filled(GridSpec::default(), FREE);
    assert_eq!(world.plan_on(&open).await.weights_version, 0);

    let publisher = world
        .session
        .publisher(&keys::weights("test"))
        .await
        .unwrap();
    soon(publisher.wait_for_subscribers()).await.unwrap();
    for version in [1, 3] {
        publisher.put(&weights(version)).await.unwrap();
        let mut plan = world.plan_on(&open).await;
        while plan.weights_version != version {
            plan = world.plan_on(&open).await;
        }
        assert_eq!(plan.method, "tiev-fcn");
        assert!(plan.weights_age_s.is_finite());
    }
    let mut damaged = weights(5);
    damaged.safetensors[100] ^= 1;
    let mut forged = weights(6);
    forged.version = 7;
    for bad in [weights(2), damaged, forged] {
        publisher.put(&bad).await.unwrap();
    }
    // Good ones behind them show that the bad ones were seen.
    publisher.put(&weights(4)).await.unwrap();
    let mut plan = world.plan_on(&open).await;
    while plan.weights_version == 3 {
        plan = world.plan_on(&open).await;
    }
    assert_eq!(plan.weights_version, 4);
    let summary = world.end().await;
    assert_eq!((summary.weights, summary.rejected), (3, 2));
}

#[tokio::test(flavor = "multi_thread")]
async fn grids_that_cannot_be_meant_are_counted_and_the_next_one_is_planned() {
    let mut world = World::start().await;
    let open = Occupancy::filled(GridSpec::default(), FREE);
    let mut bad = open.to_message(Header::at(5, "base_link"));
    bad.data.truncate(17);
    world.grids.put(&bad).await.unwrap();
    let mut wall = open.clone();
    wall.set(Cell::new(100, 75), OCCUPIED);
    world.plan_on(&wall).await;
    let summary = world.end().await;
    assert!(summary.rejected <= 1 && summary.frames >= 1);
}
