//! One frame from obstacles to plans: regions from the network, then a search to each target.

use std::sync::Arc;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use swath_bridge::{GridSpec, Occupancy, Pose2};

use crate::collision::CollisionMap;
use crate::network::{Network, Prediction, Reach, Surroundings};
use crate::plan::{PlanConfig, Planner, TargetPlan};
use crate::timing::CpuTimer;
use crate::{Error, MotionModel, Plane};

/// Which cells of an occupancy grid are obstacles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ObstacleConfig {
    /// Least occupancy of an obstacle, percent.
    pub threshold_percent: i8,
    /// Whether cells that nothing is known of are obstacles.
    pub unknown_is_obstacle: bool,
}

impl Default for ObstacleConfig {
    fn default() -> Self {
        Self {
            threshold_percent: 50,
            unknown_is_obstacle: false,
        }
    }
}

impl ObstacleConfig {
    /// The obstacles of an occupancy grid.
    pub fn obstacles(&self, occupancy: &Occupancy) -> Plane {
        Plane::from_occupancy(occupancy, self.threshold_percent, self.unknown_is_obstacle)
    }
}

/// What a frame is planned on.
#[derive(Debug, Clone, Copy)]
pub struct FrameInput<'a> {
    /// Size and place of the grid.
    pub spec: GridSpec,
    /// Occupied cells.
    pub obstacles: &'a Plane,
    /// The rough path, vehicle frame; may be empty.
    pub reference: &'a [Pose2],
    /// Targets, vehicle frame.
    pub goals: &'a [Pose2],
}

/// A planned frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FramePlan {
    /// One for each goal, in their order.
    pub targets: Vec<TargetPlan>,
    /// The regions that were predicted, one for each goal; none without a network.
    pub regions: Vec<Plane>,
    /// How well each goal can be reached, as far as the network says.
    pub reach: Vec<Option<Reach>>,
    /// Elapsed time of the prediction.
    pub network: Duration,
    /// Elapsed time of the searches.
    pub search: Duration,
    /// Processor time of both.
    pub cpu: Duration,
    /// Elapsed time of both.
    pub total: Duration,
}

/// Plans frames of one vehicle.
#[derive(Debug)]
pub struct FramePlanner {
    model: Arc<MotionModel>,
    planner: Planner,
}

impl FramePlanner {
    /// A planner of a vehicle's motions.
    pub fn new(model: Arc<MotionModel>) -> Self {
        Self {
            model,
            planner: Planner::new(),
        }
    }

    /// Plans to every goal: with `tiev-fcn` in the regions of a network, or with `tiev` without one.
    ///
    /// # Errors
    /// Those of [`CollisionMap::new`], [`Network::predict`] and [`Planner::plan`]: sizes that do not
    /// fit together.
    pub fn plan(
        &self,
        input: &FrameInput<'_>,
        network: Option<&Network>,
        config: &PlanConfig,
    ) -> Result<FramePlan, Error> {
        let cpu = CpuTimer::of_process();
        let started = Instant::now();
        let predictions = network
            .map(|network| predict(input, network, config.speed_m_per_s))
            .transpose()?;
        let network_time = started.elapsed();
        let (regions, reach) = predictions.map_or_else(Default::default, |predictions| {
            let parts = predictions.into_iter();
            let parts = parts.map(|prediction| (prediction.region, prediction.reach));
            parts.unzip::<_, _, Vec<_>, Vec<_>>()
        });
        let map = CollisionMap::new(Arc::clone(&self.model), input.spec, input.obstacles)?;
        let targets = self.planner.plan(
            &map,
            input.goals,
            network.map(|_| regions.as_slice()),
            config,
        )?;
        let total = started.elapsed();
        Ok(FramePlan {
            targets,
            regions,
            reach,
            network: if network.is_some() {
                network_time
            } else {
                Duration::ZERO
            },
            search: total.saturating_sub(network_time),
            cpu: cpu.elapsed(),
            total,
        })
    }
}

/// The region to each goal (the paper's Algorithm 2, lines 2 to 9).
fn predict(
    input: &FrameInput<'_>,
    network: &Network,
    speed_m_per_s: f64,
) -> Result<Vec<Prediction>, Error> {
    let info = network.info();
    if info.spec != input.spec {
        return Err(Error::GridMismatch {
            got: input.spec,
            wanted: info.spec,
        });
    }
    let mut reference = Plane::empty(input.spec.rows, input.spec.cols);
    reference.draw_line(&input.spec, input.reference, info.reference_dilation_m);
    let surroundings = Surroundings {
        obstacles: input.obstacles,
        reference: &reference,
        speed_m_per_s,
    };
    network.predict(&surroundings, input.goals)
}
