//! The path that a controller follows: poses with curvature by arc length.

use swath_bridge::Pose2;

/// One pose of a path that can be driven.
///
/// Between two points the curvature changes linearly with the arc length (a clothoid), so the points
/// say all about the path.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PathPoint {
    /// Middle of the rear axle and heading, vehicle frame.
    pub pose: Pose2,
    /// Curvature, 1/m, positive to the left.
    pub curvature_per_m: f64,
    /// Arc length from the start, metres.
    pub at_m: f64,
}
