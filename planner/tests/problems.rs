//! The six real problems: every path of both methods starts at the vehicle, ends at its goal and hits
//! nothing, by a checker that shares no code with the planner.

use std::sync::Arc;

use swath_bridge::{Cell, GridSpec, Outcome, Pose2, Vehicle};
use swath_planner::check::{CheckLimits, Ends, check_path};
use swath_planner::search::TargetResult;
use swath_planner::smooth::{ObstacleCells, SmoothConfig, SmoothRequest, Smoother};
use swath_planner::{
    CollisionMap, GoalTolerance, Method, MotionModel, PlanConfig, Plane, Planner, TargetPlan,
};

mod data;

/// Expansions for one target; enough for most that can be reached.
const MAX_EXPANSIONS: u64 = 40_000;
/// Farthest that two tested poses lie apart.
const TESTED_M: f64 = 0.1;
const TESTED_RAD: f64 = 2.0 * std::f64::consts::PI / 180.0;

/// The angle from one to another, radians in [-π, π].
fn turn_rad(from: f64, to: f64) -> f64 {
    let (sin, cos) = (to - from).sin_cos();
    sin.atan2(cos)
}

/// Occupied squares, and the vehicle as a rectangle among them.
struct Checker {
    spec: GridSpec,
    vehicle: Vehicle,
    obstacles: Plane,
}

impl Checker {
    /// Whether the full rectangle at a pose touches an occupied square: they are apart just if they
    /// are along a side of the one or the other.
    fn hits(&self, pose: &Pose2) -> bool {
        let (sin, cos) = pose.yaw_rad.sin_cos();
        let vehicle = &self.vehicle;
        let middle_m = (vehicle.front_m - vehicle.rear_m) / 2.0;
        let (half_length_m, half_width_m) = (
            f64::midpoint(vehicle.front_m, vehicle.rear_m),
            vehicle.half_width_m,
        );
        let (x_m, y_m) = (pose.x_m + cos * middle_m, pose.y_m + sin * middle_m);
        let half_cell_m = self.spec.resolution_m / 2.0;
        let reach_x_m = half_length_m * cos.abs() + half_width_m * sin.abs();
        let reach_y_m = half_length_m * sin.abs() + half_width_m * cos.abs();
        let across_cell_m = half_cell_m * (cos.abs() + sin.abs());
        let first = self.spec.cell_at(x_m + reach_x_m, y_m + reach_y_m);
        let last = self.spec.cell_at(x_m - reach_x_m, y_m - reach_y_m);
        (first.row - 1..=last.row + 1).any(|row| {
            (first.col - 1..=last.col + 1).any(|col| {
                if !self.obstacles.get(Cell::new(row, col)) {
                    return false;
                }
                let dx_m = (f64::from(self.spec.ego_row) - f64::from(row)) * 0.2 - x_m;
                let dy_m = (f64::from(self.spec.ego_col) - f64::from(col)) * 0.2 - y_m;
                dx_m.abs() <= reach_x_m + half_cell_m
                    && dy_m.abs() <= reach_y_m + half_cell_m
                    && (dx_m * cos + dy_m * sin).abs() <= half_length_m + across_cell_m
                    && (dy_m * cos - dx_m * sin).abs() <= half_width_m + across_cell_m
            })
        })
    }

    /// The first pose on the way from one pose to the next that hits something.
    fn hit_between(&self, from: &Pose2, to: &Pose2) -> Option<Pose2> {
        let (dx_m, dy_m) = (to.x_m - from.x_m, to.y_m - from.y_m);
        let turn = turn_rad(from.yaw_rad, to.yaw_rad);
        let pieces = (dx_m.hypot(dy_m) / TESTED_M)
            .max(turn.abs() / TESTED_RAD)
            .ceil()
            .max(1.0);
        let mut piece = 0.0;
        while piece <= pieces {
            let share = piece / pieces;
            let pose = Pose2::new(
                from.x_m + share * dx_m,
                from.y_m + share * dy_m,
                from.yaw_rad + share * turn,
            );
            if self.hits(&pose) {
                return Some(pose);
            }
            piece += 1.0;
        }
        None
    }

    fn check(&self, what: &str, goal: &Pose2, result: &TargetResult) {
        let path = &result.path;
        assert_eq!(
            path[0],
            Pose2::new(0.0, 0.0, 0.0),
            "{what} starts elsewhere"
        );
        let last = path[path.len() - 1];
        let off_m = (last.x_m - goal.x_m).hypot(last.y_m - goal.y_m);
        let off_rad = turn_rad(last.yaw_rad, goal.yaw_rad).abs();
        assert!(
            off_m <= 0.5 && off_rad <= 15f64.to_radians(),
            "{what} ends {off_m} m and {off_rad} rad from its goal"
        );
        for pair in path.windows(2) {
            let step_m = (pair[1].x_m - pair[0].x_m).hypot(pair[1].y_m - pair[0].y_m);
            assert!(step_m <= 0.2 + 1e-9, "{what} has a gap of {step_m} m");
            let hit = self.hit_between(&pair[0], &pair[1]);
            assert_eq!(hit, None, "{what} hits something");
        }
    }
}

/// Smooths the paths of one problem; how many can be driven. Those that can must pass the checker.
fn drive(what: &str, obstacles: &Plane, plans: &[&TargetPlan], config: &PlanConfig) -> usize {
    let (spec, vehicle) = (GridSpec::default(), Vehicle::default());
    let cells = ObstacleCells::new(spec, obstacles).expect("the map is of the default size");
    let smoother = Smoother::new(&vehicle, SmoothConfig::default());
    let mut smoother = smoother.expect("the defaults are in range");
    let limit_per_m = smoother.curvature_limit_per_m(config.speed_m_per_s);
    let mut drivable = 0;
    for plan in plans {
        let request = SmoothRequest {
            chords: &plan.result.path,
            goal: plan.goal,
            tolerance: GoalTolerance::default(),
            speed_m_per_s: config.speed_m_per_s,
            start_curvature_per_m: Some(0.0),
            stop: None,
        };
        let path = smoother.smooth(&cells, &request);
        if !path.is_drivable() {
            continue;
        }
        drivable += 1;
        let ends = Ends {
            start: Pose2::default(),
            start_curvature_per_m: Some(0.0),
            goal: plan.goal,
        };
        let limits = CheckLimits::new(&vehicle, limit_per_m);
        let found = check_path((&spec, obstacles), &limits, &ends, &path.points);
        assert!(found.is_empty(), "{what} {:?}: {found:?}", plan.goal);
    }
    drivable
}

#[test]
fn the_checker_sees_what_stands_inside_beside_and_before_the_vehicle() {
    let spec = GridSpec::default();
    let checker = |cell: Cell| {
        let mut obstacles = Plane::empty(spec.rows, spec.cols);
        obstacles.set(cell);
        Checker {
            spec,
            vehicle: Vehicle::default(),
            obstacles,
        }
    };
    // From the rear axle the vehicle reaches 3.62 m ahead, 0.58 m back and 0.885 m to each side; a
    // cell's square reaches 0.1 m from its centre.
    for (row, col, hits) in [
        (290, 75, true),
        (282, 75, true),
        (281, 75, false),
        (303, 75, true),
        (304, 75, false),
        (295, 71, true),
        (295, 70, false),
    ] {
        let found = checker(Cell::new(row, col)).hits(&Pose2::default());
        assert_eq!(found, hits, "row {row} column {col}");
    }
    let beside = checker(Cell::new(300, 60));
    assert!(beside.hits(&Pose2::new(0.0, 0.0, std::f64::consts::FRAC_PI_2)));
    let turning = (Pose2::default(), Pose2::new(0.0, 0.0, 3.0));
    assert!(!beside.hits(&turning.0) && !beside.hits(&turning.1));
    assert!(beside.hit_between(&turning.0, &turning.1).is_some());
}

#[test]
fn every_path_on_the_problems_passes_the_checker() {
    let Some(problems) = data::problems() else {
        return;
    };
    let spec = GridSpec::default();
    let vehicle = Vehicle::default();
    let model = MotionModel::new(&vehicle, spec.resolution_m);
    let model = Arc::new(model.expect("the default vehicle fits the default cells"));
    let planner = Planner::new();
    let config = PlanConfig {
        method: Method::Tiev,
        max_expansions: MAX_EXPANSIONS,
        ..PlanConfig::default()
    };
    let (mut paths, mut drivable) = (0, 0);
    for name in data::NAMES {
        let (obstacles, goals) = data::read(&problems, name).expect("the problem can be read");
        let checker = Checker {
            spec,
            vehicle,
            obstacles,
        };
        let map = CollisionMap::new(Arc::clone(&model), spec, &checker.obstacles)
            .expect("the map is of the default size");
        let plan = |goals: &[Pose2], regions: Option<&[Plane]>| {
            let plans = planner.plan(&map, goals, regions, &config);
            plans.expect("there are as many regions as goals")
        };
        let plain = plan(&goals, None);
        let solved: Vec<_> = plain
            .iter()
            .filter(|plan| plan.result.outcome == Outcome::Solved)
            .collect();
        assert!(solved.len() >= 5, "{name}: {} solved", solved.len());
        paths += solved.len();
        drivable += drive(name, &checker.obstacles, &solved, &config);
        let region = |path: &[Pose2]| {
            let mut region = Plane::empty(spec.rows, spec.cols);
            region.draw_line(&spec, path, 1.4);
            region
        };
        let regions: Vec<_> = solved
            .iter()
            .map(|plan| region(&plan.result.path))
            .collect();
        let goals: Vec<_> = solved.iter().map(|plan| plan.goal).collect();
        let guided = plan(&goals, Some(&regions));
        for (plain, guided) in solved.iter().zip(&guided) {
            let goal = &plain.goal;
            checker.check(&format!("tiev on {name} to {goal:?}"), goal, &plain.result);
            assert_eq!(guided.result.outcome, Outcome::Solved, "{name} {goal:?}");
            checker.check(
                &format!("tiev-fcn on {name} to {goal:?}"),
                goal,
                &guided.result,
            );
            // The region may mislead, but what it finds is never better than the optimum.
            assert!(guided.result.cost >= plain.result.cost - 1e-3);
        }
    }
    assert!(
        drivable as f64 >= 0.98 * paths as f64,
        "{drivable} of {paths} can be driven"
    );
}
