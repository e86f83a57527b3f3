//! Which states farther off the trunk goes on from: the cheapest of each square of cells and range of
//! headings.

use super::goal::Goal;
use super::memory::State;
use crate::action::DIRECTIONS;
use crate::collision::{CollisionMap, WORD};

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
        fine_steps: 60_000,
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
    /// By row and by column: where their squares begin.
    of_row: Vec<u32>,
    of_col: Vec<u32>,
    cols: RowsOf,
    /// A bit for each cell that reaches a goal, and the words that are not 0.
    goal_cells: Vec<u64>,
    goal_words: Vec<usize>,
    range_bits: u32,
}

/// Divides by a number of columns, by multiplying.
#[derive(Debug, Clone, Copy, Default)]
struct RowsOf {
    cols: usize,
    inverse: u64,
}

impl RowsOf {
    const BITS: u32 = 40;

    /// Up to cell 2^24 in rows of up to 2^12 the inverse is too great by less than a row in all: quotients
    /// are exact.
    const fn new(cols: usize) -> Self {
        Self {
            cols,
            inverse: (1 << Self::BITS) / cols as u64 + 1,
        }
    }

    #[inline]
    const fn place_of(self, cell: usize) -> (usize, usize) {
        let row = ((cell as u64 * self.inverse) >> Self::BITS) as usize;
        (row, cell - row * self.cols)
    }
}

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
        for word in self.goal_words.drain(..) {
            self.goal_cells[word] = 0;
        }
        let (rows, cols) = (map.spec().rows as usize, map.spec().cols as usize);
        let ranges = DIRECTIONS >> range_bits;
        let across = cols.div_ceil(side);
        let classes = across * rows.div_ceil(side) * ranges;
        // Pages that nothing is written to take no memory.
        if self.cheapest.len() < classes {
            self.cheapest = vec![0; classes];
        }
        let words = (rows * cols).div_ceil(WORD);
        if self.goal_cells.len() < words {
            self.goal_cells = vec![0; words];
        }
        let begin = |square: usize| u32::try_from(square * ranges).unwrap_or(u32::MAX);
        self.of_row.clear();
        self.of_row
            .extend((0..rows).map(|row| begin(row / side * across)));
        self.of_col.clear();
        self.of_col.extend((0..cols).map(|col| begin(col / side)));
        self.cols = RowsOf::new(cols);
        for &cell in goals.iter().flat_map(|(_, goal)| goal.cells()) {
            self.goal_cells[cell / WORD] |= 1 << (cell % WORD);
            self.goal_words.push(cell / WORD);
        }
    }

    pub(super) fn reaches_goal(&self, state: State) -> bool {
        self.goal_cells[state.cell() / WORD] >> (state.cell() % WORD) & 1 != 0
    }

    fn index_of(&self, state: State) -> u32 {
        let range = u32::from(state.direction()) >> self.range_bits;
        let (row, col) = self.cols.place_of(state.cell());
        self.of_row[row] + self.of_col[col] + range
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn rows_and_columns_are_those_of_a_division(cols in 1..=4096_usize, cell in 0..1_usize << 24) {
            let last = cols * 4096 - 1;
            let cell = cell % (last + 1);
            let first_of_row = cell / cols * cols;
            for cell in [0, cell, first_of_row, first_of_row.saturating_sub(1), last] {
                prop_assert_eq!(RowsOf::new(cols).place_of(cell), (cell / cols, cell % cols));
            }
        }
    }
}
