//! A frame as seen from where its paths begin, on its own grid or on another.

use std::borrow::Cow;
use std::sync::Arc;

use swath_bridge::geometry::MAX_GRID_SIDE_CELLS;
use swath_bridge::{Cell, GridSpec, Pose2};

use super::{FrameInput, Start};
use crate::collision::CollisionMap;
use crate::kernel::Kernel;
use crate::{Error, MotionModel, Plane};

/// Distance from an occupied cell's centre to the points that stand for it, in cells, along both axes.
const QUARTER: f64 = 0.25;

/// Cells may overlap by so much, in cells, without being taken to.
const TOUCH: f64 = 1e-3;

/// Obstacles, reference and goals in the frame of the start.
#[derive(Debug)]
pub(super) struct View<'a> {
    pub(super) spec: GridSpec,
    pub(super) obstacles: Cow<'a, Plane>,
    pub(super) reference: Cow<'a, [Pose2]>,
    pub(super) goals: Cow<'a, [Pose2]>,
}

impl<'a> View<'a> {
    pub(super) fn new(input: &FrameInput<'a>) -> Self {
        if input.start.is_vehicle() {
            return Self {
                spec: input.spec,
                obstacles: Cow::Borrowed(input.obstacles),
                reference: Cow::Borrowed(input.reference),
                goals: Cow::Borrowed(input.goals),
            };
        }
        let obstacles = turned(&input.spec, input.obstacles, &input.start);
        Self::of(input, input.spec, obstacles)
    }

    /// On a grid around the start, of the same resolution, whose cells beyond the frame's own grid
    /// are occupied. No cell is free that overlaps an occupied one, but for those under the vehicle at
    /// the start and at a goal, if it touches no occupied cell of the frame there.
    ///
    /// # Errors
    /// As [`CollisionMap::new`].
    pub(super) fn on(
        input: &FrameInput<'a>,
        spec: &GridSpec,
        model: &Arc<MotionModel>,
    ) -> Result<Self, Error> {
        if input.start.is_vehicle() && input.spec == *spec {
            return Ok(Self::new(input));
        }
        let mut obstacles = covered(input, spec);
        let map = CollisionMap::new(Arc::clone(model), input.spec, input.obstacles)?;
        let start_from_frame = input.start.pose.inverse();
        let poses = input.goals.iter().chain([&input.start.pose]);
        for pose in poses.filter(|pose| map.pose_is_free(pose)) {
            let seen = start_from_frame.then(pose);
            clear_under(&mut obstacles, spec, (model, &seen));
        }
        Ok(Self::of(input, *spec, obstacles))
    }

    fn of(input: &FrameInput<'a>, spec: GridSpec, obstacles: Plane) -> Self {
        let start_from_vehicle = input.start.pose.inverse();
        let seen = |poses: &[Pose2]| {
            let seen = poses.iter().map(|pose| start_from_vehicle.then(pose));
            seen.collect::<Vec<_>>()
        };
        Self {
            spec,
            obstacles: Cow::Owned(obstacles),
            reference: Cow::Owned(seen(input.reference)),
            goals: Cow::Owned(seen(input.goals)),
        }
    }
}

/// Clears the cells that the vehicle touches at a pose.
fn clear_under(plane: &mut Plane, spec: &GridSpec, (model, pose): (&MotionModel, &Pose2)) {
    let cell = spec.cell_at(pose.x_m, pose.y_m);
    let (x_m, y_m) = spec.centre_of(cell);
    let offset = Pose2::new(pose.x_m - x_m, pose.y_m - y_m, pose.yaw_rad);
    for span in Kernel::of_pose(model.vehicle(), spec.resolution_m, &offset).spans {
        for d_col in span.first_col..=span.last_col {
            plane.clear(Cell::new(
                cell.row.saturating_add(span.d_row),
                cell.col.saturating_add(d_col),
            ));
        }
    }
}

/// The grid around a start that holds all of a frame's grid, of the same resolution.
///
/// Where that would be larger than [`MAX_GRID_SIDE_CELLS`] a side, it holds as much around start and
/// goals as there is room for; `None` if it cannot hold those.
pub fn grid_around(spec: &GridSpec, start: &Pose2, goals: &[Pose2]) -> Option<GridSpec> {
    let half_m = spec.resolution_m / 2.0;
    let (front_m, left_m) = spec.centre_of(spec.cell_of_index(0));
    let (rear_m, right_m) = spec.centre_of(spec.cell_of_index(spec.len() - 1));
    let start_from_frame = start.inverse();
    let seen = |x_m: f64, y_m: f64| start_from_frame.then(&Pose2::new(x_m, y_m, 0.0));
    let corners = [
        seen(front_m + half_m, left_m + half_m),
        seen(front_m + half_m, right_m - half_m),
        seen(rear_m - half_m, left_m + half_m),
        seen(rear_m - half_m, right_m - half_m),
    ];
    let is_on = |goal: &&Pose2| spec.index_of(spec.cell_at(goal.x_m, goal.y_m)).is_some();
    let goals: Vec<Pose2> = goals
        .iter()
        .filter(is_on)
        .map(|goal| seen(goal.x_m, goal.y_m))
        .collect();
    let side = |of: fn(&Pose2) -> f64| {
        let bounds = |poses: &[Pose2]| {
            let along = || poses.iter().map(|pose| of(pose) / spec.resolution_m);
            (
                along().fold(f64::INFINITY, f64::min),
                along().fold(f64::NEG_INFINITY, f64::max),
            )
        };
        let (least, most) = bounds(&corners);
        let (nearest, farthest) = bounds(&goals);
        cells_along((least, most), (nearest.min(0.0), farthest.max(0.0)))
    };
    let (ahead, behind) = side(|pose| pose.x_m)?;
    let (left, right) = side(|pose| pose.y_m)?;
    Some(GridSpec {
        rows: ahead + behind + 1,
        cols: left + right + 1,
        resolution_m: spec.resolution_m,
        ego_row: ahead,
        ego_col: left,
    })
}

/// Cells before and behind the start's along an axis, given the least and greatest coordinate of the map
/// and of what has to be held, in cells.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a few thousand cells, none of them negative"
)]
fn cells_along((least, most): (f64, f64), (first, last): (f64, f64)) -> Option<(u32, u32)> {
    let before = libm::ceil(most - 0.5 - TOUCH).max(0.0);
    let behind = libm::ceil(-least - 0.5 - TOUCH).max(0.0);
    let room = f64::from(MAX_GRID_SIDE_CELLS) - 1.0;
    if before + behind <= room {
        return Some((before as u32, behind as u32));
    }
    let (needed_before, needed_behind) = (libm::ceil(last), libm::ceil(-first));
    let spare = room - needed_before - needed_behind;
    if spare < 0.0 {
        return None;
    }
    // What is left goes to both ends alike, and to one of them what the other cannot use.
    let wanted_behind = (behind - needed_behind).max(0.0);
    let more_before = (before - needed_before)
        .max(0.0)
        .min((spare / 2.0).max(spare - wanted_behind));
    let kept_before = needed_before + libm::floor(more_before);
    let kept_behind = behind.min(room - kept_before);
    Some((kept_before as u32, kept_behind as u32))
}

/// The cells of a grid around the start that overlap an occupied cell of the frame, or whose centres lie
/// beyond the frame's grid.
fn covered(input: &FrameInput<'_>, spec: &GridSpec) -> Plane {
    let mut plane = Plane::empty(spec.rows, spec.cols);
    let start = &input.start.pose;
    let (sin, cos) = libm::sincos(start.yaw_rad);
    for index in 0..spec.len() {
        let (x_m, y_m) = spec.centre_of(spec.cell_of_index(index));
        let x_in_frame_m = start.x_m + cos * x_m - sin * y_m;
        let y_in_frame_m = start.y_m + sin * x_m + cos * y_m;
        let cell = input.spec.cell_at(x_in_frame_m, y_in_frame_m);
        if input.spec.index_of(cell).is_none() {
            plane.set_index(index);
        }
    }
    // Two squares overlap unless their projections on the axes of one of them do not.
    let reach = 0.5 + 0.5 * (sin.abs() + cos.abs()) - TOUCH;
    input.obstacles.each_set(|index| {
        let (x_m, y_m) = input.spec.centre_of(input.spec.cell_of_index(index));
        let (dx_m, dy_m) = (x_m - start.x_m, y_m - start.y_m);
        let (x_m, y_m) = (cos * dx_m + sin * dy_m, cos * dy_m - sin * dx_m);
        let middle = spec.cell_at(x_m, y_m);
        for row in middle.row.saturating_sub(1)..=middle.row.saturating_add(1) {
            for col in middle.col.saturating_sub(1)..=middle.col.saturating_add(1) {
                let cell = Cell::new(row, col);
                let Some(index) = spec.index_of(cell) else {
                    continue;
                };
                let (cell_x_m, cell_y_m) = spec.centre_of(cell);
                let off_x = (cell_x_m - x_m) / spec.resolution_m;
                let off_y = (cell_y_m - y_m) / spec.resolution_m;
                let along = (cos * off_x - sin * off_y).abs();
                let across = (sin * off_x + cos * off_y).abs();
                if off_x.abs() < reach && off_y.abs() < reach && along < reach && across < reach {
                    plane.set_index(index);
                }
            }
        }
    });
    plane
}

/// The cells that hold one of four points of an occupied cell.
///
/// Cells that an occupied one touches by less than a quarter may be missed, so paths found on this are
/// to be tested on the cells as they came.
fn turned(spec: &GridSpec, obstacles: &Plane, start: &Start) -> Plane {
    let mut plane = Plane::empty(spec.rows, spec.cols);
    let start_from_vehicle = start.pose.inverse();
    let (sin, cos) = libm::sincos(start_from_vehicle.yaw_rad);
    let off_m = QUARTER * spec.resolution_m;
    obstacles.each_set(|index| {
        let (x_m, y_m) = spec.centre_of(spec.cell_of_index(index));
        for (dx_m, dy_m) in [
            (off_m, off_m),
            (off_m, -off_m),
            (-off_m, off_m),
            (-off_m, -off_m),
        ] {
            let (x_m, y_m) = (x_m + dx_m, y_m + dy_m);
            plane.set(spec.cell_at(
                start_from_vehicle.x_m + cos * x_m - sin * y_m,
                start_from_vehicle.y_m + sin * x_m + cos * y_m,
            ));
        }
    });
    plane
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen_from(pose: Pose2, cells: &[Cell]) -> Plane {
        let spec = GridSpec::default();
        let mut obstacles = Plane::empty(spec.rows, spec.cols);
        for &cell in cells {
            obstacles.set(cell);
        }
        let start = Start {
            pose,
            curvature_per_m: None,
        };
        turned(&spec, &obstacles, &start)
    }

    #[test]
    fn moving_by_whole_cells_moves_cells() {
        let seen = seen_from(
            Pose2::new(1.0, -0.4, 0.0),
            &[Cell::new(200, 70), Cell::new(10, 5)],
        );
        assert!(seen.get(Cell::new(205, 68)) && seen.get(Cell::new(15, 3)));
        assert_eq!(seen.count(), 2);
    }

    #[test]
    fn turning_left_moves_what_is_ahead_to_the_right() {
        let quarter = std::f64::consts::FRAC_PI_2;
        // 6 m ahead.
        let seen = seen_from(Pose2::new(0.0, 0.0, quarter), &[Cell::new(270, 75)]);
        assert!(seen.get(Cell::new(300, 105)));
        assert_eq!(seen.count(), 1);
    }

    #[test]
    fn a_wall_has_no_holes_at_any_angle() {
        let wall: Vec<Cell> = (20..140).map(|col| Cell::new(250, col)).collect();
        for step in 0..25 {
            let yaw_rad = 0.02 * f64::from(step);
            let seen = seen_from(Pose2::new(0.33, 0.17, yaw_rad), &wall);
            // Every ray ahead from within the wall's reach meets it.
            for col in 60..90 {
                let is_met = (0..300).any(|row| seen.get(Cell::new(row, col)));
                assert!(is_met, "{yaw_rad} rad, column {col}");
            }
        }
    }

    fn input_on(spec: GridSpec, obstacles: &Plane, pose: Pose2) -> FrameInput<'_> {
        FrameInput {
            spec,
            obstacles,
            reference: &[],
            goals: &[],
            start: Start {
                pose,
                curvature_per_m: None,
            },
        }
    }

    /// Cells that a fine sampling of an occupied cell's square meets, moved by hand.
    fn met(spec: &GridSpec, pose: &Pose2, cell: Cell, seen: &GridSpec) -> Vec<Cell> {
        let (x_m, y_m) = spec.centre_of(cell);
        let mut met = Vec::new();
        for along in -10..=10 {
            for across in -10..=10 {
                let off = |step: i32| 0.0495 * f64::from(step) * spec.resolution_m;
                let point = Pose2::new(x_m + off(along), y_m + off(across), 0.0);
                let there = pose.inverse().then(&point);
                met.push(seen.cell_at(there.x_m, there.y_m));
            }
        }
        met
    }

    #[test]
    fn a_grid_around_a_start_holds_the_map_and_loses_no_obstacle() {
        let spec = GridSpec {
            rows: 30,
            cols: 20,
            resolution_m: 0.25,
            ego_row: 12,
            ego_col: 7,
        };
        let cells: Vec<Cell> = (0..30).map(|at| Cell::new(at, (at * 7) % 20)).collect();
        let mut obstacles = Plane::empty(spec.rows, spec.cols);
        for &cell in &cells {
            obstacles.set(cell);
        }
        for step in 0..50 {
            let step = f64::from(step);
            let pose = Pose2::new(0.02 * step - 0.5, 0.3 - 0.013 * step, 0.13 * step - 3.1);
            let seen = grid_around(&spec, &pose, &[]).unwrap();
            let view = View::of(
                &input_on(spec, &obstacles, pose),
                seen,
                covered(&input_on(spec, &obstacles, pose), &seen),
            );
            for &cell in &cells {
                for there in met(&spec, &pose, cell, &seen) {
                    assert!(seen.index_of(there).is_some(), "{pose:?} {cell:?}");
                    assert!(view.obstacles.get(there), "{pose:?} {cell:?} {there:?}");
                }
            }
            for index in 0..seen.len() {
                let (x_m, y_m) = seen.centre_of(seen.cell_of_index(index));
                let at = pose.then(&Pose2::new(x_m, y_m, 0.0));
                if spec.index_of(spec.cell_at(at.x_m, at.y_m)).is_none() {
                    assert!(view.obstacles.get_index(index), "beyond the map is free");
                }
            }
        }
    }

    #[test]
    fn turns_by_right_angles_are_exact() {
        let spec = GridSpec {
            rows: 30,
            cols: 20,
            resolution_m: 0.25,
            ego_row: 12,
            ego_col: 7,
        };
        let mut obstacles = Plane::empty(spec.rows, spec.cols);
        obstacles.set(Cell::new(0, 0));
        obstacles.set(Cell::new(11, 7));
        for quarter in 0..4 {
            let yaw_rad = f64::from(quarter) * std::f64::consts::FRAC_PI_2;
            let pose = Pose2::new(0.5, -0.25, yaw_rad);
            let seen = grid_around(&spec, &pose, &[]).unwrap();
            assert_eq!(seen.len(), spec.len(), "{seen:?}");
            let view = View::of(
                &input_on(spec, &obstacles, pose),
                seen,
                covered(&input_on(spec, &obstacles, pose), &seen),
            );
            assert_eq!(view.obstacles.count(), 2);
            let ahead = pose.inverse().then(&Pose2::new(0.25, 0.0, 0.0));
            assert!(view.obstacles.get(seen.cell_at(ahead.x_m, ahead.y_m)));
        }
    }

    #[test]
    fn a_giant_map_keeps_start_and_goals_or_says_that_it_cannot() {
        let spec = GridSpec {
            rows: 4096,
            cols: 4096,
            resolution_m: 0.1,
            ego_row: 4000,
            ego_col: 2000,
        };
        let diagonal = std::f64::consts::FRAC_PI_4;
        let start = Pose2::new(0.0, 0.0, diagonal);
        let near = Pose2::new(60.0, 30.0, 0.0);
        let seen = grid_around(&spec, &start, &[near]).unwrap();
        seen.validate().unwrap();
        let goal = start.inverse().then(&near);
        assert!(seen.index_of(seen.cell_at(goal.x_m, goal.y_m)).is_some());
        let corner = Pose2::new(-9.0, 199.0, diagonal);
        let opposite = Pose2::new(399.0, -208.0, 0.0);
        assert_eq!(
            grid_around(&spec, &corner, &[opposite]).map(|seen| seen.cols),
            None
        );
        let along = Pose2::new(-9.0, 199.0, 0.0);
        assert_eq!(
            grid_around(&spec, &along, &[opposite]).unwrap().len(),
            spec.len()
        );
    }

    #[test]
    fn a_vehicle_that_fits_is_not_hemmed_in_by_turned_cells() {
        let vehicle = swath_bridge::Vehicle {
            wheelbase_m: 0.4,
            front_m: 0.6,
            rear_m: 0.2,
            half_width_m: 0.3,
            min_turning_radius_m: 0.9,
            ..swath_bridge::Vehicle::default()
        }
        .with_limits_of_its_size();
        let model = Arc::new(MotionModel::new(&vehicle, 0.1).unwrap());
        let spec = GridSpec {
            rows: 40,
            cols: 40,
            resolution_m: 0.1,
            ego_row: 20,
            ego_col: 20,
        };
        let pose = Pose2::new(0.02, -0.03, 0.7);
        let mut obstacles = Plane::empty(spec.rows, spec.cols);
        let corners = [(0.6, 0.3), (0.6, -0.3), (-0.2, 0.3), (-0.2, -0.3)];
        let outside = |x_m: f64, y_m: f64| Pose2::new(x_m * 1.4, y_m * 1.4, 0.0);
        for (x_m, y_m) in corners {
            let at = pose.then(&outside(x_m, y_m));
            obstacles.set(spec.cell_at(at.x_m, at.y_m));
        }
        let input = input_on(spec, &obstacles, pose);
        let exact = CollisionMap::new(Arc::clone(&model), spec, &obstacles).unwrap();
        assert!(exact.pose_is_free(&pose));
        let seen = grid_around(&spec, &pose, &[]).unwrap();
        let view = View::on(&input, &seen, &model).unwrap();
        let map = CollisionMap::new(Arc::clone(&model), seen, &view.obstacles).unwrap();
        assert!(map.pose_is_free(&Pose2::default()));
    }
}
