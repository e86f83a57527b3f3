//! Which motions hit an obstacle, for every cell at once.
//!
//! For each action of the lookup table and each turn between neighbouring directions, a bit says of
//! every cell whether the motion from there would touch an occupied one or leave the map. The bits of
//! 64 motions that are neighbours in heading lie together, cell by cell. They are computed a tile of the
//! map at a time when they are first asked for: the obstacles are dilated with each motion's swept cells,
//! many words at a time, and the result is transposed. So a large map costs what is looked at of it.

mod occupied;
mod runs;
mod tiles;

use std::sync::{Arc, OnceLock};

use swath_bridge::{Cell, GridSpec, Pose2};

use crate::action::{ACTIONS, DIRECTIONS, REACH_CELLS};
use crate::kernel::Kernel;
use crate::motion::{MotionModel, SECTORS};
use crate::{Error, Plane};

use occupied::Occupied;
use runs::{Part, Runs};
use tiles::{TILE_ROWS, Tiles};

pub(crate) use tiles::Tiling;

/// Bits a word, and motions a group.
pub(crate) const WORD: usize = u64::BITS as usize;
/// Rows of tiles whose obstacles are prepared together.
const PART_TILES: usize = 8;
/// Column offsets of the lookup table.
const OFFSETS: usize = 2 * REACH_CELLS as usize + 1;

/// Answers for one obstacle map whether a motion of one vehicle is free.
#[derive(Debug)]
pub struct CollisionMap {
    model: Arc<MotionModel>,
    spec: GridSpec,
    occupied: Occupied,
    tiling: Tiling,
    /// By parts of the map, each of tiles one below the other.
    runs: Vec<OnceLock<Runs>>,
    chords: Tiles,
    turns: Tiles,
    /// For each column offset of an action, the columns from which it leaves the map: a row's words.
    leaving: Vec<u64>,
}

impl CollisionMap {
    /// The map of a plane of occupied cells. What lies beyond the edge counts as free.
    ///
    /// # Errors
    /// [`Error::Shape`] when plane, grid and model do not fit together.
    pub fn new(model: Arc<MotionModel>, spec: GridSpec, obstacles: &Plane) -> Result<Self, Error> {
        spec.validate()?;
        obstacles.check_size("obstacles", &spec)?;
        if (spec.resolution_m - model.resolution_m()).abs() > 1e-9 {
            return Err(Error::ResolutionMismatch {
                grid_m: spec.resolution_m,
                model_m: model.resolution_m(),
            });
        }
        let (rows, cols) = (spec.rows as usize, spec.cols as usize);
        let tiling = Tiling::new(rows, cols);
        let parts = tiling.len() / tiling.across();
        let parts = parts.div_ceil(PART_TILES) * tiling.across();
        let row_words = tiling.across() * tiling.words();
        let mut leaving = vec![0u64; OFFSETS * row_words];
        for (words, d_col) in leaving.chunks_mut(row_words).zip(-REACH_CELLS..) {
            for col in 0..cols {
                let to = col.checked_add_signed(d_col as isize);
                if to.is_none_or(|to| to >= cols) {
                    words[col / WORD] |= 1 << (col % WORD);
                }
            }
        }
        Ok(Self {
            occupied: Occupied::new(obstacles),
            tiling,
            runs: (0..parts).map(|_| OnceLock::new()).collect(),
            chords: Tiles::new(ACTIONS, tiling),
            turns: Tiles::new(DIRECTIONS, tiling),
            leaving,
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
        self.occupied.is_clear(&kernel, cell)
    }

    /// Whether the footprint is free on a cell's centre with the heading of a direction.
    pub(crate) fn state_is_free(&self, cell: Cell, direction: u8) -> bool {
        self.occupied
            .is_clear(&self.model.poses[usize::from(direction)], cell)
    }

    /// Of the 64 actions of a group, those which hit something from a cell or leave the map: bit `i`
    /// is for action `64 * group + i`.
    #[inline]
    pub(crate) fn blocked_chords(&self, group: usize, cell: (usize, usize)) -> u64 {
        self.chords.at(group, cell, |action, tile, bits| {
            self.fill_chord(action, tile, bits);
        })
    }

    /// Of the 64 turns of a group, those which hit something on a cell: bit `i` is for the turn from
    /// direction `64 * group + i` to the next one counter-clockwise.
    #[inline]
    pub(crate) fn blocked_turns(&self, group: usize, cell: (usize, usize)) -> u64 {
        self.turns.at(group, cell, |direction, tile, bits| {
            if let Some(kernel) = self.model.turns.get(direction) {
                self.dilate(kernel, tile, bits);
            }
        })
    }

    /// How the map is divided.
    pub(crate) const fn tiling(&self) -> &Tiling {
        &self.tiling
    }

    /// Sets the cells of a tile from which a kernel touches an occupied one. It must not reach farther
    /// than the model's motions.
    fn dilate(&self, kernel: &Kernel, tile: usize, reached: &mut [u64]) {
        let across = self.tiling.across();
        let (part_row, column) = (tile / across / PART_TILES, tile % across);
        let runs = self.runs[part_row * across + column].get_or_init(|| {
            let first_row = part_row * PART_TILES * TILE_ROWS;
            let part = Part {
                first_row,
                rows: (PART_TILES * TILE_ROWS).min(self.occupied.rows - first_row),
                first_word: column * self.tiling.words(),
                words: self.tiling.words(),
            };
            Runs::new(&self.occupied, part, self.model.reach_cells)
        });
        let ((first_row, _), _) = self.tiling.cells_of(tile);
        runs.dilate(kernel, first_row, reached);
    }

    /// The sectors in which straight drives may pass the cells of a tile, rows padded to
    /// [`Tiling::padded_cols`]: bit `i` is for headings from the shortest step `i` to the next one. More
    /// may be set than are free, never fewer.
    pub(crate) fn passable_sectors(&self, tile: usize, sectors: &mut Vec<u16>) {
        let parts = &self.model.corridors.parts;
        let (_, (rows, _)) = self.tiling.cells_of(tile);
        let words = rows * self.tiling.words();
        sectors.clear();
        sectors.resize(words * WORD, 0);
        let mut free = vec![0u64; words];
        let mut blocked = vec![0u64; words];
        for sector in 0..SECTORS {
            // A vehicle that no part is known of may pass anywhere.
            free.fill(if parts.is_empty() { u64::MAX } else { 0 });
            for (_, kernel) in parts.iter().filter(|(of, _)| *of == sector) {
                blocked.fill(0);
                self.dilate(kernel, tile, &mut blocked);
                for (free, blocked) in free.iter_mut().zip(&blocked) {
                    *free |= !blocked;
                }
            }
            for (word, cells) in free.iter().zip(sectors.as_chunks_mut::<WORD>().0) {
                for (bit, cell) in cells.iter_mut().enumerate() {
                    *cell |= u16::from(word >> bit & 1 != 0) << sector;
                }
            }
        }
    }

    /// The occupied cells: rows of whole words, column 0 in the least significant bit.
    pub(crate) fn occupied_words(&self) -> &[u64] {
        &self.occupied.words
    }

    /// In the same order, the cells from which a kernel touches an occupied one. It must not reach
    /// farther than the model's motions.
    pub(crate) fn dilated(&self, kernel: &Kernel) -> Vec<u64> {
        let row_words = self.occupied.row_words;
        let mut reached = vec![0u64; self.occupied.words.len()];
        for tile in 0..self.tiling.len() {
            let ((first_row, first_col), (rows, cols)) = self.tiling.cells_of(tile);
            let mut bits = vec![0u64; rows * self.tiling.words()];
            self.dilate(kernel, tile, &mut bits);
            let (first_word, words) = (first_col / WORD, cols.div_ceil(WORD));
            let to = reached[first_row * row_words..].chunks_mut(row_words);
            for (to, from) in to.zip(bits.chunks(self.tiling.words())) {
                to[first_word..][..words].copy_from_slice(&from[..words]);
            }
        }
        reached
    }

    fn fill_chord(&self, action: usize, tile: usize, bits: &mut [u64]) {
        let Some(kernel) = self.model.chords.get(action) else {
            return;
        };
        self.dilate(kernel, tile, bits);
        let action = &self.model.table.actions()[action];
        let words = self.tiling.words();
        let ((first_row, first_col), _) = self.tiling.cells_of(tile);
        let offset = usize::try_from(action.d_col + REACH_CELLS).unwrap_or(0);
        let leaving = offset * self.tiling.across() * words + first_col / WORD;
        let leaving = &self.leaving[leaving..][..words];
        for (row, bits) in bits.chunks_mut(words).enumerate() {
            let to = (first_row + row).checked_add_signed(action.d_row as isize);
            let stays = to.is_some_and(|to| to < self.spec.rows as usize);
            for (word, leaving) in bits.iter_mut().zip(leaving) {
                *word |= if stays { *leaving } else { u64::MAX };
            }
        }
    }
}

#[cfg(test)]
mod tests;
