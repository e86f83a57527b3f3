//! The path that is being followed, and where the next one goes on from it.

use swath_bridge::geometry::wrap_angle_rad;
use swath_bridge::{GridSpec, Pose2, Vehicle};

use crate::check::{CheckLimits, Ends, Fault, check_path};
use crate::frame::Start;
use crate::{PathPoint, Plane};

/// Farther from its path, or turned farther from it, a vehicle is not following it.
const OFF_COURSE_M: f64 = 0.3;
const OFF_COURSE_RAD: f64 = 0.17;
/// A path with less than this left is not gone on from, metres.
const LEAST_LEFT_M: f64 = 2.0;

/// A path in the odometry's frame.
#[derive(Debug)]
pub(super) struct Course {
    points: Vec<PathPoint>,
    goal: Pose2,
}

/// The part of a course that stays as it is, and where it ends, in the vehicle's frame.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Kept {
    /// The last of these is where the next path begins; empty if it begins with the vehicle.
    pub(super) points: Vec<PathPoint>,
    pub(super) start: Start,
}

impl Course {
    /// A path that was found in the vehicle's frame.
    pub(super) fn new(points: &[PathPoint], goal: &Pose2, odom_from_vehicle: &Pose2) -> Self {
        Self {
            points: moved(points, odom_from_vehicle),
            goal: odom_from_vehicle.then(goal),
        }
    }

    /// What it leads to, in the frame of a vehicle.
    pub(super) fn goal(&self, odom_from_vehicle: &Pose2) -> Pose2 {
        odom_from_vehicle.inverse().then(&self.goal)
    }

    /// What is kept of it for a vehicle that is to follow it for so many metres more; `None` if the
    /// vehicle does not follow it or there is not enough of it.
    pub(super) fn kept(&self, odom_from_vehicle: &Pose2, ahead_m: f64) -> Option<Kept> {
        let distance_m = |point: &PathPoint| point.pose.distance_m(odom_from_vehicle);
        let by_distance = |a: &&PathPoint, b: &&PathPoint| distance_m(a).total_cmp(&distance_m(b));
        let nearest = self.points.iter().min_by(by_distance)?;
        let turned_rad = wrap_angle_rad(nearest.pose.yaw_rad - odom_from_vehicle.yaw_rad);
        if distance_m(nearest) > OFF_COURSE_M || turned_rad.abs() > OFF_COURSE_RAD {
            return None;
        }
        let end_m = nearest.at_m + ahead_m;
        let first = self
            .points
            .partition_point(|point| point.at_m < nearest.at_m);
        let last = self.points.partition_point(|point| point.at_m < end_m);
        let (start, end) = (self.points.get(last)?, self.points.last()?);
        if end.at_m - start.at_m < LEAST_LEFT_M {
            return None;
        }
        let points = moved(&self.points[first..=last], &odom_from_vehicle.inverse());
        let start = points.last()?;
        Some(Kept {
            start: Start {
                pose: start.pose,
                curvature_per_m: Some(start.curvature_per_m),
            },
            points,
        })
    }
}

impl Kept {
    /// Whether the vehicle can still drive it.
    pub(super) fn is_free(
        &self,
        (spec, obstacles): (&GridSpec, &Plane),
        vehicle: &Vehicle,
        curvature_limit_per_m: f64,
    ) -> bool {
        let (Some(first), Some(last)) = (self.points.first(), self.points.last()) else {
            return true;
        };
        if self.points.len() == 1 {
            return true;
        }
        let limits = CheckLimits::new(vehicle, curvature_limit_per_m);
        let ends = Ends {
            start: first.pose,
            start_curvature_per_m: None,
            goal: last.pose,
        };
        let violations = check_path((spec, obstacles), &limits, &ends, &self.points);
        violations.iter().all(|violation| {
            // It was checked for the rest when it was new.
            !matches!(
                violation.fault,
                Fault::Collision | Fault::OffMap | Fault::Curvature
            )
        })
    }

    /// The kept part and what follows it, as one path.
    pub(super) fn followed_by(&self, path: &[PathPoint]) -> Vec<PathPoint> {
        let Some((join, kept)) = self.points.split_last() else {
            return path.to_vec();
        };
        let first_m = self.points.first().map_or(0.0, |first| first.at_m);
        let at_start = |point: &PathPoint| PathPoint {
            at_m: point.at_m - first_m,
            ..*point
        };
        let after = |point: &PathPoint| PathPoint {
            at_m: point.at_m + join.at_m - first_m,
            ..*point
        };
        let kept = kept.iter().map(at_start);
        kept.chain(path.iter().map(after)).collect()
    }
}

fn moved(points: &[PathPoint], by: &Pose2) -> Vec<PathPoint> {
    let moved = |point: &PathPoint| PathPoint {
        pose: by.then(&point.pose),
        ..*point
    };
    points.iter().map(moved).collect()
}

#[cfg(test)]
mod tests {
    use swath_bridge::Cell;

    use super::*;

    /// Points every 0.2 m along an arc to the left.
    fn arc(curvature_per_m: f64, length_m: f64) -> Vec<PathPoint> {
        let point = |at_m: f64| {
            let yaw_rad = curvature_per_m * at_m;
            let (sin, cos) = libm::sincos(yaw_rad);
            PathPoint {
                pose: Pose2::new(
                    sin / curvature_per_m,
                    (1.0 - cos) / curvature_per_m,
                    yaw_rad,
                ),
                curvature_per_m,
                at_m,
            }
        };
        let mut points = Vec::new();
        while points.len() as f64 * 0.2 <= length_m {
            points.push(point(points.len() as f64 * 0.2));
        }
        points
    }

    #[test]
    fn a_vehicle_on_its_course_goes_on_from_a_point_of_it() {
        let path = arc(0.1, 20.0);
        let odom = Pose2::new(7.0, -3.0, 1.0);
        let course = Course::new(&path, &path[100].pose, &odom);
        // The vehicle has driven 4 m of it.
        let now = odom.then(&path[20].pose);
        let kept = course.kept(&now, 1.1).unwrap();
        assert_eq!(kept.points.len(), 7);
        assert!(kept.points[0].pose.distance_m(&Pose2::default()) < 1e-9);
        let expected = path[20].pose.inverse().then(&path[26].pose);
        assert!(kept.start.pose.distance_m(&expected) < 1e-9);
        assert_eq!(kept.start.curvature_per_m, Some(0.1));
        let goal = path[20].pose.inverse().then(&path[100].pose);
        assert!(course.goal(&now).distance_m(&goal) < 1e-9);

        let rest = moved(&arc(0.1, 5.0), &kept.start.pose);
        let joined = kept.followed_by(&rest);
        assert_eq!(joined.len(), 6 + rest.len());
        for pair in joined.windows(2) {
            assert!((pair[1].at_m - pair[0].at_m - 0.2).abs() < 1e-9);
            assert!((pair[1].pose.distance_m(&pair[0].pose) - 0.2).abs() < 1e-3);
        }
        assert!(joined[0].at_m.abs() < 1e-12);
    }

    #[test]
    fn a_vehicle_off_its_course_or_at_its_end_does_not() {
        let path = arc(0.1, 20.0);
        let course = Course::new(&path, &path[100].pose, &Pose2::default());
        let on = |pose: &Pose2| course.kept(pose, 1.0).is_some();
        assert!(on(&Pose2::new(0.1, 0.05, 0.05)));
        assert!(!on(&Pose2::new(0.0, 0.5, 0.0)));
        assert!(!on(&Pose2::new(0.0, 0.0, 0.4)));
        assert!(!on(&path[95].pose));
    }

    #[test]
    fn what_is_kept_is_tested_on_the_new_map() {
        let spec = GridSpec::default();
        let path = arc(0.1, 20.0);
        let course = Course::new(&path, &path[100].pose, &Pose2::default());
        let kept = course.kept(&Pose2::default(), 4.0).unwrap();
        let mut obstacles = Plane::empty(spec.rows, spec.cols);
        let vehicle = Vehicle::default();
        assert!(kept.is_free((&spec, &obstacles), &vehicle, 0.18));
        assert!(!kept.is_free((&spec, &obstacles), &vehicle, 0.09));
        obstacles.set(Cell::new(270, 67));
        assert!(!kept.is_free((&spec, &obstacles), &vehicle, 0.18));
        assert!(Kept::default().is_free((&spec, &obstacles), &vehicle, 0.18));
    }
}
