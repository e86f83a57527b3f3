//! The six problems by methods that need no network: time, expansions, outcomes, and how far costs
//! are from the optimum, which `tiev` finds.
//!
//! `cargo bench -p swath-planner --bench problems [-- METHOD... [DEADLINE_MS]]`; the maps are looked for where
//! `SWATH_DATA` points, else in `../shared/data`. Without `tiev` there are no ratios. A deadline is for
//! the frame, and `swath` alone keeps it.

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use swath_bridge::{GridSpec, Outcome, Vehicle};
use swath_planner::{
    CollisionMap, CpuTimer, Method, MotionModel, PlanConfig, Planner, TargetPlan, millis,
};

#[path = "../tests/data/mod.rs"]
mod data;

/// Runs of which the cheapest counts.
const ROUNDS: usize = 3;
/// Processor time from which on one run is enough.
const LONG_MS: f64 = 300.0;

struct Measured {
    plans: Vec<TargetPlan>,
    cpu_ms: f64,
    elapsed_ms: f64,
}

fn main() {
    let Some(problems) = data::problems() else {
        return;
    };
    let named: Vec<Method> = std::env::args()
        .filter_map(|name| Method::from_name(&name))
        .collect();
    let wanted = |method: &Method| {
        let is_usual = named.is_empty() && Method::COMPARED.contains(method);
        !method.needs_regions() && (is_usual || named.contains(method))
    };
    let methods: Vec<Method> = Method::ALL.into_iter().filter(wanted).collect();
    let model = MotionModel::new(&Vehicle::default(), GridSpec::default().resolution_m);
    let model = Arc::new(model.expect("the default vehicle fits the default cells"));
    println!(
        "{:9} {:8} {:>9} {:>9} {:>10} {:>6} {:>11} {:>9} {:>7} {:>7}",
        "map",
        "method",
        "cpu ms",
        "wall ms",
        "steps",
        "solved",
        "unreachable",
        "undecided",
        "mean",
        "max"
    );
    let mut ratios = Vec::new();
    for name in data::NAMES {
        let measured: Vec<Measured> = methods
            .iter()
            .map(|&method| measure(&model, &problems, name, method))
            .collect();
        let optimum = methods.iter().position(|&method| method == Method::Tiev);
        for (method, of_method) in methods.iter().zip(&measured) {
            print_row(
                name,
                *method,
                of_method,
                optimum.map(|tiev| &measured[tiev]),
            );
        }
        let last = &measured[measured.len() - 1];
        ratios.push(
            measured
                .iter()
                .map(|other| other.cpu_ms / last.cpu_ms)
                .collect::<Vec<_>>(),
        );
    }
    let last = methods.last().map_or("", |method| method.name());
    for (index, method) in methods.iter().enumerate() {
        let mut of_method: Vec<f64> = ratios.iter().map(|ratio| ratio[index]).collect();
        of_method.sort_by(f64::total_cmp);
        let median = f64::midpoint(of_method[2], of_method[3]);
        println!(
            "{} takes {median:.1} times the processor time of {last} at the median, {:.1} at least",
            method.name(),
            of_method[0]
        );
    }
}

fn measure(model: &Arc<MotionModel>, problems: &Path, name: &str, method: Method) -> Measured {
    let spec = GridSpec::default();
    let (obstacles, goals) = data::read(problems, name).expect("the problem can be read");
    let planner = Planner::new();
    let config = PlanConfig {
        method,
        frame_deadline_ms: std::env::args()
            .find_map(|arg| arg.parse().ok())
            .unwrap_or(0),
        ..PlanConfig::default()
    };
    let run = || {
        let (cpu, started) = (CpuTimer::of_process(), Instant::now());
        let map = CollisionMap::new(Arc::clone(model), spec, &obstacles);
        let map = map.expect("the map is of the default size");
        let plans = planner.plan(&map, &goals, None, &config);
        Measured {
            plans: plans.expect("the configuration is valid"),
            cpu_ms: millis(cpu.elapsed()),
            elapsed_ms: millis(started.elapsed()),
        }
    };
    let mut best = run();
    for _ in 1..ROUNDS {
        if best.cpu_ms > LONG_MS {
            break;
        }
        let again = run();
        if again.cpu_ms < best.cpu_ms {
            best = again;
        }
    }
    best
}

fn print_row(name: &str, method: Method, measured: &Measured, optimum: Option<&Measured>) {
    let count = |wanted: &dyn Fn(Outcome) -> bool| {
        let plans = measured.plans.iter();
        plans.filter(|plan| wanted(plan.result.outcome)).count()
    };
    let solved = count(&|outcome| outcome == Outcome::Solved);
    let undecided = count(&|outcome| outcome == Outcome::BudgetExhausted);
    let steps: u64 = measured.plans.iter().map(|plan| plan.result.steps).sum();
    let ratios: Vec<f64> = optimum.map_or_else(Vec::new, |optimum| {
        let pairs = measured.plans.iter().zip(&optimum.plans);
        let ratios = pairs.map(|(plan, best)| plan.result.cost / best.result.cost);
        ratios.filter(|ratio| ratio.is_finite()).collect()
    });
    let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
    let most = ratios.iter().copied().fold(f64::NAN, f64::max);
    println!(
        "{name:9} {:8} {:9.1} {:9.1} {steps:10} {solved:6} {:11} {undecided:9} {mean:7.4} {most:7.4}",
        method.name(),
        measured.cpu_ms,
        measured.elapsed_ms,
        measured.plans.len() - solved - undecided,
    );
}
