//! Chord paths made drivable: continuous heading and curvature within the limits of the vehicle.
//!
//! The search's paths turn on the spot at the joints of their chords. Here the rate at which the
//! curvature changes is optimised step by step, so that whatever is looked at can be driven: first a
//! path that follows the chords as a driver would, then differential dynamic programming that bends it
//! away from obstacles, into the goal's tolerance and straight where it can be. The result is tested
//! for contact without gaps; what does not pass is tried again nearer to the chords, and is flagged at
//! last. What is flagged hits nothing either, unless the chords do.

mod attempt;
mod clothoid;
mod cost;
mod drivable;
mod ending;
mod footprint;
mod obstacles;
mod optimise;
mod reference;
mod scale;
mod verify;

use serde::{Deserialize, Serialize};
use swath_bridge::geometry::wrap_angle_rad;
use swath_bridge::{Pose2, Vehicle};

use crate::Error;
use crate::path_point::PathPoint;
use crate::tolerance::GoalTolerance;

pub(crate) use clothoid::State;
pub(crate) use footprint::Footprint;
pub(crate) use verify::{LEAST_GAP_M, contact_gap_m};

pub use drivable::{DrivablePath, Shortfall};
pub use obstacles::ObstacleCells;
pub use swath_bridge::Drivability;

use attempt::{ATTEMPTS, Attempt};
use cost::{Cost, Nearby, Weights};
use drivable::as_chords;
use obstacles::ScaledCells;
use optimise::{Limits, Optimiser, Progress, Trajectory};
use reference::{Guess, Reference};
use scale::Scale;

/// Farthest that two points of a path lie apart, metres.
pub const POINT_SPACING_M: f64 = 0.2;
/// Longest path that is smoothed, in steps of [`POINT_SPACING_M`].
pub const MAX_STEPS: usize = 8192;
/// A path that ends so near to the goal ends at it, metres and radians.
const AT_GOAL_M: f64 = 0.01;
const AT_GOAL_RAD: f64 = 0.01;
/// Most iterations to bring a path that is good to the goal itself.
const ITERATIONS_TO_GOAL: usize = 30;
/// Where the tolerance of the heading is wider than this, any heading within it is as good, radians.
const MOST_TURN_TO_GOAL_RAD: f64 = 0.6;
/// Most iterations that one attempt may be given.
const MOST_ITERATIONS: f64 = 10_000.0;
/// Widest gap that may be preferred, metres.
const MAX_PREFERRED_GAP_M: f64 = 2.0;
/// The goal's tolerance and the points' distance are kept with this to spare, metres and radians, for
/// whoever rounds to single precision.
const SLACK: f64 = 1e-4;
/// States stay so far from the map's edge that the path between two of them stays on it, metres.
const MAP_MARGIN_M: f64 = 0.005;

/// Contact and a missed goal weigh at most so much.
const MOST_CONTACT: f64 = 1e5;
const URGENCY_GROWTH: f64 = 10.0;
/// Iterations after which the cells near the path are looked at again.
const ITERATIONS_A_GATHERING: usize = 3;
/// Iterations after which contact weighs more.
const ITERATIONS_A_ROUND: usize = 15;
/// What is tried for want of a path within the vehicle's limits: so many times its curvature and rate.
const RELAXED_CURVATURE: f64 = 2.0;
const RELAXED_RATE: f64 = 4.0;

/// Where a path is to end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Ending {
    AtGoal,
    WithinTolerance,
}

/// What an attempt is made in, in units of the scale.
struct Around<'a> {
    cells: ScaledCells<'a>,
    footprint: Footprint,
    limits: &'a Limits,
    tolerance: GoalTolerance,
}

/// How paths are smoothed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SmoothConfig {
    /// Gap to obstacles that is preferred, metres; less is taken where it must be.
    pub preferred_gap_m: f64,
    /// Most iterations for one attempt.
    pub max_iterations: usize,
}

impl SmoothConfig {
    /// Whether every setting is in its range.
    ///
    /// # Errors
    /// [`Error::SmoothConfig`] names the one that is not.
    pub fn validate(&self) -> Result<(), Error> {
        let iterations = self.max_iterations as f64;
        for (field, value, most) in [
            ("preferred_gap_m", self.preferred_gap_m, MAX_PREFERRED_GAP_M),
            ("max_iterations", iterations, MOST_ITERATIONS),
        ] {
            if !(value > 0.0 && value <= most) {
                return Err(Error::SmoothConfig { field, value, most });
            }
        }
        Ok(())
    }
}

impl Default for SmoothConfig {
    fn default() -> Self {
        Self {
            preferred_gap_m: 0.25,
            max_iterations: 60,
        }
    }
}

/// A chord path to smooth.
#[derive(Clone, Copy)]
pub struct SmoothRequest<'a> {
    /// The path that a search found.
    pub chords: &'a [Pose2],
    /// What it leads to.
    pub goal: Pose2,
    /// How near to the goal the path has to end.
    pub tolerance: GoalTolerance,
    /// The vehicle's speed, m/s; it limits the curvature.
    pub speed_m_per_s: f64,
    /// Curvature that the vehicle drives at the start, 1/m, which is clamped to the limit; `None` if
    /// it may begin with any, as one that stands.
    pub start_curvature_per_m: Option<f64>,
    /// Asked every few iterations whether to stop, if there is no time without end.
    pub stop: Option<&'a (dyn Fn() -> bool + Sync)>,
}

impl std::fmt::Debug for SmoothRequest<'_> {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("SmoothRequest")
            .field("chords", &self.chords)
            .field("goal", &self.goal)
            .field("tolerance", &self.tolerance)
            .field("speed_m_per_s", &self.speed_m_per_s)
            .field("start_curvature_per_m", &self.start_curvature_per_m)
            .field("stop", &self.stop.map(|_| "callback"))
            .finish()
    }
}

/// What came of attempts that failed.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tried {
    shortfall: Shortfall,
    iterations: usize,
}

/// Smooths the paths of one vehicle; keeps its memory from path to path.
#[derive(Debug)]
pub struct Smoother {
    vehicle: Vehicle,
    scale: Scale,
    config: SmoothConfig,
    /// Chords and goal in units of the scale.
    chords: Vec<Pose2>,
    goal: Pose2,
    reference: Reference,
    guess: Guess,
    nearby: Nearby,
    optimiser: Optimiser,
    path: Trajectory,
    /// The same in metres.
    driven: Trajectory,
    /// One that was tested and found good.
    good: Trajectory,
    near: Vec<(f64, f64)>,
}

impl Smoother {
    /// A smoother for a vehicle.
    ///
    /// # Errors
    /// [`Error::Bridge`] for dimensions that are no vehicle's, [`Error::SmoothConfig`] for settings
    /// that are out of range.
    pub fn new(vehicle: &Vehicle, config: SmoothConfig) -> Result<Self, Error> {
        vehicle.validate()?;
        config.validate()?;
        Ok(Self {
            vehicle: *vehicle,
            scale: Scale::of(vehicle),
            config,
            chords: Vec::new(),
            goal: Pose2::default(),
            reference: Reference::default(),
            guess: Guess::default(),
            nearby: Nearby::default(),
            optimiser: Optimiser::default(),
            path: Trajectory::default(),
            driven: Trajectory::default(),
            good: Trajectory::default(),
            near: Vec::new(),
        })
    }

    /// How it smooths.
    pub const fn config(&self) -> &SmoothConfig {
        &self.config
    }

    /// The curvature that the vehicle's paths keep to at a speed, 1/m.
    pub fn curvature_limit_per_m(&self, speed_m_per_s: f64) -> f64 {
        self.vehicle.curvature_limit_per_m(speed_m_per_s)
    }

    /// Makes a chord path drivable.
    pub fn smooth(&mut self, cells: &ObstacleCells, request: &SmoothRequest<'_>) -> DrivablePath {
        match self.smooth_at_once(cells, request) {
            Ok(path) => path,
            Err(tried) => self.smooth_at_length(cells, request, tried),
        }
    }

    /// Makes a chord path drivable at the vehicle's speed if that goes at the first attempt, as it does
    /// for nearly all; else what came of it.
    pub(crate) fn smooth_at_once(
        &mut self,
        cells: &ObstacleCells,
        request: &SmoothRequest<'_>,
    ) -> Result<DrivablePath, Tried> {
        let mut tried = Tried {
            shortfall: Shortfall::Input,
            iterations: 0,
        };
        if !self.set_reference(request, Ending::AtGoal) {
            return Err(tried);
        }
        let limits = self.limits(request, Drivability::AtSpeed);
        match self.attempt(
            cells,
            request,
            (&limits, ATTEMPTS[0]),
            &mut tried.iterations,
        ) {
            Ok(()) => Ok(self.path_of(Drivability::AtSpeed, None, tried.iterations)),
            Err(shortfall) => Err(Tried { shortfall, ..tried }),
        }
    }

    /// Makes a chord path as drivable as it can be, for which the first attempt has failed.
    pub(crate) fn smooth_at_length(
        &mut self,
        cells: &ObstacleCells,
        request: &SmoothRequest<'_>,
        tried: Tried,
    ) -> DrivablePath {
        let (mut shortfall, mut iterations) = (tried.shortfall, tried.iterations);
        if matches!(shortfall, Shortfall::Input | Shortfall::Time)
            || !self.set_reference(request, Ending::WithinTolerance)
        {
            return as_chords(request.chords, shortfall, iterations);
        }
        let at_speed = self.curvature_limit_per_m(request.speed_m_per_s);
        for drivability in [
            Drivability::AtSpeed,
            Drivability::Slower,
            Drivability::TooTight,
        ] {
            if drivability == Drivability::Slower && at_speed >= self.least_radius_curvature() {
                continue;
            }
            let limits = self.limits(request, drivability);
            let is_at_speed = drivability == Drivability::AtSpeed;
            for attempt in &ATTEMPTS[1..] {
                match self.attempt(cells, request, (&limits, *attempt), &mut iterations) {
                    Ok(()) => {
                        let shortfall = (!is_at_speed).then_some(shortfall);
                        return self.path_of(drivability, shortfall, iterations);
                    }
                    Err(Shortfall::Time) => {
                        return as_chords(request.chords, Shortfall::Time, iterations);
                    }
                    Err(reason) if is_at_speed => shortfall = reason,
                    Err(_) => {}
                }
            }
        }
        as_chords(request.chords, shortfall, iterations)
    }

    /// Whether there is something to smooth.
    fn set_reference(&mut self, request: &SmoothRequest<'_>, ending: Ending) -> bool {
        request.chords.iter().all(Pose2::is_finite)
            && request.goal.is_finite()
            && request.start_curvature_per_m.is_none_or(f64::is_finite)
            && {
                self.scale.poses(request.chords, &mut self.chords);
                self.goal = self.scale.pose(&request.goal);
                if let Some(last) = self.chords.last()
                    && request.tolerance.tolerance_rad > MOST_TURN_TO_GOAL_RAD
                {
                    self.goal.yaw_rad = last.yaw_rad;
                }
                if ending == Ending::AtGoal {
                    ending::bring_to(&self.goal, &mut self.chords);
                }
                self.reference
                    .fit(&self.chords, POINT_SPACING_M - SLACK, MAX_STEPS)
            }
    }

    fn least_radius_curvature(&self) -> f64 {
        1.0 / self.vehicle.min_turning_radius_m
    }

    /// What a path may do that is to be as drivable, in units of the scale.
    fn limits(&self, request: &SmoothRequest<'_>, drivability: Drivability) -> Limits {
        let rate_per_m2 = self.vehicle.max_curvature_rate_per_m2;
        let (curvature_per_m, rate_per_m2) = match drivability {
            Drivability::AtSpeed => (
                self.curvature_limit_per_m(request.speed_m_per_s),
                rate_per_m2,
            ),
            Drivability::Slower => (self.least_radius_curvature(), rate_per_m2),
            Drivability::TooTight | Drivability::TurnsOnTheSpot => (
                RELAXED_CURVATURE * self.least_radius_curvature(),
                RELAXED_RATE * rate_per_m2,
            ),
        };
        Limits {
            curvature_per_m: self.scale.curvature(curvature_per_m),
            rate_per_m2: self.scale.rate(rate_per_m2),
            start_is_free: request.start_curvature_per_m.is_none(),
        }
    }

    /// The path as it is now.
    fn path_of(
        &self,
        drivability: Drivability,
        shortfall: Option<Shortfall>,
        iterations: usize,
    ) -> DrivablePath {
        DrivablePath {
            points: self.points(),
            drivability,
            shortfall,
            iterations,
        }
    }

    fn attempt(
        &mut self,
        cells: &ObstacleCells,
        request: &SmoothRequest<'_>,
        (limits, attempt): (&Limits, Attempt),
        iterations: &mut usize,
    ) -> Result<(), Shortfall> {
        let around = self.around(cells, limits, request.tolerance);
        self.set_out(request, limits);
        let mut weights =
            attempt.weights(attempt.gap_share * self.scale.length(self.config.preferred_gap_m));
        self.optimiser.restart();
        let mut used = 0;
        let mut result = Err(Shortfall::Contact);
        let mut in_round = 0;
        while used < self.config.max_iterations {
            if request.stop.is_some_and(|is_time_up| is_time_up()) {
                // One that is good already is good enough.
                result = result.map_err(|_so_far| Shortfall::Time);
                break;
            }
            let progress = self.improve(&around, weights, used == 0);
            used += progress.iterations;
            in_round += progress.iterations;
            if !(progress.is_settled || progress.is_finished || in_round >= ITERATIONS_A_ROUND) {
                continue;
            }
            let checked = self.check(cells, request);
            if checked.is_ok() {
                result = checked;
                let may_go_on = !progress.is_finished && used < ITERATIONS_TO_GOAL;
                if !may_go_on || !attempt.is_for_goal() || self.is_at_goal(request) {
                    break;
                }
                self.good.copy_from(&self.driven);
                continue;
            }
            if result.is_ok() {
                // It was better before it came still nearer to the goal.
                self.driven.copy_from(&self.good);
                break;
            }
            result = checked;
            if progress.is_finished || in_round >= ITERATIONS_A_ROUND {
                if weights.contact >= MOST_CONTACT {
                    break;
                }
                weights.contact *= URGENCY_GROWTH;
                weights.goal *= URGENCY_GROWTH;
                in_round = 0;
                self.optimiser.restart();
            }
        }
        *iterations += used;
        result
    }

    /// What an attempt is made in, in units of the scale.
    fn around<'a>(
        &self,
        cells: &'a ObstacleCells,
        limits: &'a Limits,
        tolerance: GoalTolerance,
    ) -> Around<'a> {
        let vehicle = self.scale.vehicle(&self.vehicle);
        let cells = cells.scaled(self.scale.factor());
        Around {
            footprint: Footprint::new(&vehicle, cells.resolution_m()),
            cells,
            limits,
            tolerance: self.scale.tolerance(tolerance),
        }
    }

    /// Improves the path by some iterations. The cells near it are gathered again when it has moved away
    /// from them, or `anew`.
    fn improve(&mut self, around: &Around<'_>, weights: Weights, anew: bool) -> Progress {
        self.nearby.update(
            &around.cells,
            &around.footprint,
            &self.path.states,
            (weights.preferred_gap_m, anew),
        );
        let cost = Cost {
            weights,
            footprint: &around.footprint,
            places: &self.reference.places,
            place_of: &self.guess.places,
            nearby: &self.nearby,
            goal: self.goal,
            tolerance: around.tolerance,
            step_m: self.reference.step_m,
        };
        self.optimiser
            .improve(&cost, around.limits, &mut self.path, ITERATIONS_A_GATHERING)
    }

    /// The path to start from: the chords as a driver would follow them.
    fn set_out(&mut self, request: &SmoothRequest<'_>, limits: &Limits) {
        let first = self.chords[0];
        let start = State {
            x_m: first.x_m,
            y_m: first.y_m,
            yaw_rad: first.yaw_rad,
            curvature_per_m: self
                .scale
                .curvature(request.start_curvature_per_m.unwrap_or(0.0))
                .clamp(-limits.curvature_per_m, limits.curvature_per_m),
        };
        let bounds = (limits.curvature_per_m, limits.rate_per_m2);
        self.reference.follow(start, bounds, &mut self.guess);
        self.path.states.clone_from(&self.guess.states);
        self.path.rates_per_m2.clone_from(&self.guess.rates_per_m2);
        self.path.step_m = self.reference.step_m;
    }

    /// Whether the path is free, on the map, and ends in the goal's tolerance. It is tested in metres.
    fn check(
        &mut self,
        cells: &ObstacleCells,
        request: &SmoothRequest<'_>,
    ) -> Result<(), Shortfall> {
        let (goal, tolerance) = (&request.goal, &request.tolerance);
        let footprint = Footprint::new(&self.vehicle, cells.spec().resolution_m);
        self.scale.back(&self.path, &mut self.driven);
        let cells = cells.scaled(1.0);
        let path = &self.driven;
        let Some(last) = path.states.last() else {
            return Err(Shortfall::Input);
        };
        let off_m = libm::hypot(last.x_m - goal.x_m, last.y_m - goal.y_m);
        let off_rad = wrap_angle_rad(last.yaw_rad - goal.yaw_rad).abs();
        if !(off_m <= tolerance.tolerance_m - SLACK && off_rad <= tolerance.tolerance_rad - SLACK) {
            return Err(Shortfall::Goal);
        }
        let is_on_map = |state: &State| cells.holds((state.x_m, state.y_m), MAP_MARGIN_M);
        if !path.states.iter().all(is_on_map) {
            return Err(Shortfall::OffMap);
        }
        let driven = (path.states.as_slice(), path.rates_per_m2.as_slice());
        let contact =
            verify::first_contact(&cells, &footprint, driven, path.step_m, &mut self.near);
        contact.map_or(Ok(()), |_| Err(Shortfall::Contact))
    }

    /// Whether the path ends at the goal itself.
    fn is_at_goal(&self, request: &SmoothRequest<'_>) -> bool {
        let goal = self.scale.pose_back(&self.goal);
        self.driven.states.last().is_some_and(|last| {
            let pose = last.pose();
            pose.distance_m(&goal) <= AT_GOAL_M.min(request.tolerance.tolerance_m)
                && wrap_angle_rad(pose.yaw_rad - goal.yaw_rad).abs() <= AT_GOAL_RAD
        })
    }

    /// The path's points; where steps are longer than points may lie apart, with points between.
    fn points(&self) -> Vec<PathPoint> {
        let path = &self.driven;
        let halves = path.step_m > POINT_SPACING_M - SLACK;
        let point = |state: &State, at_m: f64| PathPoint {
            pose: state.pose(),
            curvature_per_m: state.curvature_per_m,
            at_m,
        };
        let mut points = Vec::with_capacity(path.states.len() * (1 + usize::from(halves)));
        let mut index = 0.0;
        for (step, state) in path.states.iter().enumerate() {
            points.push(point(state, index * path.step_m));
            if let Some(&rate) = path.rates_per_m2.get(step).filter(|_| halves) {
                let middle = state.after(0.5 * path.step_m, rate);
                points.push(point(&middle, (index + 0.5) * path.step_m));
            }
            index += 1.0;
        }
        points
    }
}

#[cfg(test)]
mod tests;
