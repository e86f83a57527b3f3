//! A planner node on one session, and what a vehicle sends and hears on another.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::time::Duration;

use swath_bridge::msg::geometry::{PoseArray, Transform, TransformStamped, Vector3};
use swath_bridge::msg::header::Header;
use swath_bridge::msg::nav::{OccupancyGrid, Odometry, Path};
use swath_bridge::msg::swath::PlanReport;
use swath_bridge::msg::tf2::TFMessage;
use swath_bridge::poses::{odometry_message, ros_pose};
use swath_bridge::{
    FREE, Frame, GridSpec, Occupancy, Pose2, Publisher, Session, SessionConfig, Subscriber,
    Vehicle, keys,
};
use swath_planner::node::{
    self, FollowConfig, FramesConfig, NodeConfig, NodeSummary, ServedNetwork,
};
use swath_planner::{ObstacleConfig, PlanConfig, TargetConfig};
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

/// Longer than anything here takes, so that a test that would hang fails.
const PATIENCE: Duration = Duration::from_mins(5);
/// After so long a grid is taken for lost, and everything is sent again.
const AGAIN: Duration = Duration::from_secs(5);
pub(crate) const VEHICLE: &str = "v0";
/// Time between two grids, nanoseconds.
const PERIOD_NANOS: u64 = 100_000_000;

pub(crate) async fn soon<T>(what: impl Future<Output = T>) -> T {
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

pub(crate) fn config() -> NodeConfig {
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
        follow: FollowConfig::default(),
        frames: FramesConfig::default(),
        run: "*".to_owned(),
        trusted: Vec::new(),
        shares_vehicle: false,
    }
}

/// What a vehicle sends at one moment; what is not given is not sent.
#[derive(Debug, Clone, Default)]
pub(crate) struct Moment {
    /// The grid, whose stamp is that of the moment.
    pub(crate) grid: Option<OccupancyGrid>,
    /// The vehicle's pose in `odom`.
    pub(crate) odometry: Option<Pose2>,
    /// Parent, child, and the child's pose in the parent, at the moment.
    pub(crate) transforms: Vec<(&'static str, &'static str, Pose2)>,
    /// Frame and poses.
    pub(crate) targets: Option<(&'static str, Vec<Pose2>)>,
    /// Frame and poses.
    pub(crate) reference: Option<(&'static str, Vec<Pose2>)>,
}

/// The node and its surroundings.
pub(crate) struct Surroundings {
    pub(crate) session: Session,
    pub(crate) grids: Publisher<OccupancyGrid>,
    pub(crate) odometry: Publisher<Odometry>,
    pub(crate) tf: Publisher<TFMessage>,
    pub(crate) targets: Publisher<PoseArray>,
    pub(crate) references: Publisher<Path>,
    pub(crate) plans: Subscriber<PlanReport>,
    paths: Subscriber<Path>,
    pub(crate) stamp: u64,
    stop: oneshot::Sender<()>,
    node: JoinHandle<NodeSummary>,
}

impl Surroundings {
    pub(crate) async fn start(config: NodeConfig, initial: Option<ServedNetwork>) -> Self {
        let (session, node_session) = pair().await;
        let plans = session.subscriber(&keys::plan(VEHICLE), 64).await.unwrap();
        let paths = session.subscriber(&keys::path(VEHICLE), 64).await.unwrap();
        let (stop, stopped) = oneshot::channel();
        let node = tokio::spawn(async move {
            let stopped = async { drop(stopped.await) };
            node::run(&node_session, config, initial, stopped, |_| ())
                .await
                .unwrap()
        });
        let all = Self {
            grids: session.publisher(&keys::grid(VEHICLE)).await.unwrap(),
            odometry: session.publisher(&keys::odom(VEHICLE)).await.unwrap(),
            tf: session.publisher(&keys::tf(VEHICLE)).await.unwrap(),
            targets: session.publisher(&keys::targets(VEHICLE)).await.unwrap(),
            references: session.publisher(&keys::reference(VEHICLE)).await.unwrap(),
            session,
            plans,
            paths,
            stamp: 1_000_000_000,
            stop,
            node,
        };
        soon(all.grids.wait_for_subscribers()).await.unwrap();
        soon(all.odometry.wait_for_subscribers()).await.unwrap();
        soon(all.tf.wait_for_subscribers()).await.unwrap();
        soon(all.targets.wait_for_subscribers()).await.unwrap();
        soon(all.references.wait_for_subscribers()).await.unwrap();
        all
    }

    /// Sends a moment, all at a new stamp.
    async fn send(&mut self, moment: &Moment) -> Option<Header> {
        self.stamp += PERIOD_NANOS;
        if let Some(pose) = &moment.odometry {
            let odometry = odometry_of(self.stamp, pose);
            self.odometry.put(&odometry).await.unwrap();
        }
        if !moment.transforms.is_empty() {
            let transforms = moment.transforms.iter();
            let transforms = transforms
                .map(|(parent, child, pose)| transform(self.stamp, parent, child, pose))
                .collect();
            self.tf.put(&TFMessage { transforms }).await.unwrap();
        }
        if let Some((frame, poses)) = &moment.targets {
            let targets = PoseArray {
                header: Header::at(self.stamp, frame),
                poses: poses.iter().map(ros_pose).collect(),
            };
            self.targets.put(&targets).await.unwrap();
        }
        if let Some((frame, poses)) = &moment.reference {
            let header = Header::at(self.stamp, frame);
            let reference = swath_bridge::poses::path_message(&header, poses);
            self.references.put(&reference).await.unwrap();
        }
        let mut grid = moment.grid.clone()?;
        grid.header.stamp = Header::at(self.stamp, "").stamp;
        self.grids.put(&grid).await.unwrap();
        Some(grid.header)
    }

    /// Sends a moment, again and again since a grid may be lost or overtake what belongs to it, until a
    /// report on its grid is as wanted; that, and the path that was published with it.
    pub(crate) async fn plan(
        &mut self,
        moment: &Moment,
        is_wanted: impl Fn(&PlanReport) -> bool,
    ) -> (PlanReport, Path) {
        soon(async {
            loop {
                let header = self.send(moment).await.unwrap();
                let Some(report) = self.report_on(&header).await else {
                    continue;
                };
                if is_wanted(&report) {
                    return (report, self.path_of(&header).await);
                }
            }
        })
        .await
    }

    async fn report_on(&mut self, header: &Header) -> Option<PlanReport> {
        let waited = tokio::time::timeout(AGAIN, async {
            loop {
                let report = self.plans.recv().await.unwrap().message;
                if report.header == *header {
                    return report;
                }
            }
        });
        waited.await.ok()
    }

    /// The path for a grid that was planned on.
    async fn path_of(&mut self, header: &Header) -> Path {
        loop {
            let path = self.paths.recv().await.unwrap().message;
            if path.header == *header {
                return path;
            }
        }
    }

    /// The next report that is as wanted, whatever is sent.
    pub(crate) async fn next_report(
        &mut self,
        is_wanted: impl Fn(&PlanReport) -> bool,
    ) -> PlanReport {
        soon(async {
            loop {
                let report = self.plans.recv().await.unwrap().message;
                if is_wanted(&report) {
                    return report;
                }
            }
        })
        .await
    }

    pub(crate) async fn end(self) -> NodeSummary {
        self.stop.send(()).unwrap();
        soon(self.node).await.unwrap()
    }
}

/// Odometry of a vehicle that stands in `odom`.
pub(crate) fn odometry_of(stamp_nanos: u64, pose: &Pose2) -> Odometry {
    let frame = Frame {
        stamp_nanos,
        occupancy: Occupancy::filled(GridSpec::default(), FREE),
        odom_from_vehicle: *pose,
        speed_m_per_s: 0.0,
        turn_rad_per_s: 0.0,
        reference: Vec::new(),
    };
    odometry_message(&Header::at(stamp_nanos, "base_link"), &frame)
}

pub(crate) fn transform(
    stamp_nanos: u64,
    parent: &str,
    child: &str,
    pose: &Pose2,
) -> TransformStamped {
    let pose = ros_pose(pose);
    TransformStamped {
        header: Header::at(stamp_nanos, parent),
        child_frame_id: child.to_owned(),
        transform: Transform {
            translation: Vector3 {
                x: pose.position.x,
                y: pose.position.y,
                z: 0.0,
            },
            rotation: pose.orientation,
        },
    }
}
