//! What makes one path better than another, and how its cost changes with each state.

use std::f64::consts::TAU;

use swath_bridge::Pose2;

use super::clothoid::State;
use super::footprint::Footprint;
use super::obstacles::ScaledCells;
use super::reference::Place;
use crate::tolerance::GoalTolerance;

/// The goal counts as missed by what lies beyond this share of the tolerance, so that the end lies well
/// within it.
const AIM_WITHIN: f64 = 0.8;
/// Cells are kept for a state as long as it moves no farther than this, metres at the rectangle's
/// farthest corner.
const KEPT_FOR_M: f64 = 0.3;

/// A turn by one radian counts as a move of so many metres.
const TURNED_M: f64 = 2.0;

/// What a path is judged by. All but the goal's are per metre of path.
#[derive(Debug, Clone, Copy)]
pub(super) struct Weights {
    /// Curvature, squared.
    pub(super) bend: f64,
    /// Change of curvature, squared.
    pub(super) steer: f64,
    /// Distance aside from the chords, squared.
    pub(super) stray: f64,
    /// Length, once.
    pub(super) length: f64,
    /// Missing metres of the gap that is preferred, squared, for each cell.
    pub(super) near: f64,
    pub(super) preferred_gap_m: f64,
    /// The same of the gap that is needed.
    pub(super) contact: f64,
    pub(super) needed_gap_m: f64,
    /// Metres and radians beyond what the goal allows, squared.
    pub(super) goal: f64,
    /// Metres from the goal, squared, and radians.
    pub(super) off_goal: f64,
    pub(super) turned_from_goal: f64,
}

/// A cost with its gradient and Hessian (Gauss-Newton) by x, y, heading, curvature and step length.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Expansion {
    pub(super) gradient: [f64; 5],
    pub(super) hessian: [[f64; 5]; 5],
}

impl Expansion {
    /// Makes every change of the pose cost.
    pub(super) fn damp(&mut self, weight: f64) {
        self.hessian[0][0] += weight;
        self.hessian[1][1] += weight;
        self.hessian[2][2] += weight * TURNED_M * TURNED_M;
    }

    /// Adds `weight / 2 · residual²`.
    fn add(&mut self, weight: f64, residual: f64, by_pose: [f64; 3]) {
        for (row, &slope) in by_pose.iter().enumerate() {
            let scaled = weight * slope;
            self.gradient[row] += scaled * residual;
            for (col, &other) in by_pose.iter().enumerate() {
                self.hessian[row][col] += scaled * other;
            }
        }
    }
}

/// The border cells near each state.
#[derive(Debug, Default)]
pub(super) struct Nearby {
    centres: Vec<(f64, f64)>,
    /// For each state the end of its cells.
    ends: Vec<usize>,
    gathered_at: Vec<State>,
}

impl Nearby {
    /// Gathers the cells again if a state has moved too far since.
    pub(super) fn update(
        &mut self,
        cells: &ScaledCells<'_>,
        footprint: &Footprint,
        states: &[State],
        (within_m, anew): (f64, bool),
    ) {
        let has_moved = |(state, from): (&State, &State)| {
            let moved_m = libm::hypot(state.x_m - from.x_m, state.y_m - from.y_m);
            let turned_m = (state.yaw_rad - from.yaw_rad).abs() * footprint.reach_m;
            moved_m + turned_m > KEPT_FOR_M
        };
        if !anew && !states.iter().zip(&self.gathered_at).any(has_moved) {
            return;
        }
        self.centres.clear();
        self.ends.clear();
        self.gathered_at.clear();
        for state in states {
            let placed = footprint.placed(&state.pose());
            cells.each_near(&placed, within_m + KEPT_FOR_M, |centre| {
                self.centres.push(centre);
            });
            self.ends.push(self.centres.len());
            self.gathered_at.push(*state);
        }
    }

    fn of(&self, index: usize) -> &[(f64, f64)] {
        let from = if index == 0 { 0 } else { self.ends[index - 1] };
        &self.centres[from..self.ends[index]]
    }
}

/// Everything that the cost of one path depends on beside the path.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cost<'a> {
    pub(super) weights: Weights,
    pub(super) footprint: &'a Footprint,
    pub(super) places: &'a [Place],
    /// For each state the number of its place.
    pub(super) place_of: &'a [usize],
    pub(super) nearby: &'a Nearby,
    pub(super) goal: Pose2,
    pub(super) tolerance: GoalTolerance,
    /// Nominal distance between states, metres.
    pub(super) step_m: f64,
}

impl Cost<'_> {
    /// The cost of a path.
    pub(super) fn of(&self, states: &[State], rates: &[f64], step_m: f64) -> f64 {
        let mut sum = 0.0;
        for (index, state) in states.iter().enumerate() {
            sum += self.of_state(index, state, None);
        }
        let steering: f64 = rates.iter().map(|rate| rate * rate).sum();
        sum += 0.5 * self.step_m * self.weights.steer * steering;
        if let Some(last) = states.last() {
            sum += self.of_end(last, None);
        }
        sum + self.weights.length * step_m * rates.len() as f64
    }

    /// The cost of being in a state; what is given is added to.
    pub(super) fn of_state(
        &self,
        index: usize,
        state: &State,
        mut expansion: Option<&mut Expansion>,
    ) -> f64 {
        let weights = &self.weights;
        let bend = self.step_m * weights.bend;
        let curvature = state.curvature_per_m;
        let mut cost = 0.5 * bend * curvature * curvature;
        if let Some(expansion) = expansion.as_deref_mut() {
            expansion.gradient[3] += bend * curvature;
            expansion.hessian[3][3] += bend;
        }
        let place = &self.places[self.place_of[index]];
        let aside_m = place.cos * (state.y_m - place.y_m) - place.sin * (state.x_m - place.x_m);
        let stray = self.step_m * weights.stray;
        cost += 0.5 * stray * aside_m * aside_m;
        if let Some(expansion) = expansion.as_deref_mut() {
            expansion.add(stray, aside_m, [-place.sin, place.cos, 0.0]);
        }
        cost + self.of_gaps(index, state, expansion)
    }

    fn of_gaps(&self, index: usize, state: &State, mut expansion: Option<&mut Expansion>) -> f64 {
        let centres = self.nearby.of(index);
        if centres.is_empty() {
            return 0.0;
        }
        let weights = &self.weights;
        let (near, contact) = (self.step_m * weights.near, self.step_m * weights.contact);
        let sincos = libm::sincos(state.yaw_rad);
        let placed = self.footprint.placed_by((state.x_m, state.y_m), sincos);
        let mut cost = 0.0;
        for &centre in centres {
            let beside = placed.beside(centre, self.step_m);
            let missing_m = weights.preferred_gap_m - beside.gap_m;
            if missing_m <= 0.0 || beside.share == 0.0 {
                continue;
            }
            let urgent_m = (missing_m - weights.preferred_gap_m + weights.needed_gap_m).max(0.0);
            let (near, contact) = (beside.share * near, beside.share * contact);
            cost += 0.5 * (near * missing_m * missing_m + contact * urgent_m * urgent_m);
            if let Some(expansion) = expansion.as_deref_mut() {
                let by_pose = placed.beside_by_pose(&beside).map(|slope| -slope);
                expansion.add(near, missing_m, by_pose);
                if urgent_m > 0.0 {
                    expansion.add(contact, urgent_m, by_pose);
                }
            }
        }
        cost
    }

    /// The cost of ending in a state.
    pub(super) fn of_end(&self, last: &State, expansion: Option<&mut Expansion>) -> f64 {
        let goal = &self.goal;
        let (dx, dy) = (last.x_m - goal.x_m, last.y_m - goal.y_m);
        let distance_m = libm::hypot(dx, dy);
        let far_m = (distance_m - AIM_WITHIN * self.tolerance.tolerance_m).max(0.0);
        // The goal's heading, counted through as many turns as the path has made.
        let turns = libm::round((last.yaw_rad - goal.yaw_rad) / TAU);
        let turned_rad = last.yaw_rad - goal.yaw_rad - turns * TAU;
        let far_rad = (turned_rad.abs() - AIM_WITHIN * self.tolerance.tolerance_rad).max(0.0);
        let weight = self.weights.goal;
        let off = self.weights.off_goal;
        let turned = self.weights.turned_from_goal;
        if let Some(expansion) = expansion {
            expansion.add(off, dx, [1.0, 0.0, 0.0]);
            expansion.add(off, dy, [0.0, 1.0, 0.0]);
            expansion.add(turned, turned_rad, [0.0, 0.0, 1.0]);
            if far_m > 0.0 {
                expansion.add(weight, far_m, [dx / distance_m, dy / distance_m, 0.0]);
            }
            if far_rad > 0.0 {
                expansion.add(weight, far_rad, [0.0, 0.0, turned_rad.signum()]);
            }
        }
        0.5 * weight * (far_m * far_m + far_rad * far_rad)
            + 0.5 * (off * distance_m * distance_m + turned * turned_rad * turned_rad)
    }
}
