//! The planners of this crate that need no network.

use std::error::Error;
use std::sync::Arc;
use std::time::Instant;

use swath_bridge::Outcome;
use swath_planner::{
    CollisionMap, CpuTimer, Method, MotionModel, PlanConfig, Planner, TargetPlan, millis,
};

use crate::problem::Problem;
use crate::run::{Drive, Fate, Run};

/// Ours come first, the one that the others are compared with at their end.
const METHODS: [Method; 3] = [Method::Tiev, Method::Weighted, Method::Swath];
/// Runs of which the cheapest counts: they differ in nothing but what else the machine does.
const ROUNDS: usize = 3;
/// Processor time from which on one run is enough, milliseconds.
const LONG_MS: f64 = 300.0;

/// All methods, collision map included; `tiev` and `weighted` stop at the limit of a goal, `swath`
/// decides all of them.
pub(crate) fn run_all(
    problem: &Problem,
    model: &Arc<MotionModel>,
) -> Result<Vec<Run>, Box<dyn Error>> {
    let run_cheapest = |method| {
        let mut best = run(problem, model, method)?;
        for _ in 1..ROUNDS {
            if best.cpu_ms < LONG_MS {
                let again = run(problem, model, method)?;
                if again.cpu_ms < best.cpu_ms {
                    best = again;
                }
            }
        }
        Ok(best)
    };
    METHODS.into_iter().map(run_cheapest).collect()
}

fn run(problem: &Problem, model: &Arc<MotionModel>, method: Method) -> Result<Run, Box<dyn Error>> {
    let planner = Planner::new();
    let config = PlanConfig {
        method,
        time_limit_ms: u64::try_from(crate::duration(problem.limit_s)?.as_millis())?,
        ..PlanConfig::default()
    };
    let (cpu, started) = (CpuTimer::of_process(), Instant::now());
    let map = CollisionMap::new(Arc::clone(model), problem.spec, &problem.obstacles)?;
    let plans = planner.plan(&map, &problem.goals, None, &config)?;
    let (cpu_ms, elapsed_ms) = (millis(cpu.elapsed()), millis(started.elapsed()));
    let solved_cpu_ms = if method == Method::Swath {
        cpu_ms
    } else {
        let solved = plans
            .iter()
            .filter(|plan| plan.result.outcome == Outcome::Solved);
        solved.map(|plan| millis(plan.cpu)).sum()
    };
    Ok(Run {
        planner: method.name().to_owned(),
        drive: Drive::Chords,
        fates: plans.into_iter().map(fate_of).collect(),
        cpu_ms,
        solved_cpu_ms,
        elapsed_ms,
    })
}

fn fate_of(plan: TargetPlan) -> Fate {
    match plan.result.outcome {
        Outcome::Solved => Fate::Solved(plan.result.path),
        Outcome::BudgetExhausted | Outcome::Cancelled => Fate::Undecided,
        Outcome::Unreachable
        | Outcome::StartOccupied
        | Outcome::GoalOccupied
        | Outcome::OutOfBounds => Fate::Unreachable,
    }
}
