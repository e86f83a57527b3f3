//! `swath plan`: once on a map, or as a node.

use std::path::Path;
use std::sync::Arc;

use serde::Serialize;
use swath_bridge::{Outcome, Pose2, goals, pgm};
use swath_planner::network::Network;
use swath_planner::smooth::Drivability;
use swath_planner::{FrameInput, FramePlan, FramePlanner, Method, MotionModel, Start, millis};

use crate::cli::{NetworkOptions, PlanOptions};
use crate::config::Config;
use crate::network;
use crate::output::{self, Failure};

pub(crate) mod node;
mod picture;
mod regions;

/// Runs the command.
pub(crate) fn run(
    options: &PlanOptions,
    session: &NetworkOptions,
    config: &Config,
) -> Result<(), Failure> {
    match (&options.map, &options.goals) {
        (Some(map), Some(goals)) => plan_once(options, map, goals, config),
        _ => node::run(options, session, config),
    }
}

/// The network to plan with, if the method asks for one: that of a file, or the one that comes with
/// swath.
fn network_of(options: &PlanOptions, config: &Config) -> anyhow::Result<Option<Network>> {
    let plan = options.plan_config(config);
    if plan.uses_network() {
        return network::load(options.weights.as_deref()).map(Some);
    }
    anyhow::ensure!(
        options.weights.is_none(),
        "{} plans without a network: --weights is for --method {}",
        plan.method.name(),
        Method::TievFcn.name()
    );
    Ok(None)
}

fn plan_once(
    options: &PlanOptions,
    map: &Path,
    goal_file: &Path,
    config: &Config,
) -> Result<(), Failure> {
    let occupancy = pgm::read_map(map, &config.grid)?;
    let goals = goals::read_poses(goal_file)?;
    let reference = match &options.reference {
        Some(path) => goals::read_poses(path)?,
        None => Vec::new(),
    };
    let network = network_of(options, config)?;
    let plan_config = options.plan_config(config);
    let method = plan_config.method;
    let obstacles = config.obstacles.obstacles(&occupancy);
    let spec = occupancy.spec;
    let model = Arc::new(MotionModel::new(&config.vehicle, spec.resolution_m)?);
    let input = FrameInput {
        spec,
        obstacles: &obstacles,
        reference: &reference,
        goals: &goals,
        start: Start::default(),
    };
    if let Some(path) = &options.regions {
        regions::write(path, &input, network.as_ref(), &plan_config)?;
    }
    let plan = FramePlanner::new(model).plan(&input, network.as_ref(), &plan_config)?;

    if let Some(path) = &options.json {
        output::json_to(path, &PlanJson::new(method, &plan))?;
    }
    if let Some(path) = &options.picture {
        picture::draw(path, &occupancy, &input, &plan, config)?;
    }
    if options.json.as_deref() != Some(Path::new("-")) {
        print_table((method, plan_config.speed_m_per_s), &plan)?;
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
    smooth_ms: f64,
}

#[derive(Debug, Serialize)]
struct TargetJson {
    index: usize,
    goal: [f64; 3],
    status: Outcome,
    /// Not a number, and so null, unless solved.
    cost: f64,
    /// The cost is at most so many times the optimum; null if nothing is proved.
    bound: f64,
    length_m: f64,
    steps: u64,
    time_ms: f64,
    /// How far the path can be driven; null unless solved.
    drivability: Option<Drivability>,
    /// Drivable where that says so, else the chords of the search.
    path: Vec<[f64; 3]>,
    /// One a pose, 1/m; empty for chords.
    curvature_per_m: Vec<f64>,
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
                bound: target.result.bound,
                length_m: target.result.length_m,
                steps: target.result.steps,
                time_ms: millis(target.cpu),
                drivability: target.drivable.as_ref().map(|path| path.drivability),
                path: target.poses().iter().map(triple).collect(),
                curvature_per_m: target.curvatures_per_m(),
            });
        Self {
            method: method.name(),
            targets: targets.collect(),
            network_ms: millis(plan.network),
            search_ms: millis(plan.search),
            cpu_ms: millis(plan.cpu),
            total_ms: millis(plan.total),
            smooth_ms: millis(plan.smooth),
        }
    }
}

fn print_table((method, speed_m_per_s): (Method, f64), plan: &FramePlan) -> anyhow::Result<()> {
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
        "{}: {solved} of {} solved; network {:.1} ms, search {:.1} ms, processor {:.1} ms, smoothing \
         {:.1} ms",
        method.name(),
        plan.targets.len(),
        millis(plan.network),
        millis(plan.search),
        millis(plan.cpu),
        millis(plan.smooth),
    ))?;
    let flagged = plan.targets.iter().filter(|target| {
        let drivable = target.drivable.as_ref();
        drivable.is_some_and(|path| !path.is_drivable())
    });
    let flagged = flagged.count();
    if flagged > 0 {
        output::line(format_args!(
            "{flagged} of the paths cannot be driven at {speed_m_per_s} m/s as they are; --json says why"
        ))?;
    }
    Ok(())
}
