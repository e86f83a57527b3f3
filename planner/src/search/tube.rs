//! The states around a path: those that lie near it and head nearly as it does. A search among them finds
//! the way that the path means, at little cost.

use swath_bridge::geometry::wrap_angle_rad;
use swath_bridge::{Cell, Pose2};

use crate::action::ActionTable;
use crate::collision::CollisionMap;
use crate::motion::{BLOCK, BLOCKS};

/// So far from a path's poses to either side, cells and directions.
const CELLS: i32 = 2;
const TURNS: u8 = 6;

/// A bit for each direction.
type Headings = [u32; BLOCKS];

/// The states around a path.
#[derive(Debug)]
pub(super) struct Tube {
    /// By cell, ascending.
    cells: Vec<(usize, Headings)>,
}

impl Tube {
    /// The states around a path of chords, its own among them.
    pub(super) fn around(map: &CollisionMap, path: &[Pose2]) -> Self {
        let (spec, table) = (map.spec(), map.model().table());
        let mut cells = Vec::new();
        let mut yaw_rad = f64::NAN;
        let mut headings = Headings::default();
        for pose in path {
            if pose.yaw_rad != yaw_rad {
                yaw_rad = pose.yaw_rad;
                headings = headings_around(table, yaw_rad);
            }
            let centre = spec.cell_at(pose.x_m, pose.y_m);
            let offsets = -CELLS..=CELLS;
            let square = offsets.clone().flat_map(|d_row| {
                let row = centre.row + d_row;
                offsets
                    .clone()
                    .map(move |d_col| Cell::new(row, centre.col + d_col))
            });
            let on_map = square.filter_map(|cell| spec.index_of(cell));
            cells.extend(on_map.map(|cell| (cell, headings)));
        }
        cells.sort_unstable_by_key(|&(cell, _)| cell);
        cells.dedup_by(|(cell, more), (kept, headings)| {
            if cell != kept {
                return false;
            }
            for (to, more) in headings.iter_mut().zip(more) {
                *to |= *more;
            }
            true
        });
        Self { cells }
    }

    /// Which of a cell's states in a block of directions are in the tube, a bit each.
    #[inline]
    pub(super) fn of_block(&self, cell: usize, number: usize) -> u32 {
        self.cells
            .binary_search_by_key(&cell, |&(cell, _)| cell)
            .map_or(0, |place| self.cells[place].1[number])
    }
}

fn headings_around(table: &ActionTable, yaw_rad: f64) -> Headings {
    let off = |&direction: &u8| wrap_angle_rad(table.angle_rad(direction) - yaw_rad).abs();
    let nearest = (0..=u8::MAX).min_by(|a, b| off(a).total_cmp(&off(b)));
    let first = nearest.unwrap_or(0).wrapping_sub(TURNS);
    let mut headings = Headings::default();
    for turn in 0..=2 * TURNS {
        let direction = usize::from(first.wrapping_add(turn));
        headings[direction / BLOCK] |= 1 << (direction % BLOCK);
    }
    headings
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use swath_bridge::{GridSpec, Vehicle};

    use super::*;
    use crate::{MotionModel, Plane};

    #[test]
    fn a_tube_has_what_is_near_in_place_and_heading_and_nothing_else() {
        let spec = GridSpec::default();
        let model = MotionModel::new(&Vehicle::default(), spec.resolution_m).unwrap();
        let plane = Plane::empty(spec.rows, spec.cols);
        let map = CollisionMap::new(Arc::new(model), spec, &plane).unwrap();
        let ego = spec.ego();
        let at = |rows: i32, direction: u8| {
            let (x_m, y_m) = spec.centre_of(Cell::new(ego.row - rows, ego.col));
            Pose2::new(x_m, y_m, map.model().table().angle_rad(direction))
        };
        // Turns on the spot, so that one place has two headings.
        let tube = Tube::around(&map, &[at(0, 0), at(10, 0), at(10, 30), at(11, 30)]);
        let has = |rows: i32, cols: i32, direction: u8| {
            let cell = spec.index_of(Cell::new(ego.row - rows, ego.col + cols));
            let direction = usize::from(direction);
            let bits = tube.of_block(cell.unwrap(), direction / BLOCK);
            bits >> (direction % BLOCK) & 1 != 0
        };
        for turn in 0..=u8::MAX {
            let is_near = |to: u8| turn.wrapping_sub(to) <= TURNS || to.wrapping_sub(turn) <= TURNS;
            for (cells, is_in) in [(0, true), (2, true), (-2, true), (3, false)] {
                assert_eq!(has(0, cells, turn), is_in && is_near(0));
                assert_eq!(has(10, cells, turn), is_in && (is_near(0) || is_near(30)));
                assert_eq!(has(13, cells, turn), is_in && is_near(30));
                assert!(!has(5, cells, turn));
            }
        }
    }
}
