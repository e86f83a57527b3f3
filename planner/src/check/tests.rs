use proptest::prelude::*;
use swath_bridge::Cell;

use super::*;

const LIMIT_PER_M: f64 = 1.0 / 5.5;

/// Drives with a list of rates of curvature, 1/m², 0.2 m each, in tiny steps.
fn drive(rates: &[f64]) -> Vec<PathPoint> {
    const PIECES: u32 = 2000;
    let mut point = PathPoint::default();
    let mut points = vec![point];
    for rate in rates {
        let ds = 0.2 / f64::from(PIECES);
        for _ in 0..PIECES {
            let middle = point.pose.yaw_rad + 0.5 * ds * point.curvature_per_m;
            point.pose.x_m += ds * middle.cos();
            point.pose.y_m += ds * middle.sin();
            point.pose.yaw_rad += ds * (point.curvature_per_m + 0.5 * ds * rate);
            point.curvature_per_m += ds * rate;
        }
        point.at_m = 0.2 * points.len() as f64;
        points.push(point);
    }
    points
}

/// Straight on, then left as tightly as allowed, then right again.
fn bends() -> Vec<PathPoint> {
    let mut rates = vec![0.0; 10];
    rates.extend([0.3, 0.3, 0.3, 0.0, 0.0, 0.0, 0.0]);
    rates.extend([-0.3; 6]);
    rates.extend([0.0, 0.0, 0.3, 0.3, 0.3, 0.0]);
    drive(&rates)
}

fn limits() -> CheckLimits {
    CheckLimits::new(&Vehicle::default(), LIMIT_PER_M)
}

fn ends_of(points: &[PathPoint]) -> Ends {
    Ends {
        start: points[0].pose,
        start_curvature_per_m: Some(points[0].curvature_per_m),
        goal: points[points.len() - 1].pose,
    }
}

fn empty() -> Plane {
    let spec = GridSpec::default();
    Plane::empty(spec.rows, spec.cols)
}

/// The kinds of fault of a path that should be as [`bends`].
fn faults(points: &[PathPoint]) -> Vec<Fault> {
    let ends = ends_of(&bends());
    let found = check_path((&GridSpec::default(), &empty()), &limits(), &ends, points);
    let mut faults: Vec<Fault> = found.iter().map(|violation| violation.fault).collect();
    faults.sort_unstable();
    faults.dedup();
    faults
}

#[test]
fn a_path_of_clothoids_within_the_limits_passes() {
    assert_eq!(faults(&bends()), []);
}

#[test]
fn a_shifted_pose_is_a_jump_aside() {
    for (dx, dy) in [(0.0, 0.003), (0.0, -0.003), (0.003, 0.0)] {
        for index in [1, 12, 20] {
            let mut points = bends();
            points[index].pose.x_m += dx;
            points[index].pose.y_m += dy;
            let found = faults(&points);
            let jumps = [Fault::Sideways, Fault::ArcLength, Fault::Curvature];
            assert!(
                found.iter().any(|fault| jumps.contains(fault)),
                "{index} {found:?}"
            );
            assert!(
                found.contains(&Fault::CurvatureMisstated) || dx != 0.0,
                "{found:?}"
            );
        }
    }
}

#[test]
fn everything_behind_a_gap_is_a_jump() {
    let mut points = bends();
    for point in &mut points[15..] {
        point.pose.y_m += 0.05;
    }
    assert!(faults(&points).contains(&Fault::Sideways));
    let mut points = bends();
    points.remove(14);
    assert!(faults(&points).contains(&Fault::Spacing));
    let mut points = bends();
    points.insert(14, points[14]);
    assert!(faults(&points).contains(&Fault::Spacing));
}

#[test]
fn a_turned_pose_is_a_jump_of_the_heading() {
    let mut points = bends();
    for point in &mut points[5..] {
        point.pose.yaw_rad += 0.05;
    }
    let found = faults(&points);
    assert!(found.contains(&Fault::HeadingJump) && found.contains(&Fault::Sideways));
}

#[test]
fn driving_back_is_a_cusp() {
    let mut points = drive(&[0.0; 10]);
    let forth = points.len();
    for step in 1..4u32 {
        let back = PathPoint {
            at_m: 2.0 + 0.2 * f64::from(step),
            pose: Pose2::new(2.0 - 0.2 * f64::from(step), 0.0, 0.0),
            ..PathPoint::default()
        };
        points.push(back);
    }
    let ends = ends_of(&points);
    let found = check_path((&GridSpec::default(), &empty()), &limits(), &ends, &points);
    let cusps: Vec<_> = found
        .iter()
        .filter(|violation| violation.fault == Fault::Cusp)
        .collect();
    assert_eq!(cusps.len(), 3);
    assert_eq!(cusps[0].at_m, points[forth - 1].at_m);
    assert!((cusps[0].amount - std::f64::consts::PI).abs() < 1e-9);
}

#[test]
fn a_bend_that_is_2_percent_too_tight_is_seen_even_if_it_is_not_stated() {
    let tighter = CheckLimits::new(&Vehicle::default(), 0.18 / 1.02);
    let ends = ends_of(&bends());
    let found = check_path((&GridSpec::default(), &empty()), &tighter, &ends, &bends());
    assert!(
        found
            .iter()
            .any(|violation| violation.fault == Fault::Curvature)
    );
    let mut understated = bends();
    for point in &mut understated {
        point.curvature_per_m /= 1.05;
    }
    let found = check_path(
        (&GridSpec::default(), &empty()),
        &tighter,
        &ends,
        &understated,
    );
    let kinds: Vec<_> = found.iter().map(|violation| violation.fault).collect();
    assert!(kinds.contains(&Fault::Curvature) && kinds.contains(&Fault::CurvatureMisstated));
}

#[test]
fn curvature_that_changes_too_fast_is_seen_from_headings_alone() {
    let points = drive(&[0.0, 0.0, 0.32, 0.32, 0.0, 0.0]);
    let ends = ends_of(&points);
    let found = check_path((&GridSpec::default(), &empty()), &limits(), &ends, &points);
    let rates = found
        .iter()
        .filter(|violation| violation.fault == Fault::CurvatureRate);
    // Two stated changes and the one between them that the turns show.
    assert_eq!(rates.count(), 3);
    // A turn on the spot, as chords have it.
    let mut points = drive(&[0.0; 8]);
    for point in &mut points[4..] {
        let (sin, cos) = 0.1f64.sin_cos();
        let ahead = point.pose.x_m - 0.8;
        point.pose = Pose2::new(0.8 + cos * ahead, sin * ahead, 0.1);
    }
    let ends = ends_of(&points);
    let found = check_path((&GridSpec::default(), &empty()), &limits(), &ends, &points);
    let kinds: Vec<_> = found.iter().map(|violation| violation.fault).collect();
    for fault in [
        Fault::CurvatureRate,
        Fault::HeadingJump,
        Fault::CurvatureMisstated,
    ] {
        assert!(kinds.contains(&fault), "{kinds:?}");
    }
}

#[test]
fn start_and_goal_are_held_to() {
    let points = bends();
    let check = |ends: &Ends| {
        let found = check_path((&GridSpec::default(), &empty()), &limits(), ends, &points);
        found
            .iter()
            .map(|violation| violation.fault)
            .collect::<Vec<_>>()
    };
    let good = ends_of(&points);
    let moved = |pose: &Pose2, x_m: f64, yaw_rad: f64| {
        Pose2::new(pose.x_m + x_m, pose.y_m, pose.yaw_rad + yaw_rad)
    };
    for (start, fault) in [
        (moved(&good.start, 1e-6, 0.0), Fault::WrongStart),
        (moved(&good.start, 0.0, 1e-6), Fault::WrongStart),
    ] {
        assert_eq!(check(&Ends { start, ..good }), [fault]);
    }
    let bent = Ends {
        start_curvature_per_m: Some(0.01),
        ..good
    };
    assert_eq!(check(&bent), [Fault::WrongStartCurvature]);
    for (goal, faults) in [
        (moved(&good.goal, 0.499, 0.0), vec![]),
        (moved(&good.goal, -0.501, 0.0), vec![Fault::GoalMissed]),
        (moved(&good.goal, 0.0, 14.9f64.to_radians()), vec![]),
        (
            moved(&good.goal, 0.0, -15.1f64.to_radians()),
            vec![Fault::GoalTurned],
        ),
        (moved(&good.goal, 0.0, std::f64::consts::TAU), vec![]),
    ] {
        assert_eq!(check(&Ends { goal, ..good }), faults);
    }
}

#[test]
fn numbers_that_are_not_and_paths_that_are_none_are_named() {
    assert_eq!(faults(&[]), [Fault::NoPath]);
    assert_eq!(faults(&bends()[..1]), [Fault::NoPath]);
    for spoil in [
        |point: &mut PathPoint| point.pose.x_m = f64::NAN,
        |point: &mut PathPoint| point.pose.yaw_rad = f64::INFINITY,
        |point: &mut PathPoint| point.curvature_per_m = f64::NAN,
        |point: &mut PathPoint| point.at_m = f64::NEG_INFINITY,
    ] {
        let mut points = bends();
        spoil(&mut points[7]);
        assert_eq!(faults(&points), [Fault::NotFinite]);
    }
    // Far beyond any map, and with pieces of any length, nothing takes long or panics.
    let mut points = bends();
    points[9].pose.x_m = 1e300;
    assert!(faults(&points).contains(&Fault::OffMap));
}

#[test]
fn a_corner_that_touches_between_two_points_is_a_collision() {
    let points = bends();
    let spec = GridSpec::default();
    let ends = ends_of(&points);
    let vehicle = Vehicle::default();
    // The outer front corner in the middle of the tight bend to the left is the right one; a cell is
    // moved towards it until they meet.
    let (front, width) = (vehicle.front_m, vehicle.half_width_m);
    let pose = points[16].pose;
    let (sin, cos) = pose.yaw_rad.sin_cos();
    let corner = (
        pose.x_m + front * cos + width * sin,
        pose.y_m + front * sin - width * cos,
    );
    let mut seen = Vec::new();
    for aside in 0..6 {
        let mut obstacles = empty();
        let cell = spec.cell_at(corner.0, corner.1 - 0.1 * f64::from(aside));
        obstacles.set(cell);
        let found = check_path((&spec, &obstacles), &limits(), &ends, &points);
        assert!(
            found
                .iter()
                .all(|violation| violation.fault == Fault::Collision)
        );
        seen.push(!found.is_empty());
    }
    assert!(seen[0] && !seen[5], "{seen:?}");
    // Inside of the vehicle, where no edge passes at the start.
    let mut obstacles = empty();
    obstacles.set(Cell::new(292, 75));
    let found = check_path((&spec, &obstacles), &limits(), &ends, &points);
    assert_eq!((found[0].fault, found[0].at_m), (Fault::Collision, 0.0));
}

/// Whether one of the points of a rectangle, a centimetre apart and its edges included, is in a square.
fn touched_by_points(vehicle: &Vehicle, pose: &Pose2, centre: (f64, f64), side_m: f64) -> bool {
    let (sin, cos) = pose.yaw_rad.sin_cos();
    let along = vehicle.front_m + vehicle.rear_m;
    let (rows, cols) = (
        (along / 0.01).ceil(),
        (2.0 * vehicle.half_width_m / 0.01).ceil(),
    );
    let mut row = 0.0;
    while row <= rows {
        let ahead = -vehicle.rear_m + along * row / rows;
        let mut col = 0.0;
        while col <= cols {
            let left = vehicle.half_width_m * (2.0 * col / cols - 1.0);
            let x_m = pose.x_m + ahead * cos - left * sin;
            let y_m = pose.y_m + ahead * sin + left * cos;
            let half = side_m / 2.0;
            if (x_m - centre.0).abs() <= half && (y_m - centre.1).abs() <= half {
                return true;
            }
            col += 1.0;
        }
        row += 1.0;
    }
    false
}

proptest! {
    #[test]
    fn overlaps_agree_with_a_rasterised_footprint(
        x in -1.0..1.0f64, y in -1.0..1.0f64, yaw in -7.0..7.0f64,
        ahead in -1.5..4.5f64, left in -1.6..1.6f64,
    ) {
        let vehicle = Vehicle::default();
        let pose = Pose2::new(x, y, yaw);
        let (sin, cos) = yaw.sin_cos();
        let centre = (x + ahead * cos - left * sin, y + ahead * sin + left * cos);
        let overlap = overlap_m(&vehicle, &pose, centre, 0.2);
        let touched = touched_by_points(&vehicle, &pose, centre, 0.2);
        prop_assert!(!touched || overlap >= -1e-12, "{overlap}");
        // What overlaps by more than the points' distance holds one of them.
        prop_assert!(touched || overlap < 0.015, "{overlap}");
    }

    #[test]
    fn no_occupied_cell_is_overlooked(
        seed in 0u64..1_000_000, x in -25.0..65.0f64, y in -20.0..20.0f64, yaw in -3.2..3.2f64,
    ) {
        let (spec, vehicle) = (GridSpec::default(), Vehicle::default());
        let mut obstacles = empty();
        for k in 0..3000u64 {
            let hash = (seed * 3000 + k).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 20;
            let index = usize::try_from(hash % spec.len() as u64).unwrap();
            obstacles.set_index(index);
        }
        let pose = Pose2::new(x, y, yaw);
        let all = (0..spec.len()).filter(|&index| obstacles.get_index(index));
        let overlaps = all.map(|index| {
            let centre = spec.centre_of(spec.cell_of_index(index));
            overlap_m(&vehicle, &pose, centre, spec.resolution_m)
        });
        let worst = overlaps.filter(|&overlap| overlap >= 0.0).reduce(f64::max);
        let found = rectangle::worst_overlap_m(&spec, &obstacles, &vehicle, &pose);
        match (worst, found) {
            (None, None) => {}
            (Some(worst), Some(found)) => prop_assert!((worst - found).abs() < 1e-9),
            other => prop_assert!(false, "{other:?}"),
        }
    }

    #[test]
    fn whatever_rates_within_the_limits_pass_and_one_beyond_does_not(
        rates in prop::collection::vec(-0.3..0.3f64, 20), at in 2usize..18,
    ) {
        let mut curvature = 0.0;
        let within: Vec<f64> = rates.iter().map(|rate| {
            let next: f64 = (curvature + 0.2 * rate).clamp(-LIMIT_PER_M, LIMIT_PER_M);
            let rate = (next - curvature) / 0.2;
            curvature = next;
            rate
        }).collect();
        let points = drive(&within);
        let spec = GridSpec::default();
        let found = check_path((&spec, &empty()), &limits(), &ends_of(&points), &points);
        prop_assert!(found.is_empty(), "{found:?}");
        let mut beyond = within;
        beyond[at] = 0.31f64.copysign(beyond[at]);
        let points = drive(&beyond);
        let found = check_path((&spec, &empty()), &limits(), &ends_of(&points), &points);
        prop_assert!(found.iter().any(|violation| violation.fault == Fault::CurvatureRate));
    }

    #[test]
    fn a_pose_between_two_lies_on_the_clothoid(rate in -0.3..0.3f64, from in -0.18..0.18f64) {
        // Twice 0.1 m: the middle of the whole is known.
        let points = drive(&[from / 0.2, rate / 4.0]);
        let fine = drive(&[from / 0.2]);
        prop_assert_eq!(points[1], fine[1]);
        let (a, b) = (points[1].pose, points[2].pose);
        let middle = curve::between(&a, &b, 0.5);
        let s = 0.1;
        let yaw = a.yaw_rad + s * from + s * s * rate / 8.0;
        prop_assert!((middle.yaw_rad - yaw).abs() < 1e-4);
        for (share, end) in [(0.0, a), (1.0, b)] {
            let pose = curve::between(&a, &b, share);
            prop_assert!(pose.distance_m(&end) < 1e-12);
            prop_assert!((pose.yaw_rad - end.yaw_rad).abs() < 1e-9);
        }
    }
}
