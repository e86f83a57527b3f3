//! One frame from obstacles to plans: regions from the network where they are of use, a search for all
//! targets, and paths that can be driven.
//!
//! Paths may begin where the vehicle will be when they are ready. The search's graph begins on a cell's
//! centre, heading along the grid, so it is given the obstacles as they are seen from there; what it
//! finds is made drivable, and tested, on the cells as they came.

mod asking;
mod drive;
mod view;

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use swath_bridge::{GridSpec, Occupancy, Outcome, Pose2};

use crate::collision::CollisionMap;
use crate::method::Method;
use crate::network::{Network, Prediction, Reach, Surroundings};
use crate::plan::{PlanConfig, Planner, TargetPlan, deadline_in, order_of};
use crate::pool::Pool;
use crate::smooth::Smoother;
use crate::timing::CpuTimer;
use crate::{Error, MotionModel, Plane};

pub use asking::Consulted;

use drive::{Drive, make_drivable};
use view::View;

pub use view::grid_around;

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
    /// Checks the threshold: 1 to 100 percent. At 0 free cells would be obstacles.
    ///
    /// # Errors
    /// [`swath_bridge::Error::InvalidConfig`] names the field.
    pub fn validate(&self) -> Result<(), Error> {
        if (1..=100).contains(&self.threshold_percent) {
            return Ok(());
        }
        Err(Error::Bridge(swath_bridge::Error::InvalidConfig {
            field: "threshold_percent",
            value: f64::from(self.threshold_percent),
            least: 1.0,
            most: 100.0,
        }))
    }

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
    /// Where paths begin.
    pub start: Start,
}

impl FrameInput<'_> {
    /// The probability of each cell to lie in the region of the path to each goal, as the methods that
    /// plan in regions see it: those cells are in the region whose probability is above 0.5.
    ///
    /// # Shapes
    /// One vector for each goal, row-major over all cells of the grid.
    ///
    /// # Errors
    /// [`Error::GridMismatch`] where the network was trained for another grid, [`Error::Shape`] where
    /// the obstacles are not of the grid's size.
    pub fn region_probabilities(
        &self,
        network: &Network,
        speed_m_per_s: f64,
    ) -> Result<Vec<Vec<f32>>, Error> {
        let view = View::new(self);
        let reference = reference_plane(&self.spec, &view.reference, network)?;
        let surroundings = Surroundings {
            obstacles: &view.obstacles,
            reference: &reference,
            speed_m_per_s,
        };
        network.probabilities(&surroundings, &view.goals)
    }
}

/// Where paths begin, and how.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Start {
    /// In the vehicle's frame; by default where the vehicle is.
    pub pose: Pose2,
    /// The curvature that is driven there, 1/m; `None` if paths may begin with any.
    pub curvature_per_m: Option<f64>,
}

impl Start {
    /// Whether that is where the vehicle is.
    pub fn is_vehicle(&self) -> bool {
        self.pose == Pose2::default()
    }
}

/// A planned frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FramePlan {
    /// One for each goal, in their order.
    pub targets: Vec<TargetPlan>,
    /// Where the paths begin.
    pub start: Start,
    /// The regions that were predicted, one for each goal, as seen from the start; none without a
    /// network.
    pub regions: Vec<Plane>,
    /// How well each goal can be reached, as far as the network says.
    pub reach: Vec<Option<Reach>>,
    /// Whether the network was asked.
    pub consulted: Consulted,
    /// Elapsed time of the prediction.
    pub network: Duration,
    /// Elapsed time of the searches.
    pub search: Duration,
    /// Processor time of both.
    pub cpu: Duration,
    /// Elapsed time of both.
    pub total: Duration,
    /// Elapsed time of making paths drivable, after that.
    pub smooth: Duration,
    /// Time that there was for all of it; zero for no limit.
    pub deadline: Duration,
}

/// A frame as it is searched.
#[derive(Debug, Clone, Copy)]
struct Seen<'a> {
    map: &'a CollisionMap,
    view: &'a View<'a>,
    /// When the searches end.
    deadline: Option<Instant>,
}

/// What came of searching a frame.
#[derive(Debug)]
struct Found {
    targets: Vec<TargetPlan>,
    regions: Vec<Plane>,
    reach: Vec<Option<Reach>>,
    consulted: Consulted,
    network: Duration,
}

impl Found {
    /// Without a network.
    const fn without(targets: Vec<TargetPlan>) -> Self {
        Self {
            targets,
            regions: Vec::new(),
            reach: Vec::new(),
            consulted: Consulted::Without,
            network: Duration::ZERO,
        }
    }
}

/// Share of a frame's time that is kept at most for making paths drivable, and time for each path.
const SMOOTH_SHARE: f64 = 0.2;
const SMOOTH_A_PATH: Duration = Duration::from_micros(400);

/// Plans frames of one vehicle.
#[derive(Debug)]
pub struct FramePlanner {
    model: Arc<MotionModel>,
    planner: Planner,
    smoothers: Pool<Option<Smoother>>,
    /// Longest prediction so far: what one is expected to take.
    longest_prediction: Mutex<Duration>,
}

impl FramePlanner {
    /// A planner of a vehicle's motions.
    pub fn new(model: Arc<MotionModel>) -> Self {
        Self {
            model,
            planner: Planner::new(),
            smoothers: Pool::default(),
            longest_prediction: Mutex::default(),
        }
    }

    /// Plans to every goal by the method of the configuration; with a network, in its regions, and
    /// `tiev` is `tiev-fcn` then. Under a deadline, counted from the call, what is not done by then is
    /// left undone: [`swath_bridge::Outcome::BudgetExhausted`] for a search, `None` for a drivable path.
    ///
    /// # Errors
    /// Those of [`CollisionMap::new`], [`Network::predict`], [`Planner::plan`] and [`Smoother::new`]:
    /// sizes that do not fit together, and settings out of range.
    pub fn plan(
        &self,
        input: &FrameInput<'_>,
        network: Option<&Network>,
        config: &PlanConfig,
    ) -> Result<FramePlan, Error> {
        self.plan_view(input, || Ok(View::new(input)), network, config)
    }

    /// [`Self::plan`], searched on a grid around the start (see [`grid_around`]) rather than on one of the
    /// frame's size. Paths stay on the frame's grid, and regions are on the other one.
    ///
    /// # Errors
    /// As [`Self::plan`].
    pub fn plan_on(
        &self,
        input: &FrameInput<'_>,
        around_start: &GridSpec,
        network: Option<&Network>,
        config: &PlanConfig,
    ) -> Result<FramePlan, Error> {
        let view = || View::on(input, around_start, &self.model);
        self.plan_view(input, view, network, config)
    }

    fn plan_view<'a>(
        &self,
        input: &FrameInput<'a>,
        view: impl FnOnce() -> Result<View<'a>, Error>,
        network: Option<&Network>,
        config: &PlanConfig,
    ) -> Result<FramePlan, Error> {
        let cpu = CpuTimer::of_process();
        let started = Instant::now();
        let deadline = deadline_in(config.frame_deadline_ms);
        let view = view()?;
        let map = CollisionMap::new(Arc::clone(&self.model), view.spec, &view.obstacles)?;
        let seen = Seen {
            map: &map,
            view: &view,
            deadline: deadline.map(|deadline| search_deadline(deadline, input, config)),
        };
        let mut found = match network {
            Some(network) if config.method == Method::Swath => {
                self.search_asking(&seen, network, config)?
            }
            Some(network) => self.search_inside(&seen, network, config)?,
            None => Found::without(self.search(&seen, None, config)?),
        };
        let (cpu, total) = (cpu.elapsed(), started.elapsed());
        as_seen_by_vehicle(input, &mut found.targets);
        if view.spec != input.spec {
            name_goals_off_the_grid(input, &mut found.targets);
        }
        if config.smooth {
            self.make_drivable(input, &mut found.targets, (deadline, config))?;
        }
        Ok(FramePlan {
            targets: found.targets,
            start: input.start,
            regions: found.regions,
            reach: found.reach,
            consulted: found.consulted,
            network: found.network,
            search: total.saturating_sub(found.network),
            cpu,
            total,
            smooth: started.elapsed().saturating_sub(total),
            deadline: Duration::from_millis(config.frame_deadline_ms),
        })
    }

    /// Searches without a network, or in regions.
    fn search(
        &self,
        seen: &Seen<'_>,
        regions: Option<&[Plane]>,
        config: &PlanConfig,
    ) -> Result<Vec<TargetPlan>, Error> {
        let goals = (seen.map, &*seen.view.goals);
        self.planner
            .plan_until(seen.deadline, goals, regions, config)
    }

    /// Predicts all regions, and searches in them.
    fn search_inside(
        &self,
        seen: &Seen<'_>,
        network: &Network,
        config: &PlanConfig,
    ) -> Result<Found, Error> {
        let started = Instant::now();
        let predictions = predict(seen, &seen.view.goals, network, config.speed_m_per_s)?;
        let elapsed = started.elapsed();
        let parts = predictions.into_iter();
        let parts = parts.map(|prediction| (prediction.region, prediction.reach));
        let (regions, reach): (Vec<_>, Vec<_>) = parts.unzip();
        Ok(Found {
            targets: self.search(seen, Some(&regions), config)?,
            regions,
            reach,
            consulted: Consulted::ForAll,
            network: elapsed,
        })
    }

    /// Makes paths drivable.
    fn make_drivable(
        &self,
        input: &FrameInput<'_>,
        targets: &mut [TargetPlan],
        (deadline, config): (Option<Instant>, &PlanConfig),
    ) -> Result<(), Error> {
        let is_late = |by: Duration| deadline.is_some_and(|at| Instant::now() >= at + by);
        let drive = Drive {
            vehicle: self.model.vehicle(),
            config: &config.smoothing,
            speed_m_per_s: config.speed_m_per_s,
            tolerance: config.goal,
            order: &order_of(input.goals, config.order),
            is_late: &is_late,
        };
        make_drivable(&self.smoothers, input, targets, drive)
    }
}

/// When the searches of a frame end.
fn search_deadline(deadline: Instant, input: &FrameInput<'_>, config: &PlanConfig) -> Instant {
    if !config.smooth {
        return deadline;
    }
    let all = Duration::from_millis(config.frame_deadline_ms);
    let paths = input.goals.len().div_ceil(rayon::current_num_threads());
    let each = SMOOTH_A_PATH * u32::try_from(paths).unwrap_or(u32::MAX);
    let kept = all.mul_f64(SMOOTH_SHARE).min(each);
    deadline.checked_sub(kept).unwrap_or(deadline)
}

/// Brings results into the vehicle's frame.
fn as_seen_by_vehicle(input: &FrameInput<'_>, targets: &mut [TargetPlan]) {
    if input.start.is_vehicle() {
        return;
    }
    for (target, goal) in targets.iter_mut().zip(input.goals) {
        target.goal = *goal;
        for pose in &mut target.result.path {
            *pose = input.start.pose.then(pose);
        }
    }
}

/// Goals beyond the frame's grid are out of bounds, though the grid around the start may hold them.
fn name_goals_off_the_grid(input: &FrameInput<'_>, targets: &mut [TargetPlan]) {
    for (target, goal) in targets.iter_mut().zip(input.goals) {
        let cell = input.spec.cell_at(goal.x_m, goal.y_m);
        let is_occupied = target.result.outcome == Outcome::GoalOccupied;
        if is_occupied && input.spec.index_of(cell).is_none() {
            target.result.outcome = Outcome::OutOfBounds;
        }
    }
}

/// The regions to goals (the paper's Algorithm 2, lines 2 to 9).
fn predict(
    seen: &Seen<'_>,
    goals: &[Pose2],
    network: &Network,
    speed_m_per_s: f64,
) -> Result<Vec<Prediction>, Error> {
    let reference = reference_plane(seen.map.spec(), &seen.view.reference, network)?;
    let surroundings = Surroundings {
        obstacles: &seen.view.obstacles,
        reference: &reference,
        speed_m_per_s,
    };
    network.predict(&surroundings, goals)
}

/// The reference as the network expects it.
fn reference_plane(
    spec: &GridSpec,
    reference: &[Pose2],
    network: &Network,
) -> Result<Plane, Error> {
    let info = network.info();
    if info.spec != *spec {
        return Err(Error::GridMismatch {
            got: *spec,
            wanted: info.spec,
        });
    }
    let mut plane = Plane::empty(spec.rows, spec.cols);
    plane.draw_line(spec, reference, info.reference_dilation_m);
    Ok(plane)
}
