//! Cells of a grid that is turned against a vehicle's, moved to that without losing an obstacle.
//!
//! A target cell counts as overlapping a source cell if the two squares do, which is decided exactly: two
//! convex shapes are apart just if they are apart along an axis of one of them. Most cells are free, so the
//! target cells that the source covers are found first, and then only source cells that are occupied or
//! unknown are looked at.

use super::resample::{ALIGNED_CELLS, Source};
use super::{FREE, OCCUPIED_THRESHOLD, Occupancy, UNKNOWN};
use crate::geometry::{GridSpec, Pose2};

/// Source cells as seen from the target grid. Lengths are in target cells; the axes u and v point along
/// the target's rows and columns.
#[derive(Debug)]
struct Seen<'a> {
    source: &'a Source<'a>,
    spec: &'a GridSpec,
    sin: f64,
    cos: f64,
    /// Corner of the first source cell.
    corner: Point,
    /// Side of a source cell.
    side: f64,
}

#[derive(Debug, Clone, Copy)]
struct Point {
    u: f64,
    v: f64,
}

impl Source<'_> {
    /// The same cells on the grid of `spec`, by the worst of the source cells that a target cell overlaps.
    /// What the source does not cover is unknown. `vehicle_from_source` is the pose of the corner of the
    /// first source cell; [`Source::origin_m`] is not used.
    pub(crate) fn turned(&self, spec: &GridSpec, vehicle_from_source: &Pose2) -> Occupancy {
        let (sin, cos) = libm::sincos(vehicle_from_source.yaw_rad);
        let seen = Seen {
            source: self,
            spec,
            sin,
            cos,
            // Row and column numbers grow against x and y.
            corner: Point {
                u: f64::from(spec.ego_row) - vehicle_from_source.x_m / spec.resolution_m,
                v: f64::from(spec.ego_col) - vehicle_from_source.y_m / spec.resolution_m,
            },
            side: self.resolution_m / spec.resolution_m,
        };
        let mut occupancy = Occupancy::filled(*spec, UNKNOWN);
        seen.mark_covered(&mut occupancy);
        // The worst of all known cells first: unknown ones then only hide what is not occupied.
        seen.each_overlap(
            &mut occupancy,
            |value| value > FREE,
            |cell, value| {
                *cell = (*cell).max(value);
            },
        );
        seen.each_overlap(
            &mut occupancy,
            |value| value < FREE,
            |cell, _| {
                if *cell < OCCUPIED_THRESHOLD {
                    *cell = UNKNOWN;
                }
            },
        );
        occupancy
    }
}

impl Seen<'_> {
    /// The place of a point of the source, which is in source cells from its corner.
    fn place(&self, x: f64, y: f64) -> Point {
        let (x, y) = (x * self.side, y * self.side);
        Point {
            u: self.corner.u - (self.cos * x - self.sin * y),
            v: self.corner.v - (self.sin * x + self.cos * y),
        }
    }

    /// Whether a target cell overlaps a rectangle of the source, given by its middle and half sides: as far
    /// as the source's axes tell.
    fn overlaps(&self, row: usize, col: usize, middle: Point, half: Point) -> bool {
        let (du, dv) = (row as f64 - middle.u, col as f64 - middle.v);
        let cell = f64::midpoint(self.sin.abs(), self.cos.abs()) - ALIGNED_CELLS;
        (self.cos * du + self.sin * dv).abs() < half.u + cell
            && (self.cos * dv - self.sin * du).abs() < half.v + cell
    }

    /// Rows and columns of the target cells that may overlap a rectangle: all that do as far as the
    /// target's axes tell.
    fn around(
        &self,
        middle: Point,
        half: Point,
    ) -> (std::ops::Range<usize>, std::ops::Range<usize>) {
        let (sin, cos) = (self.sin.abs(), self.cos.abs());
        let along = |at: f64, half: f64, cells: u32| {
            let reach = half + 0.5 - ALIGNED_CELLS;
            let from = libm::ceil(at - reach).clamp(0.0, f64::from(cells));
            let to = (libm::floor(at + reach) + 1.0).clamp(from, f64::from(cells));
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "both are clamped to the number of cells"
            )]
            (from as usize..to as usize)
        };
        (
            along(middle.u, cos * half.u + sin * half.v, self.spec.rows),
            along(middle.v, sin * half.u + cos * half.v, self.spec.cols),
        )
    }

    /// Marks the target cells that the source covers in part as free.
    fn mark_covered(&self, occupancy: &mut Occupancy) {
        let (width, height) = (f64::from(self.source.width), f64::from(self.source.height));
        let middle = self.place(width / 2.0, height / 2.0);
        let half = Point {
            u: width * self.side / 2.0,
            v: height * self.side / 2.0,
        };
        let (rows, cols) = self.around(middle, half);
        for row in rows {
            for col in cols.clone() {
                if self.overlaps(row, col, middle, half) {
                    occupancy.cells[row * self.spec.cols as usize + col] = FREE;
                }
            }
        }
    }

    /// Shows each target cell that overlaps a source cell whose value is wanted, with that value.
    fn each_overlap(
        &self,
        occupancy: &mut Occupancy,
        is_wanted: impl Fn(i8) -> bool,
        mut show: impl FnMut(&mut i8, i8),
    ) {
        let half = Point {
            u: self.side / 2.0,
            v: self.side / 2.0,
        };
        let (xs, ys) = self.source_cells_near();
        let width = self.source.width as usize;
        for y in ys {
            let line = &self.source.cells[y * width..][..width];
            for (x, &value) in line.iter().enumerate().take(xs.end).skip(xs.start) {
                if !is_wanted(value) {
                    continue;
                }
                let middle = self.place(x as f64 + 0.5, y as f64 + 0.5);
                let (rows, cols) = self.around(middle, half);
                for row in rows {
                    for col in cols.clone() {
                        if self.overlaps(row, col, middle, half) {
                            show(
                                &mut occupancy.cells[row * self.spec.cols as usize + col],
                                value,
                            );
                        }
                    }
                }
            }
        }
    }

    /// Columns and lines of the source's cells that may lie on the target grid.
    fn source_cells_near(&self) -> (std::ops::Range<usize>, std::ops::Range<usize>) {
        let (rows, cols) = (f64::from(self.spec.rows), f64::from(self.spec.cols));
        let (mut x_range, mut y_range) = (
            (f64::INFINITY, f64::NEG_INFINITY),
            (f64::INFINITY, f64::NEG_INFINITY),
        );
        for (u, v) in [(0.0, 0.0), (0.0, cols), (rows, 0.0), (rows, cols)] {
            let (du, dv) = (self.corner.u - (u - 0.5), self.corner.v - (v - 0.5));
            let x = (self.cos * du + self.sin * dv) / self.side;
            let y = (self.cos * dv - self.sin * du) / self.side;
            x_range = (x_range.0.min(x), x_range.1.max(x));
            y_range = (y_range.0.min(y), y_range.1.max(y));
        }
        let cells = |(least, most): (f64, f64), cells: u32| {
            let from = libm::floor(least - 1.0).clamp(0.0, f64::from(cells));
            let to = libm::ceil(most + 1.0).clamp(from, f64::from(cells));
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "both are clamped to the number of cells"
            )]
            (from as usize..to as usize)
        };
        (
            cells(x_range, self.source.width),
            cells(y_range, self.source.height),
        )
    }
}
