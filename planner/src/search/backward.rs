//! Proofs that a goal cannot be reached: a search from the goal backwards that came to its end.
//!
//! It goes over the edges of the very graph that is searched forward. What leads to a state is known
//! exactly: its direction is that of the last action, so the cell before is one of a few, and the
//! headings there are those which the action may follow and from which the turn is free. No move is
//! approximated. A goal that is walled in, or that needs a turn which nobody can make, has few states
//! before it, so a small limit finds most of what can be found.

use swath_bridge::Cell;

use super::goal::Goal;
use super::memory::State;
use super::start_of;
use crate::collision::CollisionMap;
use crate::motion::{ArrivalBlock, BLOCKS, Successors};

/// Memory of a backward search, reused from one to the next.
#[derive(Debug, Default)]
pub(super) struct Backward {
    /// By cell: the directions from which the goal can be reached, a bit each.
    reaching: Vec<Directions>,
    /// Cells that have any.
    touched: Vec<usize>,
    open: Vec<State>,
}

/// A bit for each direction, by block.
type Directions = [u32; BLOCKS];

/// What a backward search found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Finding {
    /// No state but those that were seen leads to the goal, and the start is not one of them.
    Unreachable,
    /// The start leads to the goal.
    Reachable,
    /// The limit came first.
    Unknown,
}

impl Backward {
    /// Goes back from a goal, over at most `max_states` states.
    pub(super) fn search(
        &mut self,
        map: &CollisionMap,
        successors: &Successors,
        goal: &Goal,
        max_states: usize,
    ) -> Finding {
        self.clear(map.spec().len());
        for state in goal.states() {
            let (block, within) = state.split();
            self.add(state.cell(), block, 1 << within);
        }
        let start = start_of(map);
        let (start_block, start_within) = start.split();
        let mut states = 0;
        while let Some(state) = self.open.pop() {
            if states == max_states {
                return Finding::Unknown;
            }
            states += 1;
            self.expand(map, successors, state);
            if self.reaching[start.cell()][start_block] >> start_within & 1 != 0 {
                return Finding::Reachable;
            }
        }
        Finding::Unreachable
    }

    fn clear(&mut self, cells: usize) {
        if self.reaching.len() == cells {
            for cell in self.touched.drain(..) {
                self.reaching[cell] = Directions::default();
            }
        } else {
            self.reaching = vec![Directions::default(); cells];
            self.touched.clear();
        }
        self.open.clear();
    }

    /// Adds directions of a block on a cell to those that reach the goal.
    fn add(&mut self, cell: usize, block: usize, directions: u32) {
        let reaching = &mut self.reaching[cell];
        let mut new = directions & !reaching[block];
        if new != 0 && *reaching == Directions::default() {
            self.touched.push(cell);
        }
        reaching[block] |= new;
        while new != 0 {
            let state = State::in_block(cell, block, new.trailing_zeros());
            self.open.push(state);
            new &= new - 1;
        }
    }

    /// Adds the states from which one action leads to a state.
    fn expand(&mut self, map: &CollisionMap, successors: &Successors, to: State) {
        let spec = map.spec();
        let to_cell = spec.cell_of_index(to.cell());
        for index in successors.actions_of(to.direction()) {
            let action = &map.model().table().actions()[index];
            let cell = Cell::new(to_cell.row - action.d_row, to_cell.col - action.d_col);
            let Some(from) = spec.index_of(cell) else {
                continue;
            };
            let cols = spec.cols as usize;
            let at = (from / cols, from % cols);
            if map.blocked_chords(index / 64, at) >> (index % 64) & 1 != 0 {
                continue;
            }
            let arrivals = successors.arrivals(index);
            let known = &self.reaching[from];
            let is_known = |block: &ArrivalBlock| block.allowed & !known[block.number] == 0;
            if arrivals.blocks().iter().all(is_known) {
                continue;
            }
            let turnable = arrivals.turnable(|group| map.blocked_turns(group, at));
            for block in arrivals.blocks() {
                let headings = block.allowed & turnable.of_block(block.number);
                self.add(from, block.number, headings);
            }
        }
    }
}
