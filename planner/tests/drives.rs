//! Hybrid A* and RRT*: every path is a drive within the limits that hits nothing, by the independent
//! checker, with and without a region, on small random maps and on the six real problems.

use std::collections::BTreeMap;
use std::sync::Arc;

use proptest::prelude::*;
use swath_bridge::{Cell, GridSpec, Outcome, Pose2, Vehicle};
use swath_planner::check::{CheckLimits, Ends, Fault, check_path};
use swath_planner::search::TargetResult;
use swath_planner::{
    CollisionMap, Method, MotionModel, PathPoint, PlanConfig, Plane, Planner, dubins,
};

mod data;

const PLAIN: [Method; 2] = [Method::Hybrid, Method::RrtStar];
const ALL: [Method; 4] = [
    Method::Hybrid,
    Method::HybridFcn,
    Method::RrtStar,
    Method::RrtStarFcn,
];

/// The poses of a path with arc lengths and the curvature of the piece behind each.
fn points(path: &[Pose2]) -> Vec<PathPoint> {
    let mut points = Vec::new();
    let mut at_m = 0.0;
    for pair in path.windows(2) {
        let turn = (pair[1].yaw_rad - pair[0].yaw_rad).sin();
        let turn = turn.asin();
        let half = (0.5 * turn).abs().max(1e-9);
        let length_m = pair[0].distance_m(&pair[1]) * half / half.sin();
        let curvature_per_m = turn / length_m;
        points.push(PathPoint {
            pose: pair[0],
            curvature_per_m,
            at_m,
        });
        at_m += length_m;
    }
    points.push(PathPoint {
        pose: path[path.len() - 1],
        curvature_per_m: points.last().map_or(0.0, |point| point.curvature_per_m),
        at_m,
    });
    points
}

/// A path of arcs must be sound in all but how fast the curvature changes where one follows another.
fn assert_sound(
    ground: (&GridSpec, &Plane),
    model: &MotionModel,
    (goal, speed_m_per_s): (Pose2, f64),
    result: &TargetResult,
) {
    let curvature_per_m = model.vehicle().curvature_limit_per_m(speed_m_per_s);
    let limits = CheckLimits::new(model.vehicle(), curvature_per_m);
    let ends = Ends {
        start: Pose2::default(),
        start_curvature_per_m: None,
        goal,
    };
    let points = points(&result.path);
    if points.len() > 1 {
        let mut found = check_path(ground, &limits, &ends, &points);
        found.retain(|one| !matches!(one.fault, Fault::CurvatureRate | Fault::CurvatureMisstated));
        assert!(found.is_empty(), "{goal:?}: {found:?}");
    }
    let length_m = points[points.len() - 1].at_m;
    assert!((result.length_m - length_m).abs() < 1e-3);
    let turned = result.path.windows(2).map(|pair| {
        let turn = (pair[1].yaw_rad - pair[0].yaw_rad).sin();
        turn.asin().abs()
    });
    let cost = length_m + turned.sum::<f64>();
    assert!((result.cost - cost).abs() < 1e-3, "{} {cost}", result.cost);
}

fn small_spec() -> GridSpec {
    GridSpec {
        rows: 60,
        cols: 45,
        resolution_m: 0.2,
        ego_row: 50,
        ego_col: 22,
    }
}

fn small_model() -> Arc<MotionModel> {
    let vehicle = Vehicle {
        wheelbase_m: 0.6,
        front_m: 0.8,
        rear_m: 0.25,
        half_width_m: 0.3,
        min_turning_radius_m: 1.5,
        ..Vehicle::default()
    }
    .with_limits_of_its_size();
    Arc::new(MotionModel::new(&vehicle, 0.2).expect("the vehicle fits the cells"))
}

/// Blocks of cells by their first row and column and their sides.
fn blocked(spec: &GridSpec, blocks: &[(i32, i32, i32, i32)]) -> Plane {
    let mut plane = Plane::empty(spec.rows, spec.cols);
    for &(row, col, rows, cols) in blocks {
        for row in row..row + rows {
            for col in col..col + cols {
                plane.set(Cell::new(row, col));
            }
        }
    }
    plane
}

fn config(method: Method, speed_m_per_s: f64) -> PlanConfig {
    PlanConfig {
        method,
        speed_m_per_s,
        max_expansions: 1500,
        ..PlanConfig::default()
    }
}

fn block() -> impl Strategy<Value = (i32, i32, i32, i32)> {
    (0..60i32, 0..45i32, 1..12i32, 1..12i32)
}

fn goal() -> impl Strategy<Value = Pose2> {
    (-1.5..9.5f64, -4.2..4.2f64, -3.1..3.1f64).prop_map(|(x, y, yaw)| Pose2::new(x, y, yaw))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn every_path_is_sound_and_comes_again(
        blocks in proptest::collection::vec(block(), 0..7),
        goals in proptest::collection::vec(goal(), 1..4),
        region in proptest::collection::vec(block(), 1..7),
        is_fast: bool,
    ) {
        let (spec, model) = (small_spec(), small_model());
        let obstacles = blocked(&spec, &blocks);
        let map = CollisionMap::new(Arc::clone(&model), spec, &obstacles).unwrap();
        let regions = vec![blocked(&spec, &region); goals.len()];
        let speed = if is_fast { 4.0 } else { 1.4 };
        let planner = Planner::new();
        let plan = |planner: &Planner, method: Method| {
            let regions = method.needs_regions().then_some(regions.as_slice());
            let plans = planner.plan(&map, &goals, regions, &config(method, speed)).unwrap();
            plans.into_iter().map(|plan| plan.result).collect::<Vec<_>>()
        };
        for method in ALL {
            let results = plan(&planner, method);
            for (goal, result) in goals.iter().zip(&results) {
                if result.outcome == Outcome::Solved {
                    assert_sound((&spec, &obstacles), &model, (*goal, speed), result);
                } else {
                    prop_assert!(result.path.is_empty() && result.cost.is_nan());
                }
            }
            let again = plan(&Planner::new(), method);
            for (one, other) in results.iter().zip(&again) {
                prop_assert_eq!(one.outcome, other.outcome);
                prop_assert_eq!((&one.path, one.steps), (&other.path, other.steps));
            }
        }
    }

    #[test]
    fn what_is_called_unreachable_no_other_method_reaches(
        blocks in proptest::collection::vec(block(), 4..16), goal in goal(),
    ) {
        let (spec, model) = (small_spec(), small_model());
        let obstacles = blocked(&spec, &blocks);
        let map = CollisionMap::new(model, spec, &obstacles).unwrap();
        let outcome = |method| {
            let plans = Planner::new().plan(&map, &[goal], None, &config(method, 1.4)).unwrap();
            plans[0].result.outcome
        };
        let drives = PLAIN.map(outcome);
        if drives.contains(&Outcome::Unreachable) {
            prop_assert_eq!(drives, [Outcome::Unreachable; 2]);
            prop_assert_ne!(outcome(Method::Tiev), Outcome::Solved);
        }
        if outcome(Method::Tiev) == Outcome::Solved {
            prop_assert!(!drives.contains(&Outcome::Unreachable));
        }
    }

    #[test]
    fn a_goal_within_walls_is_never_reached(
        row in 8..30i32, col in 8..36i32, room in 4..7i32, blocks in proptest::collection::vec(block(), 0..3),
    ) {
        let (spec, model) = (small_spec(), small_model());
        let (first, last, side) = (row - room, row + room, 2 * room + 1);
        let mut blocks = blocks;
        blocks.extend([(first, col - room, 1, side), (last, col - room, 1, side)]);
        blocks.extend([(first, col - room, side, 1), (first, col + room, side, 1)]);
        let obstacles = blocked(&spec, &blocks);
        let map = CollisionMap::new(model, spec, &obstacles).unwrap();
        let (x_m, y_m) = spec.centre_of(Cell::new(row, col));
        // The room reaches to column 0 or beyond at most: what lies beyond the map cannot be driven on.
        for method in PLAIN {
            let goals = [Pose2::new(x_m, y_m, 0.0)];
            let plans = Planner::new().plan(&map, &goals, None, &config(method, 1.4)).unwrap();
            let known = [Outcome::Unreachable, Outcome::GoalOccupied, Outcome::StartOccupied];
            prop_assert!(known.contains(&plans[0].result.outcome), "{:?}", plans[0].result.outcome);
        }
    }
}

#[test]
fn in_the_open_the_drive_is_as_cheap_as_can_be() {
    let spec = GridSpec::default();
    let model = Arc::new(MotionModel::new(&Vehicle::default(), 0.2).unwrap());
    let empty = Plane::empty(spec.rows, spec.cols);
    let map = CollisionMap::new(Arc::clone(&model), spec, &empty).unwrap();
    let goals = [
        Pose2::new(20.0, 3.0, 0.2),
        Pose2::new(15.0, -8.0, -1.4),
        Pose2::new(-5.0, 11.0, 3.1),
    ];
    for (method, most) in [(Method::Hybrid, 1.0), (Method::RrtStar, 1.2)] {
        let plans = Planner::new()
            .plan(&map, &goals, None, &config(method, 1.4))
            .unwrap();
        for plan in plans {
            assert_eq!(plan.result.outcome, Outcome::Solved);
            // The shortest drive, which here is also the cheapest: no more than two arcs.
            let drive = dubins::shortest_path(&Pose2::default(), &plan.goal, 5.5, 0.05);
            let cost: f64 = drive
                .windows(2)
                .map(|pair| {
                    let turn = (pair[1].yaw_rad - pair[0].yaw_rad).sin().asin();
                    pair[0].distance_m(&pair[1]) + turn.abs()
                })
                .sum();
            let found = plan.result.cost;
            assert!(found <= most * cost + 0.02, "{method:?} {found} {cost}");
            assert!(found >= Pose2::default().distance_m(&plan.goal) - 0.5);
        }
    }
}

#[test]
fn a_region_around_the_path_saves_steps_and_a_wrong_one_hides_nothing() {
    let spec = GridSpec::default();
    let model = Arc::new(MotionModel::new(&Vehicle::default(), 0.2).unwrap());
    // Two walls, the first open on the left and the second on the right.
    let obstacles = blocked(&spec, &[(210, 70, 2, 81), (130, 0, 2, 80)]);
    let map = CollisionMap::new(Arc::clone(&model), spec, &obstacles).unwrap();
    let goals = [Pose2::new(42.0, 0.0, 0.0)];
    let run = |method: Method, region: Option<&Plane>, seed: u64| {
        let config = PlanConfig {
            max_expansions: 60_000,
            seed,
            ..config(method, 1.4)
        };
        let regions = region.map(std::slice::from_ref);
        let mut plans = Planner::new().plan(&map, &goals, regions, &config).unwrap();
        let result = plans.remove(0).result;
        assert_eq!(result.outcome, Outcome::Solved, "{method:?}");
        // Chords turn on the spot, which no drive does.
        if method != Method::Weighted {
            assert_sound((&spec, &obstacles), &model, (goals[0], 1.4), &result);
        }
        result
    };
    let mut region = Plane::empty(spec.rows, spec.cols);
    region.draw_line(&spec, &run(Method::Weighted, None, 0).path, 1.4);
    let wrong = blocked(&spec, &[(380, 0, 20, 20)]);
    for (plain, guided, seeds) in [
        (Method::Hybrid, Method::HybridFcn, 1),
        (Method::RrtStar, Method::RrtStarFcn, 12),
    ] {
        let steps = |method: Method, region: Option<&Plane>| -> u64 {
            (0..seeds).map(|seed| run(method, region, seed).steps).sum()
        };
        let (without, with) = (steps(plain, None), steps(guided, Some(&region)));
        assert!(with < without, "{guided:?}: {with} against {without}");
        run(guided, Some(&wrong), 0);
    }
}

#[test]
fn every_path_on_the_problems_is_sound() {
    let Some(problems) = data::problems() else {
        return;
    };
    let spec = GridSpec::default();
    let model = Arc::new(MotionModel::new(&Vehicle::default(), 0.2).unwrap());
    let mut solved_of = BTreeMap::new();
    for name in data::NAMES {
        let (obstacles, goals) = data::read(&problems, name).unwrap();
        let map = CollisionMap::new(Arc::clone(&model), spec, &obstacles).unwrap();
        let planner = Planner::new();
        let mut regions: Option<Vec<Plane>> = None;
        for method in ALL {
            let of_method = regions.as_deref().filter(|_| method.needs_regions());
            let config = config(method, 1.4);
            let plans = planner.plan(&map, &goals, of_method, &config).unwrap();
            let solved: Vec<_> = plans
                .iter()
                .filter(|plan| plan.result.outcome == Outcome::Solved)
                .collect();
            // Few iterations do not solve everything.
            solved_of
                .entry(method.name())
                .and_modify(|count| *count += solved.len())
                .or_insert(solved.len());
            for plan in solved {
                assert_sound((&spec, &obstacles), &model, (plan.goal, 1.4), &plan.result);
            }
            regions.get_or_insert_with(|| {
                let region = |path: &[Pose2]| {
                    let mut region = Plane::empty(spec.rows, spec.cols);
                    region.draw_line(&spec, path, 1.4);
                    region
                };
                plans.iter().map(|plan| region(&plan.result.path)).collect()
            });
        }
    }
    for (method, solved) in solved_of {
        assert!(solved >= 100, "{method}: {solved}");
    }
}
