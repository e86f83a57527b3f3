//! Which motions hit an obstacle, for every cell at once.
//!
//! For each action of the lookup table and each turn between neighbouring directions, a bit says of
//! every cell whether the motion from there would touch an occupied one or leave the map. The bits of
//! 64 motions that are neighbours in heading lie together, cell by cell. They are computed for 64 rows
//! at a time when they are first asked for: the obstacles are dilated with each motion's swept cells,
//! many words at a time, and the result is transposed.

mod runs;
mod tiles;

use std::sync::Arc;

use swath_bridge::{Cell, GridSpec, Pose2};

use crate::action::{ACTIONS, DIRECTIONS, REACH_CELLS};
use crate::kernel::Kernel;
use crate::motion::{MotionModel, SECTORS};
use crate::{Error, Plane};

use runs::Runs;
use tiles::Tiles;

/// Bits a word, and motions a group.
pub(crate) const WORD: usize = u64::BITS as usize;
/// Column offsets of the lookup table.
const OFFSETS: usize = 2 * REACH_CELLS as usize + 1;

/// Answers for one obstacle map whether a motion of one vehicle is free.
#[derive(Debug)]
pub struct CollisionMap {
    model: Arc<MotionModel>,
    spec: GridSpec,
    runs: Runs,
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
        let runs = Runs::new(obstacles, model.reach_cells);
        let (rows, cols) = (spec.rows as usize, spec.cols as usize);
        let row_words = runs.row_words();
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
            runs,
            chords: Tiles::new(ACTIONS, rows, row_words),
            turns: Tiles::new(DIRECTIONS, rows, row_words),
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
        self.runs.is_clear(&kernel, cell)
    }

    /// Whether the footprint is free on a cell's centre with the heading of a direction.
    pub(crate) fn state_is_free(&self, cell: Cell, direction: u8) -> bool {
        self.runs
            .is_clear(&self.model.poses[usize::from(direction)], cell)
    }

    /// Of the 64 actions of a group, those which hit something from a cell or leave the map: bit `i`
    /// is for action `64 * group + i`.
    #[inline]
    pub(crate) fn blocked_chords(&self, group: usize, cell: (usize, usize)) -> u64 {
        self.chords.at(group, cell, |action, first_row, bits| {
            self.fill_chord(action, first_row, bits);
        })
    }

    /// Of the 64 turns of a group, those which hit something on a cell: bit `i` is for the turn from
    /// direction `64 * group + i` to the next one counter-clockwise.
    #[inline]
    pub(crate) fn blocked_turns(&self, group: usize, cell: (usize, usize)) -> u64 {
        self.turns.at(group, cell, |direction, first_row, bits| {
            if let Some(kernel) = self.model.turns.get(direction) {
                self.runs.dilate(kernel, first_row, bits);
            }
        })
    }

    /// Sets for each cell, with a border around the map, the sectors in which straight drives may pass:
    /// bit `i` is for headings from the shortest step `i` to the next one. More may be set than are
    /// free, never fewer. False if `stop` ended it.
    pub(crate) fn passable_sectors(
        &self,
        sectors: &mut [u16],
        border: usize,
        stop: &dyn Fn() -> bool,
    ) -> bool {
        let cols = self.spec.cols as usize;
        let row_words = self.runs.row_words();
        let parts = &self.model.corridors.parts;
        let mut free = vec![0u64; self.spec.rows as usize * row_words];
        let mut blocked = free.clone();
        for sector in 0..SECTORS {
            // A vehicle that no part is known of may pass anywhere.
            free.fill(if parts.is_empty() { u64::MAX } else { 0 });
            for (_, kernel) in parts.iter().filter(|(of, _)| *of == sector) {
                blocked.fill(0);
                self.runs.dilate(kernel, 0, &mut blocked);
                for (free, blocked) in free.iter_mut().zip(&blocked) {
                    *free |= !blocked;
                }
                if stop() {
                    return false;
                }
            }
            let rows = free
                .chunks(row_words)
                .zip(sectors.chunks_mut(cols + 2 * border).skip(border));
            for (free, of_row) in rows {
                for (word, cells) in free.iter().zip(of_row[border..][..cols].chunks_mut(WORD)) {
                    for (bit, cell) in cells.iter_mut().enumerate() {
                        *cell |= u16::from(word >> bit & 1 != 0) << sector;
                    }
                }
            }
        }
        true
    }

    /// The occupied cells: rows of whole words, column 0 in the least significant bit.
    pub(crate) fn occupied_words(&self) -> Vec<u64> {
        self.runs.occupied_words()
    }

    /// In the same order, the cells from which a kernel touches an occupied one. It must not reach
    /// farther than the model's motions.
    pub(crate) fn dilated(&self, kernel: &Kernel) -> Vec<u64> {
        let mut reached = vec![0u64; self.spec.rows as usize * self.runs.row_words()];
        self.runs.dilate(kernel, 0, &mut reached);
        reached
    }

    fn fill_chord(&self, action: usize, first_row: usize, bits: &mut [u64]) {
        let Some(kernel) = self.model.chords.get(action) else {
            return;
        };
        self.runs.dilate(kernel, first_row, bits);
        let action = &self.model.table.actions()[action];
        let row_words = self.runs.row_words();
        let offset = usize::try_from(action.d_col + REACH_CELLS).unwrap_or(0);
        let leaving = &self.leaving[offset * row_words..][..row_words];
        for (row, words) in bits.chunks_mut(row_words).enumerate() {
            let to = (first_row + row).checked_add_signed(action.d_row as isize);
            let stays = to.is_some_and(|to| to < self.spec.rows as usize);
            for (word, leaving) in words.iter_mut().zip(leaving) {
                *word |= if stays { *leaving } else { u64::MAX };
            }
        }
    }
}

#[cfg(test)]
mod tests;
