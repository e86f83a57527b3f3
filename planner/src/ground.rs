//! Where a vehicle that drives arcs may go on one map: contact without gaps, and what it certainly cannot
//! reach.

use swath_bridge::{Outcome, Pose2, Vehicle};

use crate::collision::{CollisionMap, WORD};
use crate::kernel::Kernel;
use crate::search::{Distances, Goal, Passable};
use crate::segment::Segment;
use crate::smooth::{Footprint, LEAST_GAP_M, ObstacleCells, State, contact_gap_m};
use crate::tolerance::Target;

/// Longest piece of a segment for which nearby cells are gathered at once, metres.
const PIECE_M: f64 = 0.6;

/// The obstacles of a map for drives along segments, and what all targets on it share.
#[derive(Debug)]
pub(crate) struct Ground {
    cells: ObstacleCells,
    footprint: Footprint,
    passable: Passable,
    /// By cell: whether nothing proves that the vehicle cannot come there.
    open: Vec<bool>,
}

/// Centres of cells near the vehicle, gathered anew for each piece; kept to save allocations.
pub(crate) type Nearby = Vec<(f64, f64)>;

impl Ground {
    pub(crate) fn new(map: &CollisionMap) -> Self {
        Self {
            cells: ObstacleCells::of_map(map),
            footprint: Footprint::new(map.model().vehicle(), map.spec().resolution_m),
            passable: Passable::default(),
            open: open_cells(map),
        }
    }

    /// The same with what [`Self::measure_to`] needs.
    pub(crate) fn surveyed(map: &CollisionMap) -> Self {
        let mut ground = Self::new(map);
        ground.passable.survey(map, &|| false);
        ground
    }

    /// Measures how far it is from everywhere to a goal, around obstacles. False if `stop` ended it.
    pub(crate) fn measure_to(
        &self,
        map: &CollisionMap,
        goal: &Goal,
        distances: &mut Distances,
        stop: &dyn Fn() -> bool,
    ) -> bool {
        distances.measure_to((map, &self.passable), goal.cells(), stop)
    }

    /// Whether the rectangle at a pose touches nothing and its reference point is on the map.
    pub(crate) fn is_free(&self, pose: &Pose2) -> bool {
        let placed = self.footprint.placed(pose);
        let cells = self.cells.scaled(1.0);
        cells.holds((pose.x_m, pose.y_m), 0.0) && cells.is_clear(&placed, LEAST_GAP_M)
    }

    /// The end of a segment, if it can be driven from a pose that is free.
    pub(crate) fn drive(
        &self,
        from: &Pose2,
        segment: &Segment,
        near: &mut Nearby,
    ) -> Option<Pose2> {
        let pieces = libm::ceil(segment.length_m / PIECE_M - 1e-9).max(1.0);
        let length_m = segment.length_m / pieces;
        let bend = segment.curvature_per_m;
        // Between its ends a piece lies aside of its chord by no more than this.
        let margin_m = 0.125 * bend.abs() * length_m * length_m;
        let cells = self.cells.scaled(1.0);
        let mut pose = *from;
        let mut piece = 0.0;
        while piece < pieces {
            let state = State {
                x_m: pose.x_m,
                y_m: pose.y_m,
                yaw_rad: pose.yaw_rad,
                curvature_per_m: bend,
            };
            piece += 1.0;
            pose = segment.after(from, length_m * piece);
            if !cells.holds((pose.x_m, pose.y_m), margin_m)
                || contact_gap_m(&cells, &self.footprint, (&state, 0.0, length_m), near).is_some()
            {
                return None;
            }
        }
        Some(pose)
    }

    /// The end of several segments, if they can be driven one after another.
    pub(crate) fn drive_all(
        &self,
        from: &Pose2,
        segments: &[Segment],
        near: &mut Nearby,
    ) -> Option<Pose2> {
        let drive = |pose: Pose2, segment: &Segment| self.drive(&pose, segment, near);
        segments.iter().try_fold(*from, drive)
    }

    /// A goal on this ground, unless it is known without a search what becomes of it.
    pub(crate) fn goal(
        &self,
        map: &CollisionMap,
        target: impl Into<Target>,
    ) -> Result<Goal, Outcome> {
        let goal = Goal::new(map, target)?;
        if self.is_walled_off(&goal) {
            return Err(Outcome::Unreachable);
        }
        if !self.is_free(&Pose2::default()) {
            return Err(Outcome::StartOccupied);
        }
        Ok(goal)
    }

    /// Whether it is proved that no drive leads to a goal.
    ///
    /// A disc around the reference point moves within the vehicle. It stays so far from obstacles that
    /// around the centres of the cells that it passes a disc smaller by half a diagonal is free. Where
    /// no chain of neighbouring cells with such discs leads, nothing leads.
    fn is_walled_off(&self, goal: &Goal) -> bool {
        !goal.cells().iter().any(|&cell| self.open[cell])
    }
}

/// Cells that a chain of neighbours whose discs are free joins to the vehicle's.
fn open_cells(map: &CollisionMap) -> Vec<bool> {
    let spec = map.spec();
    let Vehicle {
        front_m,
        rear_m,
        half_width_m,
        ..
    } = *map.model().vehicle();
    let half_diagonal_m = spec.resolution_m * std::f64::consts::FRAC_1_SQRT_2;
    let radius_m = front_m.min(rear_m).min(half_width_m) - half_diagonal_m;
    let blocked = map.dilated(&Kernel::of_disc(spec.resolution_m, radius_m));
    let (rows, cols) = (spec.rows as usize, spec.cols as usize);
    let row_words = cols.div_ceil(WORD);
    let is_blocked =
        |row: usize, col: usize| blocked[row * row_words + col / WORD] >> (col % WORD) & 1 != 0;
    let mut open = vec![false; rows * cols];
    let mut front: Vec<usize> = spec.index_of(spec.ego()).into_iter().collect();
    for &cell in &front {
        open[cell] = true;
    }
    while let Some(cell) = front.pop() {
        let (row, col) = (cell / cols, cell % cols);
        for row in row.saturating_sub(1)..=(row + 1).min(rows - 1) {
            for col in col.saturating_sub(1)..=(col + 1).min(cols - 1) {
                let next = row * cols + col;
                if !open[next] && !is_blocked(row, col) {
                    open[next] = true;
                    front.push(next);
                }
            }
        }
    }
    open
}
