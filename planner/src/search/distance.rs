//! A lower bound on the length of the way from the vehicle to every cell of a map.
//!
//! One Dijkstra search over cells in sixteen steps (straight, diagonal, knight's move). A step is
//! there if the vehicle, made narrower by half a cell to each side, could stand on both its ends with a
//! heading close to the step's: see `motion::corridors` for why every free chord is a sum of such
//! steps. A step counts a little less than its length, so that such a sum is never longer than its
//! chord: in units of 1/35 cell they count 34, 49 and 76 where their lengths are 35, 49.5 and 78.3.
//! Between straight and knight's move a chord (x, y) then counts 34 x + 8 y, between knight's move and
//! diagonal 27 x + 22 y, which by Cauchy is at most 34.93 and 34.83 times its length.

use crate::collision::CollisionMap;
use crate::motion::{COST_UNITS, SECTORS};

/// Counts of a straight step, a diagonal one and a knight's move.
const COUNTS: [u32; 3] = [34, 49, 76];
/// Counts of a cell's side.
const COUNTS_PER_CELL: f64 = 35.0;
/// A list for each count that a front can be away from its nearest cell.
const BUCKETS: usize = 128;
/// How often it is asked whether to stop, in counts of the front's distance.
const STOP_INTERVAL: u32 = 64;
/// Stands for no way.
pub(super) const NO_WAY: u32 = u32::MAX;
/// Cells around the map.
const BORDER: usize = 2;

/// Lower bounds on lengths from the vehicle.
#[derive(Debug, Default)]
pub(super) struct Distances {
    /// With a border: the sectors that a cell can be passed in.
    sectors: Vec<u16>,
    counts: Vec<u32>,
    buckets: Vec<Vec<u32>>,
    cols: usize,
    units_per_count: f64,
}

impl Distances {
    /// Measures all ways on a map. False if `stop` ended it.
    pub(super) fn measure(&mut self, map: &CollisionMap, stop: &dyn Fn() -> bool) -> bool {
        let spec = map.spec();
        let (rows, cols) = (spec.rows as usize, spec.cols as usize);
        self.cols = cols + 2 * BORDER;
        let len = (rows + 2 * BORDER) * self.cols;
        self.sectors.clear();
        self.sectors.resize(len, 0);
        if !map.passable_sectors(&mut self.sectors, BORDER, stop) {
            return false;
        }
        self.counts.clear();
        self.counts.resize(len, NO_WAY);
        self.buckets.resize_with(BUCKETS, Vec::new);
        self.buckets.iter_mut().for_each(Vec::clear);
        self.units_per_count = spec.resolution_m * COST_UNITS / COUNTS_PER_CELL;
        let (row, col) = (spec.ego_row as usize, spec.ego_col as usize);
        row >= rows
            || col >= cols
            || self.search(map, (row + BORDER) * self.cols + col + BORDER, stop)
    }

    #[expect(
        clippy::cast_possible_truncation,
        reason = "grids have at most 2^24 cells"
    )]
    fn search(&mut self, map: &CollisionMap, start: usize, stop: &dyn Fn() -> bool) -> bool {
        let mut steps = [(0isize, 0u32, 0u16); SECTORS];
        for (number, (to, &(d_row, d_col))) in steps
            .iter_mut()
            .zip(&map.model().corridors.steps)
            .enumerate()
        {
            let count = match d_row.abs() + d_col.abs() {
                1 => COUNTS[0],
                2 => COUNTS[1],
                _ => COUNTS[2],
            };
            let sides = 1 << number | 1 << ((number + SECTORS - 1) % SECTORS);
            *to = (
                d_row as isize * self.cols.cast_signed() + d_col as isize,
                count,
                sides,
            );
        }
        self.counts[start] = 0;
        // The vehicle stands here, whatever the sectors say.
        self.sectors[start] = u16::MAX;
        self.buckets[0].push(start as u32);
        let (mut now, mut waiting) = (0u32, 1usize);
        while waiting > 0 {
            let mut bucket = std::mem::take(&mut self.buckets[now as usize % BUCKETS]);
            waiting -= bucket.len();
            for &cell in &bucket {
                let cell = cell as usize;
                if self.counts[cell] != now {
                    continue;
                }
                let here = self.sectors[cell];
                for &(offset, count, sides) in &steps {
                    let next = cell.wrapping_add_signed(offset);
                    let count = now + count;
                    if self.sectors[next] & here & sides != 0 && count < self.counts[next] {
                        self.counts[next] = count;
                        self.buckets[count as usize % BUCKETS].push(next as u32);
                        waiting += 1;
                    }
                }
            }
            bucket.clear();
            self.buckets[now as usize % BUCKETS] = bucket;
            now += 1;
            if now.is_multiple_of(STOP_INTERVAL) && stop() {
                return false;
            }
        }
        true
    }

    /// Lower bound on the length of any way to a cell, in units; [`NO_WAY`] if there is none.
    #[inline]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a cast saturates"
    )]
    pub(super) fn to(&self, (row, col): (usize, usize)) -> u32 {
        let count = self.counts[(row + BORDER) * self.cols + col + BORDER];
        if count == NO_WAY {
            return NO_WAY;
        }
        (f64::from(count) * self.units_per_count) as u32
    }
}
