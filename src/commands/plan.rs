//! `swath plan`: once on a map, or as a node.

use std::path::Path;
use std::sync::Arc;

use serde::Serialize;
use swath_bridge::{GridSpec, Outcome, Pose2, goals};
use swath_planner::network::Network;
use swath_planner::smooth::Drivability;
use swath_planner::{FrameInput, FramePlan, FramePlanner, Method, MotionModel, TargetPlan, millis};

use crate::cli::{NetworkOptions, PlanOptions};
use crate::config::Config;
use crate::network;
use crate::output::{self, Failure};
use crate::outputs;

pub(crate) use picture::reason_of;
use place::Place;

pub(crate) mod node;
mod picture;
mod place;
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
    for path in [&options.json, &options.picture].into_iter().flatten() {
        if path != Path::new("-") {
            outputs::test_file(path)?;
        }
    }
    let place = Place::read(map, options.start.as_ref(), config)?;
    let named = goals::read_poses(goal_file)?;
    if named.is_empty() {
        return Err(anyhow::anyhow!(
            "{}: there is no goal, expected a line \"x y yaw\" for each",
            goal_file.display()
        )
        .into());
    }
    let goals = place.in_grid(&named);
    let reference = match &options.reference {
        Some(path) => place.in_grid(&goals::read_poses(path)?),
        None => Vec::new(),
    };
    let network = network_of(options, config)?;
    let plan_config = options.plan_config(config);
    let method = plan_config.method;
    let obstacles = config.obstacles.obstacles(&place.occupancy);
    let spec = place.occupancy.spec;
    let model = Arc::new(MotionModel::new(&config.vehicle, spec.resolution_m)?);
    let input = FrameInput {
        spec,
        obstacles: &obstacles,
        reference: &reference,
        goals: &goals,
        start: place.start,
    };
    let around = place.grid_around(&goals, network.as_ref())?;
    if let Some(network) = &network {
        warn_of_misfit(network, &around, config);
    }
    if let Some(path) = &options.regions {
        if place.is_around {
            return Err(anyhow::anyhow!(
                "{}: --regions are those of a map in the vehicle's frame, without --start and unturned",
                path.display()
            )
            .into());
        }
        regions::write(path, &input, network.as_ref(), &plan_config)?;
    }
    let planner = FramePlanner::new(model);
    let plan = planner.plan_on(&input, &around, network.as_ref(), &plan_config)?;

    if let Some(path) = &options.json {
        output::json_to(path, &PlanJson::new(method, &plan, (&place, &named)))?;
    }
    if let Some(path) = &options.picture {
        let shown = picture::Shown {
            place: &place,
            named: &named,
            around: &around,
            method,
        };
        shown.draw(path, &input, &plan, config)?;
    }
    if options.json.as_deref() != Some(Path::new("-")) {
        print_table((method, plan_config.speed_m_per_s), &plan, &named)?;
    }
    let is_solved = |target: &TargetPlan| target.result.outcome == Outcome::Solved;
    if plan.targets.iter().any(is_solved) {
        return Ok(());
    }
    Err(Failure::Unsolved(place.why_unsolved(&plan)))
}

/// Says where the network was trained for something else than is planned on.
fn warn_of_misfit(network: &Network, around: &GridSpec, config: &Config) {
    if let Some(what) = network::misfit_on(network.info(), around, &config.vehicle) {
        tracing::warn!("the network may be of little use: {what}");
    }
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct PlanJson {
    method: &'static str,
    /// Where paths begin, in the frame that they are in.
    start: [f64; 3],
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
    /// Of a plan; goals as they were given, paths in the map's frame.
    fn new(method: Method, plan: &FramePlan, (place, named): (&Place, &[Pose2])) -> Self {
        let triple = |pose: &Pose2| [pose.x_m, pose.y_m, pose.yaw_rad];
        let targets = plan
            .targets
            .iter()
            .zip(named)
            .enumerate()
            .map(|(index, (target, goal))| TargetJson {
                index,
                goal: triple(goal),
                status: target.result.outcome,
                cost: target.result.cost,
                bound: target.result.bound,
                length_m: target.result.length_m,
                steps: target.result.steps,
                time_ms: millis(target.cpu),
                drivability: target.drivable.as_ref().map(|path| path.drivability),
                path: target
                    .poses()
                    .iter()
                    .map(|pose| triple(&place.in_map(pose)))
                    .collect(),
                curvature_per_m: target.curvatures_per_m(),
            });
        Self {
            method: method.name(),
            start: triple(&place.in_map(&place.start.pose)),
            targets: targets.collect(),
            network_ms: millis(plan.network),
            search_ms: millis(plan.search),
            cpu_ms: millis(plan.cpu),
            total_ms: millis(plan.total),
            smooth_ms: millis(plan.smooth),
        }
    }
}

fn print_table(
    (method, speed_m_per_s): (Method, f64),
    plan: &FramePlan,
    named: &[Pose2],
) -> anyhow::Result<()> {
    output::line(
        "target         goal (x, y, yaw)  status              cost  length m    steps  time ms",
    )?;
    for (index, (target, goal)) in plan.targets.iter().zip(named).enumerate() {
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
