//! The obstacles of a part of a map as bitmaps from which the reach of a whole kernel is put together.

use std::sync::OnceLock;

use super::WORD;
use super::occupied::Occupied;
use crate::kernel::Kernel;

/// Cells of a map: rows, and words of their columns.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part {
    pub(super) first_row: usize,
    pub(super) rows: usize,
    pub(super) first_word: usize,
    pub(super) words: usize,
}

/// For each power of two, the cells from which a run of that many columns to the right holds an
/// obstacle. Any run is then the union of two.
#[derive(Debug)]
pub(super) struct Runs {
    part: Part,
    /// Rows before and behind the part, and columns to its sides, as far as kernels reach; columns in
    /// whole words.
    reach: usize,
    margin: usize,
    words_per_row: usize,
    /// `levels[k]` is for runs of 2^k columns.
    levels: Vec<Vec<u64>>,
    occupied_rows: Vec<bool>,
    /// By level and first bit: that level moved, so that this bit is the one of column 0. A kernel's
    /// rows are then runs of whole words, which the compiler joins a register at a time.
    shifted: Vec<OnceLock<Box<[u64]>>>,
}

impl Runs {
    /// The runs of a part of a map for kernels that reach `reach` cells far. What lies off the map is
    /// free.
    pub(super) fn new(occupied: &Occupied, part: Part, reach: usize) -> Self {
        let margin_words = reach.div_ceil(WORD).max(1);
        let margin = margin_words * WORD;
        // A run may begin anywhere in the margins, and is looked at with one word behind it.
        let words_per_row = 2 * margin_words + part.words + 1;
        let rows = part.rows + 2 * reach;
        let mut first = vec![0u64; rows * words_per_row];
        let skipped = margin_words.saturating_sub(part.first_word);
        let from_word = part.first_word.saturating_sub(margin_words);
        for (row, to) in (0isize..).zip(first.chunks_mut(words_per_row)) {
            let row = row + part.first_row.cast_signed() - reach.cast_signed();
            let from = occupied.row(row).map(|words| &words[from_word..]);
            for (to, word) in to[skipped..].iter_mut().zip(from.unwrap_or_default()) {
                *to = *word;
            }
        }
        let occupied_rows = first
            .chunks(words_per_row)
            .map(|row| row.iter().any(|&word| word != 0))
            .collect();
        let mut levels = vec![first];
        while 1 << (levels.len() - 1) <= 2 * reach {
            let run = 1 << (levels.len() - 1);
            let last = &levels[levels.len() - 1];
            let mut next = vec![0; last.len()];
            for (from, to) in last
                .chunks(words_per_row)
                .zip(next.chunks_mut(words_per_row))
            {
                for (word, to) in to.iter_mut().enumerate() {
                    *to = from[word] | bits_at(from, word * WORD + run);
                }
            }
            levels.push(next);
        }
        let shifts = levels.len() * (2 * margin + 1);
        Self {
            part,
            reach,
            margin,
            words_per_row,
            levels,
            occupied_rows,
            shifted: (0..shifts).map(|_| OnceLock::new()).collect(),
        }
    }

    /// The level for a run of `columns`.
    const fn level(columns: usize) -> usize {
        (usize::BITS - 1 - columns.leading_zeros()) as usize
    }

    /// Sets in `reached`, the words of some rows of the part from one of the map on, the cells from which
    /// a kernel touches an occupied one.
    pub(super) fn dilate(&self, kernel: &Kernel, first_row: usize, reached: &mut [u64]) {
        let first_row = first_row - self.part.first_row;
        // Sources are joined in fours, so that the target is loaded and stored less often.
        let mut waiting: [&[u64]; 4] = [&[]; 4];
        let mut count = 0;
        for span in &kernel.spans {
            let columns = usize::try_from(span.last_col - span.first_col + 1).unwrap_or(1);
            let level = Self::level(columns);
            let first = self.margin.saturating_add_signed(span.first_col as isize);
            let second = first + columns - (1 << level);
            let row = (self.reach + first_row).saturating_add_signed(span.d_row as isize);
            for first in [Some(first), Some(second).filter(|&second| second != first)] {
                let Some(first) = first else { continue };
                let from = row * self.part.words;
                waiting[count] = &self.shifted(level, first)[from..][..reached.len()];
                count += 1;
                if count == waiting.len() {
                    join_four(reached, waiting);
                    count = 0;
                }
            }
        }
        for source in &waiting[..count] {
            for (to, from) in reached.iter_mut().zip(*source) {
                *to |= from;
            }
        }
    }

    /// A level moved so that `first` is the bit of column 0, with margins above and below.
    fn shifted(&self, level: usize, first: usize) -> &[u64] {
        self.shifted[level * (2 * self.margin + 1) + first].get_or_init(|| {
            let words = self.part.words;
            let mut moved = vec![0u64; self.occupied_rows.len() * words].into_boxed_slice();
            let (skip, shift) = (first / WORD, first % WORD);
            let from = self.levels[level].chunks(self.words_per_row);
            let rows = moved.chunks_mut(words).zip(from).zip(&self.occupied_rows);
            for ((to, from), _) in rows.filter(|(_, is_occupied)| **is_occupied) {
                for (to, pair) in to.iter_mut().zip(from[skip..].windows(2)) {
                    // Shifting by 1 first keeps a shift of 0 from becoming one of 64.
                    *to = pair[0] >> shift | pair[1] << 1 << (WORD - 1 - shift);
                }
            }
            moved
        })
    }
}

fn join_four(reached: &mut [u64], sources: [&[u64]; 4]) {
    let [a, b, c, d] = sources.map(|source| &source[..reached.len()]);
    for (index, to) in reached.iter_mut().enumerate() {
        *to |= a[index] | b[index] | c[index] | d[index];
    }
}

/// The 64 bits of a row that begin at `bit`; beyond the row's end they are 0.
#[inline]
fn bits_at(row: &[u64], bit: usize) -> u64 {
    let (word, shift) = (bit / WORD, bit % WORD);
    let low = row.get(word).copied().unwrap_or(0) >> shift;
    // Shifting by 1 and then by the rest keeps a shift of 0 from becoming one of 64.
    let high = row.get(word + 1).copied().unwrap_or(0) << 1 << (WORD - 1 - shift);
    low | high
}
