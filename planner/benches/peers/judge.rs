//! Whether a path that a planner hands over can be driven: the same questions to everyone's.

use swath_bridge::geometry::wrap_angle_rad;
use swath_bridge::{GridSpec, Pose2};
use swath_planner::CollisionMap;
use swath_planner::{GOAL_TOLERANCE_M, GOAL_TOLERANCE_RAD};

use crate::run::Drive;

/// Farthest that two poses of a path may lie apart, metres; only poses are tested.
const SPACING_M: f64 = 0.21;
/// Between two poses with a cusp between them a car may have driven so far, metres, whatever their
/// distance.
const HIDDEN_BY_CUSP_M: f64 = 0.1;
/// What rounding may add to a distance in metres or an angle in radians.
const ROUNDING: f64 = 1e-3;
/// Share by which a curvature may pass the limit.
const CURVATURE_TOLERANCE: f64 = 0.01;

/// The map and the vehicle by which paths are judged.
pub(crate) struct Judge<'a> {
    pub(crate) map: &'a CollisionMap,
    pub(crate) spec: GridSpec,
    pub(crate) turning_radius_m: f64,
}

impl Judge<'_> {
    /// Whether a path leads from the origin to the goal, hits nothing, stays on the map with its
    /// reference point, and turns and moves as its car can.
    pub(crate) fn accepts(&self, path: &[Pose2], goal: &Pose2, drive: Drive) -> bool {
        let (Some(first), Some(last)) = (path.first(), path.last()) else {
            return false;
        };
        let (away_m, turned_rad) = difference(last, goal);
        let (start_m, start_rad) = difference(first, &Pose2::default());
        path.iter().all(Pose2::is_finite)
            && start_m.max(start_rad) <= ROUNDING
            && away_m <= GOAL_TOLERANCE_M + ROUNDING
            && turned_rad <= GOAL_TOLERANCE_RAD + ROUNDING
            && path
                .windows(2)
                .all(|pair| self.joins(&pair[0], &pair[1], drive))
            && path.iter().all(|pose| self.is_free(pose))
    }

    fn is_free(&self, pose: &Pose2) -> bool {
        let cell = self.spec.cell_at(pose.x_m, pose.y_m);
        self.spec.index_of(cell).is_some() && self.map.pose_is_free(pose)
    }

    fn joins(&self, from: &Pose2, to: &Pose2, drive: Drive) -> bool {
        let (length_m, turn_rad) = difference(from, to);
        let there = from.inverse().then(to);
        let backward = there.x_m < -ROUNDING;
        let driven_m = match drive {
            Drive::Reversing => length_m.max(HIDDEN_BY_CUSP_M),
            Drive::Chords | Drive::Forward => length_m,
        };
        let most_rad = (1.0 + CURVATURE_TOLERANCE) * driven_m / self.turning_radius_m + ROUNDING;
        length_m <= SPACING_M
            && (drive == Drive::Reversing || !backward)
            && (drive == Drive::Chords || turn_rad <= most_rad)
    }
}

/// Distance in metres and angle in radians between two poses.
fn difference(a: &Pose2, b: &Pose2) -> (f64, f64) {
    (a.distance_m(b), wrap_angle_rad(a.yaw_rad - b.yaw_rad).abs())
}

/// Length of a path, metres.
pub(crate) fn length_m(path: &[Pose2]) -> f64 {
    path.windows(2)
        .map(|pair| pair[0].distance_m(&pair[1]))
        .sum()
}
