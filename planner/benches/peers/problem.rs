//! What every planner is given.

use swath_bridge::{GridSpec, Pose2, Vehicle};
use swath_planner::Plane;

/// One map with its goals.
pub(crate) struct Problem {
    pub(crate) name: &'static str,
    pub(crate) spec: GridSpec,
    pub(crate) vehicle: Vehicle,
    pub(crate) obstacles: Plane,
    pub(crate) goals: Vec<Pose2>,
    /// Time for one goal, seconds.
    pub(crate) limit_s: f64,
}

impl Problem {
    /// A problem of the grid and the vehicle that are the defaults.
    pub(crate) fn new(
        name: &'static str,
        (obstacles, goals): (Plane, Vec<Pose2>),
        limit_s: f64,
    ) -> Self {
        Self {
            name,
            spec: GridSpec::default(),
            vehicle: Vehicle::default(),
            obstacles,
            goals,
            limit_s,
        }
    }
}
