//! Blocked motions by cell: 64 motions of a cell in one word, so that an expansion learns with a few
//! loads what it may do.

use std::sync::OnceLock;

use super::WORD;

/// Rows of a tile, and words of its columns at most. Tiles are filled when they are first looked at, so
/// that a search pays for the ground and headings that it comes to and for no others.
pub(super) const TILE_ROWS: usize = 64;
const TILE_WORDS: usize = 4;
const TILE_COLS: usize = TILE_WORDS * WORD;

/// How a map is divided into tiles.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tiling {
    rows: usize,
    cols: usize,
    /// Tiles side by side, and words of a tile's columns: of the last one some may be off the map.
    across: usize,
    words: usize,
}

impl Tiling {
    pub(super) fn new(rows: usize, cols: usize) -> Self {
        Self {
            rows,
            cols,
            across: cols.div_ceil(TILE_COLS),
            words: cols.div_ceil(WORD).min(TILE_WORDS),
        }
    }

    /// Number of tiles.
    pub(crate) const fn len(&self) -> usize {
        self.across * self.rows.div_ceil(TILE_ROWS)
    }

    /// Number of tiles side by side.
    pub(crate) const fn across(&self) -> usize {
        self.across
    }

    /// Words of a row of a tile.
    pub(super) const fn words(&self) -> usize {
        self.words
    }

    /// Columns of a tile with those that are off the map.
    pub(crate) const fn padded_cols(&self) -> usize {
        self.words * WORD
    }

    /// Number of the tile that holds a cell.
    #[inline]
    pub(crate) const fn tile_of(&self, (row, col): (usize, usize)) -> usize {
        row / TILE_ROWS * self.across + col / TILE_COLS
    }

    /// Where a cell lies in its tile, whose rows are padded.
    #[inline]
    pub(crate) const fn place_in_tile(&self, (row, col): (usize, usize)) -> usize {
        row % TILE_ROWS * self.padded_cols() + col % TILE_COLS
    }

    /// First row and first column of a tile, and how many there are of each on the map.
    pub(crate) fn cells_of(&self, tile: usize) -> ((usize, usize), (usize, usize)) {
        let first = (
            tile / self.across * TILE_ROWS,
            tile % self.across * TILE_COLS,
        );
        let rows = TILE_ROWS.min(self.rows - first.0);
        (first, (rows, TILE_COLS.min(self.cols - first.1)))
    }
}

/// For groups of 64 motions, a word a cell.
#[derive(Debug)]
pub(super) struct Tiles {
    groups: usize,
    tiling: Tiling,
    /// By tile and group: a word for each cell, rows padded to whole words of columns.
    filled: Vec<OnceLock<Box<[u64]>>>,
}

impl Tiles {
    /// Tiles for a number of motions.
    pub(super) fn new(motions: usize, tiling: Tiling) -> Self {
        let groups = motions.div_ceil(WORD);
        Self {
            groups,
            tiling,
            filled: (0..groups * tiling.len())
                .map(|_| OnceLock::new())
                .collect(),
        }
    }

    /// The 64 motions of a group at a cell, filling its tile with `fill` if need be: given a motion,
    /// the tile's number and its bits (cleared), it sets those from which the motion is blocked.
    #[inline]
    pub(super) fn at(
        &self,
        group: usize,
        cell: (usize, usize),
        fill: impl Fn(usize, usize, &mut [u64]),
    ) -> u64 {
        let number = self.tiling.tile_of(cell);
        let tile = self.filled[number * self.groups + group].get_or_init(|| {
            self.fill(number, |motion, bits| {
                fill(group * WORD + motion, number, bits);
            })
        });
        tile[self.tiling.place_in_tile(cell)]
    }

    #[cold]
    fn fill(&self, number: usize, fill: impl Fn(usize, &mut [u64])) -> Box<[u64]> {
        let (_, (rows, _)) = self.tiling.cells_of(number);
        let words = rows * self.tiling.words;
        let mut bits = vec![0u64; words * WORD];
        for (motion, bits) in bits.chunks_mut(words).enumerate() {
            fill(motion, bits);
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
