//! `swath plan`: once on a map, or as a node.

use std::path::Path;
use std::sync::Arc;

use anyhow::Context;
use serde::Serialize;
use swath_bridge::{Outcome, Pose2, goals, pgm};
use swath_planner::network::Network;
use swath_planner::{FrameInput, FramePlan, FramePlanner, Method, MotionModel, millis};

use crate::cli::{NetworkOptions, PlanOptions};
use crate::config::Config;
use crate::output::{self, Failure};

pub(crate) mod node;
mod picture;

/// Runs the command.
pub(crate) fn run(
    options: &PlanOptions,
    network: &NetworkOptions,
    config: &Config,
) -> Result<(), Failure> {
    match (&options.map, &options.goals) {
        (Some(map), Some(goals)) => plan_once(options, map, goals, config),
        _ => node::run(options, network, config),
    }
}

/// Loads a network from a weights file.
pub(crate) fn load_network(path: &Path) -> anyhow::Result<Network> {
    let context = || path.display().to_string();
    let bytes = std::fs::read(path).with_context(context)?;
    Network::load(&bytes).with_context(context)
}

/// The method that was asked for, or the best one that can run.
fn method_of(options: &PlanOptions) -> anyhow::Result<Method> {
    let has_weights = options.weights.is_some();
    let method = options.method.unwrap_or(if has_weights {
        Method::TievFcn
    } else {
        Method::Tiev
    });
    anyhow::ensure!(
        has_weights || !method.needs_regions(),
        "{} predicts regions and needs a network: give --weights FILE (swath train makes one)",
        method.name()
    );
    Ok(method)
}

fn plan_once(
    options: &PlanOptions,
    map: &Path,
    goal_file: &Path,
    config: &Config,
) -> Result<(), Failure> {
    let method = method_of(options)?;
    let occupancy = pgm::read_map(map, &config.grid)?;
    let goals = goals::read_poses(goal_file)?;
    let reference = match &options.reference {
        Some(path) => goals::read_poses(path)?,
        None => Vec::new(),
    };
    let network = match &options.weights {
        Some(path) if method.needs_regions() => Some(load_network(path)?),
        _ => None,
    };
    let mut plan_config = config.plan;
    plan_config.speed_m_per_s = options.speed.unwrap_or(plan_config.speed_m_per_s);
    plan_config.time_limit_ms = options.time_limit_ms.unwrap_or(plan_config.time_limit_ms);

    let obstacles = config.obstacles.obstacles(&occupancy);
    let spec = occupancy.spec;
    let model = Arc::new(MotionModel::new(&config.vehicle, spec.resolution_m)?);
    let input = FrameInput {
        spec,
        obstacles: &obstacles,
        reference: &reference,
        goals: &goals,
    };
    let plan = FramePlanner::new(model).plan(&input, network.as_ref(), &plan_config)?;

    if let Some(path) = &options.json {
        output::json_to(path, &PlanJson::new(method, &plan))?;
    }
    if let Some(path) = &options.picture {
        picture::draw(path, &occupancy, &input, &plan, config)?;
    }
    if options.json.as_deref() != Some(Path::new("-")) {
        print_table(method, &plan)?;
    }
    Ok(())
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct PlanJson {
    method: &'static str,
    targets: Vec<TargetJson>,
    network_ms: f64,
    search_ms: f64,
    cpu_ms: f64,
    total_ms: f64,
}

#[derive(Debug, Serialize)]
struct TargetJson {
    index: usize,
    goal: [f64; 3],
    status: Outcome,
    /// Not a number, and so null, unless solved.
    cost: f64,
    length_m: f64,
    steps: u64,
    time_ms: f64,
    path: Vec<[f64; 3]>,
}

impl PlanJson {
    fn new(method: Method, plan: &FramePlan) -> Self {
        let triple = |pose: &Pose2| [pose.x_m, pose.y_m, pose.yaw_rad];
        let targets = plan
            .targets
            .iter()
            .enumerate()
            .map(|(index, target)| TargetJson {
                index,
                goal: triple(&target.goal),
                status: target.result.outcome,
                cost: target.result.cost,
                length_m: target.result.length_m,
                steps: target.result.steps,
                time_ms: millis(target.cpu),
                path: target.result.path.iter().map(triple).collect(),
            });
        Self {
            method: method.name(),
            targets: targets.collect(),
            network_ms: millis(plan.network),
            search_ms: millis(plan.search),
            cpu_ms: millis(plan.cpu),
            total_ms: millis(plan.total),
        }
    }
}

fn print_table(method: Method, plan: &FramePlan) -> anyhow::Result<()> {
    output::line(
        "target         goal (x, y, yaw)  status              cost  length m    steps  time ms",
    )?;
    for (index, target) in plan.targets.iter().enumerate() {
        let goal = &target.goal;
        let result = &target.result;
        let number = |value: f64| {
            if value.is_nan() {
                "-".to_owned()
            } else {
                format!("{value:.2}")
            }
        };
        output::line(format_args!(
            "{index:>6}  {:>6.2} {:>6.2} {:>6.2} rad  {:<16} {:>7} {:>9} {:>8} {:>8.2}",
            goal.x_m,
            goal.y_m,
            goal.yaw_rad,
            result.outcome.name(),
            number(result.cost),
            number(result.length_m),
            result.steps,
            millis(target.cpu),
        ))?;
    }
    let solved = plan
        .targets
        .iter()
        .filter(|target| target.result.outcome == Outcome::Solved)
        .count();
    output::line(format_args!(
        "{}: {solved} of {} solved; network {:.1} ms, search {:.1} ms, processor {:.1} ms",
        method.name(),
        plan.targets.len(),
        millis(plan.network),
        millis(plan.search),
        millis(plan.cpu),
    ))?;
    if solved > 0 {
        output::line(
            "The paths are chords of the lookup table: they turn at their joints, within the angle \
             limit of the speed, and a controller has to round them off.",
        )?;
    }
    Ok(())
}
