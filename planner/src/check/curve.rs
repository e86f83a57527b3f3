//! Whether points lie on a curve that a car can follow: estimates from positions and headings alone,
//! and their agreement with what is stated.

use std::f64::consts::{PI, TAU};

use swath_bridge::Pose2;

use super::{CheckLimits, Fault, Violation};
use crate::path_point::PathPoint;

/// Stated and estimated curvature may differ by this beside the limit's tolerance, 1/m: what is
/// neglected below on arcs of 0.2 m.
const NEGLECTED_PER_M: f64 = 1e-4;
/// Angle between motion and mean heading that rounding may make, radians.
const NEGLECTED_RAD: f64 = 2e-4;

/// Distance between two poses in metres, and turn from one to the other in radians, in [-π, π].
pub(super) fn difference(from: &Pose2, to: &Pose2) -> (f64, f64) {
    let distance_m = (to.x_m - from.x_m).hypot(to.y_m - from.y_m);
    (distance_m, signed_angle(to.yaw_rad - from.yaw_rad))
}

fn signed_angle(angle_rad: f64) -> f64 {
    let angle = angle_rad.rem_euclid(TAU);
    if angle > PI { angle - TAU } else { angle }
}

/// The pose at a share of the way: a cubic through both positions that leaves and arrives in the
/// directions of the headings.
pub(super) fn between(from: &Pose2, to: &Pose2, share: f64) -> Pose2 {
    let (length_m, turn_rad) = difference(from, to);
    let t = share;
    let speed_m = length_m * (1.0 + turn_rad * turn_rad / 24.0);
    let cubic = |a: f64, b: f64, leave: f64, arrive: f64| {
        let (t2, t3) = (t * t, t * t * t);
        let place = (2.0 * t3 - 3.0 * t2 + 1.0) * a
            + (t3 - 2.0 * t2 + t) * leave
            + (3.0 * t2 - 2.0 * t3) * b
            + (t3 - t2) * arrive;
        let slope = (6.0 * t2 - 6.0 * t) * (a - b)
            + (3.0 * t2 - 4.0 * t + 1.0) * leave
            + (3.0 * t2 - 2.0 * t) * arrive;
        (place, slope)
    };
    let (leave, arrive) = (from.yaw_rad.sin_cos(), to.yaw_rad.sin_cos());
    let (x_m, dx) = cubic(from.x_m, to.x_m, speed_m * leave.1, speed_m * arrive.1);
    let (y_m, dy) = cubic(from.y_m, to.y_m, speed_m * leave.0, speed_m * arrive.0);
    // Two points at one place, or a cusp between them, have no direction of motion.
    let yaw_rad = if dx.hypot(dy) > 1e-3 * length_m && length_m > 0.0 {
        dy.atan2(dx)
    } else {
        from.yaw_rad + share * turn_rad
    };
    Pose2::new(x_m, y_m, yaw_rad)
}

/// What one piece between two points shows.
struct Piece {
    at_m: f64,
    /// Arc length, from the distance and the turn.
    length_m: f64,
    distance_m: f64,
    /// Direction of motion, radians.
    bearing_rad: f64,
    turn_rad: f64,
}

/// Finds what no car could follow.
pub(super) fn check(limits: &CheckLimits, points: &[PathPoint], found: &mut Vec<Violation>) {
    let pieces: Vec<Piece> = points.windows(2).map(piece).collect();
    let mut out = Report { limits, found };
    for point in points {
        out.curvature(point.at_m, point.curvature_per_m);
    }
    for (piece, pair) in pieces.iter().zip(points.windows(2)) {
        out.piece(piece, &pair[0], &pair[1]);
    }
    for (pair, points) in pieces.windows(2).zip(points.windows(3)) {
        out.joint((&pair[0], &pair[1]), points);
    }
    let first = points[0].at_m;
    out.report(Fault::ArcLength, (0.0, first.abs()), 1e-9);
}

fn piece(pair: &[PathPoint]) -> Piece {
    let (from, to) = (&pair[0].pose, &pair[1].pose);
    let (distance_m, turn_rad) = difference(from, to);
    // A chord of an arc that turns by a is shorter by the factor sin(a/2) / (a/2).
    let half = 0.5 * turn_rad.abs();
    let length_m = if half > 1e-6 {
        distance_m * half / half.sin()
    } else {
        distance_m
    };
    Piece {
        at_m: pair[0].at_m,
        length_m,
        distance_m,
        bearing_rad: (to.y_m - from.y_m).atan2(to.x_m - from.x_m),
        turn_rad,
    }
}

struct Report<'a> {
    limits: &'a CheckLimits,
    found: &'a mut Vec<Violation>,
}

impl Report<'_> {
    fn report(&mut self, fault: Fault, (at_m, amount): (f64, f64), most: f64) {
        if amount.is_nan() || amount > most {
            self.found.push(Violation {
                fault,
                at_m,
                amount,
            });
        }
    }

    fn curvature(&mut self, at_m: f64, per_m: f64) {
        let most = self.limits.max_curvature_per_m * (1.0 + self.limits.tolerance);
        self.report(Fault::Curvature, (at_m, per_m.abs()), most);
    }

    fn rate(&mut self, at_m: f64, per_m2: f64) {
        let most = self.limits.max_curvature_rate_per_m2 * (1.0 + self.limits.tolerance);
        self.report(Fault::CurvatureRate, (at_m, per_m2.abs()), most);
    }

    fn agrees(&mut self, at_m: f64, stated: f64, estimated: f64) {
        let most = self.limits.tolerance * self.limits.max_curvature_per_m + NEGLECTED_PER_M;
        let off = (stated - estimated).abs();
        self.report(Fault::CurvatureMisstated, (at_m, off), most);
    }

    /// One piece: spacing, stated length, direction of motion, turn.
    fn piece(&mut self, piece: &Piece, from: &PathPoint, to: &PathPoint) {
        let at_m = piece.at_m;
        let most_m = self.limits.max_spacing_m * (1.0 + 1e-9);
        self.report(Fault::Spacing, (at_m, piece.distance_m), most_m);
        if piece.distance_m < 1e-6 {
            self.found.push(Violation {
                fault: Fault::Spacing,
                at_m,
                amount: piece.distance_m,
            });
            return;
        }
        let stated_m = to.at_m - from.at_m;
        let off_m = (stated_m - piece.length_m).abs();
        self.report(
            Fault::ArcLength,
            (at_m, off_m),
            1e-4 * piece.length_m + 1e-9,
        );
        let aside_rad = signed_angle(piece.bearing_rad - from.pose.yaw_rad);
        self.report(Fault::Cusp, (at_m, aside_rad.abs()), PI / 2.0);
        // On a clothoid the motion's direction is the mean heading, but for rate · length² / 12.
        let rate = self.limits.max_curvature_rate_per_m2 * (1.0 + self.limits.tolerance);
        let aside_rad = signed_angle(aside_rad - 0.5 * piece.turn_rad).abs();
        let most_rad = rate * piece.length_m * piece.length_m / 12.0 + NEGLECTED_RAD;
        self.report(Fault::Sideways, (at_m, aside_rad), most_rad);
        let most = self.limits.max_curvature_per_m * (1.0 + self.limits.tolerance);
        let most_rad = most * piece.length_m;
        self.report(Fault::HeadingJump, (at_m, piece.turn_rad.abs()), most_rad);
        // The turn over a piece is its mean curvature.
        let estimated = piece.turn_rad / piece.length_m;
        self.curvature(at_m, estimated);
        let stated = f64::midpoint(from.curvature_per_m, to.curvature_per_m);
        self.agrees(at_m, stated, estimated);
        self.rate(
            at_m,
            (to.curvature_per_m - from.curvature_per_m) / piece.length_m,
        );
    }

    /// Two pieces and the point between them: curvature from three positions, and its rate from two
    /// turns.
    fn joint(&mut self, (before, behind): (&Piece, &Piece), points: &[PathPoint]) {
        let (a, b) = (before.length_m, behind.length_m);
        if before.distance_m < 1e-6 || behind.distance_m < 1e-6 {
            return;
        }
        let at_m = behind.at_m;
        let turned = signed_angle(behind.bearing_rad - before.bearing_rad);
        let estimated = 2.0 * turned / (a + b);
        self.curvature(at_m, estimated);
        // Three positions show the mean of the curvature under a hat that is as wide as they reach.
        let [first, middle, last] = [0, 1, 2].map(|index| points[index].curvature_per_m);
        let stated = (a * (first + 2.0 * middle) + b * (2.0 * middle + last)) / (3.0 * (a + b));
        self.agrees(at_m, stated, estimated);
        let change = behind.turn_rad / b - before.turn_rad / a;
        self.rate(at_m, change / (0.5 * (a + b)));
    }
}
