use std::ops::Range;

use super::*;
use crate::motion::Side;
use proptest::prelude::*;
use swath_bridge::Vehicle;

fn map_of(spec: GridSpec, cells: &[(i32, i32)]) -> CollisionMap {
    let model = Arc::new(MotionModel::new(&Vehicle::default(), spec.resolution_m).unwrap());
    let mut obstacles = Plane::empty(spec.rows, spec.cols);
    for &(row, col) in cells {
        obstacles.set(Cell::new(row, col));
    }
    CollisionMap::new(model, spec, &obstacles).unwrap()
}

fn touches(kernel: &Kernel, start: (i32, i32), cells: &[(i32, i32)]) -> bool {
    kernel.spans.iter().any(|span| {
        cells.iter().any(|&(row, col)| {
            row == start.0 + span.d_row
                && (span.first_col..=span.last_col).contains(&(col - start.1))
        })
    })
}

/// Compares what a map says of some of its cells with looking at every cell of a kernel.
fn compare(
    spec: GridSpec,
    (rows, cols): (Range<i32>, Range<i32>),
    cells: &[(i32, i32)],
    (action, direction): (u16, u8),
) -> Result<(), TestCaseError> {
    let map = map_of(spec, cells);
    let model = map.model().clone();
    for (row, col) in rows.flat_map(|row| cols.clone().map(move |col| (row, col))) {
        let cell = (usize::try_from(row).unwrap(), usize::try_from(col).unwrap());
        let bit = |word: u64, number: usize| word >> (number % 64) & 1 != 0;
        let action = usize::from(action);
        let step = &model.table().actions()[action];
        let leaves = spec
            .index_of(Cell::new(row + step.d_row, col + step.d_col))
            .is_none();
        let blocked = bit(map.blocked_chords(action / 64, cell), action);
        prop_assert_eq!(
            blocked,
            leaves || touches(&model.chords[action], (row, col), cells)
        );
        let turn = usize::from(direction);
        let blocked = bit(map.blocked_turns(turn / 64, cell), turn);
        prop_assert_eq!(blocked, touches(&model.turns[turn], (row, col), cells));
        let pose = &model.poses[usize::from(direction)];
        let free = map.state_is_free(Cell::new(row, col), direction);
        prop_assert_eq!(free, !touches(pose, (row, col), cells));
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(8))]

    #[test]
    fn bitmaps_agree_with_looking_at_every_cell_of_a_kernel(
        cells in proptest::collection::vec((0i32..70, 0i32..90), 0..6),
        action in 0u16..368, direction: u8,
    ) {
        let spec = GridSpec { rows: 70, cols: 90, ego_row: 50, ego_col: 45, ..GridSpec::default() };
        compare(spec, (0..70, 0..90), &cells, (action, direction))?;
    }

    #[test]
    fn bitmaps_agree_where_tiles_and_parts_of_a_map_meet(
        cells in proptest::collection::vec((470i32..560, 200i32..310), 0..12),
        action in 0u16..368, direction: u8,
    ) {
        let spec = GridSpec {
            rows: 560,
            cols: 310,
            ego_row: 540,
            ego_col: 45,
            ..GridSpec::default()
        };
        compare(spec, (500..525, 240..270), &cells, (action, direction))?;
        compare(spec, (550..560, 300..310), &cells, (action, direction))?;
    }
}

#[test]
fn what_lies_beyond_the_edge_is_free_but_an_obstacle_inside_is_not() {
    let spec = GridSpec {
        rows: 30,
        cols: 30,
        ego_row: 0,
        ego_col: 0,
        ..GridSpec::default()
    };
    let map = map_of(spec, &[(5, 0)]);
    assert!(map.pose_is_free(&Pose2::new(0.0, 0.0, 0.0)));
    assert!(!map.pose_is_free(&Pose2::new(0.0, 0.0, std::f64::consts::PI)));
    assert!(map.pose_is_free(&Pose2::new(-5.0, -4.0, 0.5)));
    assert!(!map.pose_is_free(&Pose2::new(f64::NAN, 0.0, 0.0)));
}

#[test]
fn turning_sweeps_what_neither_heading_touches() {
    let model = MotionModel::new(&Vehicle::default(), 0.2).unwrap();
    let covered = |kernel: &Kernel, other: &Kernel| {
        let cells = |k: &Kernel| -> Vec<(i32, i32)> {
            let of = |s: &crate::kernel::Span| {
                let row = s.d_row;
                (s.first_col..=s.last_col)
                    .map(move |col| (row, col))
                    .collect::<Vec<_>>()
            };
            k.spans.iter().flat_map(of).collect()
        };
        let inside = cells(other);
        cells(kernel).iter().all(|cell| inside.contains(cell))
    };
    for direction in 0..=u8::MAX {
        let next = Side::Left.turned(direction, 1);
        let turn = &model.turns[usize::from(direction)];
        assert!(covered(&model.poses[usize::from(direction)], turn));
        assert!(covered(&model.poses[usize::from(next)], turn));
    }
}

#[test]
fn planes_and_models_that_do_not_fit_are_refused() {
    let model = Arc::new(MotionModel::new(&Vehicle::default(), 0.2).unwrap());
    let spec = GridSpec::default();
    let small = Plane::empty(10, 10);
    assert!(CollisionMap::new(Arc::clone(&model), spec, &small).is_err());
    let coarse = GridSpec {
        resolution_m: 0.4,
        ..spec
    };
    let plane = Plane::empty(spec.rows, spec.cols);
    assert!(CollisionMap::new(model, coarse, &plane).is_err());
}
