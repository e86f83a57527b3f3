//! Paths of small vehicles, smoothed as those of a car.
//!
//! The weights of the cost and the lengths that it knows are those of a car. A vehicle that turns more
//! tightly is smoothed in units in which its turning radius is that car's, so that its path, its steps and
//! its gaps are to its size what those of the car are. Whatever is published was tested in metres.

use swath_bridge::{Pose2, Vehicle};

use super::clothoid::State;
use super::optimise::Trajectory;
use crate::tolerance::GoalTolerance;

/// Turning radius of the car that everything is tuned for, metres.
const CAR_RADIUS_M: f64 = 5.5;
/// Greatest factor: smaller vehicles would need steps of millimetres.
const MOST: f64 = 16.0;

/// How many units a metre has; 1 for cars and all that turns as widely.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale(f64);

impl Scale {
    pub(super) fn of(vehicle: &Vehicle) -> Self {
        Self((CAR_RADIUS_M / vehicle.min_turning_radius_m).clamp(1.0, MOST))
    }

    pub(super) const fn factor(self) -> f64 {
        self.0
    }

    pub(super) fn length(self, metres: f64) -> f64 {
        metres * self.0
    }

    pub(super) fn curvature(self, per_m: f64) -> f64 {
        per_m / self.0
    }

    pub(super) fn rate(self, per_m2: f64) -> f64 {
        per_m2 / (self.0 * self.0)
    }

    pub(super) fn pose(self, pose: &Pose2) -> Pose2 {
        Pose2::new(pose.x_m * self.0, pose.y_m * self.0, pose.yaw_rad)
    }

    pub(super) fn pose_back(self, pose: &Pose2) -> Pose2 {
        Pose2::new(pose.x_m / self.0, pose.y_m / self.0, pose.yaw_rad)
    }

    pub(super) fn poses(self, poses: &[Pose2], into: &mut Vec<Pose2>) {
        into.clear();
        into.extend(poses.iter().map(|pose| self.pose(pose)));
    }

    pub(super) fn tolerance(self, tolerance: GoalTolerance) -> GoalTolerance {
        GoalTolerance {
            tolerance_m: tolerance.tolerance_m * self.0,
            ..tolerance
        }
    }

    pub(super) fn vehicle(self, vehicle: &Vehicle) -> Vehicle {
        Vehicle {
            wheelbase_m: vehicle.wheelbase_m * self.0,
            front_m: vehicle.front_m * self.0,
            rear_m: vehicle.rear_m * self.0,
            half_width_m: vehicle.half_width_m * self.0,
            min_turning_radius_m: vehicle.min_turning_radius_m * self.0,
            ..*vehicle
        }
    }

    /// A path in units as one in metres.
    pub(super) fn back(self, path: &Trajectory, into: &mut Trajectory) {
        into.step_m = path.step_m / self.0;
        into.states.clear();
        into.states.extend(path.states.iter().map(|state| State {
            x_m: state.x_m / self.0,
            y_m: state.y_m / self.0,
            yaw_rad: state.yaw_rad,
            curvature_per_m: state.curvature_per_m * self.0,
        }));
        into.rates_per_m2.clear();
        let squared = self.0 * self.0;
        into.rates_per_m2
            .extend(path.rates_per_m2.iter().map(|rate| rate * squared));
    }
}
