//! The planner node: newest grid, reference, odometry and weights in; plans, path and regions out.
//!
//! It is one task that owns everything it knows. A frame is planned on a thread of its own with what
//! was known when its grid was taken, the network included, so weights that arrive meanwhile are used
//! from the next frame on and no plan ever mixes two versions.
//!
//! With odometry, paths begin on the one that is followed, a little ahead of the vehicle, so that what
//! is driven next does not change; or else where the vehicle will be when it can follow them. Where
//! nothing can be driven, and when grids stop coming, the path is empty, which says stop.

mod course;
mod follow;
mod job;
mod track;

use std::future::Future;
use std::pin::pin;
use std::sync::Arc;
use std::time::Duration;

use swath_bridge::geometry::Pose2;
use swath_bridge::msg::geometry::PoseArray;
use swath_bridge::msg::header::Header;
use swath_bridge::msg::nav::{OccupancyGrid, Odometry, Path};
use swath_bridge::msg::swath::{PlanReport, Weights};
use swath_bridge::poses::{path_message, pose_of_ros, poses_of_path, ros_pose};
use swath_bridge::{
    FREE, GridSpec, OCCUPIED, Occupancy, Publisher, Received, Session, Subscriber, Vehicle, caught,
    clock, keys, signature,
};
use tokio::task::{JoinHandle, spawn_blocking};
use tokio::time::Instant;

use crate::frame::{FramePlan, FramePlanner, ObstacleConfig, Start};
use crate::method::Method;
use crate::network::Network;
use crate::plan::PlanConfig;
use crate::report::plan_report;
use crate::targets::{MAX_TARGETS, TargetConfig, sample_targets};
use crate::{Error, MotionModel, Plane};

pub use follow::FollowConfig;

use follow::{Departure, Follower};
use job::Job;

/// Messages of a kind that may wait while a frame is planned.
const QUEUE: usize = 16;
/// Messages that could not be used are logged one in so many.
const LOGGED_EVERY: u64 = 100;

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
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct NodeSummary {
    /// Frames planned.
    pub frames: u64,
    /// Weights taken into use.
    pub weights: u64,
    /// Messages that could not be used.
    pub rejected: u64,
}

/// Runs a planner node until `stop` is done. `observe` sees every report that is published.
///
/// Whatever ends it, a panic included, the last path is withdrawn.
///
/// # Errors
/// [`Error::Bridge`] when the session fails or another planner plans for the vehicle,
/// [`Error::Panicked`], and errors of [`MotionModel::new`].
pub async fn run(
    session: &Session,
    config: NodeConfig,
    initial: Option<ServedNetwork>,
    stop: impl Future<Output = ()>,
    observe: impl FnMut(&PlanReport),
) -> Result<NodeSummary, Error> {
    let mut node = Node::new(session, config, initial).await?;
    let served = caught(serve(&mut node, stop, observe)).await;
    let served = served.unwrap_or_else(|what| Err(Error::Panicked { what }));
    let withdrawn = if node.expires.is_some() || served.is_err() {
        node.withdraw("the node ends").await
    } else {
        Ok(())
    };
    served.and(withdrawn).map(|()| node.summary)
}

/// Plans on grids until `stop` is done.
async fn serve(
    node: &mut Node,
    stop: impl Future<Output = ()>,
    mut observe: impl FnMut(&PlanReport),
) -> Result<(), Error> {
    let mut stop = pin!(stop);
    loop {
        tokio::select! {
            biased;
            () = &mut stop => return Ok(()),
            Some(weights) = node.inputs.weights.recv() => node.take_weights(weights).await,
            Some(odom) = node.inputs.odom.recv() => node.take_odom(&odom.message),
            () = passed(node.expires) => {
                node.withdraw("grids have stopped coming").await?;
            }
            Some(path) = node.inputs.reference.recv() => {
                node.reference = poses_of_path(&path.message);
            }
            Some(targets) = node.inputs.targets.recv() => node.take_targets(&targets.message),
            Some(planned) = finished(&mut node.planning) => {
                if let Some(report) = node.publish(planned?).await? {
                    observe(&report);
                }
            }
            Some(grid) = node.inputs.grid.recv(), if node.planning.is_none() => node.start(grid),
            else => return Ok(()),
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

struct Inputs {
    grid: Subscriber<OccupancyGrid>,
    odom: Subscriber<Odometry>,
    reference: Subscriber<Path>,
    targets: Subscriber<PoseArray>,
    weights: Subscriber<Weights>,
}

struct Outputs {
    plan: Publisher<PlanReport>,
    path: Publisher<Path>,
    region: Publisher<OccupancyGrid>,
}

struct Node {
    config: NodeConfig,
    inputs: Inputs,
    outputs: Outputs,
    planner: Arc<FramePlanner>,
    network: Option<Arc<ServedNetwork>>,
    reference: Vec<Pose2>,
    targets: Vec<Pose2>,
    speed_m_per_s: f64,
    follower: Follower,
    /// When the path that was published last is withdrawn, and the frame that it was in.
    expires: Option<Instant>,
    frame_id: String,
    planning: Option<JoinHandle<Planned>>,
    summary: NodeSummary,
    _token: swath_bridge::NodeToken,
}

/// A frame that was planned, and what is needed to report it.
struct Planned {
    plan: Result<(FramePlan, Option<usize>), Error>,
    departure: Departure,
    grid: Received<OccupancyGrid>,
    network: Option<Arc<ServedNetwork>>,
    method: Method,
    speed_m_per_s: f64,
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
        let model = Arc::new(MotionModel::new(&config.vehicle, config.grid.resolution_m)?);
        let inputs = Inputs {
            grid: session.subscriber(&keys::grid(id), 1).await?,
            odom: session.subscriber(&keys::odom(id), QUEUE).await?,
            reference: session.subscriber(&keys::reference(id), QUEUE).await?,
            targets: session.subscriber(&keys::targets(id), QUEUE).await?,
            weights: session
                .subscriber(&keys::weights(&config.run), QUEUE)
                .await?,
        };
        let outputs = Outputs {
            plan: session.publisher(&keys::plan(id)).await?,
            path: session.publisher(&keys::path(id)).await?,
            region: session.publisher(&keys::region(id)).await?,
        };
        Ok(Self {
            planner: Arc::new(FramePlanner::new(model)),
            network: initial.map(Arc::new),
            reference: Vec::new(),
            targets: Vec::new(),
            speed_m_per_s: config.plan.speed_m_per_s,
            follower: Follower::new(config.follow),
            expires: None,
            frame_id: String::new(),
            planning: None,
            summary: NodeSummary::default(),
            _token: token,
            inputs,
            outputs,
            config,
        })
    }

    fn reject(&mut self, what: &str, error: &dyn std::fmt::Display) {
        self.summary.rejected += 1;
        if self.summary.rejected % LOGGED_EVERY == 1 {
            tracing::warn!("{what} not used: {error}");
        }
    }

    fn take_odom(&mut self, odom: &Odometry) {
        if let Some(moment) = self.follower.take_odom(odom) {
            self.speed_m_per_s = moment.speed_m_per_s.abs();
            return;
        }
        let twist = &odom.twist.twist;
        let told = format!("{} m/s, {} rad/s", twist.linear.x, twist.angular.z);
        self.reject(
            "odometry",
            &format!("no car moves so, or is nowhere: {told}"),
        );
    }

    fn take_targets(&mut self, targets: &PoseArray) {
        let poses = targets
            .poses
            .iter()
            .map(pose_of_ros)
            .filter(Pose2::is_finite);
        self.targets = poses.take(MAX_TARGETS).collect();
    }

    /// Takes weights into use from the next frame on, if they are intact, trusted and newer.
    async fn take_weights(&mut self, received: Received<Weights>) {
        let weights = received.message;
        let stamp_nanos = weights.header.stamp.nanos();
        if self
            .network
            .as_ref()
            .is_some_and(|used| used.stamp_nanos >= stamp_nanos)
        {
            tracing::debug!("{}: version {} is not newer", received.key, weights.version);
            return;
        }
        if weights.vehicle != self.config.vehicle.digest() {
            tracing::warn!(
                "{}: version {} was trained for another vehicle ({})",
                received.key,
                weights.version,
                weights.vehicle
            );
        }
        let (trusted, grid) = (self.config.trusted.clone(), self.config.grid);
        let loaded = spawn_blocking(move || {
            signature::verify(&weights, &trusted)?;
            let network = Network::load(&weights.safetensors)?;
            if network.info().spec != grid {
                return Err(Error::GridMismatch {
                    got: grid,
                    wanted: network.info().spec,
                });
            }
            let (run, version) = (weights.run, weights.version);
            Ok::<_, Error>(ServedNetwork {
                network,
                run,
                version,
                stamp_nanos,
            })
        });
        match loaded.await {
            Ok(Ok(served)) => {
                tracing::info!("weights {} version {} in use", served.run, served.version);
                self.summary.weights += 1;
                self.network = Some(Arc::new(served));
            }
            Ok(Err(error)) => self.reject(&received.key, &error),
            Err(error) => self.reject(&received.key, &error),
        }
    }

    /// Starts to plan on a grid with what is known now.
    fn start(&mut self, grid: Received<OccupancyGrid>) {
        let occupancy = match Occupancy::from_message(&grid.message, &self.config.grid) {
            Ok(occupancy) => occupancy,
            Err(error) => return self.reject(&grid.key, &error),
        };
        let mut plan = self.config.plan;
        let network = self.network.clone();
        let network = network.filter(|_| plan.uses_network());
        if network.is_none() && plan.method.needs_regions() {
            plan.method = plan.method.without_regions();
        }
        plan.speed_m_per_s = self.speed_m_per_s;
        let obstacles = self.config.obstacles.obstacles(&occupancy);
        let goals = if self.targets.is_empty() {
            sample_targets(&self.reference, &occupancy.spec, &self.config.targets)
        } else {
            self.targets.clone()
        };
        let vehicle = &self.config.vehicle;
        let limit_per_m = vehicle.curvature_limit_per_m(self.speed_m_per_s);
        let departure = self.follower.depart(
            grid.message.header.stamp.nanos(),
            (&occupancy.spec, &obstacles),
            (vehicle, limit_per_m),
        );
        let job = Job {
            planner: Arc::clone(&self.planner),
            network: network.clone(),
            spec: occupancy.spec,
            obstacles,
            reference: self.reference.clone(),
            goals,
            plan,
            choice: self.config.follow.choice,
        };
        self.planning = Some(spawn_blocking(move || {
            let (departure, plan) = job.plan(departure);
            Planned {
                plan,
                departure,
                grid,
                network,
                method: job.plan.method,
                speed_m_per_s: job.plan.speed_m_per_s,
            }
        }));
    }

    /// Publishes a planned frame: the report, the chosen path, and the regions for viewing.
    async fn publish(&mut self, planned: Planned) -> Result<Option<PlanReport>, Error> {
        let header = planned.grid.message.header;
        self.frame_id.clone_from(&header.frame_id);
        let (plan, chosen) = match planned.plan {
            Ok(planned) => planned,
            Err(error) => {
                self.reject(&planned.grid.key, &error);
                self.withdraw("a grid could not be planned on").await?;
                return Ok(None);
            }
        };
        let path = chosen.and_then(|number| plan.targets.get(number));
        let path = path.and_then(|target| Some((target.drivable.as_ref()?, &target.goal)));
        let poses: Vec<Pose2> = if let Some((path, goal)) = path {
            let path = (path.points.as_slice(), goal);
            let followed = self.follower.follow(&planned.departure, path);
            followed.into_iter().map(|point| point.pose).collect()
        } else {
            self.follower.stop();
            Vec::new()
        };
        // The controller first: it waits for this.
        self.outputs
            .path
            .put(&path_message(&header, &poses))
            .await?;
        let expires_s = Duration::from_secs_f64(self.config.follow.expires_s);
        self.expires = (!poses.is_empty()).then(|| Instant::now() + expires_s);

        let mut report = plan_report(header.clone(), planned.method, planned.speed_m_per_s, &plan);
        self.summary.frames += 1;
        report.vehicle.clone_from(&self.config.vehicle_id);
        report.frame = self.summary.frames;
        report.chosen = chosen.map_or(-1, |number| i32::try_from(number).unwrap_or(i32::MAX));
        report.grids_skipped = self.inputs.grid.counts().dropped;
        let now = clock::now_nanos();
        if let Some(served) = &planned.network {
            report.weights_run.clone_from(&served.run);
            report.weights_version = served.version;
            if served.stamp_nanos > 0 {
                report.weights_age_s = now.saturating_sub(served.stamp_nanos) as f32 / 1e9;
            }
        }
        report.latency_ms = now.saturating_sub(planned.grid.received_nanos) as f32 / 1e6;
        self.follower.took(f64::from(report.latency_ms) / 1e3);
        self.outputs.plan.put(&report).await?;
        if let Some(region) = union(&plan.regions) {
            let message = region_message(&self.config.grid, &region, (header, &plan.start));
            self.outputs.region.put(&message).await?;
        }
        Ok(Some(report))
    }

    /// Says stop: publishes an empty path.
    async fn withdraw(&mut self, why: &str) -> Result<(), Error> {
        if self.expires.take().is_some() {
            tracing::warn!("{why}: the last path is withdrawn");
        }
        self.follower.stop();
        let header = Header::at(clock::now_nanos(), &self.frame_id);
        self.outputs.path.put(&path_message(&header, &[])).await?;
        Ok(())
    }
}

/// All cells of several planes.
fn union(planes: &[Plane]) -> Option<Plane> {
    let (first, rest) = planes.split_first()?;
    let mut all = first.clone();
    for plane in rest {
        all.add(plane);
    }
    Some(all)
}

/// A region as a grid, which is turned as the start is.
fn region_message(
    spec: &GridSpec,
    region: &Plane,
    (header, start): (Header, &Start),
) -> OccupancyGrid {
    let cells = (0..region.len())
        .map(|index| {
            if region.get_index(index) {
                OCCUPIED
            } else {
                FREE
            }
        })
        .collect();
    let occupancy = Occupancy { spec: *spec, cells };
    let mut message = occupancy.to_message(header);
    let origin = pose_of_ros(&message.info.origin);
    message.info.origin = ros_pose(&start.pose.then(&origin));
    message
}
