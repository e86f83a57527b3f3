//! Why a planner tells a vehicle to stop.

/// Why a path is empty: what `reason` of `swath_msgs/PlanReport` says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum StopReason {
    /// No grid has come since the planner began.
    NoGrid,
    /// Grids have stopped coming.
    StaleGrid,
    /// A grid, the reference or the targets cannot be worked with.
    BadInput,
    /// A grid, the reference or the targets are in the odometry's frame, and no odometry is near in time.
    NoOdometry,
    /// A grid, the reference or the targets are in a frame that nothing joins with the vehicle's.
    NoTransform,
    /// There is nothing to go to.
    NoTargets,
    /// The vehicle stands in an obstacle.
    StartOccupied,
    /// No target can be reached, and no search ran out of time.
    Blocked,
    /// Targets are reached by paths that the vehicle cannot drive at its speed.
    NotDrivable,
    /// Searches or the making of drivable paths ran out of time, and nothing was found before.
    NoTime,
    /// Planning failed with an error.
    Failed,
    /// The planner ends.
    Ended,
}

impl StopReason {
    /// Every reason.
    pub const ALL: [Self; 12] = [
        Self::NoGrid,
        Self::StaleGrid,
        Self::BadInput,
        Self::NoOdometry,
        Self::NoTransform,
        Self::NoTargets,
        Self::StartOccupied,
        Self::Blocked,
        Self::NotDrivable,
        Self::NoTime,
        Self::Failed,
        Self::Ended,
    ];

    /// The name in reports, logs and tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::NoGrid => "no grid yet",
            Self::StaleGrid => "stale grid",
            Self::BadInput => "bad input",
            Self::NoOdometry => "no odometry",
            Self::NoTransform => "no transform",
            Self::NoTargets => "no reference or targets",
            Self::StartOccupied => "start occupied",
            Self::Blocked => "blocked",
            Self::NotDrivable => "not drivable",
            Self::NoTime => "no time",
            Self::Failed => "planning failed",
            Self::Ended => "planner ended",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::definition_of;

    #[test]
    fn the_definition_of_the_report_lists_every_reason() {
        let definition = definition_of("swath_msgs/PlanReport").unwrap();
        for reason in StopReason::ALL {
            let listed = format!("#   {}:", reason.name());
            assert_eq!(definition.matches(&listed).count(), 1, "{}", reason.name());
        }
    }
}
