//! Which states farther off the trunk goes on from: the cheapest of each square of cells and range of
//! headings.

use super::goal::Goal;
use super::memory::State;
use crate::action::DIRECTIONS;
use crate::collision::CollisionMap;

/// How far apart states lie of which one is expanded: cells a side of a square, and bits of a direction
/// that are left out of account.
#[derive(Debug, Clone, Copy)]
pub(super) struct Grain {
    pub(super) fine: (usize, u32),
    /// After so many expansions the other one counts.
    pub(super) fine_steps: u64,
    pub(super) coarse: (usize, u32),
}

impl Grain {
    pub(super) const FIRST: Self = Self {
        fine: (3, 3),
        fine_steps: 15_000,
        coarse: (5, 3),
    };
    pub(super) const SECOND: Self = Self {
        fine: (3, 1),
        fine_steps: 25_000,
        coarse: (3, 3),
    };
}

/// Leaves the cheapest state of each square of cells and range of headings.
#[derive(Debug, Default)]
pub(super) struct Sieve {
    /// By square and range: the complement of the least cost of a state that was come to, in units; so 0
    /// where there was none, and the greatest number once one was taken.
    cheapest: Vec<u32>,
    /// Those that are not 0.
    touched: Vec<u32>,
    /// What the squares are for: rows and columns of the grid, cells a side, and ranges.
    squares_for: [usize; 4],
    /// By cell: where its square begins, and whether it reaches a goal ([`GOAL`]).
    squares: Vec<u32>,
    /// Cells that do.
    goal_cells: Vec<usize>,
    range_bits: u32,
}

/// The bit of cells that reach a goal.
const GOAL: u32 = 1 << 31;

impl Sieve {
    /// Begins with squares of so many cells a side and ranges of 2 to the power of so many directions.
    pub(super) fn divide(
        &mut self,
        map: &CollisionMap,
        goals: &[(usize, Goal)],
        (side, range_bits): (usize, u32),
    ) {
        self.range_bits = range_bits;
        for index in self.touched.drain(..) {
            self.cheapest[index as usize] = 0;
        }
        for cell in self.goal_cells.drain(..) {
            self.squares[cell] &= !GOAL;
        }
        let (rows, cols) = (map.spec().rows as usize, map.spec().cols as usize);
        self.divide_grid([rows, cols, side, DIRECTIONS >> range_bits]);
        for &cell in goals.iter().flat_map(|(_, goal)| goal.cells()) {
            self.squares[cell] |= GOAL;
            self.goal_cells.push(cell);
        }
    }

    #[expect(
        clippy::cast_possible_truncation,
        reason = "grids have at most 2^24 cells, and squares of several of these at most 2^7 ranges"
    )]
    fn divide_grid(&mut self, wanted: [usize; 4]) {
        if self.squares_for == wanted {
            return;
        }
        self.squares_for = wanted;
        let [rows, cols, side, ranges] = wanted;
        let across = cols.div_ceil(side);
        let classes = across * rows.div_ceil(side) * ranges;
        if self.cheapest.len() < classes {
            // Pages that nothing is written to take no memory.
            self.cheapest = vec![0; classes];
        }
        self.squares.clear();
        for row in 0..rows {
            let first = row / side * across;
            let squares = (0..cols).map(|col| ((first + col / side) * ranges) as u32);
            self.squares.extend(squares);
        }
    }

    pub(super) fn reaches_goal(&self, state: State) -> bool {
        self.squares[state.cell()] & GOAL != 0
    }

    fn index_of(&self, state: State) -> u32 {
        let range = u32::from(state.direction()) >> self.range_bits;
        (self.squares[state.cell()] & !GOAL) + range
    }

    /// Comes to a state at a cost, and says whether it counts: as the cheapest like it so far, or at a
    /// goal.
    #[inline]
    pub(super) fn admit(&mut self, state: State, cost: u32) -> bool {
        let index = self.index_of(state);
        let cheapest = &mut self.cheapest[index as usize];
        let is_cheapest = !cost > *cheapest;
        if is_cheapest {
            if *cheapest == 0 {
                self.touched.push(index);
            }
            *cheapest = !cost;
        }
        is_cheapest || self.reaches_goal(state)
    }

    /// Takes a state in order of cost, and says whether it is the first like it.
    pub(super) fn take(&mut self, state: State, cost: u32) -> bool {
        let index = self.index_of(state);
        let cheapest = &mut self.cheapest[index as usize];
        let is_first = !cost >= *cheapest;
        if is_first {
            if *cheapest == 0 {
                self.touched.push(index);
            }
            *cheapest = u32::MAX;
        }
        is_first
    }
}
