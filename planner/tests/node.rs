//! The planner node between real sessions: grids in, plans out, weights swapped between two plans.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::time::Duration;

use swath_bridge::geometry::wrap_angle_rad;
use swath_bridge::msg::header::Header;
use swath_bridge::msg::nav::OccupancyGrid;
use swath_bridge::msg::swath::{PlanReport, Weights};
use swath_bridge::poses::{odometry_message, path_message, poses_of_path};
use swath_bridge::signature::{SigningKey, sign};
use swath_bridge::{
    Cell, FREE, GridSpec, OCCUPIED, Occupancy, Outcome, Pose2, Publisher, Session, SessionConfig,
    Subscriber, Vehicle, keys,
};
use swath_planner::check::{CheckLimits, Ends, check_path};
use swath_planner::network::{Network, NetworkInfo, Parameters};
use swath_planner::node::{self, FollowConfig, FramesConfig, NodeConfig, NodeSummary};
use swath_planner::report::{path_points, pose_of_planar};
use swath_planner::{Method, ObstacleConfig, PlanConfig, TargetConfig};
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

/// Longer than anything here takes, so that a test that would hang fails.
const PATIENCE: Duration = Duration::from_mins(10);
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

fn config(plan: PlanConfig) -> NodeConfig {
    NodeConfig {
        vehicle_id: VEHICLE.to_owned(),
        vehicle: Vehicle::default(),
        grid: GridSpec::default(),
        obstacles: ObstacleConfig::default(),
        targets: TargetConfig {
            count: 3,
            ..TargetConfig::default()
        },
        plan,
        follow: FollowConfig::default(),
        frames: FramesConfig::default(),
        run: "*".to_owned(),
        trusted: Vec::new(),
        shares_vehicle: false,
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
        Self::start_with(PlanConfig::default()).await
    }

    async fn start_with(plan: PlanConfig) -> Self {
        let (session, node_session) = pair().await;
        let plans = session.subscriber(&keys::plan(VEHICLE), 16).await.unwrap();
        let paths = session.subscriber(&keys::path(VEHICLE), 16).await.unwrap();
        let grids = session.publisher(&keys::grid(VEHICLE)).await.unwrap();
        let (stop, stopped) = oneshot::channel();
        let node = tokio::spawn(async move {
            let stopped = async { drop(stopped.await) };
            node::run(&node_session, config(plan), None, stopped, |_| ())
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
    assert_eq!(plan.method, "swath");
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
    let in_regions = PlanConfig {
        method: Method::TievFcn,
        ..PlanConfig::default()
    };
    let mut world = World::start_with(in_regions).await;
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

/// A straight road with boxes beside and on it, in the odometry's frame: x and y ranges, metres.
const BOXES: [[f64; 4]; 5] = [
    [-50.0, 200.0, 7.0, 7.4],
    [-50.0, 200.0, -7.4, -7.0],
    [25.0, 30.0, -1.5, 2.0],
    [48.0, 52.0, 0.0, 6.0],
    [70.0, 75.0, -6.0, 0.5],
];
const SPEED_M_PER_S: f64 = 5.0;

/// What a vehicle sees of the road.
fn seen_from(odom_from_vehicle: &Pose2) -> Occupancy {
    let mut seen = Occupancy::filled(GridSpec::default(), FREE);
    for index in 0..seen.spec.len() {
        let cell = seen.spec.cell_of_index(index);
        let (x_m, y_m) = seen.spec.centre_of(cell);
        let at = odom_from_vehicle.then(&Pose2::new(x_m, y_m, 0.0));
        let is_in = |&[x0, x1, y0, y1]: &[f64; 4]| {
            (x0..=x1).contains(&at.x_m) && (y0..=y1).contains(&at.y_m)
        };
        if BOXES.iter().any(is_in) {
            seen.set(cell, OCCUPIED);
        }
    }
    seen
}

/// What is published on a vehicle's way, with the message that says it.
struct Drive {
    world: World,
    odometry: Publisher<swath_bridge::msg::nav::Odometry>,
    reference: Publisher<swath_bridge::msg::nav::Path>,
}

impl Drive {
    async fn start() -> Self {
        let world = World::start().await;
        let odometry = world.session.publisher(&keys::odom(VEHICLE)).await.unwrap();
        let reference = world
            .session
            .publisher(&keys::reference(VEHICLE))
            .await
            .unwrap();
        soon(odometry.wait_for_subscribers()).await.unwrap();
        soon(reference.wait_for_subscribers()).await.unwrap();
        Self {
            world,
            odometry,
            reference,
        }
    }

    /// Plans where a vehicle is that drives so fast along a curve; the report and the path, in the
    /// vehicle's frame.
    async fn plan_at(
        &mut self,
        pose: &Pose2,
        speed_m_per_s: f64,
        curvature_per_m: f64,
    ) -> (PlanReport, Vec<Pose2>) {
        self.world.stamp += 100_000_000;
        let header = Header::at(self.world.stamp + 1, "base_link");
        let frame = swath_bridge::Frame {
            stamp_nanos: self.world.stamp + 1,
            occupancy: Occupancy::filled(GridSpec::default(), FREE),
            odom_from_vehicle: *pose,
            speed_m_per_s,
            turn_rad_per_s: speed_m_per_s * curvature_per_m,
            reference: Vec::new(),
        };
        let odometry = odometry_message(&header, &frame);
        self.odometry.put(&odometry).await.unwrap();
        let road: Vec<Pose2> = (0..140)
            .map(|k| pose.inverse().then(&Pose2::new(f64::from(k), 0.0, 0.0)))
            .collect();
        self.reference
            .put(&path_message(&header, &road))
            .await
            .unwrap();
        // A grid that overtakes them is planned with those of before; without any there are no targets.
        let mut report = self.world.plan_on(&seen_from(pose)).await;
        while report.targets.is_empty() {
            report = self.world.plan_on(&seen_from(pose)).await;
        }
        (report, self.world.newest_path().await)
    }
}

/// Checks the chosen path as it is in a report; it begins at the report's start.
fn check_report(report: &PlanReport, pose: &Pose2, speed_m_per_s: f64) {
    let chosen = &report.targets[usize::try_from(report.chosen).unwrap()];
    let points = path_points(chosen);
    let start = points[0].pose;
    assert!(start.distance_m(&pose_of_planar(&report.start)) < 1e-4);
    let ends = Ends {
        start,
        start_curvature_per_m: None,
        goal: pose_of_planar(&chosen.goal),
    };
    let vehicle = Vehicle::default();
    let limit_per_m = vehicle.curvature_limit_per_m(speed_m_per_s);
    let obstacles = ObstacleConfig::default().obstacles(&seen_from(pose));
    let limits = CheckLimits::new(&vehicle, limit_per_m);
    let found = check_path((&GridSpec::default(), &obstacles), &limits, &ends, &points);
    assert!(found.is_empty(), "{found:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_vehicle_that_follows_its_paths_gets_past_everything_without_a_jerk() {
    let mut drive = Drive::start().await;
    let mut pose = Pose2::default();
    let mut before: Option<Vec<Pose2>> = None;
    let mut curvature_per_m = 0.0;
    let mut kept = 0;
    for _ in 0..160 {
        let (report, path) = drive.plan_at(&pose, SPEED_M_PER_S, curvature_per_m).await;
        assert!(report.chosen >= 0, "stopped at {pose:?}");
        check_report(&report, &pose, SPEED_M_PER_S);
        let in_odom: Vec<Pose2> = path.iter().map(|point| pose.then(point)).collect();
        // It is on the path at once, or will be by the time that it has it.
        assert!(
            in_odom[0].distance_m(&pose) < 1.0,
            "{:?} from {pose:?}",
            in_odom[0]
        );
        if let Some(before) = &before {
            // What is driven in the next 0.3 s is on the path of before.
            let stays = in_odom
                .iter()
                .take_while(|point| point.distance_m(&pose) < 0.3 * SPEED_M_PER_S);
            let strays = |point: &Pose2| {
                let distance_m = |other: &Pose2| other.distance_m(point);
                before.iter().map(distance_m).fold(f64::INFINITY, f64::min)
            };
            let most = stays.map(strays).fold(0.0, f64::max);
            assert!(most < 0.11, "the path moved by {most} m at {pose:?}");
            kept += usize::from(most < 1e-6);
        }
        let next = in_odom
            .iter()
            .find(|point| point.distance_m(&pose) >= 0.1 * SPEED_M_PER_S);
        let next = *next.unwrap_or(&pose);
        let turn_rad = wrap_angle_rad(next.yaw_rad - pose.yaw_rad);
        curvature_per_m = turn_rad / next.distance_m(&pose).max(0.01);
        pose = next;
        before = Some(in_odom);
        if pose.x_m > 85.0 {
            break;
        }
    }
    assert!(pose.x_m > 78.0, "it came to {pose:?}");
    assert!(kept > 100, "the way ahead was kept {kept} times");
    drive.world.end().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn when_grids_stop_coming_the_path_is_withdrawn() {
    let mut world = World::start().await;
    world.give_reference().await;
    let open = Occupancy::filled(GridSpec::default(), FREE);
    let mut plan = world.plan_on(&open).await;
    while plan.chosen < 0 {
        plan = world.plan_on(&open).await;
    }
    assert!(!world.newest_path().await.is_empty());
    let withdrawn = soon(async {
        loop {
            let path = world.paths.recv().await.unwrap().message;
            if path.poses.is_empty() {
                return path;
            }
        }
    });
    let withdrawn = withdrawn.await;
    assert_eq!(withdrawn.header.frame_id, "base_link");
    world.end().await;
}
