//! A pose to reach, and how nearly.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};
use swath_bridge::Pose2;

use crate::Error;

/// By default a goal is reached within this distance, metres.
pub const GOAL_TOLERANCE_M: f64 = 0.5;
/// By default a goal is reached within this angle, radians (15°).
pub const GOAL_TOLERANCE_RAD: f64 = 15.0 * PI / 180.0;

/// Least and greatest tolerances that can be worked with, metres and radians.
const LEAST_M: f64 = 0.01;
const MOST_M: f64 = 10.0;
const LEAST_RAD: f64 = 0.005;
const MOST_RAD: f64 = PI;

/// How near to a goal a path has to end.
///
/// A search reaches cells and directions of its table, so it takes the nearest of these where a tolerance
/// is smaller than they lie apart. What is made drivable ends within the tolerance, and at the goal itself
/// where there is room for it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GoalTolerance {
    /// Farthest that the end may lie from the goal, metres; 0.01 to 10.
    pub tolerance_m: f64,
    /// Most that the end may be turned from the goal, radians; 0.005 to π, which allows any heading.
    pub tolerance_rad: f64,
}

impl Default for GoalTolerance {
    fn default() -> Self {
        Self {
            tolerance_m: GOAL_TOLERANCE_M,
            tolerance_rad: GOAL_TOLERANCE_RAD,
        }
    }
}

impl GoalTolerance {
    /// Whether both are in their ranges.
    ///
    /// # Errors
    /// [`Error::PlanConfig`] names the one that is not.
    pub fn validate(&self) -> Result<(), Error> {
        for (field, value, least, most) in [
            ("goal.tolerance_m", self.tolerance_m, LEAST_M, MOST_M),
            (
                "goal.tolerance_rad",
                self.tolerance_rad,
                LEAST_RAD,
                MOST_RAD,
            ),
        ] {
            if !(value >= least && value <= most) {
                return Err(Error::PlanConfig {
                    field,
                    value,
                    least,
                    most,
                });
            }
        }
        Ok(())
    }
}

/// A pose to reach, in the vehicle's frame, and how nearly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// Where to.
    pub pose: Pose2,
    /// How nearly.
    pub tolerance: GoalTolerance,
}

impl From<&Pose2> for Target {
    /// With the default tolerance.
    fn from(pose: &Pose2) -> Self {
        Self {
            pose: *pose,
            tolerance: GoalTolerance::default(),
        }
    }
}
