//! A lower bound on the turning that is still to come.
//!
//! Let a path of chords lead from a point and a heading θ to a goal, that is into a disc of radius r
//! at distance D, and end in a direction from a set J. Its turns sweep an unbroken range of directions
//! that begins at θ and ends in J and holds the direction of every chord. The displacement from the
//! point into the disc has a direction b within α = asin(r / D) of the bearing β to the disc's centre.
//!
//! - If the chords' directions span less than π, then b, being that of a sum of them, lies between
//!   them, and the sweep passes it: the turns add up to at least |θ − b| + |b − J|, which is at least
//!   (|θ − β| − α)⁺ + (|β − J| − α)⁺.
//! - Else they add up to at least π.
//!
//! They also add up to at least |θ − J|. The bound is the greater of this and the smaller of the two
//! sums. It adds to a bound on length, since cost counts both. Nothing here asks for obstacles or for
//! the angle limit, so it holds on every map and at every speed. It is not consistent (β changes from
//! cell to cell), and need not be: improved states are expanded again.

use std::f64::consts::TAU;

use bytemuck::Zeroable;

use super::goal::Goal;
use crate::action::DIRECTIONS;
use crate::collision::CollisionMap;
use crate::motion::COST_UNITS;

/// What a search knows of the cost still to come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bound {
    /// The Euclidean distance: the paper's `tiev`.
    Euclidean,
    /// That and the turns still to come, with a proof of unreachability on the way: the same cost in
    /// fewer expansions. Where several paths cost the same it may find another one.
    Informed,
}

/// 2π in units of cost, rounded down.
const UNITS_PER_TURN: u64 = 6_588_397;
/// π in units of cost, rounded down.
const HALF_TURN: u32 = 3_294_198;
/// Covers what rounding may add to an angle, in 2⁻³² of a turn.
pub(super) const ROUNDING: u32 = 16;

/// The bound for one goal.
#[derive(Debug)]
pub(super) struct TurnBound {
    /// By direction: its angle in 2⁻³² of a turn.
    angles: [u32; DIRECTIONS],
    /// By direction: the least turn to one that the goal accepts, in units.
    to_goal: [u32; DIRECTIONS],
}

/// What is the same for all directions on a cell.
#[derive(Debug, Clone, Copy, Default, Zeroable)]
pub(super) struct Aim {
    /// Towards the goal, in 2⁻³² of a turn.
    pub(super) bearing: u32,
    /// How far the displacement's direction may lie from the bearing, in 2⁻³² of a turn.
    pub(super) slack: u32,
    /// Least turn from the bearing to a direction that the goal accepts, in units.
    pub(super) rest: u32,
}

impl Aim {
    /// Least turn from an angle, in 2⁻³² of a turn, to the bearing, in units.
    #[inline]
    pub(super) fn least_off(self, angle: u32) -> u32 {
        let off = angle.wrapping_sub(self.bearing);
        let off = off.min(off.wrapping_neg()).saturating_sub(self.slack);
        ((u64::from(off) * UNITS_PER_TURN) >> u32::BITS) as u32
    }
}

impl TurnBound {
    pub(super) fn new(map: &CollisionMap, goal: &Goal) -> Self {
        let table = map.model().table();
        let mut bound = Self {
            angles: [0; DIRECTIONS],
            to_goal: [0; DIRECTIONS],
        };
        for direction in 0..=u8::MAX {
            let angle_rad = table.angle_rad(direction);
            bound.angles[usize::from(direction)] = parts_of_turn(angle_rad);
            bound.to_goal[usize::from(direction)] = units(goal.turn_left_rad(angle_rad));
        }
        bound
    }

    /// What all directions on a cell share.
    pub(super) fn aim(goal: &Goal, point_m: (f64, f64)) -> Aim {
        let Some((bearing_rad, slack_rad)) = goal.bearing(point_m) else {
            // Within the tolerance any direction may be that of the displacement.
            return Aim {
                bearing: 0,
                slack: u32::MAX,
                rest: 0,
            };
        };
        Aim {
            bearing: parts_of_turn(bearing_rad),
            slack: parts_of_turn(slack_rad).saturating_add(ROUNDING),
            rest: units(goal.turn_left_rad(bearing_rad) - slack_rad),
        }
    }

    /// Least turn on the way from a cell and a direction to the goal, in units.
    #[inline]
    pub(super) fn least_turn(&self, aim: Aim, direction: u8) -> u32 {
        (aim.least_off(self.angles[usize::from(direction)]) + aim.rest)
            .min(HALF_TURN)
            .max(self.to_goal[usize::from(direction)])
    }
}

/// An angle in 2⁻³² of a turn.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the remainder is less than 2^32"
)]
pub(super) fn parts_of_turn(angle_rad: f64) -> u32 {
    let turns = angle_rad / TAU;
    ((turns - libm::floor(turns)) * 4_294_967_296.0) as u64 as u32
}

/// An angle in units of cost, rounded down.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a cast saturates, and less than nothing is nothing"
)]
fn units(angle_rad: f64) -> u32 {
    libm::floor(angle_rad * COST_UNITS) as u32
}
