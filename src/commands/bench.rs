//! `swath bench`: the paper's comparison, one report for each scene, number of targets and method.

mod checked;

use std::sync::Arc;

use swath_bridge::msg::header::Header;
use swath_bridge::recording::Writer;
use swath_bridge::{Frame, Outcome, Vehicle, keys};
use swath_generator::Generator;
use swath_planner::network::Network;
use swath_planner::{
    FrameInput, FramePlan, FramePlanner, Method, MotionModel, PlanConfig, Start, TargetConfig,
    TargetPlan, plan_report, sample_targets,
};

use checked::Checked;

use super::generate::scenes_of;
use crate::cli::BenchOptions;
use crate::config::Config;
use crate::output::{self, Failure};
use crate::progress::{self, Unit};
use crate::{network, outputs};

/// Name of the vehicle in the keys of a bench.
const VEHICLE: &str = "bench";

/// Runs the command.
pub(crate) fn run(options: &BenchOptions, config: &Config) -> Result<(), Failure> {
    outputs::test_apart(&options.out, options.log.iter().chain(&options.weights))?;
    outputs::test_file(&options.out)?;
    let network = network::load(options.weights.as_deref())?;
    let is_of_use = options.weights.is_some() || network::misfit(network.info(), config).is_none();
    let network = is_of_use.then_some(network);
    let methods = methods_of(options, network.is_some())?;
    let configured = [config.plan.frame_deadline_ms];
    let deadlines_ms = match options.deadline_ms.as_slice() {
        [] => &configured,
        named => named,
    };
    let entrants = entrants_of(&methods, deadlines_ms);
    let scenes = scenes_of(&options.log, config)?;
    let bench = Bench {
        generator: Generator::new(config.generator(), scenes)?,
        planner: FramePlanner::new(Arc::new(MotionModel::new(
            &config.vehicle,
            config.grid.resolution_m,
        )?)),
        plan: PlanConfig {
            time_limit_ms: options.time_limit_ms,
            smooth: options.check,
            ..config.plan
        },
        targets: config.targets,
        obstacles: config.obstacles,
        network,
        vehicle: config.vehicle,
    };
    let mut checked = options.check.then(Checked::default);
    let bar = progress::bar_of(options.scenes, "bench", Unit::Count("scenes"));
    let mut writer = Writer::create(&options.out)?;
    let (mut frames, mut solved) = (0u64, 0usize);
    for scene_index in 0..options.scenes {
        let (kind, frame) = bench.generator.frame(options.seed, scene_index);
        for &count in &options.targets {
            for entrant in &entrants {
                let plan = bench.plan((&frame, count), entrant, checked.as_mut())?;
                write_report(&mut writer, (&kind, scene_index), &frame, (entrant, &plan))?;
                frames += 1;
                let targets = plan.targets.iter();
                solved += targets.filter(|target| is_solved(target)).count();
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
    if let Some(checked) = checked {
        output::line(checked.describe())?;
        if checked.is_bad() {
            return Err(
                anyhow::anyhow!("there are paths that cannot be driven as was said").into(),
            );
        }
    }
    if solved == 0 {
        let what = format!("no target of {frames} plans was reached");
        return Err(Failure::Unsolved(what));
    }
    Ok(())
}

fn is_solved(target: &TargetPlan) -> bool {
    target.result.outcome == Outcome::Solved
}

fn methods_of(options: &BenchOptions, has_network: bool) -> anyhow::Result<Vec<Method>> {
    if options.methods.is_empty() {
        let can_run = |method: &Method| has_network || !method.needs_regions();
        return Ok(Method::COMPARED.into_iter().filter(can_run).collect());
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

/// A method under a deadline, if it keeps one.
struct Entrant {
    name: String,
    method: Method,
    deadline_ms: u64,
}

fn entrants_of(methods: &[Method], of_frame_ms: &[u64]) -> Vec<Entrant> {
    let mut entrants = Vec::new();
    for &method in methods {
        let deadlines_ms: &[u64] = if method == Method::Swath {
            of_frame_ms
        } else {
            &[0]
        };
        entrants.extend(deadlines_ms.iter().map(|&deadline_ms| Entrant {
            name: match deadline_ms {
                0 => method.name().to_owned(),
                _ => format!("{}-{deadline_ms}ms", method.name()),
            },
            method,
            deadline_ms,
        }));
    }
    entrants
}

struct Bench {
    generator: Generator,
    planner: FramePlanner,
    plan: PlanConfig,
    targets: TargetConfig,
    obstacles: swath_planner::ObstacleConfig,
    network: Option<Network>,
    vehicle: Vehicle,
}

impl Bench {
    fn plan(
        &self,
        (frame, count): (&Frame, usize),
        entrant: &Entrant,
        checked: Option<&mut Checked>,
    ) -> anyhow::Result<FramePlan> {
        let method = entrant.method;
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
            start: Start::default(),
        };
        let plan = PlanConfig {
            method,
            speed_m_per_s: frame.speed_m_per_s,
            frame_deadline_ms: entrant.deadline_ms,
            ..self.plan
        };
        let network = self.network.as_ref().filter(|_| plan.uses_network());
        let plan = self.planner.plan(&input, network, &plan)?;
        if let Some(checked) = checked {
            checked.add(&self.vehicle, (&input, &plan), frame.speed_m_per_s);
        }
        Ok(plan)
    }
}

fn write_report(
    writer: &mut Writer,
    (kind, scene_index): (&str, u64),
    frame: &Frame,
    (entrant, plan): (&Entrant, &FramePlan),
) -> anyhow::Result<()> {
    let header = Header::at(frame.stamp_nanos, "base_link");
    let mut report = plan_report(header, entrant.method, frame.speed_m_per_s, plan);
    report.method.clone_from(&entrant.name);
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
