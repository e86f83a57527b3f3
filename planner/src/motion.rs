//! How the vehicle moves over cells: the lookup table with the cells that each motion sweeps, and
//! which turns its speed allows.

mod arrivals;
mod corridors;
mod successors;

use std::f64::consts::{PI, TAU};

use swath_bridge::Vehicle;

use crate::Error;
use crate::action::{Action, ActionTable};
use crate::kernel::Kernel;

pub(crate) use arrivals::{ArrivalBlock, Arrivals, BLOCK, BLOCK_BITS, BLOCKS};
pub(crate) use corridors::{Corridors, SECTORS};
pub(crate) use successors::Fan;
pub use successors::Successors;

/// Costs are counted in units of 2⁻²⁰ (about a micrometre), so that sums are exact.
pub(crate) const COST_UNITS: f64 = 1_048_576.0;

/// The lookup table of one vehicle at one resolution, with the cells that each motion sweeps.
///
/// It is built once (some ten milliseconds) and shared by all maps.
#[derive(Debug)]
pub struct MotionModel {
    pub(crate) table: ActionTable,
    pub(crate) vehicle: Vehicle,
    pub(crate) resolution_m: f64,
    /// Cells of the footprint at rest, by direction.
    pub(crate) poses: Vec<Kernel>,
    /// Cells swept by each action, which is driven in its own direction.
    pub(crate) chords: Vec<Kernel>,
    /// Cells swept by turning on the spot from each direction to the next one counter-clockwise.
    pub(crate) turns: Vec<Kernel>,
    /// What straight drives leave free beside them.
    pub(crate) corridors: Corridors,
    /// Farthest row or column that any of these touches, cells from its start.
    pub(crate) reach_cells: usize,
}

impl MotionModel {
    /// Builds the model of a vehicle on cells of `resolution_m`.
    ///
    /// # Errors
    /// [`Error::Bridge`] for dimensions that are no vehicle's, [`Error::Resolution`] when the
    /// vehicle would span too many cells.
    pub fn new(vehicle: &Vehicle, resolution_m: f64) -> Result<Self, Error> {
        vehicle.validate()?;
        let longest_m = vehicle.front_m.max(vehicle.rear_m) + vehicle.half_width_m;
        if !(resolution_m > 0.0 && longest_m / resolution_m <= 400.0) {
            return Err(Error::Resolution {
                resolution_m,
                vehicle_m: longest_m,
            });
        }
        let table = ActionTable::new();
        let chord = |action: &Action| {
            let heading = table.angle_rad(action.direction);
            Kernel::of_chord(
                vehicle,
                resolution_m,
                heading,
                action.length_cells * resolution_m,
            )
        };
        let turn = |direction: u8| {
            let from = table.angle_rad(direction);
            let to = table.angle_rad(direction.wrapping_add(1));
            Kernel::of_turn(vehicle, resolution_m, from, angle_between_rad(from, to))
        };
        let pose = |direction: u8| {
            Kernel::of_chord(vehicle, resolution_m, table.angle_rad(direction), 0.0)
        };
        let poses: Vec<Kernel> = (0..=u8::MAX).map(pose).collect();
        let chords: Vec<Kernel> = table.actions().iter().map(chord).collect();
        let turns: Vec<Kernel> = (0..=u8::MAX).map(turn).collect();
        let kernels = poses.iter().chain(&chords).chain(&turns);
        let reach_cells = kernels.map(Kernel::reach_cells).max().unwrap_or(0);
        Ok(Self {
            reach_cells: usize::try_from(reach_cells).unwrap_or(0),
            poses,
            chords,
            turns,
            corridors: Corridors::new(vehicle, resolution_m, &table),
            vehicle: *vehicle,
            resolution_m,
            table,
        })
    }

    /// A model that knows no cells, for tests of what follows what.
    #[cfg(test)]
    fn without_kernels(vehicle: &Vehicle, resolution_m: f64) -> Self {
        Self {
            poses: Vec::new(),
            chords: Vec::new(),
            turns: Vec::new(),
            corridors: Corridors::default(),
            reach_cells: 0,
            table: ActionTable::new(),
            vehicle: *vehicle,
            resolution_m,
        }
    }

    /// The vehicle.
    pub const fn vehicle(&self) -> &Vehicle {
        &self.vehicle
    }

    /// Side of a cell, metres.
    pub const fn resolution_m(&self) -> f64 {
        self.resolution_m
    }

    /// The lookup table.
    pub const fn table(&self) -> &ActionTable {
        &self.table
    }

    /// The actions that may follow each direction at a speed.
    pub fn successors(&self, speed_m_per_s: f64) -> Successors {
        Successors::new(self, speed_m_per_s)
    }

    /// The paper's angle limit: curvature times the mean length of the two actions, radians.
    ///
    /// The action that led to a heading is not part of a state; its length is taken to be that of the
    /// shortest action in this direction, so that no turn is tighter than the rule allows.
    fn angle_limit_rad(&self, heading: u8, action: &Action, curvature_per_m: f64) -> f64 {
        let mean_cells = 0.5 * (self.table.shortest_cells(heading) + action.length_cells);
        curvature_per_m * mean_cells * self.resolution_m
    }

    /// The turn from one direction to another, radians in (−π, π].
    pub(crate) fn turn_rad(&self, from: u8, to: u8) -> f64 {
        let turn = angle_between_rad(self.table.angle_rad(from), self.table.angle_rad(to));
        if turn > PI { turn - TAU } else { turn }
    }
}

/// The counter-clockwise angle from one heading to another, radians in [0, 2π).
fn angle_between_rad(from_rad: f64, to_rad: f64) -> f64 {
    let angle = to_rad - from_rad;
    if angle < 0.0 { angle + TAU } else { angle }
}

/// A cost in metres and radians as a count of units.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "costs are positive, and a cast saturates"
)]
pub(crate) fn cost_units(cost: f64) -> u32 {
    libm::round(cost * COST_UNITS) as u32
}

/// To which side a turn goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Side {
    Left,
    Right,
}

impl Side {
    /// The direction that lies `steps` directions to this side.
    pub(crate) const fn turned(self, direction: u8, steps: u8) -> u8 {
        match self {
            Self::Left => direction.wrapping_add(steps),
            Self::Right => direction.wrapping_sub(steps),
        }
    }

    /// The elementary turn, named by the direction that it starts from counter-clockwise, which
    /// follows `turned` turns out of a heading.
    pub(crate) const fn passed(self, heading: u8, turned: u8) -> u8 {
        match self {
            Self::Left => heading.wrapping_add(turned),
            Self::Right => heading.wrapping_sub(turned).wrapping_sub(1),
        }
    }
}
