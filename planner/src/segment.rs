//! Drives with one curvature each, and paths made of them.

use swath_bridge::geometry::wrap_angle_rad;
use swath_bridge::{Outcome, Pose2};

use crate::search::{POSE_SPACING_M, TargetResult};

/// Segments shorter than this are left out of paths, metres: two poses at one place have no direction.
const SHORTEST_M: f64 = 1e-6;

/// An arc, or a straight line.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Segment {
    /// 1/m, positive to the left.
    pub(crate) curvature_per_m: f64,
    pub(crate) length_m: f64,
}

impl Segment {
    /// The pose after driving `at_m` of it.
    pub(crate) fn after(&self, from: &Pose2, at_m: f64) -> Pose2 {
        after_arc(from, at_m, self.curvature_per_m * at_m)
    }

    /// The pose at its end.
    pub(crate) fn end(&self, from: &Pose2) -> Pose2 {
        self.after(from, self.length_m)
    }

    /// Metres plus radians.
    pub(crate) fn cost(&self) -> f64 {
        self.length_m * (1.0 + self.curvature_per_m.abs())
    }
}

/// The pose after driving an arc of a length that turns by so much.
pub fn after_arc(from: &Pose2, length_m: f64, turn_rad: f64) -> Pose2 {
    let half_rad = 0.5 * turn_rad;
    // The chord is shorter than the arc by sin(half) / half.
    let share = if half_rad.abs() < 1e-4 {
        1.0 - half_rad * half_rad / 6.0
    } else {
        libm::sin(half_rad) / half_rad
    };
    let (sin, cos) = libm::sincos(from.yaw_rad + half_rad);
    Pose2::new(
        from.x_m + length_m * share * cos,
        from.y_m + length_m * share * sin,
        wrap_angle_rad(from.yaw_rad + turn_rad),
    )
}

/// Metres plus radians of several segments.
pub(crate) fn cost_of(segments: &[Segment]) -> f64 {
    segments.iter().map(Segment::cost).sum()
}

/// The result of driving segments from a pose.
pub(crate) fn driven(start: &Pose2, segments: &[Segment], steps: u64) -> TargetResult {
    let mut result = TargetResult {
        cost: 0.0,
        length_m: 0.0,
        path: vec![*start],
        ..TargetResult::without_path(Outcome::Solved, steps)
    };
    let mut from = *start;
    let long = segments.iter().filter(|part| part.length_m > SHORTEST_M);
    for segment in long {
        result.length_m += segment.length_m;
        result.cost += segment.cost();
        // A hair of slack keeps a multiple of the spacing from being cut once more.
        let pieces = libm::ceil(segment.length_m / POSE_SPACING_M - 1e-9).max(1.0);
        let mut piece = 1.0;
        while piece <= pieces {
            let at_m = segment.length_m * piece / pieces;
            result.path.push(segment.after(&from, at_m));
            piece += 1.0;
        }
        from = segment.end(&from);
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn segments_compose_and_follow_the_circle_of_their_curvature(
            curvature in -0.3..0.3f64, length in 0.0..20.0f64, share in 0.0..1.0f64, yaw in -3.1..3.1f64,
        ) {
            let segment = Segment { curvature_per_m: curvature, length_m: length };
            let start = Pose2::new(1.0, -2.0, yaw);
            let rest = Segment { length_m: length * (1.0 - share), ..segment };
            let composed = rest.end(&segment.after(&start, length * share));
            let end = segment.end(&start);
            prop_assert!(composed.distance_m(&end) < 1e-9);
            prop_assert!(wrap_angle_rad(composed.yaw_rad - end.yaw_rad).abs() < 1e-9);
            // The circle's centre stays where it is.
            if curvature.abs() > 1e-3 {
                let centre = |pose: &Pose2| pose.then(&Pose2::new(0.0, 1.0 / curvature, 0.0));
                prop_assert!(centre(&start).distance_m(&centre(&end)) < 1e-6);
            }
            prop_assert!((segment.cost() - length - (curvature * length).abs()) < 1e-9);
        }

        #[test]
        fn driven_paths_have_poses_close_together_and_add_up(
            parts in proptest::collection::vec((-0.2..0.2f64, 0.0..3.0f64), 1..12),
        ) {
            let segments: Vec<_> = parts
                .iter()
                .map(|&(curvature_per_m, length_m)| Segment { curvature_per_m, length_m })
                .collect();
            let result = driven(&Pose2::default(), &segments, 7);
            let end = segments.iter().fold(Pose2::default(), |pose, part| part.end(&pose));
            prop_assert!(result.path[result.path.len() - 1].distance_m(&end) < 1e-4);
            prop_assert!((result.cost - cost_of(&segments)).abs() < 1e-4);
            for pair in result.path.windows(2) {
                let step_m = pair[0].distance_m(&pair[1]);
                prop_assert!(step_m > 0.0 && step_m <= POSE_SPACING_M + 1e-9);
            }
        }
    }
}
