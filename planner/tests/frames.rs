//! Frames as a planner node plans them: under a deadline, from where the vehicle will be, with paths
//! that the independent checker passes.

use std::sync::Arc;
use std::time::{Duration, Instant};

use proptest::prelude::*;
use swath_bridge::{Cell, GridSpec, Outcome, Pose2, Vehicle};
use swath_planner::check::{CheckLimits, Ends, check_path};
use swath_planner::{
    FrameInput, FramePlan, FramePlanner, Method, MotionModel, PlanConfig, Plane, Start,
    TargetConfig, curvature_limit_per_m, sample_targets,
};

mod data;

/// Set where the machine does nothing else, so that deadlines are held to the clock.
const SOAK: &str = "SWATH_SOAK_S";
/// What a frame may take beyond its deadline.
const PATIENCE: Duration = Duration::from_millis(20);
/// Frames of which one has to be in time.
const ATTEMPTS: usize = 20;

fn planner() -> FramePlanner {
    let model = MotionModel::new(&Vehicle::default(), GridSpec::default().resolution_m);
    FramePlanner::new(Arc::new(
        model.expect("the default vehicle fits the default cells"),
    ))
}

/// Plans a frame; where deadlines are held to the clock, until one frame is in time.
fn plan_in_time(planner: &FramePlanner, input: &FrameInput<'_>, config: &PlanConfig) -> FramePlan {
    let most = Duration::from_millis(config.frame_deadline_ms) + PATIENCE;
    let is_soak = std::env::var_os(SOAK).is_some();
    let plan = (0..ATTEMPTS).find_map(|_| {
        let started = Instant::now();
        let plan = planner.plan(input, None, config).expect("it is planned");
        (!is_soak || started.elapsed() < most).then_some(plan)
    });
    plan.unwrap_or_else(|| panic!("{:?}: always late", config.method))
}

/// Checks every path that is said to be drivable; how many there are.
fn check(input: &FrameInput<'_>, plan: &FramePlan, speed_m_per_s: f64) -> usize {
    let vehicle = Vehicle::default();
    let limits = CheckLimits::new(&vehicle, curvature_limit_per_m(&vehicle, speed_m_per_s));
    let mut drivable = 0;
    for (target, goal) in plan.targets.iter().zip(input.goals) {
        assert_eq!(target.goal, *goal);
        let Some(path) = target.drivable.as_ref().filter(|path| path.is_drivable()) else {
            continue;
        };
        let ends = Ends {
            start: input.start.pose,
            start_curvature_per_m: input.start.curvature_per_m,
            goal: *goal,
        };
        let found = check_path((&input.spec, input.obstacles), &limits, &ends, &path.points);
        assert!(found.is_empty(), "to {goal:?}: {found:?}");
        drivable += 1;
    }
    drivable
}

fn reference() -> Vec<Pose2> {
    (0..60)
        .map(|k| Pose2::new(f64::from(k), 0.0, 0.0))
        .collect()
}

#[test]
fn what_is_planned_by_a_deadline_can_be_driven_whatever_the_method() {
    let Some(problems) = data::problems() else {
        return;
    };
    let planner = planner();
    for name in data::NAMES {
        let (obstacles, goals) = data::read(&problems, name).expect("the problem can be read");
        let input = FrameInput {
            spec: GridSpec::default(),
            obstacles: &obstacles,
            reference: &[],
            goals: &goals,
            start: Start::default(),
        };
        for method in [Method::Tiev, Method::Weighted, Method::Swath] {
            for frame_deadline_ms in [5, 40] {
                let config = PlanConfig {
                    method,
                    frame_deadline_ms,
                    ..PlanConfig::default()
                };
                let plan = plan_in_time(&planner, &input, &config);
                assert_eq!(plan.targets.len(), goals.len(), "{name} {method:?}");
                check(&input, &plan, config.speed_m_per_s);
            }
        }
    }
}

#[test]
fn a_frame_without_time_says_so_of_every_target() {
    let spec = GridSpec::default();
    let mut obstacles = Plane::empty(spec.rows, spec.cols);
    for row in 0..200 {
        for col in (row % 7..spec.cols).step_by(23) {
            obstacles.set(Cell::new(
                i32::try_from(row).unwrap_or(0),
                i32::try_from(col).unwrap_or(0),
            ));
        }
    }
    let goals = vec![Pose2::new(55.0, 3.0, 0.0); 200];
    let input = FrameInput {
        spec,
        obstacles: &obstacles,
        reference: &[],
        goals: &goals,
        start: Start::default(),
    };
    for method in [Method::Tiev, Method::Weighted] {
        let config = PlanConfig {
            method,
            frame_deadline_ms: 1,
            ..PlanConfig::default()
        };
        let plan = plan_in_time(&planner(), &input, &config);
        let targets = plan.targets.iter();
        let late = targets.filter(|target| target.result.outcome == Outcome::BudgetExhausted);
        assert!(late.count() > 100, "{method:?}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn paths_from_where_the_vehicle_will_be_can_be_driven_from_there(
        (x_m, y_m, yaw_rad) in (0.0..4.0f64, -0.5..0.5f64, -0.3..0.3f64),
        curvature_per_m in -0.1..0.1f64,
        blocks in prop::collection::vec((16.0..55.0f64, -12.0..12.0f64), 0..12),
    ) {
        let spec = GridSpec::default();
        let mut obstacles = Plane::empty(spec.rows, spec.cols);
        for (x_m, y_m) in blocks {
            for step in 0..6 {
                obstacles.set(spec.cell_at(x_m + 0.2 * f64::from(step), y_m));
                obstacles.set(spec.cell_at(x_m, y_m + 0.2 * f64::from(step)));
            }
        }
        let reference = reference();
        let goals = sample_targets(&reference, &spec, &TargetConfig::default());
        let input = FrameInput {
            spec,
            obstacles: &obstacles,
            reference: &reference,
            goals: &goals,
            start: Start {
                pose: Pose2::new(x_m, y_m, yaw_rad),
                curvature_per_m: Some(curvature_per_m),
            },
        };
        let config = PlanConfig::default();
        let plan = planner().plan(&input, None, &config).unwrap();
        let solved = plan.targets.iter().filter(|target| target.result.outcome == Outcome::Solved);
        let (solved, drivable) = (solved.count(), check(&input, &plan, config.speed_m_per_s));
        prop_assert!(5 * drivable >= 4 * solved, "{drivable} of {solved}");
    }
}
