//! The paper's 21 × 21 lookup table: 368 actions in 256 directions.
//!
//! Of the 440 cells around the centre, those on the axes and diagonals beyond the first ring are
//! dropped: they repeat a unit step's direction. Directions are numbered counter-clockwise from
//! straight ahead.

use std::f64::consts::TAU;

/// Reach of the table to each side, cells.
pub const REACH_CELLS: i32 = 10;
/// Number of actions in the table.
pub const ACTIONS: usize = 368;
/// Number of distinct directions among them.
pub const DIRECTIONS: usize = 256;
/// The direction straight ahead, which a vehicle in its own frame has.
pub const AHEAD: u8 = 0;

/// One straight step from the centre of a cell to that of another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Action {
    /// Rows to move, negative is ahead.
    pub d_row: i32,
    /// Columns to move, negative is left.
    pub d_col: i32,
    /// Length, cells.
    pub length_cells: f64,
    /// Number of its direction.
    pub direction: u8,
}

/// All actions, ordered by direction and then by length.
#[derive(Debug, Clone)]
pub struct ActionTable {
    actions: Vec<Action>,
    angles_rad: Vec<f64>,
    shortest_cells: Vec<f64>,
}

impl Default for ActionTable {
    fn default() -> Self {
        Self::new()
    }
}

impl ActionTable {
    /// Builds the table.
    ///
    /// # Panics
    /// Never: the table's size is a constant.
    pub fn new() -> Self {
        let mut offsets: Vec<(i32, i32)> = (-REACH_CELLS..=REACH_CELLS)
            .flat_map(|d_row| (-REACH_CELLS..=REACH_CELLS).map(move |d_col| (d_row, d_col)))
            .filter(|&(d_row, d_col)| is_action(d_row, d_col))
            .collect();
        // Two offsets share a direction when they share their reduced form, so that the order is
        // exact whatever rounding does to the angles.
        offsets.sort_by(|&a, &b| {
            let by_angle = if reduced(a) == reduced(b) {
                std::cmp::Ordering::Equal
            } else {
                angle_rad(a).total_cmp(&angle_rad(b))
            };
            by_angle.then((a.0.abs() + a.1.abs()).cmp(&(b.0.abs() + b.1.abs())))
        });
        let mut table = Self {
            actions: Vec::new(),
            angles_rad: Vec::new(),
            shortest_cells: Vec::new(),
        };
        let mut last = None;
        for (d_row, d_col) in offsets {
            let length_cells = libm::hypot(f64::from(d_row), f64::from(d_col));
            if last != Some(reduced((d_row, d_col))) {
                last = Some(reduced((d_row, d_col)));
                table.angles_rad.push(angle_rad((d_row, d_col)));
                table.shortest_cells.push(length_cells);
            }
            let direction = u8::try_from(table.angles_rad.len() - 1)
                .expect("the table has 256 distinct directions");
            table.actions.push(Action {
                d_row,
                d_col,
                length_cells,
                direction,
            });
        }
        table
    }

    /// The actions, ordered by direction and then by length.
    pub fn actions(&self) -> &[Action] {
        &self.actions
    }

    /// Angle of a direction, radians counter-clockwise from straight ahead, in [0, 2π).
    pub fn angle_rad(&self, direction: u8) -> f64 {
        self.angles_rad[usize::from(direction)]
    }

    /// Length of the shortest action in a direction, cells.
    pub fn shortest_cells(&self, direction: u8) -> f64 {
        self.shortest_cells[usize::from(direction)]
    }
}

/// Whether the table keeps an offset: all but the centre and what repeats a unit step's direction.
fn is_action(d_row: i32, d_col: i32) -> bool {
    let (rows, cols) = (d_row.abs(), d_col.abs());
    let repeats_unit_step = rows == 0 || cols == 0 || rows == cols;
    rows.max(cols) == 1 || (rows.max(cols) > 1 && !repeats_unit_step)
}

fn reduced((d_row, d_col): (i32, i32)) -> (i32, i32) {
    let (mut a, mut b) = (d_row.abs(), d_col.abs());
    while b != 0 {
        (a, b) = (b, a % b);
    }
    (d_row / a, d_col / a)
}

fn angle_rad((d_row, d_col): (i32, i32)) -> f64 {
    let angle = libm::atan2(f64::from(-d_col), f64::from(-d_row));
    if angle < 0.0 { angle + TAU } else { angle }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_has_the_papers_368_actions_in_256_directions() {
        let table = ActionTable::new();
        assert_eq!(table.actions().len(), ACTIONS);
        assert_eq!(table.angles_rad.len(), DIRECTIONS);
        assert_eq!(table.actions()[0].direction, AHEAD);
        assert_eq!(
            (table.actions()[0].d_row, table.actions()[0].d_col),
            (-1, 0)
        );
        assert!(table.angles_rad.windows(2).all(|pair| pair[0] < pair[1]));
    }

    #[test]
    fn neighbouring_directions_lie_at_most_5_72_degrees_apart() {
        let table = ActionTable::new();
        let mut gaps: Vec<f64> = table.angles_rad.windows(2).map(|p| p[1] - p[0]).collect();
        gaps.push(TAU - table.angles_rad[DIRECTIONS - 1]);
        let widest = gaps.iter().copied().fold(0.0, f64::max);
        assert!(
            widest.to_degrees() < 5.72 && widest.to_degrees() > 5.7,
            "{widest}"
        );
    }

    #[test]
    fn actions_of_one_direction_follow_one_another_from_short_to_long() {
        let table = ActionTable::new();
        for pair in table.actions().windows(2) {
            let step = pair[1].direction - pair[0].direction;
            assert!(step == 1 || (step == 0 && pair[0].length_cells < pair[1].length_cells));
            let angle = angle_rad((pair[0].d_row, pair[0].d_col));
            assert!((angle - table.angle_rad(pair[0].direction)).abs() < 1e-12);
        }
    }
}
