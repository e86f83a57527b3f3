//! Why frames were planned without a path to follow, from what became of their targets.

use std::collections::BTreeMap;

use crate::Error;
use crate::frames::{counts, names, numbers};
use crate::tables::Tables;

const TABLE: &str = "planner_health";

/// Why no path was chosen in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Stop {
    /// There was no target: no reference path had come, and nobody had sent targets.
    NoTargets,
    /// The vehicle stood on cells that are occupied.
    StartOccupied,
    /// A search or the smoothing of paths ended early, for lack of time or because it was cancelled.
    NoTime,
    /// Every target was occupied, off the grid or proved unreachable.
    Blocked,
    /// There were paths, but none that the vehicle can drive.
    NotDrivable,
}

impl Stop {
    /// The cause in words.
    pub(crate) const fn words(self) -> &'static str {
        match self {
            Self::NoTargets => "no target was known (no reference path)",
            Self::StartOccupied => "the vehicle stood on occupied cells",
            Self::NoTime => "the time ran out before a path was ready",
            Self::Blocked => "every target was blocked",
            Self::NotDrivable => "no path could be driven",
        }
    }
}

/// What became of a frame's targets.
#[derive(Debug, Clone, Copy, Default)]
struct Fates {
    targets: u64,
    solved: u64,
    /// Paths that were made as drivable as they can be, which is not enough.
    smoothed: u64,
    start_occupied: u64,
    unfinished: u64,
}

impl Fates {
    fn add(&mut self, outcome: &str, drivability: &str) {
        self.targets += 1;
        self.smoothed += u64::from(!["", "chords"].contains(&drivability));
        match outcome {
            "solved" => self.solved += 1,
            "start_occupied" => self.start_occupied += 1,
            "budget_exhausted" | "cancelled" => self.unfinished += 1,
            _ => {}
        }
    }

    const fn cause(self) -> Stop {
        if self.targets == 0 {
            Stop::NoTargets
        } else if self.smoothed > 0 {
            Stop::NotDrivable
        } else if self.solved > 0 {
            Stop::NoTime
        } else if self.start_occupied > 0 {
            Stop::StartOccupied
        } else if self.unfinished > 0 {
            Stop::NoTime
        } else {
            Stop::Blocked
        }
    }
}

/// The frames without a chosen path, by the row of their plan.
///
/// # Errors
/// [`Error::Table`] if a column is missing.
pub(super) fn stops(tables: &Tables) -> Result<BTreeMap<u64, Stop>, Error> {
    let chosen = numbers(&tables.plans, "chosen", TABLE)?;
    let mut fates: BTreeMap<u64, Fates> = (0..)
        .zip(chosen)
        .filter(|(_, chosen)| *chosen < 0.0)
        .map(|(plan, _)| (plan, Fates::default()))
        .collect();
    let plans = counts(&tables.targets, "plan", TABLE)?;
    let outcomes = names(&tables.targets, "outcome", TABLE)?;
    let drivabilities = names(&tables.targets, "drivability", TABLE)?;
    for (row, plan) in plans.iter().enumerate() {
        if let Some(fates) = fates.get_mut(plan) {
            fates.add(&outcomes[row], &drivabilities[row]);
        }
    }
    Ok(fates
        .into_iter()
        .map(|(plan, fates)| (plan, fates.cause()))
        .collect())
}

#[cfg(test)]
mod tests {
    use swath_bridge::Outcome;

    use super::*;

    fn cause_of(outcomes: &[Outcome]) -> Stop {
        let mut fates = Fates::default();
        for outcome in outcomes {
            fates.add(outcome.name(), "");
        }
        fates.cause()
    }

    #[test]
    fn the_cause_of_a_stop_is_read_from_the_outcomes() {
        use Outcome::{
            BudgetExhausted, Cancelled, GoalOccupied, OutOfBounds, Solved, StartOccupied,
            Unreachable,
        };
        assert_eq!(cause_of(&[]), Stop::NoTargets);
        assert_eq!(cause_of(&[StartOccupied, OutOfBounds]), Stop::StartOccupied);
        assert_eq!(cause_of(&[Unreachable, BudgetExhausted]), Stop::NoTime);
        assert_eq!(cause_of(&[Cancelled]), Stop::NoTime);
        assert_eq!(
            cause_of(&[Unreachable, GoalOccupied, OutOfBounds]),
            Stop::Blocked
        );
        // A path that was found but not smoothed was not looked at for lack of time.
        assert_eq!(cause_of(&[Unreachable, Solved]), Stop::NoTime);
        let mut fates = Fates::default();
        fates.add("solved", "chords");
        assert_eq!(fates.cause(), Stop::NoTime);
        fates.add("solved", "too_tight");
        assert_eq!(fates.cause(), Stop::NotDrivable);
    }
}
