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

use std::ops::Range;

use super::goal::Goal;
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
/// The map is surveyed so far around the vehicle at first, in cells, and farther when the front gets there.
const FIRST_SURVEY: usize = 192;
/// After so many cells a front from the vehicle ends once all goals are behind it.
const ENOUGH: usize = 1 << 17;
/// After so many it ends wherever they are.
const MOST: usize = 1 << 18;
/// A goal that is not come to after so many times its distance is not waited for.
const MOST_DETOUR: f64 = 1.5;
/// Stands for no way.
pub(super) const NO_WAY: u32 = u32::MAX;
/// Cells around the map.
const BORDER: usize = 2;

/// Which headings each cell of a map can be passed in.
#[derive(Debug, Default)]
pub(crate) struct Passable {
    /// With a border, by cell: a bit for each sector; 0 where the map was not surveyed.
    sectors: Vec<u16>,
    /// Rows and columns with the border.
    size: (usize, usize),
    /// By tile of the map, and their numbers.
    is_surveyed: Vec<bool>,
    surveyed: Vec<usize>,
    of_tile: Vec<u16>,
}

impl Passable {
    /// Surveys all of a map. False if `stop` ended it.
    pub(crate) fn survey(&mut self, map: &CollisionMap, stop: &dyn Fn() -> bool) -> bool {
        let spec = map.spec();
        self.begin(map);
        self.survey_around(map, spec.rows.max(spec.cols) as usize, stop)
    }

    /// Whether this is of a map of the same size.
    fn is_for(&self, map: &CollisionMap) -> bool {
        self.size == size_of(map)
    }

    /// Forgets what was surveyed.
    fn begin(&mut self, map: &CollisionMap) {
        if self.is_for(map) {
            self.is_surveyed.fill(false);
        } else {
            self.size = size_of(map);
            // Pages that nothing is written to take no memory.
            self.sectors = vec![0; self.size.0 * self.size.1];
            self.is_surveyed = vec![false; map.tiling().len()];
        }
        self.surveyed.clear();
    }

    /// Surveys what was not yet of the tiles within so many cells of the vehicle, along both axes. False
    /// if `stop` ended it.
    fn survey_around(&mut self, map: &CollisionMap, reach: usize, stop: &dyn Fn() -> bool) -> bool {
        let (spec, tiling) = (map.spec(), map.tiling());
        let ego = (spec.ego_row as usize, spec.ego_col as usize);
        let first = tiling.tile_of((ego.0.saturating_sub(reach), ego.1.saturating_sub(reach)));
        let last = tiling.tile_of((
            (ego.0 + reach).min(spec.rows as usize - 1),
            (ego.1 + reach).min(spec.cols as usize - 1),
        ));
        let across = tiling.across();
        for row in first / across..=last / across {
            for tile in row * across + first % across..=row * across + last % across {
                if self.is_surveyed[tile] {
                    continue;
                }
                self.survey_tile(map, tile);
                if stop() {
                    return false;
                }
            }
        }
        true
    }

    fn survey_tile(&mut self, map: &CollisionMap, tile: usize) {
        map.passable_sectors(tile, &mut self.of_tile);
        let from = self.of_tile.chunks(map.tiling().padded_cols());
        for (cells, from) in cells_of_tile(map, tile).zip(from) {
            let count = cells.len();
            self.sectors[cells].copy_from_slice(&from[..count]);
        }
        self.is_surveyed[tile] = true;
        self.surveyed.push(tile);
    }
}

/// Rows and columns of a map with the border.
fn size_of(map: &CollisionMap) -> (usize, usize) {
    let (rows, cols) = (map.spec().rows as usize, map.spec().cols as usize);
    (rows + 2 * BORDER, cols + 2 * BORDER)
}

/// Where the rows of a tile lie in memory with a border.
fn cells_of_tile(map: &CollisionMap, tile: usize) -> impl Iterator<Item = Range<usize>> {
    let ((first_row, first_col), (rows, cols)) = map.tiling().cells_of(tile);
    let (_, across) = size_of(map);
    (first_row..first_row + rows).map(move |row| {
        let first = (row + BORDER) * across + first_col + BORDER;
        first..first + cols
    })
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
    /// From the vehicle: what was surveyed for it.
    passable: Passable,
    /// By cell, with a border: the complement of its count; so 0 where there is no way.
    nearness: Vec<u32>,
    /// Cells that do not count less than this count at least this; [`NO_WAY`] if all were come to.
    front: u32,
    /// Cells that are waiting, and those that were.
    waiting: usize,
    visited: usize,
    buckets: Vec<Vec<u32>>,
    /// Tiles with cells that may have been come to.
    touched: Vec<usize>,
    cols: usize,
    units_per_count: f64,
}

impl Distances {
    /// Measures the ways from the vehicle to all of a map, or of a large one as far as goals are. False if
    /// `stop` ended it.
    pub(super) fn measure(
        &mut self,
        map: &CollisionMap,
        goals: &[Option<Goal>],
        stop: &dyn Fn() -> bool,
    ) -> bool {
        let mut passable = std::mem::take(&mut self.passable);
        let is_done = self.measure_on(&mut passable, (map, goals), stop);
        self.touched.clone_from(&passable.surveyed);
        self.passable = passable;
        is_done
    }

    fn measure_on(
        &mut self,
        passable: &mut Passable,
        (map, goals): (&CollisionMap, &[Option<Goal>]),
        stop: &dyn Fn() -> bool,
    ) -> bool {
        passable.begin(map);
        self.begin(map, map.spec().index_of(map.spec().ego()).as_slice());
        let steps = self.steps(map, Front::Forward);
        let mut reach = FIRST_SURVEY;
        loop {
            // Rows and columns are at least a straight step apart.
            let end = u32::try_from(reach - BORDER).unwrap_or(u32::MAX / COUNTS[0]) * COUNTS[0];
            if !passable.survey_around(map, reach, stop)
                || !self.advance((&passable.sectors, &steps), end, stop)
            {
                return false;
            }
            if self.waiting == 0 {
                self.front = NO_WAY;
                return true;
            }
            let mut goals = goals.iter().flatten();
            if self.visited >= MOST
                || self.visited >= ENOUGH && goals.all(|goal| self.is_behind(map, goal))
            {
                return true;
            }
            reach += reach / 4;
        }
    }

    /// Measures on from the rim of an exact trunk: given by cell what a state of which the trunk's are not
    /// part of a way costs at least, in units, as far as another one on the same map was measured. What is
    /// then known of a cell bounds the cost of its states that are not in the trunk. False if `stop` ended it.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a cast saturates, and grids have at most 2^24 cells"
    )]
    pub(super) fn measure_beyond(
        &mut self,
        (map, from_vehicle): (&CollisionMap, &Self),
        rim: &mut [(u32, u32)],
        stop: &dyn Fn() -> bool,
    ) -> bool {
        self.begin(map, &[]);
        let passable = &from_vehicle.passable;
        self.touched.clone_from(&passable.surveyed);
        let on = (&passable.sectors[..], &self.steps(map, Front::Forward));
        // A way into what was not surveyed is longer than the front that ended there.
        let end = from_vehicle.front;
        for (count, _) in rim.iter_mut() {
            *count = (f64::from(*count) / self.units_per_count) as u32;
        }
        rim.sort_unstable();
        for &(count, cell) in rim.iter().take_while(|(count, _)| *count < end) {
            if !self.advance(on, count, stop) {
                return false;
            }
            self.front = count;
            let place = self.place(cell as usize);
            if !count > self.nearness[place] {
                self.nearness[place] = !count;
                self.buckets[count as usize % BUCKETS].push(place as u32);
                self.waiting += 1;
            }
        }
        let is_done = self.advance(on, end, stop);
        self.front = end;
        is_done
    }

    /// Measures all ways to any of the cells of a goal, given by row-major indices, on a map that was
    /// surveyed. False if `stop` ended it.
    pub(crate) fn measure_to(
        &mut self,
        (map, passable): (&CollisionMap, &Passable),
        goal: &[usize],
        stop: &dyn Fn() -> bool,
    ) -> bool {
        self.begin(map, goal);
        self.touched.clone_from(&passable.surveyed);
        let steps = self.steps(map, Front::Backward);
        let is_done = self.advance((&passable.sectors, &steps), u32::MAX, stop);
        self.front = NO_WAY;
        is_done
    }

    /// Whether the front has passed a goal, or might have, had it gone straight there, long ago.
    fn is_behind(&self, map: &CollisionMap, goal: &Goal) -> bool {
        let was_passed = |&cell: &usize| self.count(self.place(cell)) < self.front;
        let pose = goal.pose();
        let straight = libm::hypot(pose.x_m, pose.y_m) / map.spec().resolution_m * COUNTS_PER_CELL;
        goal.cells().iter().any(was_passed) || MOST_DETOUR * straight < f64::from(self.front)
    }

    /// Begins at cells, and knows no counts but theirs.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "grids have at most 2^24 cells"
    )]
    fn begin(&mut self, map: &CollisionMap, starts: &[usize]) {
        let (rows, cols) = size_of(map);
        if self.cols == cols && self.nearness.len() == rows * cols {
            for tile in self.touched.drain(..) {
                for cells in cells_of_tile(map, tile) {
                    self.nearness[cells].fill(0);
                }
            }
        } else {
            self.cols = cols;
            // Pages that nothing is written to take no memory.
            self.nearness = vec![0; rows * cols];
            self.touched.clear();
        }
        self.buckets.resize_with(BUCKETS, Vec::new);
        self.buckets.iter_mut().for_each(Vec::clear);
        self.units_per_count = map.spec().resolution_m * COST_UNITS / COUNTS_PER_CELL;
        self.front = 0;
        self.visited = 0;
        self.waiting = starts.len();
        for &start in starts {
            let start = self.place(start);
            self.nearness[start] = !0;
            self.buckets[0].push(start as u32);
        }
    }

    /// Where a cell of a row-major index is kept.
    fn place(&self, cell: usize) -> usize {
        let cols = self.cols - 2 * BORDER;
        (cell / cols + BORDER) * self.cols + cell % cols + BORDER
    }

    fn count(&self, place: usize) -> u32 {
        !self.nearness[place]
    }

    /// The steps from a cell: how much farther in memory, what they count, and in which sectors.
    fn steps(&self, map: &CollisionMap, front: Front) -> [(isize, u32, u16); SECTORS] {
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
        steps
    }

    /// Moves the front on to a count, as far as there is anything. False if `stop` ended it.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "grids have at most 2^24 cells"
    )]
    fn advance(
        &mut self,
        (sectors, steps): (&[u16], &[(isize, u32, u16); SECTORS]),
        end: u32,
        stop: &dyn Fn() -> bool,
    ) -> bool {
        while self.waiting > 0 && self.front < end {
            let now = self.front;
            let mut bucket = std::mem::take(&mut self.buckets[now as usize % BUCKETS]);
            self.waiting -= bucket.len();
            self.visited += bucket.len();
            for &cell in &bucket {
                let cell = cell as usize;
                if self.nearness[cell] != !now {
                    continue;
                }
                // Where a way begins the vehicle may stand, whatever the sectors say.
                let here = if now == 0 { u16::MAX } else { sectors[cell] };
                for &(offset, count, sides) in steps {
                    let next = cell.wrapping_add_signed(offset);
                    let count = now + count;
                    if sectors[next] & here & sides != 0 && !count > self.nearness[next] {
                        self.nearness[next] = !count;
                        self.buckets[count as usize % BUCKETS].push(next as u32);
                        self.waiting += 1;
                    }
                }
            }
            bucket.clear();
            self.buckets[now as usize % BUCKETS] = bucket;
            self.front += 1;
            if self.front.is_multiple_of(STOP_INTERVAL) && stop() {
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
        let place = (row + BORDER) * self.cols + col + BORDER;
        let count = self.count(place).min(self.front);
        if count == NO_WAY {
            return NO_WAY;
        }
        (f64::from(count) * self.units_per_count) as u32
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use swath_bridge::{Cell, GridSpec, Pose2, Vehicle};

    use super::*;
    use crate::{MotionModel, Plane};

    fn map_with_walls() -> CollisionMap {
        let spec = GridSpec {
            rows: 600,
            cols: 600,
            ego_row: 500,
            ego_col: 300,
            ..GridSpec::default()
        };
        let mut obstacles = Plane::empty(spec.rows, spec.cols);
        for at in 0..400 {
            obstacles.set(Cell::new(400, at));
            obstacles.set(Cell::new(250, 599 - at));
        }
        let model = Arc::new(MotionModel::new(&Vehicle::default(), spec.resolution_m).unwrap());
        CollisionMap::new(model, spec, &obstacles).unwrap()
    }

    /// Measured without looking at goals.
    fn measured_all(map: &CollisionMap) -> Distances {
        let mut passable = Passable::default();
        assert!(passable.survey(map, &|| false));
        let mut distances = Distances::default();
        distances.begin(map, map.spec().index_of(map.spec().ego()).as_slice());
        let steps = distances.steps(map, Front::Forward);
        assert!(distances.advance((&passable.sectors, &steps), u32::MAX, &|| false));
        distances.front = NO_WAY;
        distances
    }

    #[test]
    fn what_ends_early_on_a_large_map_knows_the_same_or_less() {
        let map = map_with_walls();
        let all = measured_all(&map);
        let mut near = Distances::default();
        // Again and again in memory that was used.
        for (goal, least_known) in [
            (Pose2::new(10.0, 0.0, 0.0), 60_000),
            (Pose2::new(90.0, 50.0, 0.0), 200_000),
            (Pose2::new(10.0, 0.0, 0.0), 60_000),
        ] {
            let goal = Goal::new(&map, &goal).ok();
            assert!(goal.is_some());
            assert!(near.measure(&map, &[goal], &|| false));
            assert!(near.front != NO_WAY);
            let mut known = 0;
            for cell in (0..600).flat_map(|row| (0..600).map(move |col| (row, col))) {
                assert!(near.to(cell) <= all.to(cell));
                known += usize::from(near.to(cell) == all.to(cell));
            }
            assert!(known > least_known, "{known}");
        }
    }

    #[test]
    fn beyond_a_rim_nothing_is_nearer_than_the_rim_and_the_way_from_there() {
        let map = map_with_walls();
        let mut all = measured_all(&map);
        assert!(all.passable.survey(&map, &|| false));
        // A ring of cells around the vehicle that cost more than their distance.
        let rim_of = |extra_m: f64| {
            // So wide that no step leads over it.
            let rows = [455, 456, 544, 545].into_iter();
            let ring = rows.flat_map(|row| (255..=345).map(move |col| (row, col)));
            let cols = [255, 256, 344, 345].into_iter();
            let ring = ring.chain(cols.flat_map(|col| (455..=545).map(move |row| (row, col))));
            let cell = |(row, col): (u32, u32)| {
                let units = all.to((row as usize, col as usize));
                (units != NO_WAY).then(|| {
                    let cost = f64::from(units) + extra_m * COST_UNITS;
                    (
                        super::super::floor_units(cost / COST_UNITS),
                        row * 600 + col,
                    )
                })
            };
            ring.filter_map(cell).collect::<Vec<_>>()
        };
        let mut near = Distances::default();
        let goal = Goal::new(&map, &Pose2::new(10.0, 0.0, 0.0)).ok();
        assert!(near.measure(&map, &[goal], &|| false));
        let (mut beyond, mut beyond_near) = (Distances::default(), Distances::default());
        for extra_m in [0.0, 3.0] {
            let mut rim = rim_of(extra_m);
            assert!(rim.len() > 200);
            assert!(beyond.measure_beyond((&map, &all), &mut rim, &|| false));
            let mut rim = rim_of(extra_m);
            assert!(beyond_near.measure_beyond((&map, &near), &mut rim, &|| false));
            let mut known = 0;
            for cell in (0..600).flat_map(|row| (0..600).map(move |col| (row, col))) {
                let (from_all, from_near) = (beyond.to(cell), beyond_near.to(cell));
                assert!(from_near <= from_all);
                known += usize::from(from_near == from_all);
                // Beyond the ring the way leads through it.
                let is_inside = (455..=545).contains(&cell.0) && (255..=345).contains(&cell.1);
                if !is_inside && from_all != NO_WAY {
                    let least = f64::from(all.to(cell)) + extra_m * COST_UNITS;
                    // Each count of a rim is rounded down.
                    let off = (f64::from(from_all) - least) / COST_UNITS;
                    assert!((-0.01..0.01).contains(&off), "{cell:?} {off}");
                }
            }
            assert!(known > 60_000, "{known}");
        }
    }
}
