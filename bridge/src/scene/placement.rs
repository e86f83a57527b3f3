//! Where cells and metres lie in a drawing of a map.

use super::MARGIN_PX;
use crate::drawing::{Drawing, Spot};
use crate::geometry::{Cell, GridSpec, Pose2};
use crate::map::Top;
use crate::picture::Colour;

/// Pixels that the longer side of a map of few cells is enlarged to.
const SMALL_MAP_PX: u32 = 1640;
/// Most pixels of the longer side of a map.
const LARGE_MAP_PX: u32 = 2048;

/// Where cells and metres lie in the drawing.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placement {
    pub(super) spec: GridSpec,
    pub(super) top: Top,
    /// 0 where several cells share a pixel.
    pub(super) pixels_a_cell: u32,
    pub(super) cells_a_pixel: u32,
}

impl Placement {
    pub(super) fn of(spec: &GridSpec, top: Top) -> Self {
        let side = spec.rows.max(spec.cols).max(1);
        Self {
            spec: *spec,
            top,
            pixels_a_cell: if side <= LARGE_MAP_PX {
                (SMALL_MAP_PX / side).max(1)
            } else {
                0
            },
            cells_a_pixel: side.div_ceil(LARGE_MAP_PX),
        }
    }

    /// Cells to the right and down.
    const fn cells(&self) -> (u32, u32) {
        match self.top {
            Top::X => (self.spec.cols, self.spec.rows),
            Top::Y => (self.spec.rows, self.spec.cols),
        }
    }

    pub(super) const fn image_cells(&self) -> (u32, u32) {
        let (width, height) = self.cells();
        (
            width.div_ceil(self.cells_a_pixel),
            height.div_ceil(self.cells_a_pixel),
        )
    }

    pub(super) fn size_px(&self) -> (f64, f64) {
        let (width, height) = self.image_cells();
        let scale = self.pixels_a_cell.max(1);
        (f64::from(width * scale), f64::from(height * scale))
    }

    /// Pixels of a metre.
    pub(super) fn px_a_m(&self) -> f64 {
        let px_a_cell = f64::from(self.pixels_a_cell.max(1)) / f64::from(self.cells_a_pixel);
        px_a_cell / self.spec.resolution_m
    }

    /// The cell so many cells to the right and down.
    pub(super) fn cell(&self, right: u32, down: u32) -> Cell {
        let at = |cells: u32| i32::try_from(cells).unwrap_or(i32::MAX);
        match self.top {
            Top::X => Cell::new(at(down), at(right)),
            Top::Y => Cell::new(at(self.spec.rows) - 1 - at(right), at(down)),
        }
    }

    pub(super) fn spot(&self, pose: &Pose2) -> Spot {
        let (px_a_m, resolution_m) = (self.px_a_m(), self.spec.resolution_m);
        let front_m = (f64::from(self.spec.ego_row) + 0.5) * resolution_m;
        let left_m = (f64::from(self.spec.ego_col) + 0.5) * resolution_m;
        let rear_m = f64::from(self.spec.rows) * resolution_m - front_m;
        let (right_m, down_m) = match self.top {
            Top::X => (left_m - pose.y_m, front_m - pose.x_m),
            Top::Y => (rear_m + pose.x_m, left_m - pose.y_m),
        };
        Spot::new(MARGIN_PX + right_m * px_a_m, MARGIN_PX + down_m * px_a_m)
    }

    /// The direction of a heading, of length 1.
    pub(super) fn direction(&self, yaw_rad: f64) -> Spot {
        let (sin, cos) = libm::sincos(yaw_rad);
        match self.top {
            Top::X => Spot::new(-sin, -cos),
            Top::Y => Spot::new(cos, -sin),
        }
    }

    /// Draws a line through poses, as far as it is on the map.
    pub(super) fn line(
        &self,
        drawing: &mut Drawing,
        poses: &[Pose2],
        (colour, width_px): (Colour, f64),
    ) {
        let spots: Vec<Spot> = poses.iter().map(|pose| self.spot(pose)).collect();
        let mut run: Vec<Spot> = Vec::new();
        for pair in spots.windows(2) {
            let Some((from, to)) = self.clipped(pair[0], pair[1]) else {
                continue;
            };
            if run.last() != Some(&from) {
                drawing.line(std::mem::take(&mut run), colour, width_px);
                run.push(from);
            }
            run.push(to);
        }
        drawing.line(run, colour, width_px);
    }

    /// The part of a segment that is on the map (Y. Liang and B. Barsky).
    pub(super) fn clipped(&self, from: Spot, to: Spot) -> Option<(Spot, Spot)> {
        let (width, height) = self.size_px();
        let along = Spot::new(to.x - from.x, to.y - from.y);
        let (mut first, mut last) = (0.0f64, 1.0f64);
        for (step, room) in [
            (-along.x, from.x - MARGIN_PX),
            (along.x, MARGIN_PX + width - from.x),
            (-along.y, from.y - MARGIN_PX),
            (along.y, MARGIN_PX + height - from.y),
        ] {
            if step == 0.0 && room < 0.0 {
                return None;
            }
            if step < 0.0 {
                first = first.max(room / step);
            } else if step > 0.0 {
                last = last.min(room / step);
            }
        }
        let at = |part: f64| match part {
            0.0 => from,
            1.0 => to,
            part => Spot::new(from.x + part * along.x, from.y + part * along.y),
        };
        (first <= last).then(|| (at(first), at(last)))
    }

    /// The nearest spot on the map.
    pub(super) fn kept(&self, spot: Spot) -> Spot {
        let (width, height) = self.size_px();
        let kept =
            |at: f64, most: f64| at.clamp(MARGIN_PX + 8.0, (MARGIN_PX + most - 8.0).max(24.0));
        Spot::new(kept(spot.x, width), kept(spot.y, height))
    }
}
