//! A frame as seen from where its paths begin.

use std::borrow::Cow;

use swath_bridge::{GridSpec, Pose2};

use super::{FrameInput, Start};
use crate::Plane;

/// Distance from an occupied cell's centre to the points that stand for it, in cells, along both axes.
const QUARTER: f64 = 0.25;

/// Obstacles, reference and goals in the frame of the start.
#[derive(Debug)]
pub(super) struct View<'a> {
    pub(super) obstacles: Cow<'a, Plane>,
    pub(super) reference: Cow<'a, [Pose2]>,
    pub(super) goals: Cow<'a, [Pose2]>,
}

impl<'a> View<'a> {
    pub(super) fn new(input: &FrameInput<'a>) -> Self {
        if input.start.is_vehicle() {
            return Self {
                obstacles: Cow::Borrowed(input.obstacles),
                reference: Cow::Borrowed(input.reference),
                goals: Cow::Borrowed(input.goals),
            };
        }
        let start_from_vehicle = input.start.pose.inverse();
        let seen = |poses: &[Pose2]| {
            let seen = poses.iter().map(|pose| start_from_vehicle.then(pose));
            seen.collect::<Vec<_>>()
        };
        Self {
            obstacles: Cow::Owned(turned(&input.spec, input.obstacles, &input.start)),
            reference: Cow::Owned(seen(input.reference)),
            goals: Cow::Owned(seen(input.goals)),
        }
    }
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
    use swath_bridge::Cell;

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
}
