//! Where the vehicle is and how it moves, from odometry.

use std::collections::VecDeque;

use swath_bridge::Pose2;
use swath_bridge::geometry::wrap_angle_rad;
use swath_bridge::msg::nav::Odometry;
use swath_bridge::poses::pose_of_ros;

use super::frames::OdometryFault;
use crate::segment::after_arc;

/// Moments that are kept: more than a second at any usual rate.
const MOMENTS: usize = 128;
/// Longest time over which the motion is taken to go on as it was, seconds.
pub(super) const MAX_GAP_S: f64 = 0.5;
/// Two moments are joined where what one says of the other is wrong by at most this, metres; else the
/// odometry jumps between them.
const JUMP_M: f64 = 1.0;
const NANOS_PER_S: f64 = 1e9;
/// Below this speed the wheels may be turned before the vehicle has moved, m/s.
const CREEPING_M_PER_S: f64 = 0.3;

/// Faster no car drives, m/s, or turns, rad/s: what says so is not odometry.
const MAX_SPEED_M_PER_S: f64 = 100.0;
const MAX_TURN_RAD_PER_S: f64 = 10.0;

/// The vehicle's motion at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Moment {
    pub(super) stamp_nanos: u64,
    pub(super) odom_from_vehicle: Pose2,
    pub(super) speed_m_per_s: f64,
    pub(super) turn_rad_per_s: f64,
}

impl Moment {
    /// The motion that odometry tells of, if it is that of a car.
    pub(super) fn of(odom: &Odometry) -> Result<Self, OdometryFault> {
        let moment = Self {
            stamp_nanos: odom.header.stamp.nanos(),
            odom_from_vehicle: pose_of_ros(&odom.pose.pose),
            speed_m_per_s: odom.twist.twist.linear.x,
            turn_rad_per_s: odom.twist.twist.angular.z,
        };
        let (speed_m_per_s, turn_rad_per_s) = (moment.speed_m_per_s, moment.turn_rad_per_s);
        if !(moment.odom_from_vehicle.is_finite()
            && speed_m_per_s.is_finite()
            && turn_rad_per_s.is_finite())
        {
            return Err(OdometryFault::NotFinite);
        }
        if speed_m_per_s.abs() > MAX_SPEED_M_PER_S || turn_rad_per_s.abs() > MAX_TURN_RAD_PER_S {
            return Err(OdometryFault::TooFast {
                speed_m_per_s,
                turn_rad_per_s,
            });
        }
        Ok(moment)
    }

    /// The motion of another part of the same rigid body, which is so in this one's frame.
    pub(super) fn of_part(&self, this_from_part: &Pose2) -> Self {
        // A rigid body's velocity at a place is v + ω × r.
        let forward_m_per_s = self.speed_m_per_s - self.turn_rad_per_s * this_from_part.y_m;
        let left_m_per_s = self.turn_rad_per_s * this_from_part.x_m;
        let (sin, cos) = libm::sincos(this_from_part.yaw_rad);
        Self {
            odom_from_vehicle: self.odom_from_vehicle.then(this_from_part),
            speed_m_per_s: cos * forward_m_per_s + sin * left_m_per_s,
            ..*self
        }
    }

    /// The motion in the vehicle's frame over so many seconds, at the same speed and turn.
    pub(super) fn moved_by(&self, seconds: f64) -> Pose2 {
        let (length_m, turn_rad) = (self.speed_m_per_s * seconds, self.turn_rad_per_s * seconds);
        after_arc(&Pose2::default(), length_m, turn_rad)
    }

    /// The curvature that is driven, 1/m; `None` while the wheels may still be turned.
    pub(super) fn curvature_per_m(&self) -> Option<f64> {
        (self.speed_m_per_s >= CREEPING_M_PER_S).then(|| self.turn_rad_per_s / self.speed_m_per_s)
    }

    /// Between this, which is said of a time by the moment before it, and what the one after it says: the
    /// nearer one where the odometry jumps in between.
    fn blended(&self, after: &Self, share: f64) -> Self {
        let nearer = if share <= 0.5 { self } else { after };
        let (from, to) = (&self.odom_from_vehicle, &after.odom_from_vehicle);
        if from.distance_m(to) > JUMP_M {
            return *nearer;
        }
        let turned_rad = wrap_angle_rad(to.yaw_rad - from.yaw_rad);
        Self {
            odom_from_vehicle: Pose2 {
                x_m: from.x_m + share * (to.x_m - from.x_m),
                y_m: from.y_m + share * (to.y_m - from.y_m),
                yaw_rad: wrap_angle_rad(from.yaw_rad + share * turned_rad),
            },
            ..*nearer
        }
    }

    fn at(&self, stamp_nanos: u64) -> Self {
        let seconds = seconds_between(self.stamp_nanos, stamp_nanos);
        Self {
            stamp_nanos,
            odom_from_vehicle: self.odom_from_vehicle.then(&self.moved_by(seconds)),
            ..*self
        }
    }
}

/// The newest moments, by stamp.
#[derive(Debug, Default)]
pub(super) struct Track(VecDeque<Moment>);

impl Track {
    /// Takes note of a moment, unless it is late; if time begins anew, as when a recording starts over,
    /// so does the track.
    pub(super) fn take(&mut self, moment: Moment) {
        if let Some(newest) = self.0.back() {
            let ahead_s = seconds_between(newest.stamp_nanos, moment.stamp_nanos);
            if ahead_s <= -MAX_GAP_S {
                self.0.clear();
            } else if ahead_s <= 0.0 {
                return;
            }
        }
        if self.0.len() == MOMENTS {
            self.0.pop_front();
        }
        self.0.push_back(moment);
    }

    /// Forgets everything.
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    /// The motion at a time, unless nothing is known near it; at time 0, as far as it is known.
    pub(super) fn at(&self, stamp_nanos: u64) -> Option<Moment> {
        if stamp_nanos == 0 {
            return self.0.back().copied();
        }
        let after = self
            .0
            .partition_point(|moment| moment.stamp_nanos <= stamp_nanos);
        let before = after.checked_sub(1).and_then(|index| self.0.get(index));
        let near = |moment: &Moment| {
            let gap_s = seconds_between(moment.stamp_nanos, stamp_nanos);
            (gap_s.abs() <= MAX_GAP_S).then(|| moment.at(stamp_nanos))
        };
        match (before, self.0.get(after)) {
            (Some(before), Some(after)) => {
                let since_s = seconds_between(before.stamp_nanos, stamp_nanos);
                let until_s = seconds_between(stamp_nanos, after.stamp_nanos);
                let share = since_s / (since_s + until_s);
                match (near(before), near(after)) {
                    (Some(before), Some(after)) => Some(before.blended(&after, share)),
                    (one, other) => one.or(other),
                }
            }
            (Some(one), None) | (None, Some(one)) => near(one),
            (None, None) => None,
        }
    }
}

fn seconds_between(from_nanos: u64, to_nanos: u64) -> f64 {
    let apart = |from: u64, to: u64| to.saturating_sub(from) as f64 / NANOS_PER_S;
    apart(from_nanos, to_nanos) - apart(to_nanos, from_nanos)
}

#[cfg(test)]
mod tests {
    use swath_bridge::Frame;
    use swath_bridge::msg::header::Header;
    use swath_bridge::poses::odometry_message;
    use swath_bridge::{GridSpec, Occupancy};

    use super::*;

    fn odometry(
        stamp_nanos: u64,
        pose: Pose2,
        speed_m_per_s: f64,
        turn_rad_per_s: f64,
    ) -> Odometry {
        let spec = GridSpec {
            rows: 1,
            cols: 1,
            ego_row: 0,
            ego_col: 0,
            ..GridSpec::default()
        };
        let frame = Frame {
            stamp_nanos,
            occupancy: Occupancy::filled(spec, 0),
            odom_from_vehicle: pose,
            speed_m_per_s,
            turn_rad_per_s,
            reference: Vec::new(),
        };
        odometry_message(&Header::at(stamp_nanos, "base_link"), &frame)
    }

    const SECOND: u64 = 1_000_000_000;

    /// Takes odometry, if it is that of a car.
    fn take(track: &mut Track, odom: &Odometry) {
        if let Ok(moment) = Moment::of(odom) {
            track.take(moment);
        }
    }

    #[test]
    fn between_two_moments_odometry_without_motion_is_interpolated_and_a_jump_is_not() {
        let mut track = Track::default();
        take(
            &mut track,
            &odometry(10 * SECOND, Pose2::new(1.0, 0.0, 0.0), 0.0, 0.0),
        );
        take(
            &mut track,
            &odometry(
                10 * SECOND + SECOND / 5,
                Pose2::new(1.8, 0.4, 0.2),
                0.0,
                0.0,
            ),
        );
        let moment = track.at(10 * SECOND + SECOND / 20).unwrap();
        assert!(
            moment
                .odom_from_vehicle
                .distance_m(&Pose2::new(1.2, 0.1, 0.0))
                < 1e-9
        );
        assert!((moment.odom_from_vehicle.yaw_rad - 0.05).abs() < 1e-9);
        // Time zero asks for the newest.
        assert!((track.at(0).unwrap().odom_from_vehicle.x_m - 1.8).abs() < 1e-9);
        take(
            &mut track,
            &odometry(
                10 * SECOND + 2 * SECOND / 5,
                Pose2::new(50.0, 0.0, 0.0),
                0.0,
                0.0,
            ),
        );
        let moment = track.at(10 * SECOND + SECOND / 4).unwrap();
        assert!((moment.odom_from_vehicle.x_m - 1.8).abs() < 1e-9);
    }

    #[test]
    fn between_moments_the_motion_goes_on_as_it_was() {
        let mut track = Track::default();
        assert_eq!(track.at(SECOND), None);
        take(
            &mut track,
            &odometry(SECOND, Pose2::new(3.0, 4.0, 0.0), 2.0, 0.0),
        );
        let moved = track.at(SECOND + SECOND / 4).unwrap();
        assert!((moved.odom_from_vehicle.x_m - 3.5).abs() < 1e-9);
        assert_eq!(track.at(2 * SECOND), None);
        // A quarter turn to the left on a circle of 4 m.
        let turn = std::f64::consts::FRAC_PI_2;
        let circle = odometry(2 * SECOND, Pose2::default(), 4.0 * turn, turn);
        let moved = Moment::of(&circle).unwrap().moved_by(1.0);
        assert!((moved.x_m - 4.0).abs() < 1e-9 && (moved.y_m - 4.0).abs() < 1e-9);
    }

    #[test]
    fn late_doubled_and_senseless_odometry_changes_nothing() {
        let mut track = Track::default();
        take(
            &mut track,
            &odometry(SECOND, Pose2::new(1.0, 0.0, 0.0), 1.0, 0.0),
        );
        let known = track.at(SECOND);
        take(
            &mut track,
            &odometry(SECOND, Pose2::new(9.0, 0.0, 0.0), 1.0, 0.0),
        );
        take(
            &mut track,
            &odometry(SECOND * 9 / 10, Pose2::new(9.0, 0.0, 0.0), 1.0, 0.0),
        );
        take(
            &mut track,
            &odometry(SECOND + 1, Pose2::new(f64::NAN, 0.0, 0.0), 1.0, 0.0),
        );
        for (speed_m_per_s, turn_rad_per_s) in [(101.0, 0.0), (-1e300, 0.0), (1.0, 11.0)] {
            let at = SECOND + 1;
            take(
                &mut track,
                &odometry(at, Pose2::default(), speed_m_per_s, turn_rad_per_s),
            );
        }
        assert_eq!(track.at(SECOND), known);
        // A recording that starts over.
        take(
            &mut track,
            &odometry(SECOND / 10, Pose2::new(5.0, 0.0, 0.0), 1.0, 0.0),
        );
        assert!(track.at(SECOND).is_none() && track.at(SECOND / 10).is_some());
    }

    #[test]
    fn memory_does_not_grow() {
        let mut track = Track::default();
        for k in 0..10 * MOMENTS as u64 {
            take(&mut track, &odometry(k + 1, Pose2::default(), 1.0, 0.0));
        }
        assert_eq!(track.0.len(), MOMENTS);
    }
}
