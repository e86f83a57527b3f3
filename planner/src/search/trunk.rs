//! Ways from the vehicle that all targets of a frame share: near it every state at its exact cost, and
//! farther off, if it is asked for, one state for each square of cells and range of headings.
//!
//! The second part leaves states out, so its costs are those of real paths, but not of the best ones.
//! It bounds optima from above only.

use super::goal::Goal;
use super::memory::{Parent, Place, State};
use super::sieve::{Grain, Sieve};
use super::tree::{About, Block, Stage, Tree};
use super::{CellStep, Way, cell_steps, each_free_fan, each_step, start_of};
use crate::Error;
use crate::action::ACTIONS;
use crate::collision::{CollisionMap, WORD};
use crate::motion::{Fan, Successors};

/// How often it is asked whether to stop, in expansions.
const STOP_INTERVAL: u64 = 64;
/// The same in cells of the rim.
const RIM_STOP_INTERVAL: usize = 1_024;

/// Ways from the vehicle.
#[derive(Debug, Default)]
pub(super) struct Trunk {
    tree: Tree,
    steps: u64,
    /// States that were not expanded near the vehicle cost at least this.
    radius: u32,
    fine: Sieve,
    coarse: Sieve,
    /// Goals that were not reached, with their numbers.
    unreached: Vec<(usize, Goal)>,
    /// The fine sieve is for so many expansions.
    end_of_fine: u64,
}

impl Trunk {
    /// Expands what is near the vehicle, in order of cost, at most so many states. False if `stop` ended
    /// it.
    pub(super) fn grow(
        &mut self,
        map: &CollisionMap,
        successors: &Successors,
        (most, stop): (u64, &dyn Fn() -> bool),
    ) -> Result<bool, Error> {
        self.tree.prepare(map.spec())?;
        self.steps = 0;
        let start = start_of(map);
        let place = self.tree.place(start, |_| About::default());
        self.tree.improve(place, 0, Parent::START);
        self.tree.push(start, 0);
        Ok(self.grow_on((map, successors), (most, stop)))
    }

    /// Expands so many more states. False if `stop` ended it.
    pub(super) fn grow_on(
        &mut self,
        (map, successors): (&CollisionMap, &Successors),
        (most, stop): (u64, &dyn Fn() -> bool),
    ) -> bool {
        let mut expander = Expander::new(map, successors);
        let end = self.steps + most;
        self.radius = u32::MAX;
        while let Some((state, place, key)) = self.tree.pop() {
            if self.steps == end {
                self.radius = key;
                self.tree.push(state, key);
                break;
            }
            self.tree.set_stage(place, Stage::Expanded);
            self.steps += 1;
            expander.expand(&mut self.tree, (state, key));
            if self.steps.is_multiple_of(STOP_INTERVAL) && stop() {
                self.radius = key;
                return false;
            }
        }
        true
    }

    /// Becomes the same as another one.
    pub(super) fn copy(&mut self, near: &Self, map: &CollisionMap) -> Result<(), Error> {
        self.tree.prepare(map.spec())?;
        self.tree.copy(&near.tree);
        self.steps = near.steps;
        self.radius = near.radius;
        Ok(())
    }

    /// Begins where another one ended, to go on farther off towards goals that have numbers.
    pub(super) fn follow<'a>(
        &mut self,
        near: &Self,
        map: &CollisionMap,
        goals: impl Iterator<Item = (usize, &'a Goal)>,
    ) -> Result<(), Error> {
        self.copy(near, map)?;
        self.unreached.clear();
        self.unreached
            .extend(goals.map(|(number, goal)| (number, goal.clone())));
        self.divide(map, Grain::FIRST);
        Ok(())
    }

    /// Begins there again and looks closer, as far as so many more expansions go; keeps what was reached.
    pub(super) fn refine(&mut self, near: &Self, map: &CollisionMap) {
        self.tree.open.copy(&near.tree.open);
        self.divide(map, Grain::SECOND);
    }

    fn divide(&mut self, map: &CollisionMap, grain: Grain) {
        self.fine.divide(map, &self.unreached, grain.fine);
        self.coarse.divide(map, &self.unreached, grain.coarse);
        self.end_of_fine = self.steps + grain.fine_steps;
    }

    /// Goes on farther off, until all goals with numbers that are `left` are reached, there is nothing
    /// left, or so many more states were expanded.
    pub(super) fn spread(
        &mut self,
        (map, successors): (&CollisionMap, &Successors),
        left: &[usize],
        (most, stop): (u64, &dyn Fn() -> bool),
    ) {
        self.unreached.retain(|(number, _)| left.contains(number));
        let expander = Expander::new(map, successors);
        let end = self.steps + most;
        while !self.unreached.is_empty() && self.steps < end {
            let Some((state, cost)) = self.tree.pop_at_cost() else {
                break;
            };
            let is_new = [self.fine.take(state, cost), self.coarse.take(state, cost)];
            if self.fine.reaches_goal(state) {
                self.unreached.retain(|(_, goal)| !goal.accepts(state));
            }
            let is_fine = self.steps < self.end_of_fine;
            if !is_new[usize::from(!is_fine)] {
                continue;
            }
            self.steps += 1;
            let sieve = if is_fine {
                &mut self.fine
            } else {
                &mut self.coarse
            };
            expander.expand_through(sieve, &mut self.tree, (state, cost));
            if self.steps.is_multiple_of(STOP_INTERVAL) && stop() {
                break;
            }
        }
    }

    /// What the states that were reached and not expanded cost at least, in units, and their cells. False
    /// if `stop` ended it.
    pub(super) fn rim(&self, into: &mut Vec<(u32, u32)>, stop: &dyn Fn() -> bool) -> bool {
        into.clear();
        for (number, waiting) in self.tree.least_waiting().enumerate() {
            into.extend(waiting);
            if number % RIM_STOP_INTERVAL == 0 && stop() {
                return false;
            }
        }
        true
    }

    /// Expansions so far.
    pub(super) const fn steps(&self) -> u64 {
        self.steps
    }

    /// Every state of which [`Self::exact_cost`] does not know costs at least this, in units;
    /// `u32::MAX` if there is no way to it.
    #[inline]
    pub(super) const fn radius(&self) -> u32 {
        self.radius
    }

    /// Where the states of a cell are kept that share a block of directions, if any was reached.
    #[inline]
    pub(super) fn block(&self, cell: usize, block: usize) -> Option<Block> {
        self.tree.find_block(cell, block)
    }

    /// The least cost to a state near the vehicle.
    #[inline]
    pub(super) fn exact_cost(&self, place: Place) -> Option<u32> {
        (self.tree.stage(place) == Stage::Expanded).then(|| self.tree.cost(place))
    }

    /// The cost of some way to a state farther off.
    #[inline]
    pub(super) fn far_cost(&self, place: Place) -> Option<u32> {
        Some(self.tree.cost(place)).filter(|&cost| cost != u32::MAX)
    }

    /// How a state was reached.
    pub(super) fn parent(&self, state: State) -> Parent {
        self.tree.parent(state)
    }
}

/// Expands states in order of cost alone.
struct Expander<'a> {
    map: &'a CollisionMap,
    successors: &'a Successors,
    steps_of: [CellStep; ACTIONS],
    ways: [Way; WORD],
}

impl<'a> Expander<'a> {
    fn new(map: &'a CollisionMap, successors: &'a Successors) -> Self {
        Self {
            map,
            successors,
            steps_of: cell_steps(map),
            ways: [Way::default(); WORD],
        }
    }

    /// Reaches what follows a state.
    fn expand(&mut self, tree: &mut Tree, from: (State, u32)) {
        each_free_fan(self.map, self.successors, from.0, |fan, free| {
            self.follow(tree, from, (fan, free));
        });
    }

    #[inline]
    fn follow(&mut self, tree: &mut Tree, (from, cost): (State, u32), free: (&Fan, u64)) {
        let mut count = 0;
        each_step(&self.steps_of, from, free, |to, step, action| {
            let place = tree.place(to, |_| About::default());
            self.ways[count] = Way {
                to,
                place,
                known_cost: tree.cost(place),
                step,
                action,
            };
            count += 1;
        });
        for way in &self.ways[..count] {
            let cost = cost.saturating_add(way.step);
            if cost < way.known_cost {
                tree.improve(way.place, cost, Parent::new(way.action, from.direction()));
                tree.push(way.to, cost);
            }
        }
    }

    /// Reaches what follows a state, as far as a sieve admits it.
    fn expand_through(&self, sieve: &mut Sieve, tree: &mut Tree, (from, cost): (State, u32)) {
        each_free_fan(self.map, self.successors, from, |fan, free| {
            each_step(&self.steps_of, from, (fan, free), |to, step, action| {
                let cost = cost.saturating_add(step);
                if !sieve.admit(to, cost) {
                    return;
                }
                let place = tree.place(to, |_| About::default());
                let known_cost = tree.cost(place);
                if cost < known_cost {
                    tree.improve(place, cost, Parent::new(action, from.direction()));
                }
                if tree.stage(place) != Stage::Expanded {
                    tree.push(to, cost.min(known_cost));
                }
            });
        });
    }
}
