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
use crate::motion::{Preceding, Side, Successors};

/// Memory of a backward search, reused from one to the next.
#[derive(Debug, Default)]
pub(super) struct Backward {
    /// By cell: the directions from which the goal can be reached, a bit each.
    reaching: Vec<Directions>,
    /// Cells that have any.
    touched: Vec<usize>,
    open: Vec<State>,
}

/// A bit for each direction.
type Directions = [u64; 4];

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
            self.add(state.cell(), bit_of(state.direction()));
        }
        let start = start_of(map);
        let mut states = 0;
        while let Some(state) = self.open.pop() {
            if states == max_states {
                return Finding::Unknown;
            }
            states += 1;
            self.expand(map, successors, state);
            if self.reaching[start.cell()][0] & bit_of(start.direction())[0] != 0 {
                return Finding::Reachable;
            }
        }
        Finding::Unreachable
    }

    fn clear(&mut self, cells: usize) {
        if self.reaching.len() == cells {
            for cell in self.touched.drain(..) {
                self.reaching[cell] = [0; 4];
            }
        } else {
            self.reaching = vec![[0; 4]; cells];
            self.touched.clear();
        }
        self.open.clear();
    }

    /// Adds directions on a cell to those that reach the goal.
    fn add(&mut self, cell: usize, directions: Directions) {
        let reaching = &mut self.reaching[cell];
        if *reaching == [0; 4] {
            self.touched.push(cell);
        }
        for (group, (known, more)) in (0u8..).zip(reaching.iter_mut().zip(directions)) {
            let mut new = more & !*known;
            *known |= more;
            while new != 0 {
                let bit = u8::try_from(new.trailing_zeros()).unwrap_or(0);
                self.open.push(State::new(cell, group * 64 + bit));
                new &= new - 1;
            }
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
            let preceding = successors.preceding(index);
            let known = &self.reaching[from];
            if (0..4).all(|group| preceding.headings[group] & !known[group] == 0) {
                continue;
            }
            let turnable = turnable_to(map, to.direction(), at, preceding);
            let headings = [0, 1, 2, 3].map(|group| preceding.headings[group] & turnable[group]);
            self.add(from, headings);
        }
    }
}

/// The headings from which the turn to a direction is free on a cell, as far as one of those which may
/// precede it is to either side.
fn turnable_to(
    map: &CollisionMap,
    direction: u8,
    cell: (usize, usize),
    preceding: &Preceding,
) -> Directions {
    let mut free = bit_of(direction);
    for (side, most) in [
        (Side::Left, preceding.left_steps),
        (Side::Right, preceding.right_steps),
    ] {
        for turned in 0..most {
            let turn = usize::from(side.passed(direction, turned));
            if map.blocked_turns(turn / 64, cell) >> (turn % 64) & 1 != 0 {
                break;
            }
            for (free, bit) in free
                .iter_mut()
                .zip(bit_of(side.turned(direction, turned + 1)))
            {
                *free |= bit;
            }
        }
    }
    free
}

const fn bit_of(direction: u8) -> Directions {
    let mut bits = [0; 4];
    bits[direction as usize / 64] = 1 << (direction % 64);
    bits
}
