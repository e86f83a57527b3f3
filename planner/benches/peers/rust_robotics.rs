//! The planners for cars of the crate `rust_robotics_planning`: Hybrid A*, which reverses, and RRT* of
//! Dubins curves.
//!
//! Both take the vehicle for a disc around its rear axle. A disc that holds the rectangle would pass
//! nowhere, so theirs is smaller: they are asked for less than the others, and their paths are judged
//! like all others. They know no time limit, so each goal has a process, which this
//! program starts from itself and which ends itself.

use std::error::Error;
use std::process::Command;
use std::time::{Duration, Instant};

use rust_robotics_core::types::Pose2D;
use rust_robotics_planning::rrt::{AreaBounds, CircleObstacle};
use rust_robotics_planning::rrt_star_dubins::{RRTStarDubinsConfig, RRTStarDubinsPlanner};
use rust_robotics_planning::{HybridAStarConfig, HybridAStarPlanner};
use swath_bridge::{Cell, GridSpec, Pose2};
use swath_planner::{CpuTimer, millis};
use swath_planner::{GOAL_TOLERANCE_M, GOAL_TOLERANCE_RAD};

use crate::problem::Problem;
use crate::run::{Drive, Run};

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// Asks this program to plan to one goal: it is followed by planner, map, goal and limit.
pub(crate) const MODE: &str = "--rust-robotics";

const HYBRID_A_STAR: &str = "rr-hybrid-a-star";
const RRT_STAR: &str = "rr-rrt-star/dubins";

/// Side of the cells of the state space of Hybrid A*, metres.
const CELL_M: f64 = 0.5;
/// Radius of the disc of Hybrid A*, metres: of 0.9, 1.1, 1.3 and 1.6 the one with which most of its
/// paths on `s_road` are accepted. RRT* gets half the vehicle's width, the best of these for it.
const HYBRID_RADIUS_M: f64 = 1.3;
/// Distance between tested poses, metres.
const STEP_M: f64 = 0.1;
/// More than the time limit allows.
const MAX_ITERATIONS: usize = 1_000_000;
/// How often a process looks whether it is to end.
const LOOK_EVERY: Duration = Duration::from_millis(2);

/// Both planners on all goals, a process each.
pub(crate) fn run_all(problem: &Problem) -> Result<Vec<Run>> {
    let mut runs = Vec::new();
    for (planner, drive) in [
        (HYBRID_A_STAR, Drive::Reversing),
        (RRT_STAR, Drive::Forward),
    ] {
        let mut run = Run::new(planner.to_owned(), drive);
        for goal in 0..problem.goals.len() {
            let started = Instant::now();
            let output = Command::new(std::env::current_exe()?)
                .args([MODE, planner, problem.name])
                .args([goal.to_string(), problem.limit_s.to_string()])
                .output()?;
            if output.status.success() {
                run.add(String::from_utf8(output.stdout)?.trim())?;
            } else {
                run.add(&format!("crashed 0 {}", millis(started.elapsed())))?;
            }
        }
        runs.push(run);
    }
    Ok(runs)
}

/// Plans to one goal and returns its report; at the limit prints it and ends the process.
pub(crate) fn plan(planner: &str, problem: &Problem, goal: usize) -> Result<String> {
    let goal = *problem.goals.get(goal).ok_or("no such goal")?;
    // What does not depend on the goal is made before the clock starts.
    let mut hybrid = None;
    let mut rrt_star = None;
    match planner {
        HYBRID_A_STAR => hybrid = Some(hybrid_a_star(problem)?),
        RRT_STAR => rrt_star = Some(rrt_star_dubins(problem)),
        other => return Err(format!("{other}: no such planner").into()),
    }
    let (cpu, started) = (CpuTimer::of_process(), Instant::now());
    end_after(cpu, started, problem.limit_s)?;
    let path = match (&mut hybrid, &mut rrt_star) {
        (Some(planner), _) => {
            let found = planner.plan(0.0, 0.0, 0.0, goal.x_m, goal.y_m, goal.yaw_rad);
            found.map_or_else(|_| Vec::new(), |path| poses(&path.x, &path.y, &path.yaw))
        }
        (None, Some(planner)) => {
            let to = Pose2D::new(goal.x_m, goal.y_m, goal.yaw_rad);
            let found = planner.planning(Pose2D::new(0.0, 0.0, 0.0), to);
            // Its last pose is the goal itself, however far the path ends from it.
            let path = found.map_or_else(Vec::new, |path| path.poses);
            let driven = path.split_last().map_or(&[][..], |(_, driven)| driven);
            driven.iter().map(|p| Pose2::new(p.x, p.y, p.yaw)).collect()
        }
        (None, None) => Vec::new(),
    };
    let (cpu_ms, elapsed_ms) = (millis(cpu.elapsed()), millis(started.elapsed()));
    let fate = if path.is_empty() { "none" } else { "solved" };
    let words = path
        .iter()
        .map(|p| format!(" {} {} {}", p.x_m, p.y_m, p.yaw_rad));
    Ok(format!(
        "{fate} {cpu_ms} {elapsed_ms}{}",
        words.collect::<String>()
    ))
}

/// Ends the process once it has used its processor time.
fn end_after(cpu: CpuTimer, started: Instant, limit_s: f64) -> Result<()> {
    let limit = crate::duration(limit_s)?;
    let watch = move || {
        while cpu.elapsed() < limit {
            std::thread::sleep(LOOK_EVERY);
        }
        let (cpu_ms, elapsed_ms) = (millis(cpu.elapsed()), millis(started.elapsed()));
        println!("overran {cpu_ms} {elapsed_ms}");
        std::process::exit(0);
    };
    std::thread::Builder::new()
        .name("limit".to_owned())
        .spawn(watch)?;
    Ok(())
}

fn hybrid_a_star(problem: &Problem) -> Result<HybridAStarPlanner> {
    let vehicle = &problem.vehicle;
    let spec = &problem.spec;
    let (mut xs, mut ys): (Vec<f64>, Vec<f64>) = border(problem).into_iter().unzip();
    // Its grid reaches no farther than the obstacles: two in opposite corners make it ours.
    for (x, y) in corners(spec) {
        xs.push(x);
        ys.push(y);
    }
    let config = HybridAStarConfig {
        xy_resolution: CELL_M,
        yaw_resolution: 5f64.to_radians(),
        wheelbase: vehicle.wheelbase_m,
        max_steer: (vehicle.wheelbase_m / vehicle.min_turning_radius_m).atan(),
        n_steer: 4,
        step_size: STEP_M,
        robot_radius: HYBRID_RADIUS_M,
        max_curvature: 1.0 / vehicle.min_turning_radius_m,
        ..HybridAStarConfig::default()
    };
    Ok(HybridAStarPlanner::new(&xs, &ys, config)?)
}

fn rrt_star_dubins(problem: &Problem) -> RRTStarDubinsPlanner {
    let (spec, vehicle) = (&problem.spec, &problem.vehicle);
    let curvature = 1.0 / vehicle.min_turning_radius_m;
    let circle = |(x, y)| CircleObstacle::new(x, y, spec.resolution_m / 2.0);
    let [(xmax, ymax), (xmin, ymin)] = corners(spec);
    let config = RRTStarDubinsConfig {
        curvature,
        max_iter: MAX_ITERATIONS,
        goal_xy_threshold: GOAL_TOLERANCE_M,
        goal_yaw_threshold: GOAL_TOLERANCE_RAD,
        robot_radius: vehicle.half_width_m,
        // Its unit is the turning radius.
        path_resolution: STEP_M * curvature,
        ..RRTStarDubinsConfig::default()
    };
    let obstacles = border(problem).into_iter().map(circle).collect();
    RRTStarDubinsPlanner::new(obstacles, AreaBounds::new(xmin, xmax, ymin, ymax), config)
}

/// Centres of the first cell and of the last.
fn corners(spec: &GridSpec) -> [(f64, f64); 2] {
    let last = spec.len().saturating_sub(1);
    [0, last].map(|index| spec.centre_of(spec.cell_of_index(index)))
}

/// Centres of the occupied cells that have a free one beside them: both planners look at all obstacles
/// they are given, and their steps are too short to pass a border.
fn border(problem: &Problem) -> Vec<(f64, f64)> {
    let (spec, obstacles) = (&problem.spec, &problem.obstacles);
    let mut centres = Vec::new();
    obstacles.each_set(|index| {
        let cell = spec.cell_of_index(index);
        let beside = [(-1, 0), (1, 0), (0, -1), (0, 1)];
        let is_open = |(row, col)| {
            let near = Cell::new(cell.row + row, cell.col + col);
            spec.index_of(near).is_some() && !obstacles.get(near)
        };
        if beside.into_iter().any(is_open) {
            centres.push(spec.centre_of(cell));
        }
    });
    centres
}

fn poses(x: &[f64], y: &[f64], yaw: &[f64]) -> Vec<Pose2> {
    let positions = x.iter().zip(y).zip(yaw);
    positions
        .map(|((&x, &y), &yaw)| Pose2::new(x, y, yaw))
        .collect()
}
