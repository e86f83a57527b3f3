use std::sync::{Arc, OnceLock};

use proptest::prelude::*;
use swath_bridge::{Cell, GridSpec, Outcome};

use super::*;
use crate::check::{CheckLimits, Ends, Violation, check_path};
use crate::search::{Limits as SearchLimits, SearchMemory, search};
use crate::{CollisionMap, Guidance, MotionModel, Plane};

const SPEED_M_PER_S: f64 = 1.4;

fn model() -> Arc<MotionModel> {
    static MODEL: OnceLock<Arc<MotionModel>> = OnceLock::new();
    let model = || Arc::new(MotionModel::new(&Vehicle::default(), 0.2).unwrap());
    Arc::clone(MODEL.get_or_init(model))
}

fn smoother() -> Smoother {
    Smoother::new(&Vehicle::default(), SmoothConfig::default()).unwrap()
}

/// Numbers in [0, 1) from a seed.
fn dice(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    move || {
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut mixed = (state ^ (state >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (mixed >> 11) as f64 / 9_007_199_254_740_992.0
    }
}

/// Boxes anywhere but around the vehicle.
fn boxes(seed: u64, count: u32) -> Plane {
    let spec = GridSpec::default();
    let mut plane = Plane::empty(spec.rows, spec.cols);
    let mut roll = dice(seed);
    for _ in 0..count {
        let (x_m, y_m) = (75.0 * roll() - 15.0, 30.0 * roll() - 15.0);
        let (length_m, width_m) = (0.2 + 3.0 * roll() * roll(), 0.2 + 3.0 * roll() * roll());
        let first = spec.cell_at(x_m + length_m / 2.0, y_m + width_m / 2.0);
        let last = spec.cell_at(x_m - length_m / 2.0, y_m - width_m / 2.0);
        for row in first.row..=last.row {
            for col in first.col..=last.col {
                if !((265..310).contains(&row) && (66..85).contains(&col)) {
                    plane.set(Cell::new(row, col));
                }
            }
        }
    }
    plane
}

/// The chord path to a goal, if one is found soon.
fn chords(plane: &Plane, goal: &Pose2, speed_m_per_s: f64) -> Option<Vec<Pose2>> {
    let model = model();
    let successors = model.successors(speed_m_per_s);
    let map = CollisionMap::new(model, GridSpec::default(), plane).unwrap();
    let limits = SearchLimits {
        max_expansions: Some(20_000),
        stop: None,
    };
    let mut memory = SearchMemory::new();
    let result = search(
        &map,
        &successors,
        (goal, Guidance::NONE),
        limits,
        &mut memory,
    )
    .unwrap();
    (result.outcome == Outcome::Solved).then_some(result.path)
}

fn request(chords: &[Pose2], goal: Pose2) -> SmoothRequest<'_> {
    SmoothRequest {
        chords,
        goal,
        tolerance: GoalTolerance::default(),
        speed_m_per_s: SPEED_M_PER_S,
        start_curvature_per_m: Some(0.0),
        stop: None,
    }
}

/// What the checker says of a path that is to keep to a share of the vehicle's limits.
fn violations(
    plane: &Plane,
    request: &SmoothRequest<'_>,
    path: &DrivablePath,
    (curvature_per_m, rate_share): (f64, f64),
) -> Vec<Violation> {
    let mut limits = CheckLimits::new(&Vehicle::default(), curvature_per_m);
    limits.max_curvature_rate_per_m2 *= rate_share;
    let ends = Ends {
        start: request.chords[0],
        start_curvature_per_m: request.start_curvature_per_m,
        goal: request.goal,
    };
    check_path((&GridSpec::default(), plane), &limits, &ends, &path.points)
}

fn mirrored(pose: &Pose2) -> Pose2 {
    Pose2::new(pose.x_m, -pose.y_m, -pose.yaw_rad)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn a_path_is_as_drivable_as_it_says_and_hits_nothing_whatever_it_says(
        seed in 0u64..1_000_000, count in 10u32..70,
        x in 5.0..45.0f64, y in -11.0..11.0f64, turn in -0.6..0.6f64, fast in prop::bool::ANY,
    ) {
        let plane = boxes(seed, count);
        let goal = Pose2::new(x, y, 1.2 * libm::atan2(y, x) + turn);
        let speed_m_per_s = if fast { 5.0 } else { SPEED_M_PER_S };
        let Some(chords) = chords(&plane, &goal, speed_m_per_s) else { return Ok(()) };
        let cells = ObstacleCells::new(GridSpec::default(), &plane).unwrap();
        let request = SmoothRequest { speed_m_per_s, ..request(&chords, goal) };
        let mut smoother = smoother();
        let path = smoother.smooth(&cells, &request);
        let at_most = 1.0 / Vehicle::default().min_turning_radius_m;
        let limits = match path.drivability {
            Drivability::AtSpeed => (smoother.curvature_limit_per_m(speed_m_per_s), 1.0),
            Drivability::Slower => (at_most, 1.0),
            Drivability::TooTight => (2.0 * at_most, 4.0),
            Drivability::TurnsOnTheSpot => {
                let poses: Vec<_> = path.points.iter().map(|point| point.pose).collect();
                prop_assert_eq!(&poses, &chords);
                return Ok(());
            }
        };
        let found = violations(&plane, &request, &path, limits);
        prop_assert!(found.is_empty(), "{:?} {found:?}", path.drivability);
        prop_assert_eq!(path.is_drivable(), path.shortfall.is_none());
    }
}

#[test]
fn nearly_all_paths_of_a_sweep_can_be_driven() {
    let mut smoother = smoother();
    let (mut paths, mut drivable) = (0, 0);
    for seed in 0..120 {
        let plane = boxes(seed, 40);
        let cells = ObstacleCells::new(GridSpec::default(), &plane).unwrap();
        let goal = Pose2::new(12.0 + 0.25 * seed as f64, 5.0 - 0.08 * seed as f64, 0.0);
        let Some(chords) = chords(&plane, &goal, SPEED_M_PER_S) else {
            continue;
        };
        paths += 1;
        drivable += u32::from(
            smoother
                .smooth(&cells, &request(&chords, goal))
                .is_drivable(),
        );
    }
    assert!(paths >= 60, "{paths} paths");
    assert!(
        f64::from(drivable) >= 0.97 * f64::from(paths),
        "{drivable} of {paths}"
    );
}

#[test]
fn straight_lines_stay_straight() {
    let spec = GridSpec::default();
    let plane = Plane::empty(spec.rows, spec.cols);
    let cells = ObstacleCells::new(spec, &plane).unwrap();
    let goal = Pose2::new(30.1, 0.0, 0.0);
    let chords = chords(&plane, &goal, SPEED_M_PER_S).unwrap();
    let path = smoother().smooth(&cells, &request(&chords, goal));
    assert!(path.is_drivable());
    for point in &path.points {
        assert_eq!(
            (point.pose.y_m, point.pose.yaw_rad, point.curvature_per_m),
            (0.0, 0.0, 0.0)
        );
    }
}

#[test]
fn mirrored_problems_have_mirrored_paths() {
    let spec = GridSpec::default();
    let mut compared = 0;
    for seed in 0..12 {
        let plane = boxes(seed, 40);
        let mut other_plane = Plane::empty(spec.rows, spec.cols);
        for index in (0..plane.len()).filter(|&index| plane.get_index(index)) {
            let cell = spec.cell_of_index(index);
            other_plane.set(Cell::new(cell.row, 150 - cell.col));
        }
        let goal = Pose2::new(25.0, 6.0, 0.1);
        let Some(chords) = chords(&plane, &goal, SPEED_M_PER_S) else {
            continue;
        };
        let other_chords: Vec<_> = chords.iter().map(mirrored).collect();
        let smooth = |plane: &Plane, chords: &[Pose2], goal: Pose2| {
            let cells = ObstacleCells::new(spec, plane).unwrap();
            smoother().smooth(&cells, &request(chords, goal))
        };
        let path = smooth(&plane, &chords, goal);
        let other = smooth(&other_plane, &other_chords, mirrored(&goal));
        assert_eq!(path.drivability, other.drivability);
        assert_eq!(path.points.len(), other.points.len());
        for (point, other) in path.points.iter().zip(&other.points) {
            let back = mirrored(&other.pose);
            assert!(
                point.pose.distance_m(&back) < 1e-6,
                "seed {seed} at {}",
                point.at_m
            );
            assert!((point.curvature_per_m + other.curvature_per_m).abs() < 1e-6);
        }
        compared += 1;
    }
    assert!(compared >= 6, "{compared} compared");
}

#[test]
fn earlier_paths_leave_no_trace() {
    let spec = GridSpec::default();
    let mut used = smoother();
    for seed in [3, 5, 8] {
        let plane = boxes(seed, 30);
        let cells = ObstacleCells::new(spec, &plane).unwrap();
        for goal in [Pose2::new(30.0, 3.0, 0.0), Pose2::new(15.0, -4.0, -0.3)] {
            let Some(chords) = chords(&plane, &goal, SPEED_M_PER_S) else {
                continue;
            };
            let again = used.smooth(&cells, &request(&chords, goal));
            assert_eq!(again, smoother().smooth(&cells, &request(&chords, goal)));
        }
    }
}

#[test]
fn the_starts_curvature_is_kept_clamped_or_free() {
    let spec = GridSpec::default();
    let plane = Plane::empty(spec.rows, spec.cols);
    let cells = ObstacleCells::new(spec, &plane).unwrap();
    let goal = Pose2::new(20.0, 8.0, 0.8);
    let chords = chords(&plane, &goal, SPEED_M_PER_S).unwrap();
    let first_curvature = |start_curvature_per_m: Option<f64>| {
        let request = SmoothRequest {
            start_curvature_per_m,
            stop: None,
            ..request(&chords, goal)
        };
        let path = smoother().smooth(&cells, &request);
        let first = path.points[0].curvature_per_m;
        assert_eq!(path.points[0].pose, chords[0]);
        assert!(path.is_drivable());
        let kept = SmoothRequest {
            start_curvature_per_m: Some(first),
            stop: None,
            ..request
        };
        assert_eq!(violations(&plane, &kept, &path, (1.0 / 5.5, 1.0)), []);
        first
    };
    assert_eq!(first_curvature(Some(-0.1)), -0.1);
    assert_eq!(first_curvature(Some(0.4)), 1.0 / 5.5);
    // A vehicle that stands steers first: here to the left, where the goal is.
    assert!(first_curvature(None) > 0.01);
}

#[test]
fn what_only_a_slower_vehicle_can_drive_says_so() {
    let spec = GridSpec::default();
    let plane = Plane::empty(spec.rows, spec.cols);
    let cells = ObstacleCells::new(spec, &plane).unwrap();
    let goal = Pose2::new(15.0, 6.0, 0.8);
    let chords = chords(&plane, &goal, SPEED_M_PER_S).unwrap();
    let fast = SmoothRequest {
        speed_m_per_s: 15.0,
        ..request(&chords, goal)
    };
    let path = smoother().smooth(&cells, &fast);
    assert_eq!(
        (path.drivability, path.shortfall),
        (Drivability::Slower, Some(Shortfall::Goal))
    );
    assert!(path.max_curvature_per_m() > smoother().curvature_limit_per_m(15.0));
    assert_eq!(violations(&plane, &fast, &path, (1.0 / 5.5, 1.0)), []);
}

#[test]
fn what_cannot_be_driven_is_flagged() {
    let spec = GridSpec::default();
    let mut plane = Plane::empty(spec.rows, spec.cols);
    for col in 0..spec.cols {
        plane.set(Cell::new(240, i32::try_from(col).unwrap()));
    }
    let cells = ObstacleCells::new(spec, &plane).unwrap();
    // Chords right through a wall.
    let through: Vec<_> = (0..100)
        .map(|k| Pose2::new(0.2 * f64::from(k), 0.0, 0.0))
        .collect();
    let path = smoother().smooth(&cells, &request(&through, Pose2::new(19.8, 0.0, 0.0)));
    assert_eq!(path.drivability, Drivability::TurnsOnTheSpot);
    assert!(path.shortfall.is_some());
    // A right angle two metres ahead.
    let mut corner: Vec<_> = (0..10)
        .map(|k| Pose2::new(0.2 * f64::from(k), 0.0, 0.0))
        .collect();
    corner.extend((0..10).map(|k| Pose2::new(1.8, 0.2 * f64::from(k), 1.57)));
    let path = smoother().smooth(&cells, &request(&corner, Pose2::new(1.8, 1.8, 1.57)));
    assert!(!path.is_drivable());
}

#[test]
fn nothing_panics_on_hostile_input() {
    let spec = GridSpec::default();
    let plane = boxes(1, 60);
    let cells = ObstacleCells::new(spec, &plane).unwrap();
    let pose = Pose2::new;
    let lots: Vec<_> = (0..20_000)
        .map(|k| pose(f64::from(k % 2), 0.0, 0.0))
        .collect();
    for chords in [
        vec![],
        vec![pose(0.0, 0.0, 0.0)],
        vec![pose(0.0, 0.0, 0.0); 3],
        vec![pose(0.0, 0.0, 0.0), pose(f64::NAN, 0.0, 0.0)],
        vec![pose(0.0, 0.0, 0.0), pose(1e300, -1e300, 0.0)],
        vec![
            pose(0.0, 0.0, 0.0),
            pose(0.0, 0.0, 9.0),
            pose(1e-9, 0.0, 0.0),
        ],
        vec![pose(900.0, 0.0, 0.0), pose(901.0, 0.0, 0.0)],
        lots,
    ] {
        for goal in [
            pose(0.0, 0.0, 0.0),
            pose(1e300, 0.0, 0.0),
            pose(0.0, f64::INFINITY, 0.0),
        ] {
            let path = smoother().smooth(&cells, &request(&chords, goal));
            assert!(path.points.len() <= chords.len().max(2));
            assert!(!path.is_drivable());
        }
    }
    let chords = [pose(0.0, 0.0, 0.0), pose(5.0, 0.0, 0.0)];
    for speed_m_per_s in [f64::NAN, f64::INFINITY, -3.0] {
        let request = SmoothRequest {
            speed_m_per_s,
            ..request(&chords, pose(5.0, 0.0, 0.0))
        };
        smoother().smooth(&cells, &request);
    }
    let bent = SmoothRequest {
        start_curvature_per_m: Some(f64::NAN),
        stop: None,
        ..request(&chords, pose(5.0, 0.0, 0.0))
    };
    assert_eq!(
        smoother().smooth(&cells, &bent).shortfall,
        Some(Shortfall::Input)
    );
}

#[test]
fn settings_out_of_range_are_named() {
    for (iterations, gap_m) in [(0, 0.2), (60, f64::NAN), (60, -1.0), (60, 50.0)] {
        let config = SmoothConfig {
            preferred_gap_m: gap_m,
            max_iterations: iterations,
        };
        let made = Smoother::new(&Vehicle::default(), config);
        assert!(matches!(made, Err(Error::SmoothConfig { .. })));
    }
}
