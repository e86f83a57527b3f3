//! Which cells a moving rectangle touches, relative to the cell that it starts from.

use swath_bridge::{Pose2, Vehicle};

/// The rectangle is grown by this much, so that touching an obstacle's edge counts as hitting it and
/// rounding cannot hide a hit.
const GROWTH_M: f64 = 1e-5;
/// Headings that stand for a continuous turn lie at most this far apart. Between two of them a corner
/// 4 m away bulges by 6 µm, which [`GROWTH_M`] covers.
const TURN_STEP_RAD: f64 = 0.0035;

/// A run of cells in one row, relative to the start cell; both columns belong to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Span {
    pub(crate) d_row: i32,
    pub(crate) first_col: i32,
    pub(crate) last_col: i32,
}

/// The cells that a motion touches: disjoint spans, ordered by row and column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Kernel {
    pub(crate) spans: Vec<Span>,
}

impl Kernel {
    /// The footprint standing at a pose, relative to the cell whose centre is the frame's origin.
    pub(crate) fn of_pose(vehicle: &Vehicle, resolution_m: f64, pose: &Pose2) -> Self {
        let mut spans = Vec::new();
        touch(&corners(vehicle, 0.0, pose), resolution_m, &mut spans);
        Self::merged(spans)
    }

    /// A disc around the start cell's centre.
    #[expect(clippy::cast_possible_truncation, reason = "a vehicle spans few cells")]
    pub(crate) fn of_disc(resolution_m: f64, radius_m: f64) -> Self {
        let radius = radius_m.max(0.0) / resolution_m;
        // Squares begin half a cell before their centres.
        let most = libm::floor(radius + 0.5) as i32;
        let spans = (-most..=most).filter_map(|d_row| {
            let off = (f64::from(d_row.abs()) - 0.5).max(0.0);
            let square = radius * radius - off * off;
            let last_col = libm::floor(libm::sqrt(square.max(0.0)) + 0.5) as i32;
            (square >= 0.0).then_some(Span {
                d_row,
                first_col: -last_col,
                last_col,
            })
        });
        Self {
            spans: spans.collect(),
        }
    }

    /// The footprint driving `length_m` straight ahead at `heading_rad`.
    pub(crate) fn of_chord(
        vehicle: &Vehicle,
        resolution_m: f64,
        heading_rad: f64,
        length_m: f64,
    ) -> Self {
        let mut spans = Vec::new();
        let start = Pose2::new(0.0, 0.0, heading_rad);
        touch(
            &corners(vehicle, length_m, &start),
            resolution_m,
            &mut spans,
        );
        Self::merged(spans)
    }

    /// The footprint turning on the spot from one heading to another, both included.
    pub(crate) fn of_turn(
        vehicle: &Vehicle,
        resolution_m: f64,
        from_rad: f64,
        turn_rad: f64,
    ) -> Self {
        let steps = libm::ceil(turn_rad.abs() / TURN_STEP_RAD).max(1.0);
        let mut spans = Vec::new();
        let mut step = 0.0;
        while step <= steps {
            let heading = Pose2::new(0.0, 0.0, from_rad + turn_rad * step / steps);
            touch(&corners(vehicle, 0.0, &heading), resolution_m, &mut spans);
            step += 1.0;
        }
        Self::merged(spans)
    }

    fn merged(mut spans: Vec<Span>) -> Self {
        spans.sort_unstable();
        let mut merged: Vec<Span> = Vec::with_capacity(spans.len());
        for span in spans {
            match merged.last_mut() {
                Some(last) if last.d_row == span.d_row && span.first_col <= last.last_col + 1 => {
                    last.last_col = last.last_col.max(span.last_col);
                }
                _ => merged.push(span),
            }
        }
        Self { spans: merged }
    }

    /// The cells that both of two convex motions touch.
    pub(crate) fn intersection(&self, other: &Self) -> Self {
        let both = |span: &Span| {
            let same_row = other.spans.iter().find(|with| with.d_row == span.d_row)?;
            let first_col = span.first_col.max(same_row.first_col);
            let last_col = span.last_col.min(same_row.last_col);
            (first_col <= last_col).then_some(Span {
                d_row: span.d_row,
                first_col,
                last_col,
            })
        };
        Self {
            spans: self.spans.iter().filter_map(both).collect(),
        }
    }

    /// Farthest row or column from the start cell.
    pub(crate) fn reach_cells(&self) -> i32 {
        let farthest = |span: &Span| {
            span.d_row
                .abs()
                .max(span.first_col.abs())
                .max(span.last_col.abs())
        };
        self.spans.iter().map(farthest).max().unwrap_or(0)
    }
}

/// Corners of the footprint swept `length_m` straight ahead, in order.
fn corners(vehicle: &Vehicle, length_m: f64, pose: &Pose2) -> [(f64, f64); 4] {
    let (sin, cos) = libm::sincos(pose.yaw_rad);
    let front = vehicle.front_m + length_m + GROWTH_M;
    let rear = -vehicle.rear_m - GROWTH_M;
    let side = vehicle.half_width_m + GROWTH_M;
    [(front, side), (front, -side), (rear, -side), (rear, side)]
        .map(|(x, y)| (pose.x_m + cos * x - sin * y, pose.y_m + sin * x + cos * y))
}

/// Appends, for each row, the run of cells whose squares the convex polygon touches.
///
/// Within a row's strip the polygon is convex again, so the squares that it touches are just those
/// between its leftmost and its rightmost point there.
#[expect(clippy::cast_possible_truncation, reason = "a vehicle spans few cells")]
fn touch(polygon: &[(f64, f64); 4], resolution_m: f64, spans: &mut Vec<Span>) {
    // Row and column coordinates grow against x and y; the start cell's centre is (0, 0).
    let points = polygon.map(|(x_m, y_m)| (-x_m / resolution_m, -y_m / resolution_m));
    let top = points.iter().map(|p| p.0).fold(f64::INFINITY, f64::min);
    let bottom = points.iter().map(|p| p.0).fold(f64::NEG_INFINITY, f64::max);
    for d_row in libm::floor(top + 0.5) as i32..=libm::floor(bottom + 0.5) as i32 {
        let (upper, lower) = (f64::from(d_row) - 0.5, f64::from(d_row) + 0.5);
        let (mut leftmost, mut rightmost) = (f64::INFINITY, f64::NEG_INFINITY);
        for (index, &(row, col)) in points.iter().enumerate() {
            let (next_row, next_col) = points[(index + 1) % points.len()];
            let mut include = |row: f64, col: f64| {
                if row >= upper && row <= lower {
                    leftmost = leftmost.min(col);
                    rightmost = rightmost.max(col);
                }
            };
            include(row, col);
            for edge in [upper, lower] {
                if (row - edge) * (next_row - edge) < 0.0 {
                    let share = (edge - row) / (next_row - row);
                    include(edge, col + share * (next_col - col));
                }
            }
        }
        if leftmost <= rightmost {
            spans.push(Span {
                d_row,
                first_col: libm::floor(leftmost + 0.5) as i32,
                last_col: libm::floor(rightmost + 0.5) as i32,
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Whether a cell's square holds one of many points of the motion's rectangles, which are given by
    /// the inverses of their poses.
    fn touched_by_points(inverses: &[Pose2], d_row: i32, d_col: i32) -> bool {
        let vehicle = Vehicle::default();
        let is_inside = |inverse: &Pose2, (x_m, y_m): (f64, f64), slack_m: f64| {
            let point = inverse.then(&Pose2::new(x_m, y_m, 0.0));
            point.x_m <= vehicle.front_m + slack_m
                && point.x_m >= -vehicle.rear_m - slack_m
                && point.y_m.abs() <= vehicle.half_width_m + slack_m
        };
        let (x_m, y_m) = (-0.2 * f64::from(d_row), -0.2 * f64::from(d_col));
        inverses.iter().any(|inverse| {
            // A square's corner is 0.1415 m from its centre.
            is_inside(inverse, (x_m, y_m), 0.15)
                && (0..=20).any(|i| {
                    (0..=20).any(|j| {
                        let along = |share: i32| 0.2 * (f64::from(share) / 20.0 - 0.5);
                        is_inside(inverse, (x_m + along(i), y_m + along(j)), 0.0)
                    })
                })
        })
    }

    fn holds(kernel: &Kernel, d_row: i32, d_col: i32) -> bool {
        kernel
            .spans
            .iter()
            .any(|s| s.d_row == d_row && (s.first_col..=s.last_col).contains(&d_col))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]

        #[test]
        fn a_kernel_holds_every_cell_that_sampled_points_of_the_motion_touch(
            heading in 0.0..std::f64::consts::TAU, length in 0.2..2.8f64, turn in 0.01..0.1f64,
        ) {
            let vehicle = Vehicle::default();
            let chord = Kernel::of_chord(&vehicle, 0.2, heading, length);
            let along: Vec<Pose2> = (0..=30)
                .map(|k| length * f64::from(k) / 30.0)
                .map(|s| Pose2::new(s * libm::cos(heading), s * libm::sin(heading), heading))
                .map(|pose| pose.inverse())
                .collect();
            let turning = Kernel::of_turn(&vehicle, 0.2, heading, turn);
            let around: Vec<Pose2> = (0..=10)
                .map(|k| Pose2::new(0.0, 0.0, heading + turn * f64::from(k) / 10.0))
                .map(|pose| pose.inverse())
                .collect();
            let mut surplus = 0;
            for d_row in -36..=36 {
                for d_col in -36..=36 {
                    for (kernel, inverses) in [(&chord, &along), (&turning, &around)] {
                        let touched = touched_by_points(inverses, d_row, d_col);
                        prop_assert!(!touched || holds(kernel, d_row, d_col));
                        surplus += i32::from(!touched && holds(kernel, d_row, d_col));
                    }
                }
            }
            // Points 1 cm apart miss squares that are only grazed.
            prop_assert!(surplus < 25, "{surplus} cells too many");
        }
    }
}
