//! The planner node: newest grid, reference, odometry and weights in; plans, path and regions out.
//!
//! It is one task that owns everything it knows. A frame is planned on a thread of its own with what
//! was known when its grid was taken, the network included, so weights that arrive meanwhile are used
//! from the next frame on and no plan ever mixes two versions.
//!
//! A grid, the reference and the targets may each be in a frame of their own: `frames.rs` says which, and
//! all are seen from the vehicle as it was when the grid was made. What is published is in the grid's frame.
//!
//! With odometry, paths begin on the one that is followed, a little ahead of the vehicle, so that what
//! is driven next does not change; or else where the vehicle will be when it can follow them. Where
//! nothing can be driven, and when grids stop coming, the path is empty, which says stop, and a report says
//! why.

mod course;
mod follow;
mod frames;
mod inputs;
mod job;
mod outputs;
mod rejects;
mod stops;
mod track;
mod weights;

use std::future::Future;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use swath_bridge::geometry::Pose2;
use swath_bridge::msg::nav::OccupancyGrid;
use swath_bridge::msg::swath::{PlanReport, Rejection};
use swath_bridge::{
    GridSpec, Occupancy, Received, Session, StopReason, Vehicle, caught, signature,
};
use tokio::task::{JoinHandle, spawn_blocking};
use tokio::time::Instant;

use crate::frame::{FramePlan, FramePlanner, ObstacleConfig};
use crate::method::Method;
use crate::network::Network;
use crate::plan::PlanConfig;
use crate::targets::{TargetConfig, sample_targets};
use crate::{Error, MotionModel};

pub use follow::FollowConfig;
pub use frames::FramesConfig;

use follow::{Departure, Follower};
use frames::Frames;
use inputs::{Given, Inputs};
use job::Job;
use outputs::Outputs;
use rejects::{Limiter, Rejects};
use stops::Stop;

/// While no grid comes, it is said again after so long that the vehicle is to stop.
const SAY_PERIOD: Duration = Duration::from_secs(5);

/// What a planner node is told.
#[derive(Debug, Clone)]
pub struct NodeConfig {
    /// Name of the vehicle in the keys.
    pub vehicle_id: String,
    /// Its dimensions.
    pub vehicle: Vehicle,
    /// The grid that is planned on; incoming grids are brought to it.
    pub grid: GridSpec,
    /// Which cells are obstacles.
    pub obstacles: ObstacleConfig,
    /// Where targets are placed when nobody sends any.
    pub targets: TargetConfig,
    /// How frames are planned; the speed follows the odometry once there is one.
    pub plan: PlanConfig,
    /// How the chosen path is kept up.
    pub follow: FollowConfig,
    /// How frames are told apart.
    pub frames: FramesConfig,
    /// Training run to take weights from, or `*` for any.
    pub run: String,
    /// Keys whose weights are trusted; with none, any intact weights are.
    pub trusted: Vec<signature::VerifyingKey>,
    /// Whether it plans although another planner plans for the vehicle; else that is an error.
    pub shares_vehicle: bool,
}

/// A network and where it came from.
#[derive(Debug)]
pub struct ServedNetwork {
    /// The network.
    pub network: Network,
    /// Training run; empty for weights from a file.
    pub run: String,
    /// Version within the run; 0 for weights from a file.
    pub version: u64,
    /// When they were published, nanoseconds since the Unix epoch; 0 for weights from a file.
    pub stamp_nanos: u64,
}

/// What a node did.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct NodeSummary {
    /// Frames planned.
    pub frames: u64,
    /// Weights taken into use.
    pub weights: u64,
    /// Messages that could not be used.
    pub rejected: u64,
    /// The same by topic and cause.
    pub rejections: Vec<Rejection>,
}

/// Runs a planner node until `stop` is done. `observe` sees every report that is published.
///
/// Whatever ends it, a panic included, the last path is withdrawn.
///
/// # Errors
/// [`Error::Bridge`] when the session fails or another planner plans for the vehicle,
/// [`Error::Panicked`], [`Error::FollowConfig`] and [`Error::FramesConfig`] for settings out of range, and
/// errors of [`MotionModel::new`].
pub async fn run(
    session: &Session,
    config: NodeConfig,
    initial: Option<ServedNetwork>,
    stop: impl Future<Output = ()>,
    observe: impl FnMut(&PlanReport),
) -> Result<NodeSummary, Error> {
    let mut stop = pin!(stop);
    // Whoever waits for another planner to end can be stopped meanwhile.
    let mut node = tokio::select! {
        biased;
        () = &mut stop => return Ok(NodeSummary::default()),
        node = Node::new(session, config, initial) => node?,
    };
    let served = caught(serve(&mut node, stop, observe)).await;
    let served = served.unwrap_or_else(|what| Err(Error::Panicked { what }));
    if node.expires.is_some() || served.is_err() {
        let withdrawn = node.withdraw(Stop::new(StopReason::Ended, "")).await;
        served?;
        withdrawn?;
    }
    Ok(node.summary())
}

/// Plans on grids until `stop` is done.
async fn serve(
    node: &mut Node,
    stop: impl Future<Output = ()>,
    mut observe: impl FnMut(&PlanReport),
) -> Result<(), Error> {
    let mut stop = pin!(stop);
    loop {
        let report = tokio::select! {
            biased;
            () = &mut stop => return Ok(()),
            // Before all that is heard, so that no flood of messages keeps a path alive.
            () = passed(node.expires) => Some(node.withdraw(node.silence()).await?),
            Some(weights) = node.inputs.weights.recv() => {
                node.take_weights(weights).await;
                None
            }
            Some(tf) = node.inputs.tf.recv() => {
                node.take_tf(&tf.message, false);
                None
            }
            Some(tf) = node.inputs.tf_static.recv() => {
                node.take_tf(&tf.message, true);
                None
            }
            Some(odom) = node.inputs.odom.recv() => {
                node.take_odom(&odom.message);
                None
            }
            () = passed(Some(node.says)), if node.planning.is_none() => {
                Some(node.withdraw(node.silence()).await?)
            }
            Some(path) = node.inputs.reference.recv() => {
                node.take_reference(&path.message);
                None
            }
            Some(targets) = node.inputs.targets.recv() => {
                node.take_targets(&targets.message);
                None
            }
            Some(planned) = finished(&mut node.planning) => node.publish(planned?).await?,
            Some(grid) = node.inputs.grid.recv(), if node.planning.is_none() => {
                match node.start(grid) {
                    Some(refused) => Some(node.refuse(refused).await?),
                    None => None,
                }
            }
            else => return Ok(()),
        };
        if let Some(report) = report {
            observe(&report);
        }
    }
}

/// The moment when it has come; never without one.
async fn passed(moment: Option<Instant>) {
    match moment {
        Some(moment) => tokio::time::sleep_until(moment).await,
        None => std::future::pending().await,
    }
}

/// The plan that is under way, when it is finished.
async fn finished(planning: &mut Option<JoinHandle<Planned>>) -> Option<Result<Planned, Error>> {
    let Some(handle) = planning else {
        return std::future::pending().await;
    };
    let planned = handle.await;
    *planning = None;
    Some(planned.map_err(|error| Error::Panicked {
        what: error.to_string(),
    }))
}

struct Node {
    config: NodeConfig,
    inputs: Inputs,
    outputs: Outputs,
    planner: Arc<FramePlanner>,
    network: Option<Arc<ServedNetwork>>,
    frames: Frames,
    reference: Given,
    targets: Given,
    speed_m_per_s: f64,
    follower: Follower,
    /// When the path that was published last is withdrawn, and the frame that it was in.
    expires: Option<Instant>,
    frame_id: String,
    /// When the newest grid came, and why it was not used, if it was not.
    newest_grid: Option<Instant>,
    newest_refusal: Option<String>,
    /// When it is said again that there is no grid.
    says: Instant,
    planning: Option<JoinHandle<Planned>>,
    rejects: Rejects,
    /// Why the path was empty last, and when that was logged.
    stopped: Option<(StopReason, Limiter)>,
    planned_frames: u64,
    used_weights: u64,
    _token: swath_bridge::NodeToken,
}

/// A frame that was planned, and what is needed to report it.
struct Planned {
    plan: Result<(FramePlan, Option<usize>), Error>,
    departure: Departure,
    grid: Received<OccupancyGrid>,
    vehicle_from_frame: Pose2,
    has_reference: bool,
    network: Option<Arc<ServedNetwork>>,
    method: Method,
    speed_m_per_s: f64,
}

/// A grid that is not planned on.
struct Refused {
    grid: Received<OccupancyGrid>,
    stop: Stop,
}

impl Node {
    async fn new(
        session: &Session,
        config: NodeConfig,
        initial: Option<ServedNetwork>,
    ) -> Result<Self, Error> {
        let id = config.vehicle_id.as_str();
        config.follow.validate()?;
        // Before it hears or says anything: of two planners, one would undo what the other does.
        let token = if config.shares_vehicle {
            session.declare_node("planner", id).await?
        } else {
            session.claim_node("planner", id).await?
        };
        config.frames.validate()?;
        let model = Arc::new(MotionModel::new(&config.vehicle, config.grid.resolution_m)?);
        let mut rejects = Rejects::default();
        Ok(Self {
            planner: Arc::new(FramePlanner::new(model)),
            network: weights::fitting(initial, &config, &mut rejects).map(Arc::new),
            frames: Frames::new(config.frames.clone()),
            reference: Given::default(),
            targets: Given::default(),
            speed_m_per_s: config.plan.speed_m_per_s,
            follower: Follower::new(config.follow),
            expires: None,
            frame_id: String::new(),
            newest_grid: None,
            newest_refusal: None,
            says: Instant::now() + SAY_PERIOD,
            planning: None,
            rejects,
            stopped: None,
            planned_frames: 0,
            used_weights: 0,
            inputs: Inputs::new(session, id, &config.run).await?,
            outputs: Outputs::new(session, id).await?,
            _token: token,
            config,
        })
    }

    fn summary(&self) -> NodeSummary {
        let rejections = self.rejections();
        NodeSummary {
            frames: self.planned_frames,
            weights: self.used_weights,
            rejected: rejections.iter().map(|one| one.messages).sum(),
            rejections,
        }
    }

    /// Starts to plan on a grid with what is known now. If it cannot be planned on, gives it back with the
    /// reason, unless the path that is followed stays.
    fn start(&mut self, grid: Received<OccupancyGrid>) -> Option<Refused> {
        let now = Instant::now();
        self.newest_grid = Some(now);
        self.says = now + SAY_PERIOD.max(Duration::from_secs_f64(self.config.follow.expires_s));
        let seen = match self.seen_from_vehicle(&grid.message) {
            Ok(seen) => seen,
            Err(stop) => {
                self.newest_refusal = Some(stop.to_string());
                // One that is damaged says nothing of the world; the path lasts until it expires.
                let stays = stop.reason == StopReason::BadInput && self.expires.is_some();
                return (!stays).then_some(Refused { grid, stop });
            }
        };
        self.newest_refusal = None;
        let mut plan = self.config.plan;
        let network = self.network.clone();
        let network = network.filter(|_| plan.uses_network());
        if network.is_none() && plan.method.needs_regions() {
            plan.method = plan.method.without_regions();
        }
        plan.speed_m_per_s = self.speed_m_per_s;
        let obstacles = self.config.obstacles.obstacles(&seen.occupancy);
        let goals = if self.targets.poses.is_empty() {
            sample_targets(&seen.reference, &seen.occupancy.spec, &self.config.targets)
        } else {
            seen.targets
        };
        let vehicle = &self.config.vehicle;
        let limit_per_m = vehicle.curvature_limit_per_m(self.speed_m_per_s);
        let departure = self.follower.depart(
            grid.message.header.stamp.nanos(),
            (&seen.occupancy.spec, &obstacles),
            (vehicle, limit_per_m),
        );
        let job = Job {
            planner: Arc::clone(&self.planner),
            network: network.clone(),
            spec: seen.occupancy.spec,
            obstacles,
            reference: seen.reference,
            goals,
            plan,
            choice: self.config.follow.choice,
        };
        let vehicle_from_frame = seen.vehicle_from_frame;
        self.planning = Some(spawn_blocking(move || {
            let (departure, plan) = job.plan(departure);
            Planned {
                plan,
                departure,
                grid,
                vehicle_from_frame,
                has_reference: !job.reference.is_empty(),
                network,
                method: job.plan.method,
                speed_m_per_s: job.plan.speed_m_per_s,
            }
        }));
        None
    }
}

/// What a frame is planned on, in the vehicle's frame when the grid was made.
struct Seen {
    vehicle_from_frame: Pose2,
    occupancy: Occupancy,
    reference: Vec<Pose2>,
    targets: Vec<Pose2>,
}
