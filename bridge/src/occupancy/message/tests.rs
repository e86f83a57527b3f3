use super::super::{FREE, OCCUPIED_THRESHOLD};
use super::*;
use crate::geometry::Cell;
use proptest::prelude::*;

fn grid() -> impl Strategy<Value = Occupancy> {
    (1u32..30, 1u32..30, 1u32..200)
        .prop_flat_map(|(rows, cols, centimetres)| {
            let cells = proptest::collection::vec(-1i8..=100, (rows * cols) as usize);
            (Just((rows, cols, centimetres)), 0..rows, 0..cols, cells)
        })
        .prop_map(
            |((rows, cols, centimetres), ego_row, ego_col, cells)| Occupancy {
                spec: GridSpec {
                    rows,
                    cols,
                    resolution_m: f64::from(centimetres) / 100.0,
                    ego_row,
                    ego_col,
                },
                cells,
            },
        )
}

#[test]
fn the_cell_ahead_and_to_the_left_is_the_messages_last() {
    let mut occupancy = Occupancy::filled(GridSpec::default(), FREE);
    occupancy.set(Cell::new(0, 0), OCCUPIED);
    let message = occupancy.to_message(Header::at(0, "base_link"));
    assert_eq!((message.info.width, message.info.height), (401, 151));
    assert_eq!(message.data.last(), Some(&OCCUPIED));
    assert_eq!(
        message
            .data
            .iter()
            .filter(|value| **value == OCCUPIED)
            .count(),
        1
    );
    assert!((message.info.origin.position.x - -20.1).abs() < 1e-9);
    assert!((message.info.origin.position.y - -15.1).abs() < 1e-9);
}

#[test]
fn a_message_shifted_by_half_a_cell_keeps_every_obstacle() {
    let mut occupancy = Occupancy::filled(GridSpec::default(), FREE);
    occupancy.set(Cell::new(200, 75), OCCUPIED);
    let mut message = occupancy.to_message(Header::at(0, "base_link"));
    message.info.origin.position.x += 0.1;
    let shifted = Occupancy::from_message(&message, &GridSpec::default()).unwrap();
    let occupied: Vec<i32> = (0..401)
        .filter(|row| shifted.get(Cell::new(*row, 75)) == Some(OCCUPIED))
        .collect();
    assert_eq!(occupied, [199, 200]);
    assert_eq!(shifted.get(Cell::new(400, 0)), Some(FREE));
}

#[test]
fn what_cannot_be_worked_with_is_named() {
    let good = Occupancy::filled(GridSpec::default(), FREE).to_message(Header::at(0, "b"));
    let spoilt = |spoil: &dyn Fn(&mut OccupancyGrid)| {
        let mut message = good.clone();
        spoil(&mut message);
        Occupancy::from_message(&message, &GridSpec::default())
            .unwrap_err()
            .to_string()
    };
    assert!(spoilt(&|m| m.data.truncate(7)).contains("found 7"));
    assert!(spoilt(&|m| m.info.width = u32::MAX).contains("a side"));
    assert!(spoilt(&|m| m.info.height = 0).contains("a side"));
    assert!(spoilt(&|m| m.info.resolution = f32::NAN).contains("resolution"));
    assert!(spoilt(&|m| m.info.origin.position.y = f64::INFINITY).contains("finite"));
    assert!(spoilt(&|m| m.info.origin.position.x = 1e12).contains("far"));
    assert!(spoilt(&|m| m.info.origin.orientation.x = 0.5).contains("tilted by 53"));
    assert!(spoilt(&|m| m.info.origin.orientation.x = 1e9).contains("tilted by 180"));
    assert!(spoilt(&|m| m.info.origin.orientation.w = f64::NAN).contains("no rotation"));
    assert!(spoilt(&|m| m.data[3] = 101).contains("index 3"));
}

#[test]
fn a_grid_of_its_own_size_must_not_be_turned() {
    let mut message = Occupancy::filled(GridSpec::default(), FREE).to_message(Header::at(0, "b"));
    message.info.origin.orientation.z = 0.2;
    let error = Occupancy::from_message_as_is(&message)
        .unwrap_err()
        .to_string();
    assert!(error.contains("turned by 0.395 rad"), "{error}");
    assert!(Occupancy::from_message(&message, &GridSpec::default()).is_ok());
}

#[test]
fn quarter_turns_move_cells_onto_cells() {
    let spec = GridSpec {
        rows: 21,
        cols: 21,
        resolution_m: 0.5,
        ego_row: 10,
        ego_col: 10,
    };
    let mut occupancy = Occupancy::filled(spec, FREE);
    // Two cells ahead, five to the left.
    occupancy.set(Cell::new(8, 5), OCCUPIED);
    occupancy.set(Cell::new(3, 10), UNKNOWN);
    let message = occupancy.to_message(Header::at(0, "odom"));
    // The frame is turned to the left against the vehicle: what is ahead in it is to the left.
    for (quarters, cell, unknown) in [
        (1.0, Cell::new(15, 8), Cell::new(10, 3)),
        (2.0, Cell::new(12, 15), Cell::new(17, 10)),
        (3.0, Cell::new(5, 12), Cell::new(10, 17)),
    ] {
        let turn = Pose2::new(0.0, 0.0, quarters * std::f64::consts::FRAC_PI_2);
        let seen = Occupancy::from_message_in(&message, &spec, &turn).unwrap();
        let mut expected = Occupancy::filled(spec, FREE);
        expected.set(cell, OCCUPIED);
        expected.set(unknown, UNKNOWN);
        assert_eq!(seen, expected, "{quarters} quarters");
    }
}

#[test]
fn a_turn_grows_obstacles_by_no_more_than_a_cell_and_a_half() {
    let spec = GridSpec {
        rows: 61,
        cols: 61,
        resolution_m: 0.2,
        ego_row: 30,
        ego_col: 30,
    };
    let mut occupancy = Occupancy::filled(spec, FREE);
    occupancy.set(Cell::new(20, 24), OCCUPIED);
    let (x_m, y_m) = spec.centre_of(Cell::new(20, 24));
    let message = occupancy.to_message(Header::at(0, "odom"));
    for step in 0..63 {
        let turn = Pose2::new(0.03, -0.07, 0.1 * f64::from(step));
        let seen = Occupancy::from_message_in(&message, &spec, &turn).unwrap();
        let there = turn.then(&Pose2::new(x_m, y_m, 0.0));
        assert_eq!(seen.get(spec.cell_at(there.x_m, there.y_m)), Some(OCCUPIED));
        for (index, value) in seen.cells.iter().enumerate() {
            let (x_m, y_m) = spec.centre_of(spec.cell_of_index(index));
            let away_m = Pose2::new(x_m, y_m, 0.0).distance_m(&there);
            assert!(
                *value != OCCUPIED || away_m <= 2f64.sqrt() * 0.2 + 1e-9,
                "{away_m} m"
            );
        }
    }
}

#[test]
fn an_origin_that_is_turned_is_the_same_as_a_frame_that_is() {
    let mut occupancy = Occupancy::filled(GridSpec::default(), FREE);
    occupancy.set(Cell::new(100, 75), OCCUPIED);
    let message = occupancy.to_message(Header::at(0, "odom"));
    let frame = Pose2::new(2.0, -1.0, 0.7);
    let in_frame = Occupancy::from_message_in(&message, &GridSpec::default(), &frame).unwrap();
    let mut moved = message.clone();
    moved.info.origin = crate::poses::ros_pose(&frame.then(&pose_of_ros(&message.info.origin)));
    let in_origin = Occupancy::from_message(&moved, &GridSpec::default()).unwrap();
    assert_eq!(in_frame, in_origin);
    // A quaternion that is not of length one turns as much.
    for part in [
        &mut moved.info.origin.orientation.z,
        &mut moved.info.origin.orientation.w,
    ] {
        *part *= 3.0;
    }
    let scaled = Occupancy::from_message(&moved, &GridSpec::default()).unwrap();
    assert_eq!(scaled, in_origin);
}

proptest! {
    #[test]
    fn a_message_says_the_same_again(occupancy in grid()) {
        let message = occupancy.to_message(Header::at(7, "base_link"));
        prop_assert_eq!(&Occupancy::from_message(&message, &occupancy.spec).unwrap(), &occupancy);
        prop_assert_eq!(Occupancy::from_message_as_is(&message).unwrap(), occupancy);
    }

    #[test]
    fn no_obstacle_is_lost_on_any_other_grid(
        occupancy in grid(),
        resolution_m in 0.05..3.0f64,
        (dx, dy, yaw_rad) in (-2.0..2.0f64, -2.0..2.0f64, prop_oneof![Just(0.0), -3.2..3.2f64]),
    ) {
        let message = occupancy.to_message(Header::at(0, "odom"));
        let frame = Pose2::new(dx, dy, yaw_rad);
        let spec = GridSpec { rows: 60, cols: 60, resolution_m, ego_row: 30, ego_col: 30 };
        let there = Occupancy::from_message_in(&message, &spec, &frame).unwrap();
        // Wherever a point of an occupied cell is, the cell that it is in there is as occupied. Points on
        // the very edge may be in either of two cells.
        let within_m = 0.498 * occupancy.spec.resolution_m;
        for (index, value) in occupancy.cells.iter().enumerate() {
            let (x_m, y_m) = occupancy.spec.centre_of(occupancy.spec.cell_of_index(index));
            for (sx, sy) in [(0.0, 0.0), (1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
                let point = Pose2::new(x_m + sx * within_m, y_m + sy * within_m, 0.0);
                let point = frame.then(&point);
                let cell = spec.cell_at(point.x_m, point.y_m);
                let (cx, cy) = spec.centre_of(cell);
                let inside = (point.x_m - cx).abs().max((point.y_m - cy).abs());
                if inside > 0.49 * resolution_m {
                    continue;
                }
                if let Some(found) = there.get(cell) {
                    prop_assert!(*value < OCCUPIED_THRESHOLD || found >= *value);
                    prop_assert!(*value >= 0 || !(0..OCCUPIED_THRESHOLD).contains(&found));
                }
            }
        }
    }

    #[test]
    fn turned_cells_are_the_worst_of_those_that_they_overlap(
        occupancy in grid(),
        resolution_m in 0.1..2.0f64,
        (dx, dy, yaw_rad) in (-2.0..2.0f64, -2.0..2.0f64, 0.01..6.2f64),
    ) {
        let message = occupancy.to_message(Header::at(0, "odom"));
        let frame = Pose2::new(dx, dy, yaw_rad);
        let spec = GridSpec { rows: 20, cols: 20, resolution_m, ego_row: 10, ego_col: 10 };
        let seen = Occupancy::from_message_in(&message, &spec, &frame).unwrap();
        let back = frame.inverse();
        for (index, found) in seen.cells.iter().enumerate() {
            let (x_m, y_m) = spec.centre_of(spec.cell_of_index(index));
            // Samples of a square cannot find more than it overlaps.
            let mut values = Vec::new();
            for k in -10..=10 {
                for l in -10..=10 {
                    let step_m = 0.0498 * resolution_m;
                    let at = Pose2::new(x_m + f64::from(k) * step_m, y_m + f64::from(l) * step_m, 0.0);
                    let at = back.then(&at);
                    values.extend(occupancy.get(occupancy.spec.cell_at(at.x_m, at.y_m)));
                }
            }
            let most = values.iter().copied().max();
            if let Some(most) = most {
                prop_assert!(most < OCCUPIED_THRESHOLD || *found >= most);
                prop_assert!(*found != FREE || values.iter().all(|value| *value == FREE));
            }
        }
    }
}
