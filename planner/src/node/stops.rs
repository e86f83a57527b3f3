//! Why a path is empty.

use std::collections::BTreeMap;

use swath_bridge::{Outcome, StopReason};

use super::frames::NotSeen;
use crate::frame::FramePlan;

/// Why a path is empty, with the evidence.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Stop {
    pub(super) reason: StopReason,
    pub(super) detail: String,
}

impl Stop {
    pub(super) fn new(reason: StopReason, detail: impl Into<String>) -> Self {
        Self {
            reason,
            detail: detail.into(),
        }
    }

    /// Something on a topic cannot be seen from the vehicle.
    pub(super) fn not_seen(topic: &str, error: &NotSeen) -> Self {
        let reason = match error {
            NotSeen::NoOdometry { .. } => StopReason::NoOdometry,
            NotSeen::NoTransform(_) => StopReason::NoTransform,
        };
        Self::new(reason, format!("{topic}: {error}"))
    }
}

impl std::fmt::Display for Stop {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let name = self.reason.name();
        if self.detail.is_empty() {
            return write!(formatter, "{name}");
        }
        write!(formatter, "{name}: {}", self.detail)
    }
}

/// What else is known of a frame in which no path was chosen.
#[derive(Debug, Clone, Copy)]
pub(super) struct Asked {
    /// Whether there was a reference.
    pub(super) has_reference: bool,
    /// Whether paths were to be made drivable.
    pub(super) smooth: bool,
}

/// Why no path of a planned frame was chosen.
pub(super) fn stop_of(plan: &FramePlan, asked: Asked) -> Stop {
    let targets = plan.targets.len();
    if targets == 0 {
        let detail = if asked.has_reference {
            "no target that is sampled along the reference lies on the grid"
        } else {
            "neither has come"
        };
        return Stop::new(StopReason::NoTargets, detail);
    }
    let mut outcomes: BTreeMap<Outcome, usize> = BTreeMap::new();
    for target in &plan.targets {
        *outcomes.entry(target.result.outcome).or_default() += 1;
    }
    let counted = outcomes
        .iter()
        .map(|(outcome, count)| format!("{count} {}", outcome.name()))
        .collect::<Vec<_>>()
        .join(", ");
    let solved = outcomes.get(&Outcome::Solved).copied().unwrap_or(0);
    if outcomes.contains_key(&Outcome::StartOccupied) {
        return Stop::new(
            StopReason::StartOccupied,
            "the vehicle's footprint touches an obstacle where it stands",
        );
    }
    if solved == 0 {
        let ran_out = outcomes.contains_key(&Outcome::BudgetExhausted);
        let reason = if ran_out {
            StopReason::NoTime
        } else {
            StopReason::Blocked
        };
        return Stop::new(
            reason,
            format!("none of {targets} targets reached ({counted})"),
        );
    }
    let made = plan
        .targets
        .iter()
        .filter(|target| target.drivable.is_some());
    let made = made.count();
    if !asked.smooth {
        return Stop::new(
            StopReason::NotDrivable,
            format!("{solved} of {targets} targets reached, but plan.smooth is off"),
        );
    }
    if made < solved {
        return Stop::new(
            StopReason::NoTime,
            format!(
                "{solved} of {targets} targets reached, but {} of their paths were not made drivable in \
                 time, and none of the others can be driven at the speed",
                solved - made
            ),
        );
    }
    Stop::new(
        StopReason::NotDrivable,
        format!(
            "{solved} of {targets} targets reached, but no path can be driven at the speed ({counted})"
        ),
    )
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use swath_bridge::Pose2;

    use super::*;
    use crate::frame::{Consulted, Start};
    use crate::plan::TargetPlan;
    use crate::search::TargetResult;
    use crate::smooth::{Drivability, DrivablePath};

    /// A target, and whether its path was made drivable, if it was tried.
    fn target(outcome: Outcome, drivability: Option<Drivability>) -> TargetPlan {
        TargetPlan {
            goal: Pose2::default(),
            result: TargetResult::without_path(outcome, 1),
            cpu: Duration::ZERO,
            drivable: drivability.map(|drivability| DrivablePath {
                points: Vec::new(),
                drivability,
                shortfall: None,
                iterations: 0,
            }),
        }
    }

    fn stop(targets: Vec<TargetPlan>, smooth: bool) -> Stop {
        let plan = FramePlan {
            targets,
            start: Start::default(),
            regions: Vec::new(),
            reach: Vec::new(),
            consulted: Consulted::Without,
            network: Duration::ZERO,
            search: Duration::ZERO,
            cpu: Duration::ZERO,
            total: Duration::ZERO,
            smooth: Duration::ZERO,
            deadline: Duration::ZERO,
        };
        let has_reference = false;
        stop_of(
            &plan,
            Asked {
                has_reference,
                smooth,
            },
        )
    }

    #[test]
    fn each_way_of_having_no_path_has_its_reason() {
        use Drivability::{Slower, TurnsOnTheSpot};
        use Outcome::{BudgetExhausted, GoalOccupied, Solved, StartOccupied, Unreachable};
        for (targets, reason, said) in [
            (vec![], StopReason::NoTargets, "neither has come"),
            (
                vec![target(StartOccupied, None), target(StartOccupied, None)],
                StopReason::StartOccupied,
                "footprint",
            ),
            (
                vec![
                    target(Unreachable, None),
                    target(GoalOccupied, None),
                    target(Unreachable, None),
                ],
                StopReason::Blocked,
                "none of 3 targets reached (2 unreachable, 1 goal_occupied)",
            ),
            (
                vec![target(Unreachable, None), target(BudgetExhausted, None)],
                StopReason::NoTime,
                "1 budget_exhausted",
            ),
            (
                vec![target(Solved, None), target(Solved, Some(Slower))],
                StopReason::NoTime,
                "2 of 2 targets reached, but 1 of",
            ),
            (
                vec![
                    target(Solved, Some(TurnsOnTheSpot)),
                    target(Unreachable, None),
                ],
                StopReason::NotDrivable,
                "1 of 2 targets reached",
            ),
        ] {
            let stop = stop(targets, true);
            assert_eq!(stop.reason, reason);
            assert!(stop.detail.contains(said), "{}", stop.detail);
        }
        let off = stop(vec![target(Solved, None)], false);
        assert_eq!(off.reason, StopReason::NotDrivable);
        assert!(off.detail.contains("plan.smooth is off"), "{off}");
    }
}
