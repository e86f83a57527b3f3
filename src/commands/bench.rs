//! `swath bench`: the paper's comparison, one report for each scene, number of targets and method.

use std::sync::Arc;

use swath_bridge::msg::header::Header;
use swath_bridge::recording::Writer;
use swath_bridge::{Frame, keys};
use swath_generator::Generator;
use swath_planner::network::Network;
use swath_planner::{
    FrameInput, FramePlan, FramePlanner, MAX_TARGETS, Method, MotionModel, PlanConfig,
    TargetConfig, plan_report, sample_targets,
};

use super::generate::scenes_of;
use crate::cli::BenchOptions;
use crate::config::Config;
use crate::network;
use crate::output::{self, Failure};
use crate::progress;

/// Name of the vehicle in the keys of a bench.
const VEHICLE: &str = "bench";

/// Runs the command.
pub(crate) fn run(options: &BenchOptions, config: &Config) -> Result<(), Failure> {
    check(options)?;
    let network = network::load(options.weights.as_deref())?;
    let is_of_use = options.weights.is_some() || network::misfit(network.info(), config).is_none();
    let network = is_of_use.then_some(network);
    let methods = methods_of(options, network.is_some())?;
    let scenes = scenes_of(&options.log, config)?;
    let bench = Bench {
        generator: Generator::new(config.generator(), scenes)?,
        planner: FramePlanner::new(Arc::new(MotionModel::new(
            &config.vehicle,
            config.grid.resolution_m,
        )?)),
        plan: PlanConfig {
            time_limit_ms: options.time_limit_ms,
            ..config.plan
        },
        targets: config.targets,
        obstacles: config.obstacles,
        network,
    };
    let bar = progress::bar(options.scenes, "bench");
    let mut writer = Writer::create(&options.out)?;
    let mut frames = 0;
    for scene_index in 0..options.scenes {
        let (kind, frame) = bench.generator.frame(options.seed, scene_index);
        for &count in &options.targets {
            for &method in &methods {
                let plan = bench.plan(&frame, count, method)?;
                write_report(&mut writer, (&kind, scene_index), &frame, (method, &plan))?;
                frames += 1;
            }
        }
        bar.inc(1);
    }
    writer.finish()?;
    bar.finish_and_clear();
    output::line(format_args!(
        "{frames} plans in {} scenes written to {out}; for tables: swath report {out} --out report",
        options.scenes,
        out = options.out.display(),
    ))?;
    Ok(())
}

fn check(options: &BenchOptions) -> anyhow::Result<()> {
    anyhow::ensure!(
        options
            .targets
            .iter()
            .all(|count| (1..=MAX_TARGETS).contains(count)),
        "--targets takes numbers from 1 to {MAX_TARGETS}"
    );
    Ok(())
}

fn methods_of(options: &BenchOptions, has_network: bool) -> anyhow::Result<Vec<Method>> {
    if options.methods.is_empty() {
        let can_run = |method: &Method| has_network || !method.needs_regions();
        return Ok(Method::ALL.into_iter().filter(can_run).collect());
    }
    for method in &options.methods {
        anyhow::ensure!(
            has_network || !method.needs_regions(),
            "{} needs a network: give --weights FILE",
            method.name()
        );
    }
    Ok(options.methods.clone())
}

struct Bench {
    generator: Generator,
    planner: FramePlanner,
    plan: PlanConfig,
    targets: TargetConfig,
    obstacles: swath_planner::ObstacleConfig,
    network: Option<Network>,
}

impl Bench {
    fn plan(&self, frame: &Frame, count: usize, method: Method) -> anyhow::Result<FramePlan> {
        let obstacles = self.obstacles.obstacles(&frame.occupancy);
        let spec = frame.occupancy.spec;
        let goals = sample_targets(
            &frame.reference,
            &spec,
            &TargetConfig {
                count,
                ..self.targets
            },
        );
        let input = FrameInput {
            spec,
            obstacles: &obstacles,
            reference: &frame.reference,
            goals: &goals,
        };
        let plan = PlanConfig {
            method,
            speed_m_per_s: frame.speed_m_per_s,
            ..self.plan
        };
        let network = self.network.as_ref().filter(|_| plan.uses_network());
        Ok(self.planner.plan(&input, network, &plan)?)
    }
}

fn write_report(
    writer: &mut Writer,
    (kind, scene_index): (&str, u64),
    frame: &Frame,
    (method, plan): (Method, &FramePlan),
) -> anyhow::Result<()> {
    let header = Header::at(frame.stamp_nanos, "base_link");
    let mut report = plan_report(header, method, frame.speed_m_per_s, plan);
    VEHICLE.clone_into(&mut report.vehicle);
    kind.clone_into(&mut report.scene);
    report.frame = scene_index;
    writer.write(
        &keys::plan(VEHICLE),
        &report,
        frame.stamp_nanos,
        frame.stamp_nanos,
    )?;
    Ok(())
}
