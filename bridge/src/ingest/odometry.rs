//! Where the vehicle was, from `nav_msgs/Odometry`: interpolated poses, and the path still to come.

use crate::geometry::{GridSpec, Pose2, wrap_angle_rad};
use crate::msg::nav::Odometry;

use super::transform::rotation_of;

/// Most poses of a log.
pub const MAX_POSES: usize = 4_000_000;
/// Most poses of a reference.
pub const MAX_REFERENCE_POSES: usize = 2048;
/// How far before the first and behind the last pose a moment may lie, nanoseconds.
const MAX_BEYOND_NANOS: u64 = 100_000_000;
/// Longest time between two poses that is interpolated, nanoseconds.
const MAX_GAP_NANOS: u64 = 5_000_000_000;
/// A step longer than this is a jump if it is also faster than a vehicle, metres.
const JUMP_M: f64 = 3.0;
/// Faster than this is a jump, metres a second.
const JUMP_M_PER_S: f64 = 70.0;
/// Speeds below this in every message mean that the log has none, metres a second.
const MIN_SPEED_M_PER_S: f64 = 1e-6;

/// One odometry message, reduced to the plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fix {
    /// When, nanoseconds.
    pub nanos: u64,
    /// The vehicle's pose in the odometry frame.
    pub odom_from_vehicle: Pose2,
    /// Forward speed as the message has it, m/s.
    pub speed_m_per_s: f64,
}

impl Fix {
    /// The plane's part of a message, or `None` if its pose is not finite.
    pub fn of(message: &Odometry, nanos: u64) -> Option<Self> {
        let pose = &message.pose.pose;
        let rotation = rotation_of(&pose.orientation)?;
        let forward = rotation * nalgebra::Vector3::x();
        let odom_from_vehicle = Pose2::new(
            pose.position.x,
            pose.position.y,
            libm::atan2(forward.y, forward.x),
        );
        let speed_m_per_s = message.twist.twist.linear.x;
        odom_from_vehicle.is_finite().then_some(Self {
            nanos,
            odom_from_vehicle,
            speed_m_per_s: if speed_m_per_s.is_finite() {
                speed_m_per_s
            } else {
                0.0
            },
        })
    }
}

/// A drive: poses in the order of time.
#[derive(Debug, Clone, Default)]
pub struct Track {
    fixes: Vec<Fix>,
    /// For each fix, the number of jumps and long pauses up to it.
    jumps: Vec<u32>,
    has_speed: bool,
}

/// The vehicle at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// The vehicle's pose in the odometry frame.
    pub odom_from_vehicle: Pose2,
    /// Forward speed, m/s.
    pub speed_m_per_s: f64,
    /// How fast the heading turns to the left, rad/s.
    pub turn_rad_per_s: f64,
    /// Number of jumps and long pauses of the odometry before this moment.
    pub jumps: u32,
    /// The first fix behind this moment.
    next: usize,
}

impl Track {
    /// The drive of these fixes, in any order. Of several at one time the last is taken.
    pub fn new(mut fixes: Vec<Fix>) -> Self {
        fixes.sort_by_key(|fix| fix.nanos);
        fixes.reverse();
        fixes.dedup_by_key(|fix| fix.nanos);
        fixes.reverse();
        let mut count = 0;
        let jumps = fixes
            .first()
            .map(|_| 0)
            .into_iter()
            .chain(fixes.windows(2).map(|pair| {
                count += u32::from(is_jump(&pair[0], &pair[1]));
                count
            }))
            .collect();
        let has_speed = fixes
            .iter()
            .any(|fix| fix.speed_m_per_s.abs() > MIN_SPEED_M_PER_S);
        Self {
            fixes,
            jumps,
            has_speed,
        }
    }

    /// The number of poses.
    pub fn len(&self) -> usize {
        self.fixes.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.fixes.is_empty()
    }

    /// Where the vehicle was, or `None` before, after and where the odometry pauses or jumps.
    pub fn at(&self, nanos: u64) -> Option<Moment> {
        let next = self.fixes.partition_point(|fix| fix.nanos < nanos);
        let (before, after) = match (next.checked_sub(1), self.fixes.get(next)) {
            (_, Some(fix)) if fix.nanos == nanos => (next, next),
            (Some(before), Some(_)) => (before, next),
            (None, Some(fix)) if fix.nanos - nanos <= MAX_BEYOND_NANOS => (next, next),
            (Some(before), None) if nanos - self.fixes[before].nanos <= MAX_BEYOND_NANOS => {
                (before, before)
            }
            _ => return None,
        };
        let (from, to) = (&self.fixes[before], &self.fixes[after]);
        let span_nanos = to.nanos - from.nanos;
        if self.jumps[before] != self.jumps[after] || span_nanos > MAX_GAP_NANOS {
            return None;
        }
        let part = if span_nanos == 0 {
            0.0
        } else {
            (nanos - from.nanos) as f64 / span_nanos as f64
        };
        Some(Moment {
            odom_from_vehicle: between(&from.odom_from_vehicle, &to.odom_from_vehicle, part),
            speed_m_per_s: self.speed_m_per_s(before, after, part),
            turn_rad_per_s: self.motion(before, after).1,
            jumps: self.jumps[after],
            next,
        })
    }

    /// Poses in the vehicle frame of `moment`, `step_m` apart, along the drive from there until it
    /// leaves the grid, jumps or ends. The first is the vehicle's own. Empty where the drive ends
    /// within a step.
    pub fn reference(&self, moment: &Moment, step_m: f64, spec: &GridSpec) -> Vec<Pose2> {
        let vehicle_from_odom = moment.odom_from_vehicle.inverse();
        let mut poses = vec![Pose2::default()];
        let mut last = Pose2::default();
        let mut before = Pose2::default();
        for (fix, jumps) in self.fixes[moment.next..]
            .iter()
            .zip(&self.jumps[moment.next..])
        {
            if *jumps != moment.jumps {
                break;
            }
            let pose = vehicle_from_odom.then(&fix.odom_from_vehicle);
            // By distance from the last pose, not along the path: a vehicle that stands and whose
            // odometry trembles goes nowhere.
            while pose.distance_m(&last) >= step_m {
                last = at_distance(&before, &pose, &last, step_m);
                if spec.index_of(spec.cell_at(last.x_m, last.y_m)).is_none()
                    || poses.len() == MAX_REFERENCE_POSES
                {
                    return if poses.len() > 1 { poses } else { Vec::new() };
                }
                poses.push(last);
                before = last;
            }
            before = pose;
        }
        if poses.len() > 1 { poses } else { Vec::new() }
    }

    fn speed_m_per_s(&self, before: usize, after: usize, part: f64) -> f64 {
        if self.has_speed {
            let (from, to) = (&self.fixes[before], &self.fixes[after]);
            return from.speed_m_per_s + part * (to.speed_m_per_s - from.speed_m_per_s);
        }
        self.motion(before, after).0
    }

    /// Speed in m/s and turn in rad/s around two fixes, from the steps to both sides of them, since a
    /// single one may be a short and noisy one.
    fn motion(&self, before: usize, after: usize) -> (f64, f64) {
        let first = before.saturating_sub(1);
        let last = (after + 1).min(self.fixes.len() - 1);
        let (from, to) = (&self.fixes[first], &self.fixes[last]);
        let span_s = (to.nanos - from.nanos) as f64 / 1e9;
        if span_s <= 0.0 || self.jumps[first] != self.jumps[last] {
            return (0.0, 0.0);
        }
        let moved = from.odom_from_vehicle.inverse().then(&to.odom_from_vehicle);
        (moved.x_m / span_s, moved.yaw_rad / span_s)
    }
}

fn is_jump(from: &Fix, to: &Fix) -> bool {
    let distance_m = from.odom_from_vehicle.distance_m(&to.odom_from_vehicle);
    let span_s = (to.nanos - from.nanos) as f64 / 1e9;
    // Written so that a distance that is not finite counts as a jump. Where it was during a long pause,
    // nobody knows.
    to.nanos - from.nanos > MAX_GAP_NANOS
        || !(distance_m <= JUMP_M || distance_m <= JUMP_M_PER_S * span_s)
}

fn between(from: &Pose2, to: &Pose2, part: f64) -> Pose2 {
    Pose2 {
        x_m: from.x_m + part * (to.x_m - from.x_m),
        y_m: from.y_m + part * (to.y_m - from.y_m),
        yaw_rad: wrap_angle_rad(from.yaw_rad + part * wrap_angle_rad(to.yaw_rad - from.yaw_rad)),
    }
}

/// The pose between `from`, nearer than `distance_m` to `centre`, and `to`, which is not, at that
/// distance.
fn at_distance(from: &Pose2, to: &Pose2, centre: &Pose2, distance_m: f64) -> Pose2 {
    let (dx, dy) = (to.x_m - from.x_m, to.y_m - from.y_m);
    let (cx, cy) = (from.x_m - centre.x_m, from.y_m - centre.y_m);
    let squared = dx * dx + dy * dy;
    let half = cx * dx + cy * dy;
    let rest = cx * cx + cy * cy - distance_m * distance_m;
    let root = libm::sqrt((half * half - squared * rest).max(0.0));
    let part = if squared > 0.0 {
        ((root - half) / squared).clamp(0.0, 1.0)
    } else {
        1.0
    };
    between(from, to, part)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn fix(nanos: u64, x_m: f64, y_m: f64, yaw_rad: f64) -> Fix {
        Fix {
            nanos,
            odom_from_vehicle: Pose2::new(x_m, y_m, yaw_rad),
            speed_m_per_s: 0.0,
        }
    }

    const SECOND: u64 = 1_000_000_000;

    /// Straight along x at 2 m/s, a pose every 0.1 s.
    fn straight(metres: u32) -> Track {
        Track::new(
            (0..=metres * 5)
                .map(|step| {
                    fix(
                        u64::from(step) * SECOND / 10,
                        f64::from(step) * 0.2,
                        0.0,
                        0.0,
                    )
                })
                .collect(),
        )
    }

    #[test]
    fn poses_between_two_messages_turn_the_short_way_round() {
        let track = Track::new(vec![fix(10, 0.0, 0.0, 3.0), fix(30, 2.0, -2.0, -3.0)]);
        let pose = track.at(20).unwrap().odom_from_vehicle;
        assert!((pose.x_m - 1.0).abs() < 1e-12 && (pose.y_m + 1.0).abs() < 1e-12);
        assert!((pose.yaw_rad.abs() - std::f64::consts::PI).abs() < 1e-9);
        assert!(track.at(MAX_BEYOND_NANOS + 31).is_none());
        assert!(Track::default().at(0).is_none());
    }

    #[test]
    fn speed_comes_from_the_poses_where_messages_have_none() {
        let speed = straight(10).at(SECOND).unwrap().speed_m_per_s;
        assert!((speed - 2.0).abs() < 1e-9, "{speed}");
    }

    #[test]
    fn jumps_and_pauses_are_not_bridged() {
        let track = Track::new(vec![
            fix(0, 0.0, 0.0, 0.0),
            fix(SECOND, 1.0, 0.0, 0.0),
            fix(SECOND + SECOND / 10, 50.0, 0.0, 0.0),
            fix(2 * SECOND, 51.0, 0.0, 0.0),
            fix(60 * SECOND, 60.0, 0.0, 0.0),
        ]);
        assert_eq!(track.at(SECOND / 2).unwrap().jumps, 0);
        assert!(track.at(SECOND + SECOND / 20).is_none());
        assert_eq!(track.at(3 * SECOND / 2).unwrap().jumps, 1);
        assert!(track.at(30 * SECOND).is_none());
        let moment = track.at(SECOND / 2).unwrap();
        assert!(track.reference(&moment, 0.25, &GridSpec::default()).len() <= 3);
    }

    #[test]
    fn a_reference_runs_from_the_vehicle_to_the_edge_of_the_grid() {
        let track = straight(200);
        let moment = track.at(5 * SECOND).unwrap();
        let reference = track.reference(&moment, 1.0, &GridSpec::default());
        assert_eq!(reference.len(), 61);
        for (index, pose) in (0..).zip(&reference) {
            assert!((pose.x_m - f64::from(index)).abs() < 1e-9 && pose.y_m.abs() < 1e-9);
        }
    }

    #[test]
    fn the_end_of_a_log_has_no_reference() {
        let track = straight(20);
        let end = track.at(10 * SECOND).unwrap();
        assert_eq!(track.reference(&end, 1.0, &GridSpec::default()), []);
        let near_end = track.at(9 * SECOND).unwrap();
        assert_eq!(
            track.reference(&near_end, 1.0, &GridSpec::default()).len(),
            3
        );
    }

    #[test]
    fn a_trembling_vehicle_that_stands_has_no_reference() {
        let track = Track::new(
            (0..5000)
                .map(|step| {
                    fix(
                        step * SECOND / 10,
                        if step % 2 == 0 { 0.1 } else { 0.0 },
                        0.0,
                        0.0,
                    )
                })
                .collect(),
        );
        let moment = track.at(SECOND).unwrap();
        assert_eq!(track.reference(&moment, 1.0, &GridSpec::default()), []);
    }

    proptest! {
        #[test]
        fn poses_of_a_reference_are_a_step_apart(
            turns in proptest::collection::vec(-0.2..0.2f64, 20..120),
            start in 0u64..2_000_000_000,
        ) {
            let mut pose = Pose2::new(1e5, -2e5, 1.0);
            let fixes = (0..)
                .zip(&turns)
                .map(|(step, turn)| {
                    pose = pose.then(&Pose2::new(0.6, 0.0, *turn));
                    Fix { nanos: step * SECOND / 5, odom_from_vehicle: pose, speed_m_per_s: 3.0 }
                })
                .collect();
            let track = Track::new(fixes);
            if let Some(moment) = track.at(start) {
                let reference = track.reference(&moment, 1.0, &GridSpec::default());
                for pair in reference.windows(2) {
                    prop_assert!((pair[0].distance_m(&pair[1]) - 1.0).abs() < 1e-6);
                }
            }
        }
    }
}
