//! What became of a plan to one target.

use serde::{Deserialize, Serialize};

/// The result of planning to one target, as data.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// There is a path.
    Solved,
    /// There is none: the search came to its end.
    Unreachable,
    /// The search was stopped by its limit of time or expansions.
    BudgetExhausted,
    /// The vehicle stands in an obstacle.
    StartOccupied,
    /// No pose within the tolerance of the goal is free.
    GoalOccupied,
    /// The goal is off the map.
    OutOfBounds,
    /// The caller stopped the search.
    Cancelled,
}

impl Outcome {
    /// Every outcome, in the order of their codes.
    pub const ALL: [Self; 7] = [
        Self::Solved,
        Self::Unreachable,
        Self::BudgetExhausted,
        Self::StartOccupied,
        Self::GoalOccupied,
        Self::OutOfBounds,
        Self::Cancelled,
    ];

    /// The code in `swath_msgs/TargetPlan` and `swath_msgs/Sample`.
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The outcome of a code, if it has one.
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }

    /// The name used in JSON and tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Solved => "solved",
            Self::Unreachable => "unreachable",
            Self::BudgetExhausted => "budget_exhausted",
            Self::StartOccupied => "start_occupied",
            Self::GoalOccupied => "goal_occupied",
            Self::OutOfBounds => "out_of_bounds",
            Self::Cancelled => "cancelled",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_and_outcomes_are_one_to_one() {
        for (code, outcome) in (0..).zip(Outcome::ALL) {
            assert_eq!(outcome.code(), code);
            assert_eq!(Outcome::from_code(code), Some(outcome));
        }
        assert_eq!(Outcome::from_code(7), None);
    }
}
