//! The vehicle's rectangle among occupied squares, in floating point.

use swath_bridge::{Cell, GridSpec, Pose2, Vehicle};

use crate::Plane;

/// Squares farther from the vehicle's middle than it is long are not looked at; a pose so far off the
/// grid that this box holds none is off the map.
const MARGIN_CELLS: i64 = 2;

/// How far the rectangle at a pose overlaps the square around a centre, metres: the least move that
/// parts them. Zero if they touch, negative if they are apart.
pub fn overlap_m(vehicle: &Vehicle, pose: &Pose2, centre: (f64, f64), side_m: f64) -> f64 {
    let (sin, cos) = pose.yaw_rad.sin_cos();
    let corner = |ahead: f64, left: f64| {
        (
            pose.x_m + ahead * cos - left * sin,
            pose.y_m + ahead * sin + left * cos,
        )
    };
    let width = vehicle.half_width_m;
    let rectangle = [
        corner(vehicle.front_m, width),
        corner(vehicle.front_m, -width),
        corner(-vehicle.rear_m, -width),
        corner(-vehicle.rear_m, width),
    ];
    let half = side_m / 2.0;
    let square = [
        (centre.0 + half, centre.1 + half),
        (centre.0 + half, centre.1 - half),
        (centre.0 - half, centre.1 - half),
        (centre.0 - half, centre.1 + half),
    ];
    let axes = [(1.0, 0.0), (0.0, 1.0), (cos, sin), (-sin, cos)];
    let mut least = f64::INFINITY;
    for axis in axes {
        let (low_a, high_a) = shadow(&rectangle, axis);
        let (low_b, high_b) = shadow(&square, axis);
        least = least.min((high_a - low_b).min(high_b - low_a));
    }
    least
}

/// The interval that the corners cover on an axis.
fn shadow(corners: &[(f64, f64); 4], axis: (f64, f64)) -> (f64, f64) {
    let mut interval = (f64::INFINITY, f64::NEG_INFINITY);
    for (x, y) in corners {
        let along = x * axis.0 + y * axis.1;
        interval = (interval.0.min(along), interval.1.max(along));
    }
    interval
}

/// The deepest overlap with any occupied cell, metres; `None` if nothing is touched.
pub(super) fn worst_overlap_m(
    spec: &GridSpec,
    obstacles: &Plane,
    vehicle: &Vehicle,
    pose: &Pose2,
) -> Option<f64> {
    let side_m = spec.resolution_m;
    let far_m = vehicle.front_m.max(vehicle.rear_m) + vehicle.half_width_m;
    let row_of = |x_m: f64| f64::from(spec.ego_row) - x_m / side_m;
    let col_of = |y_m: f64| f64::from(spec.ego_col) - y_m / side_m;
    let mut worst: Option<f64> = None;
    for row in cells_between(
        row_of(pose.x_m + far_m),
        row_of(pose.x_m - far_m),
        spec.rows,
    ) {
        for col in cells_between(
            col_of(pose.y_m + far_m),
            col_of(pose.y_m - far_m),
            spec.cols,
        ) {
            if !obstacles.get(Cell::new(row, col)) {
                continue;
            }
            let centre = (
                (f64::from(spec.ego_row) - f64::from(row)) * side_m,
                (f64::from(spec.ego_col) - f64::from(col)) * side_m,
            );
            let overlap = overlap_m(vehicle, pose, centre, side_m);
            if overlap >= 0.0 && worst.is_none_or(|worst| overlap > worst) {
                worst = Some(overlap);
            }
        }
    }
    worst
}

/// The cells of one side of the grid between two fractional ones, and a few more.
#[expect(
    clippy::cast_possible_truncation,
    reason = "casts from floats saturate, and the range is clamped to the grid"
)]
fn cells_between(from: f64, to: f64, count: u32) -> std::ops::Range<i32> {
    let from = (from.floor() as i64)
        .saturating_sub(MARGIN_CELLS)
        .clamp(0, i64::from(count));
    let to = (to.ceil() as i64)
        .saturating_add(MARGIN_CELLS)
        .clamp(0, i64::from(count));
    from as i32..to as i32
}

/// How far a pose's reference point lies beyond the map's edge, metres.
pub(super) fn off_map_m(spec: &GridSpec, pose: &Pose2) -> Option<f64> {
    let row = f64::from(spec.ego_row) - pose.x_m / spec.resolution_m;
    let col = f64::from(spec.ego_col) - pose.y_m / spec.resolution_m;
    let beyond = |at: f64, count: u32| (-0.5 - at).max(at - (f64::from(count) - 0.5));
    let cells = beyond(row, spec.rows).max(beyond(col, spec.cols));
    (cells > 1e-9).then_some(cells * spec.resolution_m)
}
