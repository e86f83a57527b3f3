//! Ways from the vehicle that all targets of a frame share: near it every state at its exact cost, and
//! farther off, if it is asked for, one state for each square of cells and range of headings.
//!
//! The second part leaves states out, so its costs are those of real paths, but not of the best ones.
//! It bounds optima from above only.

use super::goal::Goal;
use super::memory::{Parent, State};
use super::tree::{About, Stage, Tree};
use super::{CellStep, Way, cell_steps, each_free_fan, each_step, start_of};
use crate::Error;
use crate::action::ACTIONS;
use crate::collision::{CollisionMap, WORD};
use crate::motion::{Fan, Successors};

/// Cells a side of a square, and bits of a direction that are left out of account, of which one state is
/// kept: at first, and for as many states again when time is short. There is a bit for each range of
/// directions in a word of 32.
const FINE: (usize, u32) = (3, 3);
const COARSE: (usize, u32) = (5, 3);
/// How often it is asked whether to stop, in expansions.
const STOP_INTERVAL: u64 = 64;

/// Ways from the vehicle.
#[derive(Debug, Default)]
pub(super) struct Trunk {
    tree: Tree,
    steps: u64,
    /// States that were not expanded near the vehicle cost at least this.
    radius: u32,
    /// Whether there are states farther off.
    is_spread: bool,
    fine: Sieve,
    coarse: Sieve,
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
        self.is_spread = false;
        self.steps = 0;
        self.radius = u32::MAX;
        let start = start_of(map);
        let place = self.tree.place(start, |_| About::default());
        self.tree.improve(place, 0, Parent::START);
        self.tree.push(start, 0);
        let mut expander = Expander::new(map, successors);
        while let Some((state, place, key)) = self.tree.pop() {
            if self.steps == most {
                self.radius = key;
                self.tree.push(state, key);
                break;
            }
            self.tree.set_stage(place, Stage::Expanded);
            self.steps += 1;
            expander.expand(&mut self.tree, state, |_| true);
            if self.steps.is_multiple_of(STOP_INTERVAL) && stop() {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Becomes the same as another one that has not gone on yet; keeps its memory.
    pub(super) fn copy(&mut self, near: &Self) {
        self.tree.copy(&near.tree);
        self.steps = near.steps;
        self.radius = near.radius;
        self.is_spread = false;
    }

    /// Goes on farther off, until all goals are reached, there is nothing left, or so many more states
    /// were expanded, and as many again that lie farther apart.
    pub(super) fn spread(
        &mut self,
        map: &CollisionMap,
        successors: &Successors,
        goals: &[Goal],
        (most, stop): (u64, &dyn Fn() -> bool),
    ) {
        self.fine.divide(map, goals, FINE);
        self.coarse.divide(map, goals, COARSE);
        self.is_spread = true;
        let mut unreached: Vec<&Goal> = goals.iter().collect();
        let mut expander = Expander::new(map, successors);
        let (end_of_fine, end) = (self.steps + most / 2, self.steps + most * 4 / 3);
        while let Some((state, place, _)) = self.tree.pop() {
            self.tree.set_stage(place, Stage::Kept);
            let is_new = [self.fine.take(state), self.coarse.take(state)];
            if self.fine.reaches_goal(state) {
                unreached.retain(|goal| !goal.accepts(state));
            }
            let is_fine = self.steps < end_of_fine;
            if !is_new[usize::from(!is_fine)] {
                continue;
            }
            if unreached.is_empty() || self.steps == end {
                break;
            }
            self.steps += 1;
            let sieve = if is_fine { &self.fine } else { &self.coarse };
            expander.expand(&mut self.tree, state, |to| !sieve.has(to));
            if self.steps.is_multiple_of(STOP_INTERVAL) && stop() {
                break;
            }
        }
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

    /// The least cost to a state near the vehicle.
    #[inline]
    pub(super) fn exact_cost(&self, state: State) -> Option<u32> {
        let place = self.tree.find(state)?;
        (self.tree.stage(place) == Stage::Expanded).then(|| self.tree.cost(place))
    }

    /// The cost of some way to a state farther off.
    #[inline]
    pub(super) fn far_cost(&self, state: State) -> Option<u32> {
        if !self.is_spread {
            return None;
        }
        let place = self.tree.find(state)?;
        Some(self.tree.cost(place)).filter(|&cost| cost != u32::MAX)
    }

    /// Whether there are states farther off.
    pub(super) const fn is_spread(&self) -> bool {
        self.is_spread
    }

    /// How a state was reached.
    pub(super) fn parent(&self, state: State) -> Parent {
        self.tree.parent(state)
    }
}

/// Leaves one state of each square of cells and range of headings, and all in cells that reach a goal.
#[derive(Debug, Default)]
struct Sieve {
    /// By square: the ranges of which a state was taken.
    taken: Vec<u32>,
    /// By cell; the last number is that of cells that reach a goal.
    squares: Vec<u32>,
    range_bits: u32,
}

impl Sieve {
    /// Begins with squares of so many cells a side and ranges of 2 to the power of so many directions.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "grids have at most 2^24 cells"
    )]
    fn divide(&mut self, map: &CollisionMap, goals: &[Goal], (side, range_bits): (usize, u32)) {
        self.range_bits = range_bits;
        let (rows, cols) = (map.spec().rows as usize, map.spec().cols as usize);
        let across = cols.div_ceil(side);
        let squares = across * rows.div_ceil(side);
        self.taken.clear();
        self.taken.resize(squares + 1, 0);
        self.squares.clear();
        for row in 0..rows {
            let first = row / side * across;
            self.squares
                .extend((0..cols).map(|col| (first + col / side) as u32));
        }
        for &cell in goals.iter().flat_map(Goal::cells) {
            self.squares[cell] = squares as u32;
        }
    }

    fn reaches_goal(&self, state: State) -> bool {
        self.squares[state.cell()] as usize == self.taken.len() - 1
    }

    /// Whether a state like this one was taken.
    #[inline]
    fn has(&self, state: State) -> bool {
        self.taken[self.squares[state.cell()] as usize] & self.range_of(state) != 0
    }

    /// Takes a state, and says whether it is the first like it.
    fn take(&mut self, state: State) -> bool {
        if self.reaches_goal(state) {
            return true;
        }
        let is_new = !self.has(state);
        let range = self.range_of(state);
        self.taken[self.squares[state.cell()] as usize] |= range;
        is_new
    }

    #[inline]
    fn range_of(&self, state: State) -> u32 {
        1 << (state.direction() >> self.range_bits)
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

    /// Reaches what follows a state, as far as it is `wanted`.
    fn expand(&mut self, tree: &mut Tree, state: State, wanted: impl Fn(State) -> bool) {
        let cost = tree.find(state).map_or(u32::MAX, |place| tree.cost(place));
        each_free_fan(self.map, self.successors, state, |fan, free| {
            self.follow(tree, (state, cost), (fan, free), &wanted);
        });
    }

    #[inline]
    fn follow(
        &mut self,
        tree: &mut Tree,
        (from, cost): (State, u32),
        free: (&Fan, u64),
        wanted: &impl Fn(State) -> bool,
    ) {
        let mut count = 0;
        each_step(&self.steps_of, from, free, |to, step, action| {
            if !wanted(to) {
                return;
            }
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
}
