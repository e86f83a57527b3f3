//! The memory of a search, reused from one to the next: states by cell, and the open list.

use bytemuck::Zeroable;
use bytemuck::allocation::zeroed_vec;
use swath_bridge::GridSpec;

use super::backward::Backward;
use super::bound::{Aim, TurnBound};
use super::open::OpenList;
use crate::Error;
use crate::motion::{BLOCK, BLOCK_BITS, BLOCKS};

/// A cell and a direction, as one number.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct State(pub(super) u32);

impl State {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "grids have at most 2^24 cells"
    )]
    pub(super) const fn new(cell: usize, direction: u8) -> Self {
        Self((cell as u32) << 8 | direction as u32)
    }

    /// The state of a cell in a block of directions, by its place there.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "grids have at most 2^24 cells of 2^3 blocks"
    )]
    pub(super) const fn in_block(cell: usize, number: usize, within: u32) -> Self {
        Self((cell as u32) << 8 | (number as u32) << BLOCK_BITS | within)
    }

    /// The number of its block of directions, and its place there.
    pub(super) const fn split(self) -> (usize, u32) {
        let direction = self.0 & u8::MAX as u32;
        (
            (direction >> BLOCK_BITS) as usize,
            direction & ((1 << BLOCK_BITS) - 1),
        )
    }

    pub(super) const fn cell(self) -> usize {
        (self.0 >> 8) as usize
    }

    #[expect(
        clippy::cast_possible_truncation,
        reason = "the low byte is the direction"
    )]
    pub(super) const fn direction(self) -> u8 {
        self.0 as u8
    }
}

/// Stands for no block.
const NO_BLOCK: u32 = u32::MAX;

/// How a state was reached.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Parent {
    /// Action of the lookup table that led here; `u16::MAX` at the start.
    action: u16,
    /// Direction before this action.
    from_direction: u8,
}

impl Parent {
    pub(super) const START: Self = Self {
        action: u16::MAX,
        from_direction: 0,
    };

    pub(super) const fn new(action: u16, from_direction: u8) -> Self {
        Self {
            action,
            from_direction,
        }
    }

    /// The action that led here and the direction before it, unless this is the start.
    pub(super) fn step(self) -> Option<(u16, u8)> {
        (self != Self::START).then_some((self.action, self.from_direction))
    }
}

/// Memory of a search. Cells and ranges of their directions are claimed when they are first reached,
/// so that starting a search costs nothing and memory grows with what is reached: at most 2 KiB a cell.
#[derive(Debug, Default)]
pub struct SearchMemory {
    /// Number of the running search.
    generation: u32,
    /// By cell: the search that claimed it, its states, and what is the same for all of them.
    cells: Vec<CellSlot>,
    /// Cost of the best way to each state of a claimed cell, in units; `u32::MAX` without one.
    costs: Vec<u32>,
    /// How each state that has a cost was reached.
    parents: Vec<Parent>,
    used_states: usize,
    open: OpenList,
    /// Lower bound on the turns to come, if the search uses one.
    turns: Option<Box<TurnBound>>,
    /// By cell that the search with such a bound has claimed.
    aims: Vec<Aim>,
    pub(super) backward: Backward,
}

#[derive(Debug, Clone, Copy, Zeroable)]
struct CellSlot {
    generation: u32,
    /// Lower bound on the length from here to the goal, in units.
    estimate: u32,
    is_inside: bool,
    /// Where its states are, by range of directions; [`NO_BLOCK`] for those not reached.
    blocks: [u32; BLOCKS],
}

impl CellSlot {
    /// Index into costs and parents of a state that was reached.
    fn index_of(&self, state: State) -> usize {
        let (block, within) = state.split();
        (self.blocks[block] << BLOCK_BITS | within) as usize
    }
}

/// What a search is asked about a cell when it first comes there.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct About {
    /// Lower bound on the length from here to the goal, in units.
    pub(super) estimate: u32,
    /// Whether the cell is inside the region.
    pub(super) is_inside: bool,
    /// For a bound on turns.
    pub(super) aim: Aim,
}

/// Where a state of a claimed cell is kept.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Place(pub(super) u32);

impl SearchMemory {
    /// Memory that grows with its first searches.
    pub fn new() -> Self {
        Self::default()
    }

    /// Makes ready for a search on a grid.
    pub(super) fn prepare(
        &mut self,
        spec: &GridSpec,
        turns: Option<Box<TurnBound>>,
    ) -> Result<(), Error> {
        spec.validate()?;
        // Pages that nothing is written to take no memory.
        if turns.is_some() && self.aims.len() != spec.len() {
            self.aims = zeroed_vec(spec.len());
        }
        self.turns = turns;
        if self.cells.len() != spec.len() || self.generation == u32::MAX {
            self.cells = zeroed_vec(spec.len());
            self.generation = 0;
        }
        self.generation += 1;
        self.used_states = 0;
        self.open.clear();
        Ok(())
    }

    /// Takes note of a cell; none of its states is reached yet.
    #[cold]
    fn claim(&mut self, cell: usize, about: About) {
        self.cells[cell] = CellSlot {
            generation: self.generation,
            estimate: about.estimate,
            is_inside: about.is_inside,
            blocks: [NO_BLOCK; BLOCKS],
        };
        if self.turns.is_some() {
            self.aims[cell] = about.aim;
        }
    }

    /// Gives a block of a claimed cell unreached states.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "grids have at most 2^24 cells of 2^3 blocks"
    )]
    #[cold]
    fn claim_block(&mut self, cell: usize, block: usize) -> u32 {
        let states = self.used_states..self.used_states + BLOCK;
        if self.costs.len() < states.end {
            self.costs.resize(states.end, u32::MAX);
            self.parents.resize(states.end, Parent::START);
        }
        self.costs[states.clone()].fill(u32::MAX);
        let number = (states.start / BLOCK) as u32;
        self.cells[cell].blocks[block] = number;
        self.used_states = states.end;
        number
    }

    /// The place of a state. If its cell was not reached before, `about` is asked about it.
    #[inline]
    pub(super) fn place(&mut self, state: State, about: impl FnOnce(usize) -> About) -> Place {
        if self.cells[state.cell()].generation != self.generation {
            self.claim(state.cell(), about(state.cell()));
        }
        let (block, within) = state.split();
        let mut number = self.cells[state.cell()].blocks[block];
        if number == NO_BLOCK {
            number = self.claim_block(state.cell(), block);
        }
        Place(number << BLOCK_BITS | within)
    }

    /// Cost of the best way to a state, in units; `u32::MAX` if there is none yet.
    #[inline]
    pub(super) fn cost(&self, place: Place) -> u32 {
        self.costs[place.0 as usize]
    }

    /// Whether a claimed cell is inside the region.
    #[inline]
    pub(super) fn is_inside(&self, cell: usize) -> bool {
        self.cells[cell].is_inside
    }

    /// Lower bound on the cost from a state to the goal, in units.
    #[inline]
    fn estimate(&self, slot: &CellSlot, state: State) -> u32 {
        match &self.turns {
            None => slot.estimate,
            Some(turns) => {
                slot.estimate + turns.least_turn(self.aims[state.cell()], state.direction())
            }
        }
    }

    /// Notes a better way to a state and puts it on the open list.
    #[inline]
    pub(super) fn reach(&mut self, state: State, place: Place, cost: u32, parent: Parent) {
        self.costs[place.0 as usize] = cost;
        self.parents[place.0 as usize] = parent;
        let total = cost.saturating_add(self.estimate(&self.cells[state.cell()], state));
        self.open.push(u64::from(total) << 32 | u64::from(state.0));
    }

    /// How a state that was reached was reached first at its cost.
    pub(super) fn parent(&self, state: State) -> Parent {
        self.parents[self.cells[state.cell()].index_of(state)]
    }

    /// Takes the state with the smallest total from the open list, and its cost. Ties go to the
    /// smaller cell number (farther ahead, then farther left) and then to the smaller direction.
    #[expect(clippy::cast_possible_truncation, reason = "both halves of a key are")]
    #[inline]
    pub(super) fn pop(&mut self) -> Option<(State, u32)> {
        loop {
            let key = self.open.pop()?;
            let state = State(key as u32);
            let slot = &self.cells[state.cell()];
            let cost = self.costs[slot.index_of(state)];
            // An improved state is pushed again; what was pushed before has a greater total.
            if (key >> 32) as u32 == cost.saturating_add(self.estimate(slot, state)) {
                return Some((state, cost));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn claimed_cells_are_forgotten_by_the_next_search() {
        let spec = GridSpec {
            rows: 4,
            cols: 4,
            ego_row: 0,
            ego_col: 0,
            ..GridSpec::default()
        };
        let mut memory = SearchMemory::new();
        let state = State::new(3, 9);
        for estimate in [7, 8] {
            let about = About {
                estimate,
                ..About::default()
            };
            memory.prepare(&spec, None).unwrap();
            let place = memory.place(state, |_| about);
            assert_eq!(memory.cost(place), u32::MAX);
            memory.reach(state, place, 1, Parent::new(5, 6));
            let place = memory.place(state, |_| unreachable!());
            assert_eq!(memory.cost(place), 1);
            assert_eq!(memory.parent(state).step(), Some((5, 6)));
        }
        assert_eq!(memory.costs.len(), BLOCK, "states are reused");
        assert_eq!(memory.pop(), Some((state, 1)));
        assert_eq!(memory.pop(), None);
    }

    #[test]
    fn a_state_is_taken_once_at_its_best_cost() {
        let mut memory = SearchMemory::new();
        memory.prepare(&GridSpec::default(), None).unwrap();
        let state = State::new(70, 200);
        for cost in [30, 20, 10] {
            let place = memory.place(state, |_| About {
                is_inside: true,
                ..About::default()
            });
            assert!(memory.is_inside(70) && cost < memory.cost(place));
            memory.reach(state, place, cost, Parent::new(0, 0));
        }
        assert_eq!(memory.pop(), Some((state, 10)));
        assert_eq!(memory.pop(), None);
    }
}
