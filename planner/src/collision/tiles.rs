//! Blocked motions by cell: 64 motions of a cell in one word, so that an expansion learns with a few
//! loads what it may do.

use std::sync::OnceLock;

use super::WORD;

/// Rows of a band. Bands are filled when they are first looked at, so that a search pays for the rows
/// and headings that it comes to and for no others.
const BAND_ROWS: usize = 64;

/// For groups of 64 motions, a word a cell.
#[derive(Debug)]
pub(super) struct Tiles {
    groups: usize,
    rows: usize,
    row_words: usize,
    /// By band and group: a word for each cell of the band, rows padded to whole words of columns.
    filled: Vec<OnceLock<Box<[u64]>>>,
}

impl Tiles {
    /// Tiles for a number of motions on a grid whose rows take `row_words` words of bits.
    pub(super) fn new(motions: usize, rows: usize, row_words: usize) -> Self {
        let groups = motions.div_ceil(WORD);
        Self {
            groups,
            rows,
            row_words,
            filled: (0..groups * rows.div_ceil(BAND_ROWS))
                .map(|_| OnceLock::new())
                .collect(),
        }
    }

    /// The 64 motions of a group at a cell, filling its tile with `fill` if need be: given a motion,
    /// the band's first row and its bits (cleared), it sets those from which the motion is blocked.
    #[inline]
    pub(super) fn at(
        &self,
        group: usize,
        (row, col): (usize, usize),
        fill: impl Fn(usize, usize, &mut [u64]),
    ) -> u64 {
        let band = row / BAND_ROWS;
        let tile = self.filled[band * self.groups + group].get_or_init(|| {
            self.fill(band * BAND_ROWS, |motion, first_row, bits| {
                fill(group * WORD + motion, first_row, bits);
            })
        });
        tile[row % BAND_ROWS * self.row_words * WORD + col]
    }

    #[cold]
    fn fill(&self, first_row: usize, fill: impl Fn(usize, usize, &mut [u64])) -> Box<[u64]> {
        let rows = BAND_ROWS.min(self.rows - first_row);
        let words = rows * self.row_words;
        let mut bits = vec![0u64; words * WORD];
        for (motion, bits) in bits.chunks_mut(words).enumerate() {
            fill(motion, first_row, bits);
        }
        let mut tile = vec![0u64; words * WORD].into_boxed_slice();
        for (word, cells) in tile.as_chunks_mut::<WORD>().0.iter_mut().enumerate() {
            for (motion, bits) in cells.iter_mut().zip(bits[word..].iter().step_by(words)) {
                *motion = *bits;
            }
            transpose(cells);
        }
        tile
    }
}

/// Swaps rows and columns of 64 × 64 bits; the least significant bit is column 0.
fn transpose(words: &mut [u64; WORD]) {
    // Quarters off the diagonal change places, then those of the quarters, down to single bits.
    let mut half = WORD / 2;
    let mut low = u64::MAX >> half;
    while half != 0 {
        for pair in words.chunks_exact_mut(2 * half) {
            let (upper, lower) = pair.split_at_mut(half);
            for (upper, lower) in upper.iter_mut().zip(lower) {
                let swapped = (*upper >> half ^ *lower) & low;
                *lower ^= swapped;
                *upper ^= swapped << half;
            }
        }
        half /= 2;
        low ^= low << half;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn transposing_swaps_rows_and_columns(
            words in proptest::collection::vec(any::<u64>(), WORD),
        ) {
            let mut transposed: [u64; WORD] = words.clone().try_into().unwrap();
            transpose(&mut transposed);
            for (row, to) in transposed.iter().enumerate() {
                for (col, from) in words.iter().enumerate() {
                    prop_assert_eq!(to >> col & 1, from >> row & 1);
                }
            }
        }
    }
}
