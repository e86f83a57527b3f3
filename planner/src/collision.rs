//! Which motions hit an obstacle, for every cell at once.
//!
//! For each action of the lookup table and each turn between neighbouring directions, a bitmap says
//! from which cells the motion would touch an occupied one. A bitmap is computed when it is first
//! asked for: the obstacle bitmap is dilated with the motion's swept cells, a whole row at a time.

use std::sync::{Arc, OnceLock};

use swath_bridge::{Cell, GridSpec, Pose2};

use crate::action::{ACTIONS, DIRECTIONS};
use crate::kernel::Kernel;
use crate::motion::MotionModel;
use crate::{Error, Plane};

/// Bits a word.
const WORD: usize = u64::BITS as usize;

/// Answers for one obstacle map whether a motion of one vehicle is free.
#[derive(Debug)]
pub struct CollisionMap {
    model: Arc<MotionModel>,
    spec: GridSpec,
    windows: Windows,
    chords: Vec<OnceLock<Bitmap>>,
    turns: Vec<OnceLock<Bitmap>>,
}

impl CollisionMap {
    /// The map of a plane of occupied cells. What lies beyond the edge counts as free.
    ///
    /// # Errors
    /// [`Error::Shape`] when plane, grid and model do not fit together.
    pub fn new(model: Arc<MotionModel>, spec: GridSpec, obstacles: &Plane) -> Result<Self, Error> {
        spec.validate()?;
        if (obstacles.rows(), obstacles.cols()) != (spec.rows, spec.cols) {
            return Err(Error::Shape {
                what: "obstacles",
                got: (obstacles.rows(), obstacles.cols()),
                wanted: (spec.rows, spec.cols),
            });
        }
        if (spec.resolution_m - model.resolution_m()).abs() > 1e-9 {
            return Err(Error::ResolutionMismatch {
                grid_m: spec.resolution_m,
                model_m: model.resolution_m(),
            });
        }
        let reach = model
            .chords
            .iter()
            .chain(&model.turns)
            .map(Kernel::reach_cells)
            .max();
        let margin = usize::try_from(reach.unwrap_or(0))
            .unwrap_or(0)
            .div_ceil(WORD)
            * WORD;
        Ok(Self {
            windows: Windows::new(obstacles, margin),
            chords: (0..ACTIONS).map(|_| OnceLock::new()).collect(),
            turns: (0..DIRECTIONS).map(|_| OnceLock::new()).collect(),
            model,
            spec,
        })
    }

    /// The vehicle's motions.
    pub const fn model(&self) -> &Arc<MotionModel> {
        &self.model
    }

    /// Size and place of the grid.
    pub const fn spec(&self) -> &GridSpec {
        &self.spec
    }

    /// Whether the footprint at a pose anywhere in the plane touches no occupied cell.
    pub fn pose_is_free(&self, pose: &Pose2) -> bool {
        if !pose.is_finite() {
            return false;
        }
        let cell = self.spec.cell_at(pose.x_m, pose.y_m);
        let (x_m, y_m) = self.spec.centre_of(cell);
        let offset = Pose2::new(pose.x_m - x_m, pose.y_m - y_m, pose.yaw_rad);
        let kernel = Kernel::of_pose(&self.model.vehicle, self.spec.resolution_m, &offset);
        self.windows.is_clear(&kernel, cell)
    }

    /// Whether the footprint is free on a cell's centre with the heading of a direction.
    pub(crate) fn state_is_free(&self, cell: Cell, direction: u8) -> bool {
        self.windows
            .is_clear(&self.model.poses[usize::from(direction)], cell)
    }

    /// From which cells an action of the lookup table hits something.
    pub(crate) fn chord(&self, action: u16) -> &Bitmap {
        let index = usize::from(action);
        self.chords[index].get_or_init(|| self.windows.dilated(&self.model.chords[index]))
    }

    /// On which cells the turn from a direction to the next one counter-clockwise hits something.
    pub(crate) fn turn(&self, direction: u8) -> &Bitmap {
        let index = usize::from(direction);
        self.turns[index].get_or_init(|| self.windows.dilated(&self.model.turns[index]))
    }
}

/// A bit for each cell, a row in whole words.
#[derive(Debug)]
pub(crate) struct Bitmap {
    words_per_row: usize,
    words: Vec<u64>,
}

impl Bitmap {
    /// The bit of a cell of the grid.
    #[inline]
    pub(crate) fn get(&self, row: usize, col: usize) -> bool {
        self.words[row * self.words_per_row + col / WORD] >> (col % WORD) & 1 != 0
    }
}

/// The obstacles, and for each power of two the cells from which a run of that many columns to the
/// right holds an obstacle. Any run is then the union of two.
#[derive(Debug)]
struct Windows {
    rows: i32,
    cols: usize,
    /// Free columns before column 0, so that runs may begin left of the grid.
    margin: usize,
    words_per_row: usize,
    /// `levels[k]` is for runs of 2^k columns.
    levels: Vec<Vec<u64>>,
    occupied_rows: Vec<bool>,
}

impl Windows {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        reason = "GridSpec::validate keeps sides at or below 4096"
    )]
    fn new(obstacles: &Plane, margin: usize) -> Self {
        let (rows, cols) = (obstacles.rows() as usize, obstacles.cols() as usize);
        let words_per_row = (margin + cols).div_ceil(WORD) + 1;
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
        while 1 << (levels.len() - 1) <= 2 * margin {
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
        Self {
            rows: rows as i32,
            cols,
            margin,
            words_per_row,
            levels,
            occupied_rows,
        }
    }

    /// The level for a run of `columns`, and its length.
    fn level(&self, columns: usize) -> (&[u64], usize) {
        let level = (usize::BITS - 1 - columns.leading_zeros()) as usize;
        (&self.levels[level], 1 << level)
    }

    fn row<'a>(&self, level: &'a [u64], row: i32) -> Option<&'a [u64]> {
        let index = usize::try_from(row).ok().filter(|_| row < self.rows)?;
        self.occupied_rows[index]
            .then(|| &level[index * self.words_per_row..(index + 1) * self.words_per_row])
    }

    /// Whether no cell of a kernel that starts at `cell` is occupied.
    fn is_clear(&self, kernel: &Kernel, cell: Cell) -> bool {
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
            let (level, run) = self.level(last - first + 1);
            self.row(level, cell.row.saturating_add(span.d_row))
                .is_none_or(|words| {
                    bits_at(words, first) & 1 == 0 && bits_at(words, last + 1 - run) & 1 == 0
                })
        })
    }

    /// From which cells a kernel touches an occupied one.
    fn dilated(&self, kernel: &Kernel) -> Bitmap {
        let words_per_row = self.cols.div_ceil(WORD);
        let mut words = Vec::with_capacity(self.occupied_rows.len() * words_per_row);
        for row in 0..self.rows {
            let start = words.len();
            words.resize(start + words_per_row, 0);
            for span in &kernel.spans {
                let columns = usize::try_from(span.last_col - span.first_col + 1).unwrap_or(1);
                let (level, run) = self.level(columns);
                let Some(from) = self.row(level, row + span.d_row) else {
                    continue;
                };
                let margin = i32::try_from(self.margin).unwrap_or(0);
                let first = usize::try_from(margin + span.first_col).unwrap_or(0);
                let second = first + columns - run;
                for (word, to) in words[start..].iter_mut().enumerate() {
                    *to |= bits_at(from, word * WORD + first) | bits_at(from, word * WORD + second);
                }
            }
        }
        Bitmap {
            words_per_row,
            words,
        }
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

#[cfg(test)]
mod tests;
