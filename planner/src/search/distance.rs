//! A lower bound on the length of the way from the vehicle to every cell of a map, or from every cell
//! to a goal.
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

/// Which headings each cell of a map can be passed in.
#[derive(Debug, Default)]
pub(crate) struct Passable {
    /// With a border, by cell: a bit for each sector.
    sectors: Vec<u16>,
}

impl Passable {
    /// Surveys a map. False if `stop` ended it.
    pub(crate) fn survey(&mut self, map: &CollisionMap, stop: &dyn Fn() -> bool) -> bool {
        let (rows, cols) = (map.spec().rows as usize, map.spec().cols as usize);
        self.sectors.clear();
        self.sectors
            .resize((rows + 2 * BORDER) * (cols + 2 * BORDER), 0);
        map.passable_sectors(&mut self.sectors, BORDER, stop)
    }
}

/// Which way a front of distances moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Front {
    /// From the vehicle, as it would drive.
    Forward,
    /// From a goal, against the driving direction.
    Backward,
}

/// Lower bounds on lengths from the vehicle, or to a goal.
#[derive(Debug, Default)]
pub(crate) struct Distances {
    passable: Passable,
    counts: Vec<u32>,
    buckets: Vec<Vec<u32>>,
    cols: usize,
    units_per_count: f64,
}

impl Distances {
    /// Measures all ways on a map. False if `stop` ended it.
    pub(super) fn measure(&mut self, map: &CollisionMap, stop: &dyn Fn() -> bool) -> bool {
        let mut passable = std::mem::take(&mut self.passable);
        let ego = map.spec().index_of(map.spec().ego());
        let is_done = passable.survey(map, stop)
            && self.search((map, &passable), ego.as_slice(), Front::Forward, stop);
        self.passable = passable;
        is_done
    }

    /// Measures all ways to any of the cells of a goal, given by row-major indices. False if `stop`
    /// ended it.
    pub(crate) fn measure_to(
        &mut self,
        on: (&CollisionMap, &Passable),
        goal: &[usize],
        stop: &dyn Fn() -> bool,
    ) -> bool {
        self.search(on, goal, Front::Backward, stop)
    }

    #[expect(
        clippy::cast_possible_truncation,
        reason = "grids have at most 2^24 cells"
    )]
    fn search(
        &mut self,
        (map, passable): (&CollisionMap, &Passable),
        starts: &[usize],
        front: Front,
        stop: &dyn Fn() -> bool,
    ) -> bool {
        let (spec, sectors) = (map.spec(), &passable.sectors);
        let cols = spec.cols as usize;
        self.cols = cols + 2 * BORDER;
        self.counts.clear();
        self.counts.resize(sectors.len(), NO_WAY);
        self.buckets.resize_with(BUCKETS, Vec::new);
        self.buckets.iter_mut().for_each(Vec::clear);
        self.units_per_count = spec.resolution_m * COST_UNITS / COUNTS_PER_CELL;
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
            let ahead = d_row as isize * self.cols.cast_signed() + d_col as isize;
            let offset = match front {
                Front::Forward => ahead,
                Front::Backward => -ahead,
            };
            *to = (offset, count, sides);
        }
        for start in starts {
            let start = (start / cols + BORDER) * self.cols + start % cols + BORDER;
            self.counts[start] = 0;
            self.buckets[0].push(start as u32);
        }
        let (mut now, mut waiting) = (0u32, starts.len());
        while waiting > 0 {
            let mut bucket = std::mem::take(&mut self.buckets[now as usize % BUCKETS]);
            waiting -= bucket.len();
            for &cell in &bucket {
                let cell = cell as usize;
                if self.counts[cell] != now {
                    continue;
                }
                // Where a way begins the vehicle may stand, whatever the sectors say.
                let here = if now == 0 { u16::MAX } else { sectors[cell] };
                for &(offset, count, sides) in &steps {
                    let next = cell.wrapping_add_signed(offset);
                    let count = now + count;
                    if sectors[next] & here & sides != 0 && count < self.counts[next] {
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

    /// Lower bound on the length of any way between a cell and where it was measured from, in metres,
    /// if there is one.
    pub(crate) fn metres(&self, cell: (usize, usize)) -> Option<f64> {
        let units = self.to(cell);
        (units != NO_WAY).then(|| f64::from(units) / COST_UNITS)
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
