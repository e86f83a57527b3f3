//! Shortest ways around obstacles for a disc as wide as the vehicle, from the vehicle to everywhere.
//!
//! One Dijkstra search a map answers for all goals on which side of an obstacle the way leads, and
//! which gaps are too narrow. A disc turns on the spot, which a car cannot, so a way is a hint, not a
//! path: it lies on coarse cells, and only where it begins does it know of the turning circles.

use swath_bridge::{Cell, GridSpec, Pose2};

use crate::Plane;

/// Side of the cells that ways lie on, metres; a multiple of the grid's cells of about this size.
const SIDE_M: f64 = 0.4;
/// Cells around the map that nothing enters, so that no move needs to look where the map ends.
const BORDER: usize = 2;
/// Costs of moves in units of 0.2 of a cell's side: straight, diagonal, and the knight's.
const COSTS: [u16; 3] = [5, 7, 11];
/// One list for every cost that a search's front can be away from its nearest cell.
const BUCKETS: usize = COSTS[2] as usize + 1;
const UNREACHED: u16 = u16::MAX;
/// Cells around that of a goal in which a way may end instead.
const NEAR_GOAL_CELLS: isize = 2;
/// Cells that a disc reaches to a side, at most: with more it would reach around the map's edge.
const MAX_REACH_CELLS: isize = 2 * BORDER.cast_signed();
/// Depth of the wall behind the vehicle, which cannot drive backwards, metres.
const WALL_M: f64 = 1.2;

/// What a disc's ways depend on beside the obstacles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Disc {
    /// Half of the vehicle's width, metres.
    pub(super) radius_m: f64,
    /// Tightest circle of the vehicle, metres.
    pub(super) turning_radius_m: f64,
}

/// The ways over one map, in memory that is reused from map to map.
#[derive(Debug, Default)]
pub(super) struct DiscWays {
    cells: Cells,
    blocked: Vec<bool>,
    cost: Vec<u16>,
    /// The move by which a cell is reached at that cost.
    via: Vec<u8>,
    buckets: [Vec<u32>; BUCKETS],
}

/// Where the coarse cells lie.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Cells {
    /// Cells of the grid along a side.
    shrink: usize,
    /// With borders.
    rows: usize,
    cols: usize,
    side_m: f64,
    /// Centre of the first cell within the borders, metres.
    first: (f64, f64),
}

/// A step to another cell.
#[derive(Debug, Clone, Copy)]
struct Move {
    rows: isize,
    cols: isize,
    cost: u16,
}

const fn moves() -> [Move; 16] {
    let mut moves = [Move {
        rows: 0,
        cols: 0,
        cost: 0,
    }; 16];
    let (mut count, mut rows) = (0, -2_isize);
    while rows <= 2 {
        let mut cols = -2_isize;
        while cols <= 2 {
            let cost = match (rows.unsigned_abs(), cols.unsigned_abs()) {
                (0, 1) | (1, 0) => COSTS[0],
                (1, 1) => COSTS[1],
                (1, 2) | (2, 1) => COSTS[2],
                _ => 0,
            };
            if cost > 0 {
                moves[count] = Move { rows, cols, cost };
                count += 1;
            }
            cols += 1;
        }
        rows += 1;
    }
    moves
}

const MOVES: [Move; 16] = moves();

impl Cells {
    fn of(spec: &GridSpec) -> Self {
        let mut shrink = 1;
        while (shrink + 1) as f64 * spec.resolution_m <= SIDE_M * (1.0 + 1e-9) {
            shrink += 1;
        }
        let side_m = shrink as f64 * spec.resolution_m;
        let inset_m = 0.5 * (side_m - spec.resolution_m);
        let (x_m, y_m) = spec.centre_of(Cell::new(0, 0));
        Self {
            shrink,
            rows: (spec.rows as usize).div_ceil(shrink) + 2 * BORDER,
            cols: (spec.cols as usize).div_ceil(shrink) + 2 * BORDER,
            side_m,
            first: (x_m - inset_m, y_m - inset_m),
        }
    }

    const fn len(&self) -> usize {
        self.rows * self.cols
    }

    const fn offset(&self, rows: isize, cols: isize) -> isize {
        rows * self.cols.cast_signed() + cols
    }

    const fn is_inside(&self, row: usize, col: usize) -> bool {
        row >= BORDER && col >= BORDER && row < self.rows - BORDER && col < self.cols - BORDER
    }

    fn centre(&self, index: usize) -> (f64, f64) {
        let (row, col) = (index / self.cols, index % self.cols);
        (
            self.first.0 - (row as f64 - BORDER as f64) * self.side_m,
            self.first.1 - (col as f64 - BORDER as f64) * self.side_m,
        )
    }

    /// The cell of a place within the borders.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "bounds are checked first"
    )]
    fn at(&self, x_m: f64, y_m: f64) -> Option<usize> {
        let row = libm::round((self.first.0 - x_m) / self.side_m) + BORDER as f64;
        let col = libm::round((self.first.1 - y_m) / self.side_m) + BORDER as f64;
        let is_index = |value: f64, end: usize| value >= 0.0 && value < end as f64;
        if !is_index(row, self.rows) || !is_index(col, self.cols) {
            return None;
        }
        let (row, col) = (row as usize, col as usize);
        self.is_inside(row, col).then_some(row * self.cols + col)
    }
}

impl DiscWays {
    /// Finds the ways from the vehicle over a map of the grid `spec`.
    pub(super) fn survey(&mut self, obstacles: &Plane, spec: &GridSpec, disc: Disc) {
        self.cells = Cells::of(spec);
        self.block(obstacles, disc);
        self.cost.clear();
        self.cost.resize(self.cells.len(), UNREACHED);
        self.via.resize(self.cells.len(), 0);
        if let Some(start) = self.cells.at(0.0, 0.0) {
            self.search(start);
        }
    }

    /// Marks what the disc's centre cannot enter.
    fn block(&mut self, obstacles: &Plane, disc: Disc) {
        let cells = self.cells;
        self.blocked.clear();
        self.blocked.resize(cells.len(), false);
        let reach = (disc.radius_m - 0.5 * cells.side_m).max(0.0) / cells.side_m;
        let around = around(&cells, reach);
        let cols = obstacles.cols() as usize;
        obstacles.each_set(|cell| {
            let row = cell / cols / cells.shrink + BORDER;
            let col = cell % cols / cells.shrink + BORDER;
            self.blocked[row * cells.cols + col] = true;
        });
        self.grow(&around);
        for row in 0..cells.rows {
            for col in 0..cells.cols {
                if !cells.is_inside(row, col) {
                    self.blocked[row * cells.cols + col] = true;
                }
            }
        }
        self.block_turning(disc.turning_radius_m);
    }

    /// Adds what lies around each blocked cell.
    fn grow(&mut self, around: &[isize]) {
        let cells: Vec<usize> = (0..self.blocked.len())
            .filter(|&index| self.blocked[index])
            .collect();
        for index in cells {
            for &offset in around {
                if let Some(blocked) = index
                    .checked_add_signed(offset)
                    .and_then(|index| self.blocked.get_mut(index))
                {
                    *blocked = true;
                }
            }
        }
    }

    /// Closes the circles beside the vehicle that it cannot turn into, and what lies behind it.
    fn block_turning(&mut self, radius_m: f64) {
        let inner_m = radius_m - self.cells.side_m;
        for index in 0..self.cells.len() {
            let (x_m, y_m) = self.cells.centre(index);
            let is_beside = x_m.abs() < radius_m && y_m.abs() < 2.0 * radius_m;
            if !is_beside {
                continue;
            }
            let in_circle = libm::hypot(x_m, y_m.abs() - radius_m) < inner_m;
            let behind = x_m < -0.5 * self.cells.side_m && x_m > -WALL_M && y_m.abs() <= radius_m;
            self.blocked[index] |= in_circle || behind;
        }
    }

    #[expect(
        clippy::cast_possible_truncation,
        reason = "a grid has fewer cells than four billion, and there are 16 moves"
    )]
    fn search(&mut self, start: usize) {
        let offsets = MOVES.map(|step| self.cells.offset(step.rows, step.cols));
        for bucket in &mut self.buckets {
            bucket.clear();
        }
        self.blocked[start] = false;
        self.cost[start] = 0;
        self.buckets[0].push(start as u32);
        let (mut now, mut waiting) = (0_u16, 1);
        while waiting > 0 {
            let mut bucket = std::mem::take(&mut self.buckets[usize::from(now) % BUCKETS]);
            waiting -= bucket.len();
            for &index in &bucket {
                let index = index as usize;
                if self.cost[index] != now {
                    continue;
                }
                for (via, step) in MOVES.iter().enumerate() {
                    let next = index.wrapping_add_signed(offsets[via]);
                    let cost = now.saturating_add(step.cost);
                    if self.blocked[next] || cost >= self.cost[next] || self.is_cut(index, step) {
                        continue;
                    }
                    self.cost[next] = cost;
                    self.via[next] = via as u8;
                    self.buckets[usize::from(cost) % BUCKETS].push(next as u32);
                    waiting += 1;
                }
            }
            bucket.clear();
            self.buckets[usize::from(now) % BUCKETS] = bucket;
            if now == UNREACHED - 1 {
                break;
            }
            now += 1;
        }
    }

    /// Whether one of the two cells that a knight's move passes between is blocked.
    fn is_cut(&self, index: usize, step: &Move) -> bool {
        if step.cost != COSTS[2] {
            return false;
        }
        let near = self.cells.offset(step.rows / 2, step.cols / 2);
        let far = self.cells.offset(step.rows, step.cols) - near;
        self.blocked[index.wrapping_add_signed(near)]
            || self.blocked[index.wrapping_add_signed(far)]
    }

    /// The way to a goal, pulled taut: its corners from the vehicle on, metres. `None` if a disc does
    /// not get there.
    pub(super) fn to(&self, goal: &Pose2) -> Option<Vec<(f64, f64)>> {
        let end = self.reached_near(goal)?;
        let mut chain = vec![end];
        let mut index = end;
        while self.cost[index] > 0 {
            let step = MOVES[usize::from(self.via[index])];
            index = index.wrapping_add_signed(-self.cells.offset(step.rows, step.cols));
            chain.push(index);
        }
        chain.reverse();
        let mut corners = vec![(0.0, 0.0)];
        let (mut anchor, mut next) = (0, 1);
        while next < chain.len() {
            if next > anchor + 1 && !self.is_clear(chain[anchor], chain[next]) {
                anchor = next - 1;
                corners.push(self.cells.centre(chain[anchor]));
            }
            next += 1;
        }
        corners.push((goal.x_m, goal.y_m));
        Some(corners)
    }

    /// The cell of a goal, or the cheapest one close to it if the disc does not get there.
    fn reached_near(&self, goal: &Pose2) -> Option<usize> {
        let at = self.cells.at(goal.x_m, goal.y_m)?;
        if self.cost[at] != UNREACHED {
            return Some(at);
        }
        let near = -NEAR_GOAL_CELLS..=NEAR_GOAL_CELLS;
        near.clone()
            .flat_map(|rows| near.clone().map(move |cols| (rows, cols)))
            .map(|(rows, cols)| at.wrapping_add_signed(self.cells.offset(rows, cols)))
            .filter(|&index| self.cost[index] != UNREACHED)
            .min_by_key(|&index| self.cost[index])
    }

    /// Whether the straight line between two cells meets nothing blocked.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "what lies between two cells of the grid is a cell of the grid"
    )]
    fn is_clear(&self, from: usize, to: usize) -> bool {
        let cols = self.cells.cols;
        let (row, col) = ((from / cols) as f64, (from % cols) as f64);
        let (rows, cols_along) = ((to / cols) as f64 - row, (to % cols) as f64 - col);
        let steps = rows.abs().max(cols_along.abs()).max(1.0);
        (1..steps as usize).all(|step| {
            let share = step as f64 / steps;
            let (row, col) = (row + rows * share + 0.5, col + cols_along * share + 0.5);
            !self.blocked[row as usize * cols + col as usize]
        })
    }
}

/// Offsets of the cells whose centres are within so many sides.
fn around(cells: &Cells, reach: f64) -> Vec<isize> {
    let is_near = |rows: isize, cols: isize| {
        let distance = libm::hypot(rows as f64, cols as f64);
        distance <= reach + 1e-9
    };
    let most = (0..=MAX_REACH_CELLS).take_while(|&rows| is_near(rows, 0));
    let most = most.last().unwrap_or(0);
    let offsets = (-most..=most).flat_map(|rows| (-most..=most).map(move |cols| (rows, cols)));
    offsets
        .filter(|&(rows, cols)| is_near(rows, cols))
        .map(|(rows, cols)| cells.offset(rows, cols))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SPEC: GridSpec = GridSpec {
        rows: 401,
        cols: 151,
        resolution_m: 0.2,
        ego_row: 300,
        ego_col: 75,
    };
    const DISC: Disc = Disc {
        radius_m: 0.885,
        turning_radius_m: 5.5,
    };

    /// The ways among walls across the map at `x_m`, each from one `y_m` to another.
    fn among(walls: &[(f64, f64, f64)]) -> DiscWays {
        let mut obstacles = Plane::empty(SPEC.rows, SPEC.cols);
        for &(x_m, from_m, to_m) in walls {
            let ends = [Pose2::new(x_m, from_m, 0.0), Pose2::new(x_m, to_m, 0.0)];
            obstacles.draw_line(&SPEC, &ends, 0.2);
        }
        let mut ways = DiscWays::default();
        ways.survey(&obstacles, &SPEC, DISC);
        ways
    }

    fn length_m(corners: &[(f64, f64)]) -> f64 {
        let pairs = corners.windows(2);
        pairs
            .map(|pair| libm::hypot(pair[1].0 - pair[0].0, pair[1].1 - pair[0].1))
            .sum()
    }

    #[test]
    fn in_the_open_a_way_is_straight() {
        let ways = among(&[]);
        let corners = ways.to(&Pose2::new(40.0, 3.0, 0.0)).unwrap();
        assert!(length_m(&corners) < 1.01 * libm::hypot(40.0, 3.0));
        assert!(corners.len() <= 3, "{corners:?}");
    }

    #[test]
    fn a_way_takes_the_gap_that_the_vehicle_fits_through() {
        // To the left a gap of 1.2 m, to the right one of 3 m and farther off.
        let ways = among(&[(20.0, 15.0, 2.0), (20.0, 0.4, -8.0), (20.0, -11.4, -15.0)]);
        let corners = ways.to(&Pose2::new(40.0, 0.0, 0.0)).unwrap();
        let least = corners.iter().map(|corner| corner.1).fold(0.0, f64::min);
        assert!(least < -8.5, "{corners:?}");
        let walled = among(&[(20.0, 15.2, -15.2)]);
        assert_eq!(walled.to(&Pose2::new(40.0, 0.0, 0.0)), None);
        assert!(walled.to(&Pose2::new(15.0, 0.0, 0.0)).is_some());
    }

    #[test]
    fn nothing_is_reached_backwards_or_within_the_turning_circle() {
        let ways = among(&[]);
        assert_eq!(ways.to(&Pose2::new(1.0, 4.0, 0.0)), None);
        let behind = ways.to(&Pose2::new(-12.0, 0.0, 0.0)).unwrap();
        assert!(length_m(&behind) > 20.0, "{behind:?}");
    }

    #[test]
    fn goals_off_the_map_and_maps_of_any_size_are_no_surprise() {
        let mut ways = DiscWays::default();
        assert_eq!(ways.to(&Pose2::new(1.0, 0.0, 0.0)), None);
        for (rows, cols, resolution_m) in [(1, 1, 0.2), (3, 40, 0.7), (40, 3, 0.05)] {
            let spec = GridSpec {
                rows,
                cols,
                resolution_m,
                ego_row: 5,
                ego_col: 1,
            };
            ways.survey(&Plane::empty(rows, cols), &spec, DISC);
            for x_m in [-1e9, -1.0, 0.0, 1.0, f64::NAN] {
                ways.to(&Pose2::new(x_m, 0.1, 0.0));
            }
        }
    }
}
