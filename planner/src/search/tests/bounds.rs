use std::sync::atomic::{AtomicU64, Ordering};

use super::super::swath::Effort;
use super::*;
use crate::tolerance::GoalTolerance;

/// So little that every part of the search has something to do on small maps.
const EFFORTS: [Effort; 4] = [
    Effort {
        near: 1,
        meanwhile: 1,
        far: 1,
        closer: 5,
        first: 1,
        few: 0,
        before_asking: 2,
        wide: 1,
    },
    Effort {
        near: 20,
        meanwhile: 0,
        far: 0,
        closer: 0,
        first: 1_000_000,
        few: 0,
        before_asking: 2,
        wide: 0,
    },
    Effort {
        near: 20,
        meanwhile: 10,
        far: 300,
        closer: 200,
        first: 2,
        few: 30,
        before_asking: 2,
        wide: 40,
    },
    Effort {
        near: 1_000_000,
        meanwhile: 3,
        far: 1,
        closer: 0,
        first: 1,
        few: 0,
        before_asking: 2,
        wide: 1000,
    },
];

fn swath(
    map: &CollisionMap,
    goals: &[Pose2],
    rules: (f64, Effort),
    limits: Limits<'_>,
) -> Vec<TargetResult> {
    swath_in((map, None), goals, rules, limits)
}

fn swath_in(
    (map, regions): (&CollisionMap, Option<Regions<'_>>),
    goals: &[Pose2],
    (epsilon, effort): (f64, Effort),
    limits: Limits<'_>,
) -> Vec<TargetResult> {
    let successors = map.model().successors(1.4);
    let order: Vec<usize> = (0..goals.len()).collect();
    let frame = Frame {
        map,
        successors: &successors,
        goals,
        tolerance: GoalTolerance::default(),
        order: &order,
        regions,
    };
    let rules = Rules { epsilon, limits };
    let results = FrameMemory::with_effort(effort)
        .plan(&frame, &rules)
        .unwrap();
    results.into_iter().map(|(result, _)| result).collect()
}

fn check_path(oracle: &Oracle, goal: &Pose2, found: &TargetResult) {
    assert_eq!(found.path[0], Pose2::new(0.0, 0.0, 0.0));
    let last = found.path[found.path.len() - 1];
    assert!(last.distance_m(goal) <= 0.5);
    assert!(difference(last.yaw_rad, goal.yaw_rad).abs() <= 15f64.to_radians());
    let mut cost = 0.0;
    for pair in found.path.windows(2) {
        let step_m = pair[0].distance_m(&pair[1]);
        let turn = difference(pair[1].yaw_rad, pair[0].yaw_rad);
        assert!(step_m == 0.0 || turn == 0.0, "a pose both moves and turns");
        let at = (pair[0].x_m, pair[0].y_m);
        assert!(!oracle.turn_hits(at, pair[0].yaw_rad, turn));
        assert!(!oracle.hits(at, pair[1].yaw_rad, step_m));
        cost += step_m + turn.abs();
    }
    assert!((cost - found.cost).abs() < 1e-6);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    /// With ε = 1 this asks whether every lower bound is one. `tiev` is what Dijkstra finds.
    #[test]
    fn costs_are_within_the_bound_and_what_is_unreachable_is_proved(
        (occupied, goal) in scene(),
        others in proptest::collection::vec((0.4..3.4f64, -1.5..1.5f64, -3.0..3.0f64), 3),
        epsilon in prop_oneof![Just(1.0), Just(1.2), 1.0..4.0f64],
        effort in 0usize..4,
    ) {
        let vehicle = small_vehicle();
        let map = map_with(small_spec(), &vehicle, &occupied);
        let successors = map.model().successors(1.4);
        let others = others.into_iter().map(|(x, y, yaw)| Pose2::new(x, y, yaw));
        let goals: Vec<Pose2> = std::iter::once(goal).chain(others).collect();
        let mut memory = SearchMemory::new();
        let mut weighted = WeightedMemory::default();
        let together = swath(&map, &goals, (epsilon, EFFORTS[effort]), Limits::default());
        let few = Limits { max_expansions: Some(20), ..Limits::default() };
        let in_part = swath(&map, &goals, (epsilon, EFFORTS[effort]), few);
        let oracle = Oracle::new(small_spec(), &vehicle, occupied, 1.4);
        for (goal, (together, in_part)) in goals.iter().zip(together.into_iter().zip(in_part)) {
            let none = Limits::default();
            let best = search(&map, &successors, (goal, Guidance::NONE), none, &mut memory).unwrap();
            if in_part.outcome == Outcome::Solved {
                prop_assert!(in_part.cost <= in_part.bound * best.cost + 1e-4);
                check_path(&oracle, goal, &in_part);
            } else if in_part.outcome != Outcome::BudgetExhausted {
                prop_assert_eq!(in_part.outcome, best.outcome);
            }
            let alone =
                search_weighted(&map, &successors, (goal, epsilon), none, &mut weighted).unwrap();
            for found in [alone, together] {
                prop_assert_eq!(found.outcome, best.outcome);
                if found.outcome == Outcome::Solved {
                    prop_assert!(found.cost <= epsilon * best.cost + 1e-4,
                        "{} against {}", found.cost, best.cost);
                    prop_assert!(found.cost >= best.cost - 1e-4);
                    prop_assert!(found.cost <= found.bound * best.cost + 1e-4);
                    prop_assert!(found.bound <= epsilon + 1e-4);
                    check_path(&oracle, goal, &found);
                }
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]

    /// Whatever is said of where paths are expected: random cells, all, none, all but what the optimal
    /// path passes, or a plane of another size.
    #[test]
    fn no_region_costs_the_bound_or_a_target(
        (occupied, goal) in scene(),
        other in (0.4..3.4f64, -1.5..1.5f64, -3.0..3.0f64),
        epsilon in prop_oneof![Just(1.0), Just(1.2), 1.0..4.0f64],
        effort in 0usize..4,
        (kind, seed) in (0u8..5, any::<u64>()),
    ) {
        let spec = small_spec();
        let map = map_with(spec, &small_vehicle(), &occupied);
        let successors = map.model().successors(1.4);
        let goals = [goal, Pose2::new(other.0, other.1, other.2)];
        let mut memory = SearchMemory::new();
        let best = goals.map(|goal| {
            search(&map, &successors, (&goal, Guidance::NONE), Limits::default(), &mut memory).unwrap()
        });
        let region_of = |number: usize| {
            let mut region = Plane::empty(spec.rows + u32::from(kind == 4), spec.cols);
            let passes = |cell: usize| {
                let cell = spec.cell_of_index(cell);
                best[number].path.iter().any(|pose| spec.cell_at(pose.x_m, pose.y_m) == cell)
            };
            for cell in 0..spec.len() {
                let random = seed.rotate_left(u32::try_from(cell * 7 % 64).unwrap()) & 1 == 1;
                if [random, true, false, kind == 3 && !passes(cell), random][usize::from(kind)] {
                    region.set_index(cell);
                }
            }
            Some(region)
        };
        let asked = AtomicU64::new(0);
        let regions = |left: &[usize]| {
            asked.fetch_add(1, Ordering::Relaxed);
            left.iter().map(|&number| region_of(number)).collect()
        };
        let rules = (epsilon, EFFORTS[effort]);
        let found = swath_in((&map, Some(&regions)), &goals, rules, Limits::default());
        prop_assert!(asked.load(Ordering::Relaxed) <= 1);
        let oracle = Oracle::new(spec, &small_vehicle(), occupied, 1.4);
        for ((goal, best), found) in goals.iter().zip(&best).zip(&found) {
            prop_assert_eq!(found.outcome, best.outcome);
            if found.outcome == Outcome::Solved {
                prop_assert!(found.cost <= epsilon * best.cost + 1e-4);
                prop_assert!(found.cost >= best.cost - 1e-4);
                check_path(&oracle, goal, found);
            }
        }
    }
}

/// A road with something on it, and a few goals on the road and beyond its walls.
fn road() -> (CollisionMap, Vec<Pose2>) {
    let spec = GridSpec::default();
    let walls = (0..401).flat_map(|row| [Cell::new(row, 40), Cell::new(row, 110)]);
    let parked = (230..250).map(|row| Cell::new(row, 73));
    let occupied: Vec<Cell> = walls.chain(parked).collect();
    let goals = (0..12).map(|k| {
        let k = f64::from(k);
        Pose2::new(9.0 + 4.0 * k, 2.0 * (k % 3.0) - 2.0, 0.05 * (k % 4.0))
    });
    let beyond = [Pose2::new(20.0, 11.0, 0.0), Pose2::new(5.0, -10.0, 0.3)];
    (
        map_with(spec, &Vehicle::default(), &occupied),
        goals.chain(beyond).collect(),
    )
}

#[test]
fn a_frame_costs_less_than_its_targets_one_by_one() {
    let (map, goals) = road();
    let found = swath(&map, &goals, (1.2, Effort::default()), Limits::default());
    let successors = map.model().successors(1.4);
    let mut memory = SearchMemory::new();
    let (mut steps, mut steps_alone) = (0, 0);
    for (goal, found) in goals.iter().zip(&found) {
        let target = (goal, Bound::Informed);
        let alone = search_bounded(&map, &successors, target, Limits::default(), &mut memory);
        let alone = alone.unwrap();
        assert_eq!(found.outcome, alone.outcome);
        assert!(found.outcome != Outcome::Solved || found.cost <= 1.2 * alone.cost + 1e-4);
        steps += found.steps;
        steps_alone += alone.steps;
    }
    assert!(
        found
            .iter()
            .filter(|f| f.outcome == Outcome::Solved)
            .count()
            >= 10
    );
    assert_eq!(found[12].outcome, Outcome::Unreachable);
    assert!(steps * 3 < steps_alone, "{steps} against {steps_alone}");
}

#[test]
fn a_stopped_frame_keeps_what_it_has_in_order_and_asks_no_longer() {
    let (map, goals) = road();
    let whole = swath(&map, &goals, (1.2, Effort::default()), Limits::default());
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap();
    let mut most_solved = 0;
    for patience in [0, 10, 150, 170, 200, 250, 400] {
        let asked = AtomicU64::new(0);
        let stop = || {
            (asked.fetch_add(1, Ordering::Relaxed) >= patience).then_some(Outcome::BudgetExhausted)
        };
        let limits = Limits {
            stop: Some(&stop),
            ..Limits::default()
        };
        let effort = (1.2, Effort::default());
        let found = pool.install(|| swath(&map, &goals, effort, limits));
        assert!(asked.load(Ordering::Relaxed) <= patience + 6);
        for (found, whole) in found.iter().zip(&whole) {
            let is_same = found.outcome == whole.outcome && found.path == whole.path;
            assert!(is_same || found.outcome == Outcome::BudgetExhausted);
        }
        let solved = found
            .iter()
            .filter(|f| f.outcome == Outcome::Solved)
            .count();
        assert!(solved >= most_solved, "more time, fewer targets");
        most_solved = solved;
    }
    assert!(most_solved > 0);
}

#[test]
fn bounds_and_orders_that_make_no_sense_are_refused() {
    let (map, goals) = road();
    let successors = map.model().successors(1.4);
    for (epsilon, order) in [
        (0.9, vec![0]),
        (f64::NAN, vec![0]),
        (65.0, vec![0]),
        (1.2, vec![14]),
    ] {
        let frame = Frame {
            map: &map,
            successors: &successors,
            goals: &goals,
            tolerance: GoalTolerance::default(),
            order: &order,
            regions: None,
        };
        let rules = Rules {
            epsilon,
            limits: Limits::default(),
        };
        assert!(FrameMemory::new().plan(&frame, &rules).is_err());
    }
}
