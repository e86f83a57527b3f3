//! Vehicles of all sizes: what is planned for them can be driven by them, at their own limits, by the
//! independent checker.

use std::f64::consts::PI;
use std::sync::Arc;

use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use swath_bridge::{Cell, Drivability, GridSpec, Outcome, Pose2, Vehicle};
use swath_planner::check::{CheckLimits, Ends, Fault, check_path};
use swath_planner::{
    FrameInput, FramePlan, FramePlanner, GoalTolerance, MotionModel, PlanConfig, Plane, Start,
};

/// Targets of each case.
const TARGETS: usize = 6;
/// Expansions of each, so that a case in a maze ends.
const MAX_EXPANSIONS: u64 = 60_000;

/// A vehicle, its cells and what it is to do.
#[derive(Debug, Clone, Copy)]
struct Case {
    vehicle: Vehicle,
    resolution_m: f64,
    speed_m_per_s: f64,
    tolerance: GoalTolerance,
    seed: u64,
}

fn unit(random: &mut ChaCha8Rng) -> f64 {
    f64::from(random.next_u32()) / f64::from(u32::MAX)
}

/// A vehicle whose dimensions are in the proportions of cars, trucks and robots.
fn vehicle(min_turning_radius_m: f64, shape: [f64; 4]) -> Vehicle {
    let wheelbase_m = min_turning_radius_m * (0.35 + 0.3 * shape[0]);
    Vehicle {
        wheelbase_m,
        front_m: wheelbase_m * (1.15 + 0.45 * shape[1]),
        rear_m: wheelbase_m * (0.15 + 0.35 * shape[2]),
        half_width_m: wheelbase_m * (0.2 + 0.3 * shape[3]),
        min_turning_radius_m,
        ..Vehicle::default()
    }
    .with_limits_of_its_size()
}

/// Ground of some turning circles to each side, as far as so many cells go.
fn spec_for(case: &Case) -> GridSpec {
    let cells = (10.0 * case.vehicle.min_turning_radius_m / case.resolution_m).clamp(80.0, 360.0);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "80 to 360"
    )]
    let side = cells as u32;
    GridSpec {
        rows: side,
        cols: side,
        resolution_m: case.resolution_m,
        ego_row: side * 2 / 3,
        ego_col: side / 2,
    }
}

/// Blocks of up to a third of the turning radius, none of them where the vehicle stands.
fn ground(case: &Case, spec: &GridSpec, random: &mut ChaCha8Rng) -> Plane {
    let mut plane = Plane::empty(spec.rows, spec.cols);
    let vehicle = &case.vehicle;
    let reach_m = vehicle.front_m + vehicle.half_width_m;
    for _ in 0..14 {
        let (row, col) = (
            unit(random) * f64::from(spec.rows),
            unit(random) * f64::from(spec.cols),
        );
        let side = (vehicle.min_turning_radius_m / 3.0 * unit(random) / spec.resolution_m).max(1.0);
        #[expect(clippy::cast_possible_truncation, reason = "cells of a small grid")]
        let (row, col, side) = (row as i32, col as i32, side.min(60.0) as i32);
        for at in (row..row + side).flat_map(|r| (col..col + side).map(move |c| Cell::new(r, c))) {
            let (x_m, y_m) = spec.centre_of(at);
            if spec.index_of(at).is_some() && x_m.hypot(y_m) > 1.5 * reach_m {
                plane.set(at);
            }
        }
    }
    plane
}

fn goals(spec: &GridSpec, random: &mut ChaCha8Rng) -> Vec<Pose2> {
    let side_m = f64::from(spec.rows) * spec.resolution_m;
    (0..TARGETS)
        .map(|_| {
            Pose2::new(
                side_m * (0.6 * unit(random) - 0.05),
                side_m * 0.9 * (unit(random) - 0.5),
                2.0 * PI * unit(random) - PI,
            )
        })
        .collect()
}

struct Planned {
    spec: GridSpec,
    obstacles: Plane,
    plan: FramePlan,
}

fn plan(case: &Case) -> Planned {
    let mut random = ChaCha8Rng::seed_from_u64(case.seed);
    let spec = spec_for(case);
    let obstacles = ground(case, &spec, &mut random);
    let goals = goals(&spec, &mut random);
    let model = MotionModel::new(&case.vehicle, spec.resolution_m).expect("the vehicle fits");
    let input = FrameInput {
        spec,
        obstacles: &obstacles,
        reference: &[],
        goals: &goals,
        start: Start {
            pose: Pose2::default(),
            curvature_per_m: Some(0.0),
        },
    };
    let config = PlanConfig {
        speed_m_per_s: case.speed_m_per_s,
        goal: case.tolerance,
        max_expansions: MAX_EXPANSIONS,
        ..PlanConfig::default()
    };
    let plan = FramePlanner::new(Arc::new(model))
        .plan(&input, None, &config)
        .expect("the settings are in range");
    Planned {
        spec,
        obstacles,
        plan,
    }
}

/// How many paths there are, and how many can be driven at the vehicle's speed. All must pass the checker
/// at what they claim to be.
fn checked(case: &Case) -> (usize, usize) {
    let Planned {
        spec,
        obstacles,
        plan,
    } = plan(case);
    let (mut solved, mut at_speed) = (0, 0);
    for target in &plan.targets {
        let Some(path) = &target.drivable else {
            assert!(target.result.outcome != Outcome::Solved);
            continue;
        };
        solved += 1;
        let curvature_per_m = match path.drivability {
            Drivability::AtSpeed => case.vehicle.curvature_limit_per_m(case.speed_m_per_s),
            _ => 1.0 / case.vehicle.min_turning_radius_m,
        };
        let limits = CheckLimits {
            goal_within_m: case.tolerance.tolerance_m,
            goal_within_rad: case.tolerance.tolerance_rad,
            tested_every_m: 0.25 * spec.resolution_m,
            ..CheckLimits::new(&case.vehicle, curvature_per_m)
        };
        let ends = Ends {
            start: Pose2::default(),
            start_curvature_per_m: Some(0.0),
            goal: target.goal,
        };
        let mut found = check_path((&spec, &obstacles), &limits, &ends, &path.points);
        match path.drivability {
            Drivability::AtSpeed => at_speed += 1,
            Drivability::Slower => {}
            // These say that they cannot be driven, but they hit nothing either.
            Drivability::TooTight | Drivability::TurnsOnTheSpot => {
                found.retain(|found| matches!(found.fault, Fault::Collision | Fault::OffMap));
            }
        }
        assert!(
            found.is_empty(),
            "{case:?} to {:?}: {:?}: {found:?}",
            target.goal,
            path.drivability
        );
    }
    (solved, at_speed)
}

fn cases() -> impl Strategy<Value = Case> {
    (
        (0.5f64.ln()..15f64.ln()).prop_map(f64::exp),
        proptest::array::uniform4(0.0..1.0f64),
        0.05..0.3f64,
        0.2..5.0f64,
        (0.03..0.6f64, 0.03..0.4f64),
        any::<u64>(),
    )
        .prop_map(
            |(radius_m, shape, resolution_m, speed_m_per_s, (tolerance_m, tolerance_rad), seed)| {
                Case {
                    vehicle: vehicle(radius_m, shape),
                    resolution_m,
                    speed_m_per_s,
                    tolerance: GoalTolerance {
                        tolerance_m,
                        tolerance_rad,
                    },
                    seed,
                }
            },
        )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn every_path_of_every_vehicle_passes_the_checker_at_its_own_limits(case in cases()) {
        checked(&case);
    }
}

#[test]
fn vehicles_of_all_sizes_get_paths_that_they_can_drive() {
    let (mut solved, mut at_speed) = (0, 0);
    for (number, radius_m) in (0..).zip([0.5, 0.9, 1.5, 3.0, 5.5, 9.0, 15.0]) {
        for repetition in 0..4 {
            let case = Case {
                vehicle: vehicle(radius_m, [0.5; 4]),
                // Four cells to half of the width.
                resolution_m: (radius_m * 0.04).clamp(0.05, 0.3),
                speed_m_per_s: 0.5,
                tolerance: GoalTolerance::default(),
                seed: number * 100 + repetition,
            };
            let (paths, drivable) = checked(&case);
            solved += paths;
            at_speed += drivable;
        }
    }
    assert!(solved >= 100, "{solved} paths");
    assert!(
        at_speed * 100 >= solved * 90,
        "{at_speed} of {solved} paths can be driven"
    );
}
