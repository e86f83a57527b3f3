//! How far the vehicle's rectangle is from an occupied square, and how that changes with its pose.

use swath_bridge::{Pose2, Vehicle};

/// The rectangle of a vehicle and the square of a cell.
#[derive(Debug, Clone, Copy)]
#[expect(
    clippy::struct_field_names,
    reason = "they are all lengths, and units are suffixes"
)]
pub(crate) struct Footprint {
    /// From the rear axle to the rectangle's middle, metres.
    ahead_m: f64,
    half_length_m: f64,
    half_width_m: f64,
    half_cell_m: f64,
    /// From the rear axle to the farthest corner, metres.
    pub(crate) reach_m: f64,
}

/// The rectangle at a pose.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placed {
    x_m: f64,
    y_m: f64,
    sin: f64,
    cos: f64,
    /// Farthest that a square's centre may be from the rectangle's for them to touch: along the body,
    /// across it, along x and along y.
    reach_m: [f64; 4],
    /// How the one across the body changes with the heading, metres per radian.
    across_rate_m: f64,
    ahead_m: f64,
}

/// Where a square lies beside the body.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Beside {
    pub(crate) share: f64,
    pub(crate) gap_m: f64,
    /// From the rear axle, metres.
    along_m: f64,
    /// 1 on the left, -1 on the right.
    side: f64,
}

impl Footprint {
    pub(crate) fn new(vehicle: &Vehicle, resolution_m: f64) -> Self {
        Self {
            ahead_m: 0.5 * (vehicle.front_m - vehicle.rear_m),
            half_length_m: 0.5 * (vehicle.front_m + vehicle.rear_m),
            half_width_m: vehicle.half_width_m,
            half_cell_m: 0.5 * resolution_m,
            reach_m: libm::hypot(vehicle.front_m.max(vehicle.rear_m), vehicle.half_width_m),
        }
    }

    pub(crate) fn placed(&self, pose: &Pose2) -> Placed {
        let (sin, cos) = libm::sincos(pose.yaw_rad);
        self.placed_by((pose.x_m, pose.y_m), (sin, cos))
    }

    pub(crate) fn placed_by(&self, (x_m, y_m): (f64, f64), (sin, cos): (f64, f64)) -> Placed {
        let (length, width, cell) = (self.half_length_m, self.half_width_m, self.half_cell_m);
        let (abs_sin, abs_cos) = (sin.abs(), cos.abs());
        let square = cell * (abs_sin + abs_cos);
        Placed {
            x_m: x_m + self.ahead_m * cos,
            y_m: y_m + self.ahead_m * sin,
            sin,
            cos,
            reach_m: [
                length + square,
                width + square,
                length * abs_cos + width * abs_sin + cell,
                length * abs_sin + width * abs_cos + cell,
            ],
            across_rate_m: cell * (cos * sin.signum() - sin * cos.signum()),
            ahead_m: self.ahead_m,
        }
    }
}

impl Placed {
    /// Half the size of the box along the axes that holds everything within `gap_m`, and its middle.
    pub(crate) fn bounds(&self, gap_m: f64) -> ((f64, f64), (f64, f64)) {
        let half = (self.reach_m[2] + gap_m, self.reach_m[3] + gap_m);
        ((self.x_m, self.y_m), half)
    }

    /// The gap to the square around a centre: the widest along a side of the one or the other. It is
    /// exact for overlaps, and never more than the distance.
    #[inline]
    pub(crate) fn gap_m(&self, (x_m, y_m): (f64, f64)) -> f64 {
        let (dx, dy) = (x_m - self.x_m, y_m - self.y_m);
        let along = dx * self.cos + dy * self.sin;
        let across = dy * self.cos - dx * self.sin;
        let body = (along.abs() - self.reach_m[0]).max(across.abs() - self.reach_m[1]);
        let axes = (dx.abs() - self.reach_m[2]).max(dy.abs() - self.reach_m[3]);
        body.max(axes)
    }

    /// The gap aside of the body, as far as the square is beside it: all of it where it is between
    /// front and rear, nothing `fade_m` before and behind, and a linear share on the way.
    ///
    /// The way past an obstacle leads aside, never along. The plain gap of one that the front has just
    /// reached is along, so that it would ask for a shorter path, or for poses that step over it. With
    /// poses `fade_m` apart, the shares of an obstacle that one passes add up to the same however the
    /// poses lie, so that moving them along gains nothing.
    #[inline]
    pub(crate) fn beside(&self, (x_m, y_m): (f64, f64), fade_m: f64) -> Beside {
        let (dx, dy) = (x_m - self.x_m, y_m - self.y_m);
        let along = dx * self.cos + dy * self.sin;
        let across = dy * self.cos - dx * self.sin;
        Beside {
            share: (0.5 - (along.abs() - self.reach_m[0]) / fade_m).clamp(0.0, 1.0),
            gap_m: across.abs() - self.reach_m[1],
            along_m: along + self.ahead_m,
            side: across.signum(),
        }
    }

    /// Derivatives of the gap aside.
    #[inline]
    pub(crate) fn beside_by_pose(&self, beside: &Beside) -> [f64; 3] {
        let side = beside.side;
        [
            side * self.sin,
            -side * self.cos,
            -side * beside.along_m - self.across_rate_m,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn derivatives_agree_with_finite_differences(
            x in -1.0..1.0f64, y in -1.0..1.0f64, yaw in -3.1..3.1f64,
            cell_x in -6.0..6.0f64, cell_y in -6.0..6.0f64,
        ) {
            let footprint = Footprint::new(&Vehicle::default(), 0.2);
            let at = |pose: Pose2| footprint.placed(&pose).beside((cell_x, cell_y), 0.2);
            let pose = Pose2::new(x, y, yaw);
            let beside = at(pose);
            let placed = footprint.placed(&pose);
            let gap_m = placed.gap_m((cell_x, cell_y));
            // Beside the body it is the gap, or less by what the square's other sides would allow.
            prop_assert!(beside.share < 0.5 || beside.gap_m <= gap_m + 1e-12);
            prop_assert!(beside.share > 0.0 || gap_m > 0.0);
            let step = 1e-6;
            let moved = [
                (Pose2::new(x + step, y, yaw), Pose2::new(x - step, y, yaw)),
                (Pose2::new(x, y + step, yaw), Pose2::new(x, y - step, yaw)),
                (Pose2::new(x, y, yaw + step), Pose2::new(x, y, yaw - step)),
            ];
            for (derivative, (more, less)) in placed.beside_by_pose(&beside).iter().zip(moved) {
                let difference = (at(more).gap_m - at(less).gap_m) / (2.0 * step);
                // Straight ahead and along the axes the derivative jumps.
                let is_smooth = at(more).side == at(less).side
                    && (footprint.placed(&more).across_rate_m
                        - footprint.placed(&less).across_rate_m).abs() < 1e-3;
                prop_assert!(!is_smooth || (derivative - difference).abs() < 1e-4,
                    "{} {}", derivative, difference);
            }
        }
    }
}
