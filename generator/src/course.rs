//! Lines that something follows or runs along: lanes, kerbs, reference paths.

use swath_bridge::Pose2;
use swath_bridge::geometry::wrap_angle_rad;

use crate::config::Span;

/// Distance between two poses of a course that is made from a curvature.
const STEP_M: f64 = 0.5;
/// Most poses of a course, so that no configuration asks for all memory.
const MAX_POSES: usize = 4096;

/// A line with headings, addressed by the distance along it. There are at least two poses.
#[derive(Debug, Clone, PartialEq)]
pub struct Course {
    poses: Vec<Pose2>,
    along_m: Vec<f64>,
}

impl Course {
    /// The course over `span` (metres along) with the given curvature (1/m), at 0 in the origin and
    /// heading along x there. The span holds 0.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "float to integer casts saturate and the count is limited"
    )]
    pub(crate) fn with_curvature(span: Span, curvature_per_m: impl Fn(f64) -> f64) -> Self {
        let count = (((span.1 - span.0) / STEP_M) as usize).clamp(2, MAX_POSES);
        let mut pose = Pose2::default();
        let mut along = span.0;
        let mut course = Self {
            poses: vec![pose],
            along_m: vec![along],
        };
        for _ in 0..count {
            let turn_rad = curvature_per_m(along + 0.5 * STEP_M) * STEP_M;
            let (sin, cos) = libm::sincos(pose.yaw_rad + 0.5 * turn_rad);
            pose = Pose2::new(
                pose.x_m + STEP_M * cos,
                pose.y_m + STEP_M * sin,
                wrap_angle_rad(pose.yaw_rad + turn_rad),
            );
            along += STEP_M;
            course.poses.push(pose);
            course.along_m.push(along);
        }
        let here_from_there = course.at(0.0).inverse();
        course.seen_from(&here_from_there)
    }

    /// The course through points, beginning with 0 at the first one.
    ///
    /// Points that repeat are left out; a lone point gets a companion ahead of it, so that there is
    /// a heading.
    pub(crate) fn through(points: &[[f64; 2]]) -> Self {
        let mut kept: Vec<[f64; 2]> = Vec::with_capacity(points.len());
        for &point in points.iter().take(MAX_POSES) {
            let repeats = kept
                .last()
                .is_some_and(|last| libm::hypot(point[0] - last[0], point[1] - last[1]) < 1e-6);
            if !repeats {
                kept.push(point);
            }
        }
        let first = kept.first().copied().unwrap_or([0.0, 0.0]);
        if kept.len() < 2 {
            kept = vec![first, [first[0] + STEP_M, first[1]]];
        }
        let mut along = 0.0;
        let mut course = Self {
            poses: Vec::with_capacity(kept.len()),
            along_m: Vec::with_capacity(kept.len()),
        };
        for (index, point) in kept.iter().enumerate() {
            let before = kept[index.saturating_sub(1)];
            let after = kept[(index + 1).min(kept.len() - 1)];
            let yaw_rad = libm::atan2(after[1] - before[1], after[0] - before[0]);
            along += libm::hypot(point[0] - before[0], point[1] - before[1]);
            course.poses.push(Pose2::new(point[0], point[1], yaw_rad));
            course.along_m.push(along);
        }
        course
    }

    /// The course through the positions of poses, such as the reference path of a log.
    pub(crate) fn through_poses(poses: &[Pose2]) -> Self {
        let points: Vec<[f64; 2]> = poses.iter().map(|pose| [pose.x_m, pose.y_m]).collect();
        Self::through(&points)
    }

    /// The same course whose distances begin with `begin_m`.
    #[must_use]
    pub(crate) fn starting_at(mut self, begin_m: f64) -> Self {
        let shift_m = begin_m - self.along_m[0];
        for along_m in &mut self.along_m {
            *along_m += shift_m;
        }
        self
    }

    /// Where along it the course begins and ends, metres.
    pub fn span_m(&self) -> (f64, f64) {
        let last = self.along_m.len() - 1;
        (self.along_m[0], self.along_m[last])
    }

    /// The poses that make the course.
    pub fn poses(&self) -> &[Pose2] {
        &self.poses
    }

    /// The pose at a distance along. Beyond either end the course goes on straight.
    pub fn at(&self, along_m: f64) -> Pose2 {
        let last = self.along_m.len() - 1;
        let next = self.along_m.partition_point(|&a| a <= along_m);
        let (from, to) = match next {
            0 => return ahead_of(&self.poses[0], along_m - self.along_m[0]),
            n if n > last => return ahead_of(&self.poses[last], along_m - self.along_m[last]),
            n => (n - 1, n),
        };
        let share = (along_m - self.along_m[from]) / (self.along_m[to] - self.along_m[from]);
        let (a, b) = (&self.poses[from], &self.poses[to]);
        let turn_rad = wrap_angle_rad(b.yaw_rad - a.yaw_rad);
        Pose2::new(
            a.x_m + share * (b.x_m - a.x_m),
            a.y_m + share * (b.y_m - a.y_m),
            wrap_angle_rad(a.yaw_rad + share * turn_rad),
        )
    }

    /// The pose at a distance along and to the left, metres.
    pub fn beside(&self, along_m: f64, left_m: f64) -> Pose2 {
        self.at(along_m).then(&Pose2::new(0.0, left_m, 0.0))
    }

    /// Curvature at a distance along, 1/m, as the change of heading over four metres around it.
    pub fn curvature_per_m(&self, along_m: f64) -> f64 {
        const REACH_M: f64 = 2.0;
        let (before, after) = (self.at(along_m - REACH_M), self.at(along_m + REACH_M));
        wrap_angle_rad(after.yaw_rad - before.yaw_rad) / (2.0 * REACH_M)
    }

    /// The same course in another frame.
    #[must_use]
    pub(crate) fn seen_from(&self, here_from_there: &Pose2) -> Self {
        Self {
            poses: self.poses.iter().map(|p| here_from_there.then(p)).collect(),
            along_m: self.along_m.clone(),
        }
    }

    /// Points of the parallel `left_m` to the left over a span, no more of them than its bends need.
    pub(crate) fn parallel(&self, span: Span, left_m: f64) -> Vec<[f64; 2]> {
        const MAX_STEP_M: f64 = 6.0;
        const MAX_TURN_RAD: f64 = 0.04;
        let mut points = Vec::new();
        let mut kept: Option<(f64, f64)> = None;
        let mut along = span.0;
        loop {
            let pose = self.beside(along, left_m);
            let is_last = along >= span.1;
            let is_needed = kept.is_none_or(|(kept_along, kept_yaw)| {
                along - kept_along >= MAX_STEP_M
                    || wrap_angle_rad(pose.yaw_rad - kept_yaw).abs() > MAX_TURN_RAD
            });
            if is_needed || is_last {
                points.push([pose.x_m, pose.y_m]);
                kept = Some((along, pose.yaw_rad));
            }
            if is_last || points.len() >= MAX_POSES {
                return points;
            }
            along = (along + STEP_M).min(span.1);
        }
    }
}

/// The pose straight ahead of another.
fn ahead_of(pose: &Pose2, ahead_m: f64) -> Pose2 {
    pose.then(&Pose2::new(ahead_m, 0.0, 0.0))
}

/// A curvature that runs linearly between knots (metres along, 1/m): clothoids, arcs and straights.
pub(crate) fn between_knots(knots: &[(f64, f64)], along_m: f64) -> f64 {
    let next = knots.partition_point(|knot| knot.0 <= along_m);
    match (
        next.checked_sub(1).and_then(|before| knots.get(before)),
        knots.get(next),
    ) {
        (Some(a), Some(b)) => a.1 + (b.1 - a.1) * (along_m - a.0) / (b.0 - a.0),
        (Some(only), None) | (None, Some(only)) => only.1,
        (None, None) => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    #[test]
    fn a_constant_curvature_makes_a_circle_through_the_origin() {
        let course = Course::with_curvature(Span(-20.0, 60.0), |_| 0.05);
        for &(along, x, y) in &[
            (0.0, 0.0, 0.0),
            (10.0 * PI, 20.0, 20.0),
            (-10.0 * PI, -20.0, 20.0),
        ] {
            if along < -20.0 {
                continue;
            }
            let pose = course.at(along);
            assert!(
                (pose.x_m - x).abs() < 0.02 && (pose.y_m - y).abs() < 0.02,
                "{pose:?}"
            );
        }
        assert!((course.at(10.0 * PI).yaw_rad - FRAC_PI_2).abs() < 1e-3);
        assert!((course.curvature_per_m(20.0) - 0.05).abs() < 1e-6);
    }

    #[test]
    fn a_course_goes_on_straight_beyond_its_ends() {
        let course = Course::through(&[[0.0, 0.0], [0.0, 4.0]]);
        assert_eq!(course.span_m(), (0.0, 4.0));
        assert!(course.at(6.0).distance_m(&Pose2::new(0.0, 6.0, 0.0)) < 1e-12);
        assert!(course.at(-1.0).distance_m(&Pose2::new(0.0, -1.0, 0.0)) < 1e-12);
        assert!(
            course
                .beside(2.0, 1.0)
                .distance_m(&Pose2::new(-1.0, 2.0, 0.0))
                < 1e-12
        );
    }

    #[test]
    fn repeated_and_lone_points_still_make_a_course() {
        assert_eq!(Course::through(&[]).poses().len(), 2);
        assert_eq!(Course::through(&[[1.0, 1.0]; 3]).poses().len(), 2);
    }

    #[test]
    fn a_parallel_keeps_its_distance_in_bends() {
        let course = Course::with_curvature(Span(-20.0, 60.0), |s| 0.04 * libm::sin(s / 8.0));
        for point in course.parallel(Span(-15.0, 50.0), 3.0) {
            let nearest = (0..4000)
                .map(|k| course.at(-20.0 + 0.02 * f64::from(k)))
                .map(|p| libm::hypot(p.x_m - point[0], p.y_m - point[1]))
                .fold(f64::INFINITY, f64::min);
            assert!((nearest - 3.0).abs() < 0.05, "{point:?} {nearest}");
        }
    }

    #[test]
    fn curvature_between_knots_is_linear_and_constant_outside() {
        let knots = [(0.0, 0.0), (10.0, 0.1)];
        assert!((between_knots(&knots, 5.0) - 0.05).abs() < 1e-12);
        assert!(between_knots(&knots, -5.0).abs() < 1e-12);
        assert!((between_knots(&knots, 50.0) - 0.1).abs() < 1e-12);
        assert!(between_knots(&[], 1.0).abs() < 1e-12);
    }
}
