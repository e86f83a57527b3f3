//! Occupancy by cell, and its form outside: `nav_msgs/OccupancyGrid`.

mod message;
mod resample;
mod turned;

pub use message::GridFault;
pub(crate) use resample::Source;

use crate::geometry::{Cell, GridSpec};

/// A cell that is known to be free.
pub const FREE: i8 = 0;
/// A cell that is known to be occupied.
pub const OCCUPIED: i8 = 100;
/// A cell that nothing is known of.
pub const UNKNOWN: i8 = -1;
/// Least percentage that counts as occupied unless a configuration says otherwise.
pub const OCCUPIED_THRESHOLD: i8 = 50;

/// What is known of each cell of a grid in the vehicle frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Occupancy {
    /// Size and place.
    pub spec: GridSpec,
    /// Row-major; [`FREE`], [`OCCUPIED`], [`UNKNOWN`] or a percentage between the first two.
    pub cells: Vec<i8>,
}

impl Occupancy {
    /// A grid whose cells all hold `value`.
    pub fn filled(spec: GridSpec, value: i8) -> Self {
        Self {
            spec,
            cells: vec![value; spec.len()],
        }
    }

    /// The value of a cell, or `None` off the grid.
    pub fn get(&self, cell: Cell) -> Option<i8> {
        self.spec.index_of(cell).map(|index| self.cells[index])
    }

    /// Sets a cell; off the grid this does nothing.
    pub fn set(&mut self, cell: Cell, value: i8) {
        if let Some(index) = self.spec.index_of(cell) {
            self.cells[index] = value;
        }
    }
}
