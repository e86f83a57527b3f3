//! An independent check of paths that are to be driven.
//!
//! It shares no geometry with the search, the collision map or the smoother: the rectangle is tested
//! against the occupied squares by separating axes, at poses that it interpolates itself from the
//! points' positions and headings; curvature and its rate are estimated from these and compared with
//! what is stated.

mod curve;
mod rectangle;

use swath_bridge::{GridSpec, Pose2, Vehicle};

use crate::Plane;
use crate::path_point::PathPoint;

pub use rectangle::overlap_m;

/// What a path is held to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CheckLimits {
    /// The rectangle.
    pub vehicle: Vehicle,
    /// Most curvature, 1/m.
    pub max_curvature_per_m: f64,
    /// Most change of curvature along the path, 1/m².
    pub max_curvature_rate_per_m2: f64,
    /// Share by which either may be passed.
    pub tolerance: f64,
    /// Farthest that two points may lie apart, metres.
    pub max_spacing_m: f64,
    /// Distance between tested poses, metres.
    pub tested_every_m: f64,
    /// Farthest that the end may be from the goal, metres.
    pub goal_within_m: f64,
    /// Most that the end may be turned from the goal, radians.
    pub goal_within_rad: f64,
}

impl CheckLimits {
    /// The limits of a vehicle at a largest curvature, 1/m.
    pub fn new(vehicle: &Vehicle, max_curvature_per_m: f64) -> Self {
        Self {
            vehicle: *vehicle,
            max_curvature_per_m,
            max_curvature_rate_per_m2: vehicle.max_curvature_rate_per_m2,
            tolerance: 0.01,
            max_spacing_m: 0.2,
            tested_every_m: 0.05,
            goal_within_m: 0.5,
            goal_within_rad: 15f64.to_radians(),
        }
    }
}

/// Where a path is to begin and to end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ends {
    /// The first pose.
    pub start: Pose2,
    /// The first curvature, 1/m, if it is given.
    pub start_curvature_per_m: Option<f64>,
    /// What the last pose is near to.
    pub goal: Pose2,
}

/// What may be wrong with a path; each kind has its amount.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Fault {
    /// Fewer than two points; their number.
    NoPath,
    /// A number is not finite; the point's number.
    NotFinite,
    /// The first pose is not the start; metres plus radians.
    WrongStart,
    /// The first curvature is not the given one; 1/m.
    WrongStartCurvature,
    /// The end is too far from the goal; metres.
    GoalMissed,
    /// The end is turned too far from the goal; radians.
    GoalTurned,
    /// Two points lie too far apart, or at one place; metres.
    Spacing,
    /// The stated arc length is not the distance driven; metres.
    ArcLength,
    /// The path goes backward: the angle between motion and heading, radians.
    Cusp,
    /// The motion does not follow the heading: a jump aside; radians.
    Sideways,
    /// The heading turns by more between two points than the curvature allows; radians.
    HeadingJump,
    /// A stated or estimated curvature beyond the limit; 1/m.
    Curvature,
    /// Stated and estimated curvature differ; 1/m.
    CurvatureMisstated,
    /// A stated or estimated curvature changes too fast; 1/m².
    CurvatureRate,
    /// The rectangle overlaps an occupied cell; metres.
    Collision,
    /// The reference point leaves the map; metres.
    OffMap,
}

/// One thing that is wrong with a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Violation {
    /// What.
    pub fault: Fault,
    /// Where, as arc length from the start, metres.
    pub at_m: f64,
    /// How much, in the fault's unit.
    pub amount: f64,
}

/// Everything that is wrong with a path on a map of occupied cells; nothing if it can be driven.
pub fn check_path(
    (spec, obstacles): (&GridSpec, &Plane),
    limits: &CheckLimits,
    ends: &Ends,
    points: &[PathPoint],
) -> Vec<Violation> {
    let mut found = Vec::new();
    if points.len() < 2 {
        found.push(Violation {
            fault: Fault::NoPath,
            at_m: 0.0,
            amount: points.len() as f64,
        });
        return found;
    }
    for (index, point) in points.iter().enumerate() {
        let sum = point.pose.x_m + point.pose.y_m + point.pose.yaw_rad;
        if !(sum + point.curvature_per_m + point.at_m).is_finite() {
            found.push(Violation {
                fault: Fault::NotFinite,
                at_m: point.at_m,
                amount: index as f64,
            });
        }
    }
    if !found.is_empty() {
        return found;
    }
    check_ends(limits, ends, points, &mut found);
    curve::check(limits, points, &mut found);
    check_ground((spec, obstacles), limits, points, &mut found);
    found
}

fn check_ends(limits: &CheckLimits, ends: &Ends, points: &[PathPoint], found: &mut Vec<Violation>) {
    let (first, last) = (&points[0], &points[points.len() - 1]);
    let mut report = |at_m: f64, fault: Fault, amount: f64, most: f64| {
        if amount > most {
            found.push(Violation {
                fault,
                at_m,
                amount,
            });
        }
    };
    let (distance_m, turn_rad) = curve::difference(&ends.start, &first.pose);
    report(0.0, Fault::WrongStart, distance_m + turn_rad.abs(), 1e-9);
    if let Some(given) = ends.start_curvature_per_m {
        let off = (first.curvature_per_m - given).abs();
        report(0.0, Fault::WrongStartCurvature, off, 1e-9);
    }
    let (distance_m, turn_rad) = curve::difference(&ends.goal, &last.pose);
    report(
        last.at_m,
        Fault::GoalMissed,
        distance_m,
        limits.goal_within_m,
    );
    report(
        last.at_m,
        Fault::GoalTurned,
        turn_rad.abs(),
        limits.goal_within_rad,
    );
}

/// Tests the rectangle at equal distances along the path, and at its end.
fn check_ground(
    (spec, obstacles): (&GridSpec, &Plane),
    limits: &CheckLimits,
    points: &[PathPoint],
    found: &mut Vec<Violation>,
) {
    let mut before_m = 0.0;
    let mut next_m = 0.0;
    let mut test = |pose: &Pose2, at_m: f64| {
        if let Some(amount) = rectangle::worst_overlap_m(spec, obstacles, &limits.vehicle, pose) {
            found.push(Violation {
                fault: Fault::Collision,
                at_m,
                amount,
            });
        }
        if let Some(amount) = rectangle::off_map_m(spec, pose) {
            found.push(Violation {
                fault: Fault::OffMap,
                at_m,
                amount,
            });
        }
    };
    for pair in points.windows(2) {
        let (from, to) = (&pair[0].pose, &pair[1].pose);
        let (length_m, _) = curve::difference(from, to);
        // However long a piece is, it is not tested more often than this.
        let every_m = limits.tested_every_m.max(length_m / 10_000.0);
        while next_m < before_m + length_m {
            let share = (next_m - before_m) / length_m;
            test(&curve::between(from, to, share), next_m);
            next_m += every_m;
        }
        before_m += length_m;
    }
    test(&points[points.len() - 1].pose, before_m);
}

#[cfg(test)]
mod tests;
