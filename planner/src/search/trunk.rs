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

/// Side of a square of which one state a range of headings is kept, cells.
const SQUARE_CELLS: usize = 3;
/// Directions of a range of headings: there is a bit for each range in a word of 32.
const RANGE_BITS: u32 = 3;
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
    /// By square: the ranges of headings of which a state was expanded.
    kept: Vec<u32>,
    /// By cell; the last number, of which all states are kept, is that of cells that reach a goal.
    squares: Vec<u32>,
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
        self.kept.clear();
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
    /// were expanded.
    pub(super) fn spread(
        &mut self,
        map: &CollisionMap,
        successors: &Successors,
        goals: &[Goal],
        (most, stop): (u64, &dyn Fn() -> bool),
    ) {
        let squares = self.divide(map, goals);
        self.is_spread = true;
        let mut unreached: Vec<&Goal> = goals.iter().collect();
        let mut expander = Expander::new(map, successors);
        let end = self.steps + most;
        while let Some((state, place, _)) = self.tree.pop() {
            let square = self.squares[state.cell()] as usize;
            self.tree.set_stage(place, Stage::Kept);
            if square == squares {
                unreached.retain(|goal| !goal.accepts(state));
            } else if self.kept[square] & range_of(state.direction()) != 0 {
                continue;
            } else {
                self.kept[square] |= range_of(state.direction());
            }
            if unreached.is_empty() || self.steps == end {
                break;
            }
            self.steps += 1;
            let (kept, squares) = (&self.kept, &self.squares);
            expander.expand(&mut self.tree, state, |to| {
                kept[squares[to.cell()] as usize] & range_of(to.direction()) == 0
            });
            if self.steps.is_multiple_of(STOP_INTERVAL) && stop() {
                break;
            }
        }
    }

    /// Numbers the squares and returns how many there are.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "grids have at most 2^24 cells"
    )]
    fn divide(&mut self, map: &CollisionMap, goals: &[Goal]) -> usize {
        let (rows, cols) = (map.spec().rows as usize, map.spec().cols as usize);
        let across = cols.div_ceil(SQUARE_CELLS);
        let squares = across * rows.div_ceil(SQUARE_CELLS);
        self.kept.clear();
        self.kept.resize(squares + 1, 0);
        self.squares.clear();
        self.squares.extend((0..rows * cols).map(|cell| {
            let (row, col) = (cell / cols / SQUARE_CELLS, cell % cols / SQUARE_CELLS);
            (row * across + col) as u32
        }));
        for &cell in goals.iter().flat_map(Goal::cells) {
            self.squares[cell] = squares as u32;
        }
        squares
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

const fn range_of(direction: u8) -> u32 {
    1 << (direction >> RANGE_BITS)
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
