//! `weighted`: weighted A* to one target on the exact graph, without a network.
//!
//! Keys are g + ε h for states that are new, h being the Euclidean distance and the turns still to come
//! (see `bound`), and ε (g + h) for states that were expanded before: see `tree` for why the cost is at
//! most ε times the optimum. A search that takes long also looks for a proof that its goal cannot be
//! reached.

use swath_bridge::Outcome;

use super::backward::{Backward, Finding};
use super::bound::TurnBound;
use super::goal::Goal;
use super::memory::{Parent, Place, State};
use super::tree::{About, Stage, Tree, Weights};
use super::{
    CellStep, Limits, MAX_PROOF_STATES, PROOF_AFTER_STEPS, SHORT_STOP_INTERVAL, TargetResult, Way,
    cell_steps, each_free_fan, each_step, floor_units, path, start_of,
};
use crate::Error;
use crate::action::ACTIONS;
use crate::collision::{CollisionMap, WORD};
use crate::motion::{Fan, Successors};
use crate::tolerance::Target;

/// Memory of weighted searches, reused from one to the next.
#[derive(Debug, Default)]
pub struct WeightedMemory {
    tree: Tree,
    backward: Backward,
}

/// Plans to one target with `weighted`; the cost is at most `epsilon` times the optimum.
///
/// # Errors
/// [`Error::Epsilon`] unless `epsilon` is from 1 to 64.
pub fn search_weighted(
    map: &CollisionMap,
    successors: &Successors,
    (goal, epsilon): (impl Into<Target>, f64),
    limits: Limits<'_>,
    memory: &mut WeightedMemory,
) -> Result<TargetResult, Error> {
    super::check_epsilon(epsilon)?;
    let goal = match Goal::new(map, goal) {
        Ok(goal) => goal,
        Err(outcome) => return Ok(TargetResult::without_path(outcome, 0)),
    };
    memory.tree.prepare(map.spec())?;
    let search = Search {
        map,
        successors,
        turns: TurnBound::new(map, &goal),
        goal,
        weights: Weights::new(epsilon, epsilon),
        steps_of: &cell_steps(map),
        tree: &mut memory.tree,
        ways: [Way::default(); WORD],
        best: None,
        steps: 0,
    };
    Ok(search.run(limits, &mut memory.backward))
}

struct Search<'a> {
    map: &'a CollisionMap,
    successors: &'a Successors,
    goal: Goal,
    turns: TurnBound,
    weights: Weights,
    steps_of: &'a [CellStep; ACTIONS],
    tree: &'a mut Tree,
    ways: [Way; WORD],
    /// The cheapest state that reaches the goal, and its cost.
    best: Option<(u32, State)>,
    steps: u64,
}

impl Search<'_> {
    fn run(mut self, limits: Limits<'_>, backward: &mut Backward) -> TargetResult {
        let start = start_of(self.map);
        let place = self.place(start);
        self.reach(start, place, (0, Parent::START));
        while let Some((state, place, key)) = self.tree.pop() {
            if self.best.is_some_and(|(cost, _)| key >= cost) {
                break;
            }
            self.tree.set_stage(place, Stage::Expanded);
            self.steps += 1;
            self.expand(state, self.tree.cost(place));
            if self.steps == PROOF_AFTER_STEPS && self.best.is_none() {
                let (map, successors) = (self.map, self.successors);
                let found = backward.search(map, successors, &self.goal, MAX_PROOF_STATES);
                if found == Finding::Unreachable {
                    break;
                }
            }
            if let Some(outcome) = limits.reached(self.steps, SHORT_STOP_INTERVAL) {
                return TargetResult::without_path(outcome, self.steps);
            }
        }
        let Some((_, last)) = self.best else {
            return TargetResult::without_path(Outcome::Unreachable, self.steps);
        };
        let actions = path::actions_to(self.map, |state| self.tree.parent(state), last);
        TargetResult {
            bound: self.weights.epsilon(),
            ..path::along(self.map, &actions, self.steps)
        }
    }

    fn expand(&mut self, state: State, cost: u32) {
        let (map, successors) = (self.map, self.successors);
        each_free_fan(map, successors, state, |fan, free| {
            self.follow(state, cost, (fan, free));
        });
    }

    /// Follows the actions of a fan whose bits are set: first all places are looked up, so that these
    /// loads do not wait for one another's comparison.
    #[inline]
    fn follow(&mut self, from: State, cost: u32, free: (&Fan, u64)) {
        let mut count = 0;
        let steps_of = self.steps_of;
        each_step(steps_of, from, free, |to, step, action| {
            let place = self.place(to);
            self.ways[count] = Way {
                to,
                place,
                known_cost: self.tree.cost(place),
                step,
                action,
            };
            count += 1;
        });
        for index in 0..count {
            let way = self.ways[index];
            let cost = cost.saturating_add(way.step);
            if cost < way.known_cost {
                let parent = Parent::new(way.action, from.direction());
                self.reach(way.to, way.place, (cost, parent));
            }
        }
    }

    #[inline]
    fn place(&mut self, state: State) -> Place {
        let (map, goal) = (self.map, &self.goal);
        self.tree.place(state, |cell| about_cell(map, goal, cell))
    }

    #[inline]
    fn reach(&mut self, to: State, place: Place, (cost, parent): (u32, Parent)) {
        self.tree.improve(place, cost, parent);
        let about = self.tree.about(to.cell());
        let rest = about.length + self.turns.least_turn(about.aim, to.direction());
        if rest == 0 && self.goal.accepts(to) && self.best.is_none_or(|(best, _)| cost < best) {
            self.best = Some((cost, to));
        }
        let best = self.best.map(|(best, _)| best);
        self.tree
            .enqueue((to, place), self.weights, (cost, rest, false), best);
    }
}

#[cold]
fn about_cell(map: &CollisionMap, goal: &Goal, cell: usize) -> About {
    let centre = map.spec().centre_of(map.spec().cell_of_index(cell));
    About {
        length: floor_units(goal.distance_left(centre)),
        aim: TurnBound::aim(goal, centre),
        ..About::default()
    }
}
