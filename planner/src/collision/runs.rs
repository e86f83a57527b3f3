//! The obstacles as bitmaps from which the reach of a whole kernel is put together.

use std::sync::OnceLock;

use swath_bridge::Cell;

use super::WORD;
use crate::Plane;
use crate::kernel::Kernel;

/// For each power of two, the cells from which a run of that many columns to the right holds an
/// obstacle. Any run is then the union of two.
#[derive(Debug)]
pub(super) struct Runs {
    rows: i32,
    cols: usize,
    /// Free columns before column 0, so that runs may begin left of the grid; whole words.
    margin: usize,
    words_per_row: usize,
    /// `levels[k]` is for runs of 2^k columns.
    levels: Vec<Vec<u64>>,
    occupied_rows: Vec<bool>,
    /// Rows of zeros before and behind the rows of a shifted bitmap.
    margin_rows: usize,
    /// By level and first bit: that level moved, so that this bit is the one of column 0. A kernel's
    /// rows are then runs of whole words, which the compiler joins a register at a time.
    shifted: Vec<OnceLock<Box<[u64]>>>,
}

impl Runs {
    /// The runs of a map for kernels that reach `reach` cells far.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        reason = "GridSpec::validate keeps sides at or below 4096"
    )]
    pub(super) fn new(obstacles: &Plane, reach: usize) -> Self {
        let (rows, cols) = (obstacles.rows() as usize, obstacles.cols() as usize);
        let margin = reach.div_ceil(WORD).max(1) * WORD;
        // A run may begin anywhere in the margins, and is looked at with one word behind it.
        let words_per_row = 2 * margin / WORD + cols.div_ceil(WORD) + 1;
        let mut first = vec![0u64; rows * words_per_row];
        for row in 0..rows {
            for col in 0..cols {
                if obstacles.get_index(row * cols + col) {
                    let bit = margin + col;
                    first[row * words_per_row + bit / WORD] |= 1 << (bit % WORD);
                }
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
            rows: rows as i32,
            cols,
            margin,
            words_per_row,
            levels,
            occupied_rows,
            margin_rows: reach,
            shifted: (0..shifts).map(|_| OnceLock::new()).collect(),
        }
    }

    /// Words of a row of cells.
    pub(super) const fn row_words(&self) -> usize {
        self.cols.div_ceil(WORD)
    }

    /// The occupied cells, without margins.
    pub(super) fn occupied_words(&self) -> Vec<u64> {
        let first = self.margin / WORD;
        let rows = self.levels[0].chunks(self.words_per_row);
        rows.flat_map(|row| &row[first..][..self.row_words()])
            .copied()
            .collect()
    }

    /// The level for a run of `columns`.
    const fn level(columns: usize) -> usize {
        (usize::BITS - 1 - columns.leading_zeros()) as usize
    }

    fn row(&self, level: usize, row: i32) -> Option<&[u64]> {
        let index = usize::try_from(row).ok().filter(|_| row < self.rows)?;
        self.occupied_rows[index].then(|| {
            &self.levels[level][index * self.words_per_row..(index + 1) * self.words_per_row]
        })
    }

    /// Whether no cell of a kernel that starts at `cell` is occupied.
    pub(super) fn is_clear(&self, kernel: &Kernel, cell: Cell) -> bool {
        kernel.spans.iter().all(|span| {
            let margin = i64::try_from(self.margin).unwrap_or(0);
            let last_bit = margin + i64::try_from(self.cols).unwrap_or(0) - 1;
            let first = (margin + i64::from(cell.col) + i64::from(span.first_col)).max(0);
            let last = (margin + i64::from(cell.col) + i64::from(span.last_col)).min(last_bit);
            let (Ok(first), Ok(last)) = (usize::try_from(first), usize::try_from(last)) else {
                return true;
            };
            if first > last {
                return true;
            }
            let level = Self::level(last - first + 1);
            self.row(level, cell.row.saturating_add(span.d_row))
                .is_none_or(|words| {
                    let second = last + 1 - (1 << level);
                    bits_at(words, first) & 1 == 0 && bits_at(words, second) & 1 == 0
                })
        })
    }

    /// Sets in `reached`, whose rows begin at `first_row`, the cells from which a kernel touches an
    /// occupied one.
    pub(super) fn dilate(&self, kernel: &Kernel, first_row: usize, reached: &mut [u64]) {
        let row_words = self.row_words();
        // Sources are joined in fours, so that the target is loaded and stored less often.
        let mut waiting: [&[u64]; 4] = [&[]; 4];
        let mut count = 0;
        for span in &kernel.spans {
            let columns = usize::try_from(span.last_col - span.first_col + 1).unwrap_or(1);
            let level = Self::level(columns);
            let first = self.margin.saturating_add_signed(span.first_col as isize);
            let second = first + columns - (1 << level);
            let row = (self.margin_rows + first_row).saturating_add_signed(span.d_row as isize);
            for first in [Some(first), Some(second).filter(|&second| second != first)] {
                let Some(first) = first else { continue };
                waiting[count] = &self.shifted(level, first)[row * row_words..][..reached.len()];
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
            let row_words = self.row_words();
            let rows = self.occupied_rows.len() + 2 * self.margin_rows;
            let mut words = vec![0u64; rows * row_words].into_boxed_slice();
            let (skip, shift) = (first / WORD, first % WORD);
            let inner = words[self.margin_rows * row_words..].chunks_mut(row_words);
            let from = self.levels[level].chunks(self.words_per_row);
            for ((to, from), is_occupied) in inner.zip(from).zip(&self.occupied_rows) {
                if *is_occupied {
                    for (to, pair) in to.iter_mut().zip(from[skip..].windows(2)) {
                        // Shifting by 1 first keeps a shift of 0 from becoming one of 64.
                        *to = pair[0] >> shift | pair[1] << 1 << (WORD - 1 - shift);
                    }
                }
            }
            words
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
