//! The targets of a frame while `swath` searches for them.

use std::time::Duration;

use swath_bridge::Outcome;

use super::TargetResult;
use super::goal::Goal;
use super::swath::{Frame, Rules};
use super::target::End;
use crate::tolerance::Target;

/// What is known of a target at first.
const NOTHING: TargetResult = TargetResult::without_path(Outcome::BudgetExhausted, 0);

/// The cheaper one of two undecided results, with what both have proved.
fn better_of(a: TargetResult, b: TargetResult) -> TargetResult {
    if a.outcome != Outcome::Solved || b.outcome != Outcome::Solved {
        return if a.outcome == Outcome::Solved { a } else { b };
    }
    let least = (a.cost / a.bound).max(b.cost / b.bound);
    let best = if b.cost < a.cost { b } else { a };
    TargetResult {
        bound: (best.cost / least).max(1.0),
        ..best
    }
}

/// Whether nothing is left to be searched for, or no more is allowed.
pub(super) fn is_over(rules: &Rules<'_>, work: &Work) -> bool {
    let is_spent = rules
        .limits
        .max_expansions
        .is_some_and(|most| work.spent >= most);
    work.left.is_empty() || is_spent || rules.limits.asked().is_some()
}

/// A frame's targets while they are searched for.
pub(super) struct Work {
    /// Those that can be reached for all that is known at once.
    pub(super) goals: Vec<Option<Goal>>,
    /// Numbers of those that are not decided, most useful first.
    pub(super) left: Vec<usize>,
    /// By target, with the processor time of its searches.
    pub(super) results: Vec<(TargetResult, Duration)>,
    /// Expansions that each may have been searched for with so far.
    pub(super) spent: u64,
    epsilon: f64,
}

impl Work {
    pub(super) fn new(frame: &Frame<'_>, epsilon: f64) -> Self {
        let mut results = vec![(NOTHING, Duration::ZERO); frame.goals.len()];
        let mut goals: Vec<Option<Goal>> = Vec::new();
        for (pose, result) in frame.goals.iter().zip(&mut results) {
            let target = Target {
                pose: *pose,
                tolerance: frame.tolerance,
            };
            let goal = Goal::new(frame.map, target).map_err(|outcome| {
                result.0 = TargetResult::without_path(outcome, 0);
            });
            goals.push(goal.ok());
        }
        let has_goal = |&&number: &&usize| goals[number].is_some();
        Self {
            left: frame.order.iter().filter(has_goal).copied().collect(),
            goals,
            results,
            spent: 0,
            epsilon,
        }
    }

    /// The goals that are left, with their numbers.
    pub(super) fn unsolved(&self) -> impl Iterator<Item = (usize, &Goal)> {
        let goal_of = |&number: &usize| Some((number, self.goals[number].as_ref()?));
        self.left.iter().filter_map(goal_of)
    }

    /// Puts those of which some path is known behind those of which none is.
    pub(super) fn put_unsolved_first(&mut self) {
        let results = &self.results;
        self.left
            .sort_by_key(|&number| results[number].0.outcome == Outcome::Solved);
    }

    /// Takes note of another path to a target that was decided, if it costs less. What was proved of the
    /// optimum stays.
    pub(super) fn take_better(&mut self, number: usize, other: TargetResult, cpu: Duration) {
        let (result, all_cpu) = &mut self.results[number];
        let steps = result.steps + other.steps;
        if other.outcome == Outcome::Solved && other.cost < result.cost {
            let least = result.cost / result.bound;
            *result = TargetResult {
                bound: (other.cost / least).max(1.0),
                ..other
            };
        }
        result.steps = steps;
        *all_cpu += cpu;
    }

    /// Takes note of how a search ended.
    pub(super) fn take(&mut self, number: usize, end: End, cpu: Duration) {
        let (result, all_cpu) = &mut self.results[number];
        let steps = result.steps + end.result.steps;
        *result = if end.is_decided {
            end.result
        } else {
            better_of(std::mem::replace(result, NOTHING), end.result)
        };
        if end.is_decided || result.bound <= self.epsilon {
            self.left.retain(|&left| left != number);
        }
        result.steps = steps;
        *all_cpu += cpu;
    }
}
