//! A line through poses by arc length.

use swath_bridge::geometry::wrap_angle_rad;
use swath_bridge::{GridSpec, Pose2};

/// A line through poses.
#[derive(Debug)]
pub(crate) struct Polyline<'a> {
    poses: Vec<&'a Pose2>,
    arc_m: Vec<f64>,
}

impl<'a> Polyline<'a> {
    /// A line through the poses that are finite and not at one place.
    pub(crate) fn new(poses: &'a [Pose2]) -> Self {
        let mut line = Self {
            poses: Vec::new(),
            arc_m: Vec::new(),
        };
        for pose in poses.iter().filter(|pose| pose.is_finite()) {
            let step_m = line.poses.last().map_or(0.0, |last| pose.distance_m(last));
            if line.poses.is_empty() || step_m > 1e-6 {
                line.arc_m
                    .push(line.arc_m.last().copied().unwrap_or(0.0) + step_m);
                line.poses.push(pose);
            }
        }
        line
    }

    /// The pose at an arc length, headed along the line; `None` beyond its ends.
    pub(crate) fn at(&self, arc_m: f64) -> Option<Pose2> {
        let next = self
            .arc_m
            .partition_point(|&at| at <= arc_m)
            .min(self.arc_m.len() - 1);
        let last = next.checked_sub(1)?;
        let (from, to) = (self.poses[last], self.poses[next]);
        let share = (arc_m - self.arc_m[last]) / (self.arc_m[next] - self.arc_m[last]);
        (share <= 1.0 + 1e-9).then(|| {
            let (dx, dy) = (to.x_m - from.x_m, to.y_m - from.y_m);
            let yaw_rad = wrap_angle_rad(libm::atan2(dy, dx));
            Pose2::new(from.x_m + share * dx, from.y_m + share * dy, yaw_rad)
        })
    }

    /// Arc length of the point that is nearest to a pose, the first of several, and how far off it is;
    /// `None` for a line without points.
    pub(crate) fn nearest(&self, to: &Pose2) -> Option<(f64, f64)> {
        let mut nearest = (0.0, self.poses.first()?.distance_m(to));
        for (pair, arc_m) in self.poses.windows(2).zip(&self.arc_m) {
            let (dx, dy) = (pair[1].x_m - pair[0].x_m, pair[1].y_m - pair[0].y_m);
            let (to_x_m, to_y_m) = (to.x_m - pair[0].x_m, to.y_m - pair[0].y_m);
            let length_squared = dx * dx + dy * dy;
            let share = ((to_x_m * dx + to_y_m * dy) / length_squared).clamp(0.0, 1.0);
            let point = Pose2::new(pair[0].x_m + share * dx, pair[0].y_m + share * dy, 0.0);
            let distance_m = point.distance_m(to);
            if distance_m < nearest.1 {
                nearest = (arc_m + share * libm::sqrt(length_squared), distance_m);
            }
        }
        Some(nearest)
    }

    /// The farthest arc length, up to `most_m` behind `start_m`, whose point is on the grid.
    pub(crate) fn farthest_on(&self, spec: &GridSpec, start_m: f64, most_m: f64) -> Option<f64> {
        let end_m = self.arc_m.last()?.min(start_m + most_m);
        let step_m = spec.resolution_m;
        let mut arc_m = end_m;
        while arc_m > start_m {
            let pose = self.at(arc_m)?;
            if spec.index_of(spec.cell_at(pose.x_m, pose.y_m)).is_some() {
                return Some(arc_m);
            }
            arc_m -= step_m;
        }
        None
    }
}
