//! `sensor_msgs/LaserScan`: where each beam ended, in the vehicle frame.

use nalgebra::{Isometry3, Point3};

use crate::Error;
use crate::msg::Message;
use crate::msg::sensor::LaserScan;

/// Most beams of a scan.
pub const MAX_BEAMS: usize = 100_000;
/// Nearer returns are the sensor's housing, metres, where the scan itself does not say.
const MIN_RANGE_M: f32 = 0.02;
/// Farthest return that is believed, metres.
const MAX_RANGE_M: f32 = 1000.0;

/// Where a beam ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BeamEnd {
    /// Forward, metres, vehicle frame.
    pub x_m: f32,
    /// Left, metres, vehicle frame.
    pub y_m: f32,
    /// Whether something was hit there; else the beam was only free up to there.
    pub is_hit: bool,
}

/// How the ranges of a sensor are meant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BeamConfig {
    /// How far a beam that hit nothing clears, metres.
    pub clear_m: f32,
    /// Whether a range that is exactly the greatest one is a return.
    pub is_limit_return: bool,
}

/// Where the beams of a scan ended.
///
/// A range is a return if it is finite and within the scan's limits. The least is excluded, and so is the
/// greatest, unless the configuration says otherwise: sensors that see nothing report their greatest
/// range, or infinity. Such a beam is free up to `clear_m` or the greatest range, whichever is nearer.
/// NaN, negative and too small ranges say nothing.
///
/// # Errors
/// [`Error::InvalidMessage`] if angles are not finite, the increment is 0 or there are too many
/// beams.
pub fn beams_of(
    scan: &LaserScan,
    vehicle_from_sensor: &Isometry3<f64>,
    config: &BeamConfig,
) -> Result<Vec<BeamEnd>, Error> {
    let invalid = |what: String| {
        Err(Error::InvalidMessage {
            type_name: LaserScan::TYPE_NAME,
            what,
        })
    };
    if scan.ranges.len() > MAX_BEAMS {
        return invalid(format!(
            "{} ranges, expected at most {MAX_BEAMS}",
            scan.ranges.len()
        ));
    }
    let step_rad = scan.angle_increment;
    if !(scan.angle_min.is_finite() && step_rad.is_finite()) || step_rad == 0.0 {
        return invalid(format!(
            "angle_min {} and angle_increment {step_rad}, expected finite numbers and an increment",
            scan.angle_min
        ));
    }
    let least_m = if scan.range_min.is_finite() {
        scan.range_min.max(MIN_RANGE_M)
    } else {
        MIN_RANGE_M
    };
    let most_m = if scan.range_max > 0.0 {
        scan.range_max.min(MAX_RANGE_M)
    } else {
        MAX_RANGE_M
    };
    let ends = scan
        .ranges
        .iter()
        .enumerate()
        .filter_map(|(index, &range_m)| {
            let is_limit = config.is_limit_return && range_m == most_m;
            let is_hit = range_m > least_m && (range_m < most_m || is_limit);
            let length_m = if is_hit {
                range_m
            } else if range_m >= most_m {
                config.clear_m.min(most_m)
            } else {
                return None;
            };
            let angle_rad = f64::from(scan.angle_min) + index as f64 * f64::from(step_rad);
            let (sin, cos) = libm::sincos(angle_rad);
            let length_m = f64::from(length_m);
            let end = vehicle_from_sensor * Point3::new(length_m * cos, length_m * sin, 0.0);
            #[expect(
                clippy::cast_possible_truncation,
                reason = "within a kilometre of the sensor"
            )]
            Some(BeamEnd {
                x_m: end.x as f32,
                y_m: end.y as f32,
                is_hit,
            })
        });
    Ok(ends.collect())
}

/// What the ranges of a topic's scans have in common, from which follows what the greatest one means.
///
/// There are two kinds of sensors. Some report their greatest range where they see nothing. Others report
/// infinity or NaN there, or their drivers fill in the largest reading of each scan as its greatest
/// range, which then is a return like any other.
#[derive(Debug, Clone, Default)]
pub(crate) struct RangeHabits {
    scans: u64,
    /// Different greatest ranges, up to as many as matter.
    limits_m: Vec<f32>,
    has_none_mark: bool,
    ranges: u64,
    at_limit: u64,
}

/// Different greatest ranges from which on they are those of the scans, not of the sensor: a sensor may
/// have another range in another mode.
const MANY_LIMITS: usize = 3;
/// One of so many ranges at the greatest one is more than there can be returns at just that distance.
const FEW_AT_LIMIT: u64 = 20;

impl RangeHabits {
    pub(crate) fn add(&mut self, scan: &LaserScan) {
        self.scans += 1;
        if self.limits_m.len() < MANY_LIMITS && !self.limits_m.contains(&scan.range_max) {
            self.limits_m.push(scan.range_max);
        }
        self.has_none_mark |= scan.ranges.iter().any(|range_m| !range_m.is_finite());
        let at_limit = scan
            .ranges
            .iter()
            .filter(|range_m| **range_m == scan.range_max);
        self.at_limit += at_limit.count() as u64;
        self.ranges += scan.ranges.len() as u64;
    }

    /// Whether a range that is exactly the greatest one is a return.
    pub(crate) fn is_limit_return(&self) -> bool {
        let differing = self.limits_m.len();
        let is_of_scan =
            differing >= MANY_LIMITS || (differing > 1 && differing as u64 == self.scans);
        let is_rare = self.at_limit * FEW_AT_LIMIT <= self.ranges;
        is_of_scan || (self.has_none_mark && is_rare)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::header::Header;
    use nalgebra::{Translation3, UnitQuaternion};
    use proptest::prelude::*;
    use std::f32::consts::FRAC_PI_2;

    const PLAIN: BeamConfig = BeamConfig {
        clear_m: 8.0,
        is_limit_return: false,
    };

    fn scan(ranges: &[f32]) -> LaserScan {
        LaserScan {
            header: Header::at(0, "lidar"),
            angle_min: -FRAC_PI_2,
            angle_max: FRAC_PI_2,
            angle_increment: FRAC_PI_2,
            time_increment: 0.0,
            scan_time: 0.0,
            range_min: 0.1,
            range_max: 20.0,
            ranges: ranges.to_vec(),
            intensities: Vec::new(),
        }
    }

    fn read(scan: &LaserScan) -> Vec<BeamEnd> {
        beams_of(scan, &Isometry3::identity(), &PLAIN).unwrap()
    }

    fn assert_ends(found: &[BeamEnd], wanted: &[(f32, f32, bool)]) {
        assert_eq!(found.len(), wanted.len(), "{found:?}");
        for (found, (x_m, y_m, is_hit)) in found.iter().zip(wanted) {
            let is_there = (found.x_m - x_m).abs() < 1e-4 && (found.y_m - y_m).abs() < 1e-4;
            assert!(is_there && found.is_hit == *is_hit, "{found:?} {x_m} {y_m}");
        }
    }

    #[test]
    fn beams_start_at_the_smallest_angle_and_end_at_their_range() {
        assert_ends(
            &read(&scan(&[1.0, 2.0, 3.0])),
            &[(0.0, -1.0, true), (2.0, 0.0, true), (0.0, 3.0, true)],
        );
    }

    #[test]
    fn only_ranges_within_the_limits_are_returns() {
        let none = read(&scan(&[f32::NAN, 0.0, 0.1, -1.0, f32::NEG_INFINITY]));
        assert_ends(&none, &[]);
        assert_ends(
            &read(&scan(&[f32::INFINITY, 20.0])),
            &[(0.0, -8.0, false), (8.0, 0.0, false)],
        );
        let mut unlimited = scan(&[50.0]);
        unlimited.range_max = 0.0;
        assert_ends(&read(&unlimited), &[(0.0, -50.0, true)]);
    }

    fn habits(scans: &[(f32, [f32; 30])]) -> bool {
        let mut habits = RangeHabits::default();
        for (range_max, ranges) in scans {
            habits.add(&LaserScan {
                range_max: *range_max,
                ..scan(ranges)
            });
        }
        habits.is_limit_return()
    }

    fn ranges(most: f32, rest: f32) -> [f32; 30] {
        let mut ranges = [rest; 30];
        ranges[7] = most;
        ranges
    }

    #[test]
    fn the_greatest_range_is_a_return_where_it_is_the_largest_reading() {
        let at_limit = BeamConfig {
            is_limit_return: true,
            ..PLAIN
        };
        let ends = beams_of(&scan(&[20.0]), &Isometry3::identity(), &at_limit).unwrap();
        assert_ends(&ends, &[(0.0, -20.0, true)]);
        // The sensor stands: the largest reading stays the same, beside infinity or NaN.
        for none in [f32::INFINITY, f32::NAN] {
            assert!(habits(&[
                (8.0, ranges(8.0, none)),
                (8.0, ranges(8.0, none))
            ]));
        }
        // The sensor moves: the largest reading is another one in each scan.
        assert!(habits(&[(8.0, ranges(8.0, 3.0)), (7.9, ranges(7.9, 3.0))]));
    }

    #[test]
    fn a_fixed_greatest_range_means_that_nothing_was_seen() {
        assert!(!habits(&[
            (30.0, ranges(3.0, 30.0)),
            (30.0, ranges(4.0, 30.0))
        ]));
        assert!(!habits(&[
            (30.0, ranges(30.0, 3.0)),
            (30.0, ranges(30.0, 4.0))
        ]));
        // Here infinity means something else, perhaps that there was no measurement.
        assert!(!habits(&[(30.0, ranges(f32::INFINITY, 30.0)); 5]));
        // Two modes of one sensor.
        let [near, far] = [(30.0, ranges(3.0, 30.0)), (80.0, ranges(3.0, 80.0))];
        assert!(!habits(&[near, near, far, far, near]));
    }

    #[test]
    fn a_scanner_hung_upside_down_sees_left_and_right_the_right_way_round() {
        let hung = Isometry3::from_parts(
            Translation3::new(1.0, 0.0, 2.0),
            UnitQuaternion::from_euler_angles(std::f64::consts::PI, 0.0, 0.0),
        );
        assert_ends(
            &beams_of(&scan(&[1.0]), &hung, &PLAIN).unwrap(),
            &[(1.0, 1.0, true)],
        );
    }

    #[test]
    fn a_scan_that_cannot_be_meant_is_an_error() {
        let mut bad = scan(&[1.0]);
        bad.angle_increment = 0.0;
        assert!(beams_of(&bad, &Isometry3::identity(), &PLAIN).is_err());
        bad.angle_increment = f32::NAN;
        assert!(beams_of(&bad, &Isometry3::identity(), &PLAIN).is_err());
    }

    proptest! {
        #[test]
        fn no_scan_panics(
            (angle_min, angle_increment) in (any::<f32>(), any::<f32>()),
            (range_min, range_max) in (any::<f32>(), any::<f32>()),
            ranges in proptest::collection::vec(any::<f32>(), 0..40),
        ) {
            let scan = LaserScan { angle_min, angle_increment, range_min, range_max, ..scan(&ranges) };
            if let Ok(ends) = beams_of(&scan, &Isometry3::identity(), &PLAIN) {
                prop_assert!(ends.iter().all(|end| end.x_m.is_finite() && end.y_m.is_finite()));
            }
        }
    }
}
