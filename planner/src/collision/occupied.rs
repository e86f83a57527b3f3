//! The occupied cells of a map.

use swath_bridge::Cell;

use super::WORD;
use crate::Plane;
use crate::kernel::Kernel;

/// A bit a cell: rows of whole words, column 0 in the least significant bit.
#[derive(Debug)]
pub(super) struct Occupied {
    pub(super) rows: usize,
    pub(super) cols: usize,
    pub(super) row_words: usize,
    pub(super) words: Vec<u64>,
}

impl Occupied {
    pub(super) fn new(obstacles: &Plane) -> Self {
        let cols = obstacles.cols() as usize;
        Self {
            rows: obstacles.rows() as usize,
            cols,
            row_words: cols.div_ceil(WORD),
            words: obstacles.row_words(),
        }
    }

    /// A row's words, unless it is off the map.
    pub(super) fn row(&self, row: isize) -> Option<&[u64]> {
        let row = usize::try_from(row).ok().filter(|&row| row < self.rows)?;
        Some(&self.words[row * self.row_words..][..self.row_words])
    }

    /// Whether no cell of a kernel that starts at `cell`, on the map or off it, is occupied.
    pub(super) fn is_clear(&self, kernel: &Kernel, cell: Cell) -> bool {
        kernel.spans.iter().all(|span| {
            let Some(words) = self.row(cell.row.saturating_add(span.d_row) as isize) else {
                return true;
            };
            let first = cell.col.saturating_add(span.first_col).max(0);
            let last = cell.col.saturating_add(span.last_col);
            let (Ok(first), Ok(last)) = (usize::try_from(first), usize::try_from(last)) else {
                return true;
            };
            let last = last.min(self.cols - 1);
            first > last || is_run_clear(words, first, last)
        })
    }
}

/// Whether no bit from the first to the last one is set.
fn is_run_clear(words: &[u64], first: usize, last: usize) -> bool {
    let (first_word, last_word) = (first / WORD, last / WORD);
    let from = u64::MAX << (first % WORD);
    let to = u64::MAX >> (WORD - 1 - last % WORD);
    if first_word == last_word {
        return words[first_word] & from & to == 0;
    }
    let between = &words[first_word + 1..last_word];
    words[first_word] & from == 0
        && words[last_word] & to == 0
        && between.iter().all(|&word| word == 0)
}
