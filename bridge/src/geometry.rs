//! Frames, cells and the one place where they are converted into each other.
//!
//! Vehicle frame: origin in the middle of the rear axle, x forward, y left, radians
//! counter-clockwise (REP 103). A grid lies on it with row 0 farthest ahead and column 0 farthest
//! left, so that a picture of it has the vehicle heading up. A cell is the square around its centre.

use serde::{Deserialize, Serialize};

use crate::Error;

/// Most cells a grid may have along one side.
pub const MAX_GRID_SIDE_CELLS: u32 = 4096;

/// A pose in the plane.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pose2 {
    /// Forward, metres.
    pub x_m: f64,
    /// Left, metres.
    pub y_m: f64,
    /// Counter-clockwise from x, radians.
    pub yaw_rad: f64,
}

impl Pose2 {
    /// The pose at (`x_m`, `y_m`) heading `yaw_rad`.
    pub const fn new(x_m: f64, y_m: f64, yaw_rad: f64) -> Self {
        Self { x_m, y_m, yaw_rad }
    }

    /// Whether every component is finite.
    pub fn is_finite(&self) -> bool {
        self.x_m.is_finite() && self.y_m.is_finite() && self.yaw_rad.is_finite()
    }

    /// Euclidean distance between the two positions, metres.
    pub fn distance_m(&self, other: &Self) -> f64 {
        libm::hypot(self.x_m - other.x_m, self.y_m - other.y_m)
    }

    /// `a_from_b.then(b_from_c)` is `a_from_c`: transforms and poses compose the same way.
    #[must_use]
    pub fn then(&self, b_from_c: &Self) -> Self {
        let (sin, cos) = libm::sincos(self.yaw_rad);
        Self {
            x_m: self.x_m + cos * b_from_c.x_m - sin * b_from_c.y_m,
            y_m: self.y_m + sin * b_from_c.x_m + cos * b_from_c.y_m,
            yaw_rad: wrap_angle_rad(self.yaw_rad + b_from_c.yaw_rad),
        }
    }

    /// `a_from_b.inverse()` is `b_from_a`.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let (sin, cos) = libm::sincos(self.yaw_rad);
        Self {
            x_m: -(cos * self.x_m + sin * self.y_m),
            y_m: sin * self.x_m - cos * self.y_m,
            yaw_rad: wrap_angle_rad(-self.yaw_rad),
        }
    }
}

/// The same angle in (−π, π], radians.
pub fn wrap_angle_rad(angle_rad: f64) -> f64 {
    use std::f64::consts::{PI, TAU};
    if angle_rad > -PI && angle_rad <= PI {
        return angle_rad;
    }
    let wrapped = angle_rad - TAU * libm::floor((angle_rad + PI) / TAU);
    if wrapped <= -PI { PI } else { wrapped }
}

/// A cell by its row (0 is farthest ahead) and column (0 is farthest left). It may lie off the grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Cell {
    /// Rows grow backwards.
    pub row: i32,
    /// Columns grow to the right.
    pub col: i32,
}

impl Cell {
    /// The cell at (`row`, `col`).
    pub const fn new(row: i32, col: i32) -> Self {
        Self { row, col }
    }
}

/// The size of a grid and where the vehicle stands on it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GridSpec {
    /// Rows, along x.
    pub rows: u32,
    /// Columns, along y.
    pub cols: u32,
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// Row of the cell whose centre is the vehicle's origin.
    pub ego_row: u32,
    /// Column of the cell whose centre is the vehicle's origin.
    pub ego_col: u32,
}

impl Default for GridSpec {
    /// 60 m ahead, 20 m behind, 15 m to each side in cells of 0.2 m: the size of the paper's vehicle.
    fn default() -> Self {
        Self {
            rows: 401,
            cols: 151,
            resolution_m: 0.2,
            ego_row: 300,
            ego_col: 75,
        }
    }
}

impl GridSpec {
    /// Checks that the sizes can be worked with.
    ///
    /// # Errors
    /// [`Error::InvalidGrid`] names the field that is out of range.
    pub fn validate(&self) -> Result<(), Error> {
        let invalid = |what: String| Err(Error::InvalidGrid { what });
        for (field, cells) in [("rows", self.rows), ("cols", self.cols)] {
            if !(1..=MAX_GRID_SIDE_CELLS).contains(&cells) {
                return invalid(format!(
                    "{field} is {cells}, expected 1 to {MAX_GRID_SIDE_CELLS}"
                ));
            }
        }
        if !(self.resolution_m >= 0.01 && self.resolution_m <= 10.0) {
            return invalid(format!(
                "resolution_m is {}, expected 0.01 to 10",
                self.resolution_m
            ));
        }
        for (field, cell, side) in [
            ("ego_row", self.ego_row, self.rows),
            ("ego_col", self.ego_col, self.cols),
        ] {
            if cell >= side {
                let last = side - 1;
                return invalid(format!(
                    "{field} is {cell}, expected 0 to {last}: the vehicle stands on the grid"
                ));
            }
        }
        Ok(())
    }

    /// Number of cells.
    pub const fn len(&self) -> usize {
        self.rows as usize * self.cols as usize
    }

    /// Whether there are no cells.
    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The cell under the vehicle's origin.
    #[expect(
        clippy::cast_possible_wrap,
        reason = "validate() keeps sides at or below 4096"
    )]
    pub const fn ego(&self) -> Cell {
        Cell::new(self.ego_row as i32, self.ego_col as i32)
    }

    /// The cell whose square holds the point (metres, vehicle frame), whether on the grid or not.
    ///
    /// Coordinates beyond the range of a cell number saturate, so they stay off the grid.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "float to integer casts saturate"
    )]
    pub fn cell_at(&self, x_m: f64, y_m: f64) -> Cell {
        let ego = self.ego();
        let row = libm::floor(f64::from(ego.row) - x_m / self.resolution_m + 0.5);
        let col = libm::floor(f64::from(ego.col) - y_m / self.resolution_m + 0.5);
        Cell::new(row as i32, col as i32)
    }

    /// The centre of a cell: (x, y) in metres, vehicle frame.
    pub fn centre_of(&self, cell: Cell) -> (f64, f64) {
        let ego = self.ego();
        (
            f64::from(ego.row - cell.row) * self.resolution_m,
            f64::from(ego.col - cell.col) * self.resolution_m,
        )
    }

    /// Row-major index of a cell, or `None` off the grid.
    #[expect(clippy::cast_sign_loss, reason = "negative numbers are excluded first")]
    pub const fn index_of(&self, cell: Cell) -> Option<usize> {
        if cell.row < 0 || cell.col < 0 {
            return None;
        }
        let (row, col) = (cell.row as u32, cell.col as u32);
        if row >= self.rows || col >= self.cols {
            return None;
        }
        Some(row as usize * self.cols as usize + col as usize)
    }

    /// The cell of a row-major index below [`Self::len`].
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        reason = "validate() keeps sides at or below 4096"
    )]
    pub const fn cell_of_index(&self, index: usize) -> Cell {
        let cols = self.cols as usize;
        Cell::new((index / cols) as i32, (index % cols) as i32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_ego_cell_is_the_origin_and_up_is_forward() {
        let spec = GridSpec::default();
        assert_eq!(spec.cell_at(0.0, 0.0), Cell::new(300, 75));
        assert_eq!(spec.centre_of(Cell::new(0, 0)), (60.0, 15.0));
        assert_eq!(spec.cell_at(0.09, -0.11), Cell::new(300, 76));
        assert_eq!(spec.index_of(Cell::new(401, 0)), None);
        assert_eq!(spec.index_of(spec.cell_at(f64::INFINITY, f64::NAN)), None);
    }

    proptest! {
        #[test]
        fn centres_map_back_to_their_cells(row in -50i32..500, col in -50i32..300) {
            let spec = GridSpec::default();
            let (x_m, y_m) = spec.centre_of(Cell::new(row, col));
            prop_assert_eq!(spec.cell_at(x_m, y_m), Cell::new(row, col));
        }

        #[test]
        fn a_pose_and_its_inverse_cancel(x in -50.0..50.0f64, y in -50.0..50.0f64, yaw in -3.1..3.1f64) {
            let pose = Pose2::new(x, y, yaw);
            let identity = pose.then(&pose.inverse());
            prop_assert!(identity.distance_m(&Pose2::default()) < 1e-9);
            prop_assert!(identity.yaw_rad.abs() < 1e-9);
        }

        #[test]
        fn wrapped_angles_are_the_same_angle(angle in -100.0..100.0f64) {
            let wrapped = wrap_angle_rad(angle);
            prop_assert!(wrapped > -std::f64::consts::PI && wrapped <= std::f64::consts::PI);
            prop_assert!((libm::sin(wrapped) - libm::sin(angle)).abs() < 1e-9);
            prop_assert!((libm::cos(wrapped) - libm::cos(angle)).abs() < 1e-9);
        }
    }
}
