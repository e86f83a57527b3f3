//! Cells of a grid that lies anywhere, moved to the grid of a vehicle without losing an obstacle.

use super::{OCCUPIED_THRESHOLD, Occupancy, UNKNOWN};
use crate::Error;
use crate::geometry::GridSpec;

/// Most that two grids may be apart, in cells, for their cells to count as the same.
pub(super) const ALIGNED_CELLS: f64 = 1e-3;

/// Cells as others store them: the index runs along x first, both axes grow, and the origin is the
/// corner of the first cell.
#[derive(Debug)]
pub(crate) struct Source<'a> {
    /// Percentages, or negative for unknown.
    pub(crate) cells: &'a [i8],
    /// Cells along x.
    pub(crate) width: u32,
    /// Cells along y.
    pub(crate) height: u32,
    /// Side of a cell, metres.
    pub(crate) resolution_m: f64,
    /// Corner of the first cell, metres.
    pub(crate) origin_m: (f64, f64),
}

/// For each target cell along one axis, the source cells it overlaps: first and one past the last.
type Overlaps = Vec<(usize, usize)>;

impl Source<'_> {
    /// The same cells on the grid of `spec`: exactly where the two are aligned, else by the worst of
    /// the source cells that a target cell overlaps. What the source does not cover is unknown.
    pub(crate) fn resampled(&self, spec: &GridSpec) -> Occupancy {
        let mut occupancy = Occupancy::filled(*spec, UNKNOWN);
        let along_x = self.overlaps(spec, spec.rows, self.width, (self.origin_m.0, spec.ego_row));
        let along_y = self.overlaps(
            spec,
            spec.cols,
            self.height,
            (self.origin_m.1, spec.ego_col),
        );
        let cols = spec.cols as usize;
        for (line, &(x_from, x_to)) in occupancy.cells.chunks_exact_mut(cols).zip(&along_x) {
            for (cell, &(y_from, y_to)) in line.iter_mut().zip(&along_y) {
                *cell = self.worst_of((x_from, x_to), (y_from, y_to));
            }
        }
        occupancy
    }

    /// The size and place of these cells as a vehicle's grid, if the vehicle stands on them.
    ///
    /// The grid is shifted by up to half a cell, so that the vehicle's origin is a cell's centre.
    ///
    /// # Errors
    /// [`Error::InvalidGrid`] where the vehicle's origin is off the grid.
    pub(crate) fn own_spec(&self) -> Result<GridSpec, Error> {
        let cells_before = |origin_m: f64, cells: u32| {
            let before = libm::floor(-origin_m / self.resolution_m + ALIGNED_CELLS);
            // Comparing in floating point keeps origins at any distance out of the integer range.
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "the guard keeps the value between 0 and the number of cells"
            )]
            let cells_before =
                (before >= 0.0 && before < f64::from(cells)).then_some(before as u32);
            cells_before.ok_or_else(|| Error::InvalidGrid {
                what: format!(
                    "the vehicle's origin is off the grid, which begins at {origin_m} m and has \
                     {cells} cells of {} m",
                    self.resolution_m
                ),
            })
        };
        let spec = GridSpec {
            rows: self.width,
            cols: self.height,
            resolution_m: self.resolution_m,
            ego_row: self.width - 1 - cells_before(self.origin_m.0, self.width)?,
            ego_col: self.height - 1 - cells_before(self.origin_m.1, self.height)?,
        };
        spec.validate()?;
        Ok(spec)
    }

    fn overlaps(
        &self,
        spec: &GridSpec,
        target_cells: u32,
        source_cells: u32,
        (origin_m, ego): (f64, u32),
    ) -> Overlaps {
        let last = f64::from(source_cells);
        (0..target_cells)
            .map(|index| {
                let centre_m = (f64::from(ego) - f64::from(index)) * spec.resolution_m;
                let half_m = spec.resolution_m / 2.0;
                let from = (centre_m - half_m - origin_m) / self.resolution_m;
                let to = (centre_m + half_m - origin_m) / self.resolution_m;
                let from = libm::floor(from + ALIGNED_CELLS).clamp(0.0, last);
                let to = libm::ceil(to - ALIGNED_CELLS).clamp(0.0, last);
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "both are clamped to the number of source cells"
                )]
                (from as usize, to as usize)
            })
            .collect()
    }

    fn worst_of(&self, (x_from, x_to): (usize, usize), (y_from, y_to): (usize, usize)) -> i8 {
        let width = self.width as usize;
        let mut most = UNKNOWN;
        let mut any_unknown = false;
        for y in y_from..y_to {
            for x in x_from..x_to {
                let value = self.cells[y * width + x];
                most = most.max(value);
                any_unknown |= value < 0;
            }
        }
        if most < OCCUPIED_THRESHOLD && any_unknown {
            UNKNOWN
        } else {
            most
        }
    }
}
