//! Which states count as having reached a goal, and how far it is to them.

use std::f64::consts::{FRAC_1_SQRT_2, PI};

use swath_bridge::geometry::wrap_angle_rad;
use swath_bridge::{Cell, Outcome, Pose2};

use super::memory::State;
use crate::action::AHEAD;
use crate::collision::CollisionMap;
use crate::tolerance::{GoalTolerance, Target};

/// Half of the widest angle between two neighbouring directions, radians (2.86°), rounded up: some
/// direction lies this near to any heading.
const NEAREST_DIRECTION_RAD: f64 = 0.05;
/// Some cell's centre lies this near to any point, in sides of a cell.
const NEAREST_CELL: f64 = FRAC_1_SQRT_2 + 1e-9;

/// What is kept of the tolerance where poses are not those of cells, metres and radians: a path that is
/// driven again from its segments may end this much elsewhere.
const KEPT: f64 = 1e-3;

/// The states that reach a goal.
#[derive(Debug, Clone)]
pub(crate) struct Goal {
    x_m: f64,
    y_m: f64,
    yaw_rad: f64,
    /// How near a pose has to be.
    tolerance: GoalTolerance,
    /// How near the states that are accepted are: as the tolerance says, but never so near that there is
    /// none.
    states_within: GoalTolerance,
    /// Row-major indices, ascending.
    cells: Vec<usize>,
    /// By direction.
    directions: Vec<bool>,
}

impl Goal {
    /// The goal at a pose, or the outcome that no search is needed for.
    pub(crate) fn new(map: &CollisionMap, target: impl Into<Target>) -> Result<Self, Outcome> {
        let Target { pose, tolerance } = target.into();
        let spec = map.spec();
        let within = GoalTolerance {
            tolerance_m: tolerance.tolerance_m.max(NEAREST_CELL * spec.resolution_m),
            tolerance_rad: tolerance.tolerance_rad.max(NEAREST_DIRECTION_RAD),
        };
        let within_m = within.tolerance_m;
        let centre = spec.cell_at(pose.x_m, pose.y_m);
        if !pose.is_finite() || spec.index_of(centre).is_none() {
            return Err(Outcome::OutOfBounds);
        }
        if !map.state_is_free(spec.ego(), AHEAD) {
            return Err(Outcome::StartOccupied);
        }
        let table = map.model().table();
        let directions: Vec<bool> = (0..=u8::MAX)
            .map(|direction| {
                let turn = wrap_angle_rad(table.angle_rad(direction) - pose.yaw_rad);
                turn.abs() <= within.tolerance_rad
            })
            .collect();
        let near = spec.cell_at(pose.x_m - within_m, pose.y_m - within_m);
        let far = spec.cell_at(pose.x_m + within_m, pose.y_m + within_m);
        let mut cells = Vec::new();
        let mut is_free = false;
        for row in far.row..=near.row {
            for col in far.col..=near.col {
                let cell = Cell::new(row, col);
                let (x_m, y_m) = spec.centre_of(cell);
                let distance_m = libm::hypot(x_m - pose.x_m, y_m - pose.y_m);
                let Some(index) = spec.index_of(cell).filter(|_| distance_m <= within_m) else {
                    continue;
                };
                cells.push(index);
                is_free |=
                    (0..=u8::MAX).any(|d| directions[usize::from(d)] && map.state_is_free(cell, d));
            }
        }
        if is_free {
            Ok(Self {
                x_m: pose.x_m,
                y_m: pose.y_m,
                yaw_rad: pose.yaw_rad,
                tolerance,
                states_within: within,
                cells,
                directions,
            })
        } else {
            Err(Outcome::GoalOccupied)
        }
    }

    /// Cells on which it can be reached, row-major indices, ascending.
    pub(crate) fn cells(&self) -> &[usize] {
        &self.cells
    }

    pub(super) fn accepts(&self, state: State) -> bool {
        self.directions[usize::from(state.direction())]
            && self.cells.binary_search(&state.cell()).is_ok()
    }

    /// Whether a pose anywhere in the plane reaches it.
    pub(crate) fn accepts_pose(&self, pose: &Pose2) -> bool {
        let (dx_m, dy_m) = (pose.x_m - self.x_m, pose.y_m - self.y_m);
        libm::hypot(dx_m, dy_m) <= self.tolerance.tolerance_m - KEPT
            && wrap_angle_rad(pose.yaw_rad - self.yaw_rad).abs()
                <= self.tolerance.tolerance_rad - KEPT
    }

    /// How near a pose has to be.
    pub(crate) const fn tolerance(&self) -> GoalTolerance {
        self.tolerance
    }

    /// The goal's own pose.
    pub(crate) const fn pose(&self) -> Pose2 {
        Pose2::new(self.x_m, self.y_m, self.yaw_rad)
    }

    /// Least turn on the way from a pose to the goal, radians, as `bound` has it for chords: a curve is
    /// made of ever shorter ones.
    pub(crate) fn least_turn_rad(&self, pose: &Pose2) -> f64 {
        let direct_rad = self.turn_left_rad(pose.yaw_rad);
        let Some((bearing_rad, slack_rad)) = self.bearing((pose.x_m, pose.y_m)) else {
            return direct_rad;
        };
        let first_rad = (wrap_angle_rad(bearing_rad - pose.yaw_rad).abs() - slack_rad).max(0.0);
        let then_rad = (self.turn_left_rad(bearing_rad) - slack_rad).max(0.0);
        (first_rad + then_rad).min(PI).max(direct_rad)
    }

    /// The states that reach it.
    pub(super) fn states(&self) -> impl Iterator<Item = State> {
        let directions = move |&cell: &usize| {
            (0..=u8::MAX)
                .filter(|&direction| self.directions[usize::from(direction)])
                .map(move |direction| State::new(cell, direction))
        };
        self.cells.iter().flat_map(directions)
    }

    /// Least turn from an angle to one that the tolerance accepts, radians.
    pub(crate) fn turn_left_rad(&self, angle_rad: f64) -> f64 {
        let turn_rad = wrap_angle_rad(angle_rad - self.yaw_rad).abs();
        // The direction that is accepted at the very edge may be off by rounding.
        (turn_rad - self.states_within.tolerance_rad - 1e-9).max(0.0)
    }

    /// The bearing from a point to the goal, and how far to either side the bearings of points within
    /// the tolerance lie, radians. There is none from a point within it.
    pub(crate) fn bearing(&self, (x_m, y_m): (f64, f64)) -> Option<(f64, f64)> {
        let (dx_m, dy_m) = (self.x_m - x_m, self.y_m - y_m);
        let sine = self.states_within.tolerance_m / libm::hypot(dx_m, dy_m);
        (sine < 1.0).then(|| (libm::atan2(dy_m, dx_m), libm::asin(sine)))
    }

    /// Euclidean distance from a point to the nearest one that the tolerance accepts, metres.
    pub(crate) fn distance_left(&self, (x_m, y_m): (f64, f64)) -> f64 {
        (libm::hypot(x_m - self.x_m, y_m - self.y_m) - self.states_within.tolerance_m).max(0.0)
    }
}
