//! The planner node: newest grid, reference, odometry and weights in; plans, path and regions out.
//!
//! It is one task that owns everything it knows. A frame is planned on a thread of its own with what
//! was known when its grid was taken, the network included, so weights that arrive meanwhile are used
//! from the next frame on and no plan ever mixes two versions.

use std::future::Future;
use std::pin::pin;
use std::sync::Arc;

use swath_bridge::geometry::Pose2;
use swath_bridge::msg::geometry::PoseArray;
use swath_bridge::msg::nav::{OccupancyGrid, Odometry, Path};
use swath_bridge::msg::swath::{PlanReport, Weights};
use swath_bridge::{
    FREE, GridSpec, OCCUPIED, Occupancy, Publisher, Received, Session, Subscriber, Vehicle, clock,
    keys, signature,
};
use tokio::task::{JoinHandle, spawn_blocking};

use crate::frame::{FrameInput, FramePlan, FramePlanner, ObstacleConfig};
use crate::network::Network;
use crate::plan::{Method, PlanConfig};
use crate::report::{chosen, path_message, plan_report, pose_of_ros, poses_of_path};
use crate::targets::{MAX_TARGETS, TargetConfig, sample_targets};
use crate::{Error, MotionModel, Plane};

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
    /// The method, or `None` for `tiev-fcn` as soon as there are weights and `tiev` until then.
    pub method: Option<Method>,
    /// Training run to take weights from, or `*` for any.
    pub run: String,
    /// Keys whose weights are trusted; with none, any intact weights are.
    pub trusted: Vec<signature::VerifyingKey>,
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
/// # Errors
/// [`Error::Bridge`] when the session fails, and errors of [`MotionModel::new`].
pub async fn run(
    session: &Session,
    config: NodeConfig,
    initial: Option<ServedNetwork>,
    stop: impl Future<Output = ()>,
    mut observe: impl FnMut(&PlanReport),
) -> Result<NodeSummary, Error> {
    let mut node = Node::new(session, config, initial).await?;
    let mut stop = pin!(stop);
    loop {
        tokio::select! {
            biased;
            () = &mut stop => break,
            Some(weights) = node.inputs.weights.recv() => node.take_weights(weights).await,
            Some(odom) = node.inputs.odom.recv() => node.take_odom(&odom.message),
            Some(path) = node.inputs.reference.recv() => {
                node.reference = poses_of_path(&path.message);
            }
            Some(targets) = node.inputs.targets.recv() => node.take_targets(&targets.message),
            Some(planned) = finished(&mut node.planning) => {
                if let Some(report) = node.publish(planned).await? {
                    observe(&report);
                }
            }
            Some(grid) = node.inputs.grid.recv(), if node.planning.is_none() => node.start(grid),
            else => break,
        }
    }
    Ok(node.summary)
}

/// The plan that is under way, when it is finished.
async fn finished(planning: &mut Option<JoinHandle<Planned>>) -> Option<Planned> {
    let Some(handle) = planning else {
        return std::future::pending().await;
    };
    let planned = handle.await;
    *planning = None;
    match planned {
        Ok(planned) => Some(planned),
        Err(error) => {
            tracing::error!("a frame was lost: {error}");
            std::future::pending().await
        }
    }
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
    planning: Option<JoinHandle<Planned>>,
    summary: NodeSummary,
    _token: swath_bridge::NodeToken,
}

/// A frame that was planned, and what is needed to report it.
struct Planned {
    plan: Result<FramePlan, Error>,
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
            planning: None,
            summary: NodeSummary::default(),
            _token: session.declare_node("planner", id).await?,
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
        let speed = odom.twist.twist.linear.x;
        if speed.is_finite() {
            self.speed_m_per_s = speed.abs();
        }
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
        let method = self.config.method.unwrap_or(if self.network.is_some() {
            Method::TievFcn
        } else {
            Method::Tiev
        });
        let network = self.network.clone().filter(|_| method.needs_regions());
        let method = if network.is_some() || !method.needs_regions() {
            method
        } else {
            method.without_regions()
        };
        let mut plan_config = self.config.plan;
        plan_config.method = method;
        plan_config.speed_m_per_s = self.speed_m_per_s;
        let obstacles = self.config.obstacles.obstacles(&occupancy);
        let goals = if self.targets.is_empty() {
            sample_targets(&self.reference, &occupancy.spec, &self.config.targets)
        } else {
            self.targets.clone()
        };
        let (planner, reference) = (Arc::clone(&self.planner), self.reference.clone());
        self.planning = Some(spawn_blocking(move || {
            let input = FrameInput {
                spec: occupancy.spec,
                obstacles: &obstacles,
                reference: &reference,
                goals: &goals,
            };
            let served = network.as_deref().map(|served| &served.network);
            let plan = planner.plan(&input, served, &plan_config);
            Planned {
                plan,
                grid,
                network,
                method,
                speed_m_per_s: plan_config.speed_m_per_s,
            }
        }));
    }

    /// Publishes a planned frame: the report, the chosen path, and the regions for viewing.
    async fn publish(&mut self, planned: Planned) -> Result<Option<PlanReport>, Error> {
        let plan = match planned.plan {
            Ok(plan) => plan,
            Err(error) => {
                self.reject(&planned.grid.key, &error);
                return Ok(None);
            }
        };
        let header = planned.grid.message.header;
        let mut report = plan_report(header.clone(), planned.method, planned.speed_m_per_s, &plan);
        self.summary.frames += 1;
        report.vehicle.clone_from(&self.config.vehicle_id);
        report.frame = self.summary.frames;
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
        self.outputs.plan.put(&report).await?;
        // An empty path tells a controller to stop.
        let path = chosen(&plan).map_or(&[][..], |target| &target.result.path);
        self.outputs.path.put(&path_message(&header, path)).await?;
        if let Some(region) = union(&plan.regions) {
            let mut message =
                region_occupancy(&self.config.grid, &region).to_message(header.clone());
            message.info.map_load_time = header.stamp;
            self.outputs.region.put(&message).await?;
        }
        Ok(Some(report))
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

fn region_occupancy(spec: &GridSpec, region: &Plane) -> Occupancy {
    let cells = (0..region.len())
        .map(|index| {
            if region.get_index(index) {
                OCCUPIED
            } else {
                FREE
            }
        })
        .collect();
    Occupancy { spec: *spec, cells }
}
