//! The occupied cells of a frame, ready for asking which of them lie near the vehicle.

use swath_bridge::{Cell, GridSpec};

use super::footprint::Placed;
use crate::{CollisionMap, Error, Plane};

const WORD: usize = u64::BITS as usize;

/// The occupied cells of one frame; made once and used for all its paths.
#[derive(Debug, Clone)]
pub struct ObstacleCells {
    spec: GridSpec,
    row_words: usize,
    occupied: Vec<u64>,
    /// Those that have a free neighbour: nothing that moves can touch another one first.
    border: Vec<u64>,
}

impl ObstacleCells {
    /// The cells of a plane. What lies beyond the grid's edge is free.
    ///
    /// # Errors
    /// [`Error::Shape`] if the plane is not of the grid's size, [`Error::Bridge`] if the grid is none.
    pub fn new(spec: GridSpec, obstacles: &Plane) -> Result<Self, Error> {
        spec.validate()?;
        obstacles.check_size("obstacles", &spec)?;
        Ok(Self::of_words(spec, obstacles.row_words()))
    }

    /// The occupied cells of a collision map.
    pub(crate) fn of_map(map: &CollisionMap) -> Self {
        Self::of_words(*map.spec(), map.occupied_words().to_vec())
    }

    fn of_words(spec: GridSpec, occupied: Vec<u64>) -> Self {
        let row_words = (spec.cols as usize).div_ceil(WORD);
        Self {
            spec,
            row_words,
            border: border(&occupied, row_words),
            occupied,
        }
    }

    /// Size and place of the grid.
    pub const fn spec(&self) -> &GridSpec {
        &self.spec
    }

    /// The same cells where a metre has so many units.
    pub(crate) fn scaled(&self, factor: f64) -> ScaledCells<'_> {
        ScaledCells {
            cells: self,
            spec: GridSpec {
                resolution_m: self.spec.resolution_m * factor,
                ..self.spec
            },
        }
    }
}

/// Occupied cells where lengths are counted in units of one's own; with a factor of 1, in metres.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ScaledCells<'a> {
    cells: &'a ObstacleCells,
    spec: GridSpec,
}

impl ScaledCells<'_> {
    /// Side of a cell, in units.
    pub(crate) const fn resolution_m(&self) -> f64 {
        self.spec.resolution_m
    }

    /// Whether a point is on the grid, and not nearer than a margin to its edge.
    pub(crate) fn holds(&self, (x_m, y_m): (f64, f64), margin_m: f64) -> bool {
        [(-margin_m, -margin_m), (margin_m, margin_m)]
            .into_iter()
            .all(|(dx, dy)| {
                let cell = self.spec.cell_at(x_m + dx, y_m + dy);
                self.spec.index_of(cell).is_some()
            })
    }

    /// Calls `each` with the centres of the border cells that are less than `gap_m` from a rectangle.
    pub(crate) fn each_near(&self, placed: &Placed, gap_m: f64, each: impl FnMut((f64, f64))) {
        self.each_of(&self.cells.border, (placed, gap_m), each);
    }

    /// Whether no occupied cell at all is less than `gap_m` from a rectangle.
    pub(crate) fn is_clear(&self, placed: &Placed, gap_m: f64) -> bool {
        let mut is_clear = true;
        self.each_of(&self.cells.occupied, (placed, gap_m), |_| is_clear = false);
        is_clear
    }

    #[expect(
        clippy::cast_sign_loss,
        reason = "rows and columns are clamped to the grid first"
    )]
    fn each_of(
        &self,
        bits: &[u64],
        (placed, gap_m): (&Placed, f64),
        mut each: impl FnMut((f64, f64)),
    ) {
        let ((x_m, y_m), (half_x_m, half_y_m)) = placed.bounds(gap_m);
        let first = self.spec.cell_at(x_m + half_x_m, y_m + half_y_m);
        let last = self.spec.cell_at(x_m - half_x_m, y_m - half_y_m);
        let end = self.spec.cell_of_index(self.spec.len() - 1);
        let rows = first.row.max(0)..=last.row.min(end.row);
        let (first_col, last_col) = (first.col.max(0), last.col.min(end.col));
        if first_col > last_col {
            return;
        }
        let (first_col, last_col) = (first_col as usize, last_col as usize);
        for row in rows {
            let words = &bits[row as usize * self.cells.row_words..][..self.cells.row_words];
            let (first_word, last_word) = (first_col / WORD, last_col / WORD);
            for (index, &word) in (first_word..).zip(&words[first_word..=last_word]) {
                let mut word = word;
                if index == first_word {
                    word &= u64::MAX << (first_col % WORD);
                }
                if index == last_word {
                    word &= u64::MAX >> (WORD - 1 - last_col % WORD);
                }
                while word != 0 {
                    let col = index * WORD + word.trailing_zeros() as usize;
                    word &= word - 1;
                    let col = i32::try_from(col).unwrap_or(i32::MAX);
                    let centre = self.spec.centre_of(Cell::new(row, col));
                    if placed.gap_m(centre) < gap_m {
                        each(centre);
                    }
                }
            }
        }
    }
}

/// The set bits of which one of the four neighbours is not set; beyond the edge none is.
fn border(occupied: &[u64], row_words: usize) -> Vec<u64> {
    let word_at = |row: Option<usize>, word: Option<usize>| {
        let index = row.zip(word).filter(|&(_, word)| word < row_words);
        index
            .and_then(|(row, word)| occupied.get(row * row_words + word))
            .copied()
            .unwrap_or(0)
    };
    let rows = occupied.len() / row_words;
    let mut border = Vec::with_capacity(occupied.len());
    for row in 0..rows {
        for word in 0..row_words {
            let here = word_at(Some(row), Some(word));
            let above = word_at(row.checked_sub(1), Some(word));
            let below = word_at(Some(row + 1), Some(word));
            let before = (here << 1) | (word_at(Some(row), word.checked_sub(1)) >> (WORD - 1));
            let behind = (here >> 1) | (word_at(Some(row), Some(word + 1)) << (WORD - 1));
            border.push(here & !(above & below & before & behind));
        }
    }
    border
}

#[cfg(test)]
mod tests {
    use super::super::footprint::Footprint;
    use super::*;
    use proptest::prelude::*;
    use swath_bridge::{Pose2, Vehicle};

    fn spec() -> GridSpec {
        GridSpec {
            rows: 60,
            cols: 70,
            ego_row: 30,
            ego_col: 33,
            ..GridSpec::default()
        }
    }

    #[test]
    fn a_block_keeps_its_border_and_loses_its_inside() {
        let mut plane = Plane::empty(60, 70);
        for row in 10..20 {
            for col in 55..70 {
                plane.set(Cell::new(row, col));
            }
        }
        let cells = ObstacleCells::new(spec(), &plane).unwrap();
        let bits = |row: usize, col: usize| {
            let word = row * cells.row_words + col / WORD;
            (cells.border[word] >> (col % WORD)) & 1 == 1
        };
        for row in 0..60 {
            for col in 0..70 {
                let inside = (11..19).contains(&row) && (56..69).contains(&col);
                let set = plane.get_index(row * 70 + col);
                assert_eq!(bits(row, col), set && !inside, "{row} {col}");
            }
        }
        let wrong = Plane::empty(61, 70);
        assert!(ObstacleCells::new(spec(), &wrong).is_err());
    }

    proptest! {
        #[test]
        fn every_occupied_cell_within_reach_is_named(
            seed in 0u64..1000, x in -8.0..8.0f64, y in -8.0..8.0f64, yaw in -3.1..3.1f64,
        ) {
            let mut plane = Plane::empty(60, 70);
            for index in 0..plane.len() {
                if (index as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(seed) >> 61 == 0 {
                    plane.set_index(index);
                }
            }
            let cells = ObstacleCells::new(spec(), &plane).unwrap();
            let cells = cells.scaled(1.0);
            let footprint = Footprint::new(&Vehicle::default(), 0.2);
            let placed = footprint.placed(&Pose2::new(x, y, yaw));
            let mut found = Vec::new();
            cells.each_of(&cells.cells.occupied, (&placed, 0.4), |centre| found.push(centre));
            let all = (0..plane.len()).filter(|&index| plane.get_index(index));
            let wanted: Vec<_> = all
                .map(|index| spec().centre_of(spec().cell_of_index(index)))
                .filter(|&centre| placed.gap_m(centre) < 0.4)
                .collect();
            prop_assert_eq!(cells.is_clear(&placed, 0.4), wanted.is_empty());
            prop_assert_eq!(found, wanted);
        }
    }
}
