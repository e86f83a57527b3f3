//! What a region is worth to each planner that takes one, if it is as good as can be: on the six problems,
//! around the path that `weighted` finds and 1.4 m to each side. Targets without such a path are left out.
//!
//! `cargo bench -p swath-planner --bench guidance [-- METHOD... MAP...]`, by the names without `-fcn`; the
//! maps are looked for where `SWATH_DATA` points, else in `../shared/data`. Steps and processor time are sums over
//! the targets that a method solves both with the region and without it.

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]

use std::sync::Arc;

use swath_bridge::{GridSpec, Outcome, Pose2, Vehicle};
use swath_planner::{
    CollisionMap, Method, MotionModel, PlanConfig, Plane, Planner, TargetPlan, millis,
};

#[path = "../tests/data/mod.rs"]
mod data;

/// Each planner and what it is with a region.
const PAIRS: [(Method, Method); 3] = [
    (Method::Tiev, Method::TievFcn),
    (Method::Hybrid, Method::HybridFcn),
    (Method::RrtStar, Method::RrtStarFcn),
];
/// Expansions, or iterations, for one target.
const MAX_EXPANSIONS: u64 = 20_000;
/// Expansions of `weighted` for one target; beyond, the target is left out.
const MAX_EXPANSIONS_BEFORE: u64 = 100_000;
/// Half the width of a region, metres.
const ASIDE_M: f64 = 1.4;

fn main() {
    let Some(problems) = data::problems() else {
        return;
    };
    let spec = GridSpec::default();
    let model = MotionModel::new(&Vehicle::default(), spec.resolution_m);
    let model = Arc::new(model.expect("the default vehicle fits the default cells"));
    let named: Vec<String> = std::env::args().collect();
    let is_named = |(plain, _): &(Method, Method)| named.iter().any(|name| name == plain.name());
    let any_named = PAIRS.iter().any(is_named);
    let is_map = |map: &&&str| named.iter().any(|name| name == **map);
    let any_map = data::NAMES.iter().any(|map| is_map(&map));
    println!(
        "{:9} {:12} {:>7} {:>6} {:>10} {:>9} {:>7} {:>7} {:>7}",
        "map", "method", "targets", "solved", "steps", "cpu ms", "cost", "steps x", "cpu x"
    );
    for name in data::NAMES.iter().filter(|map| !any_map || is_map(map)) {
        let (obstacles, goals) = data::read(&problems, name).expect("the problem can be read");
        let map = CollisionMap::new(Arc::clone(&model), spec, &obstacles);
        let map = map.expect("the map is of the default size");
        let best = plan(&map, &goals, None, Method::Weighted);
        let best: Vec<_> = best.into_iter().filter(is_solved).collect();
        let goals: Vec<Pose2> = best.iter().map(|plan| plan.goal).collect();
        let regions: Vec<Plane> = best.iter().map(|plan| region(&spec, plan)).collect();
        for pair in PAIRS.iter().filter(|pair| !any_named || is_named(pair)) {
            let plain = plan(&map, &goals, None, pair.0);
            let guided = plan(&map, &goals, Some(&regions), pair.1);
            print_rows(name, *pair, &best, (&plain, &guided));
        }
    }
}

fn is_solved(plan: &TargetPlan) -> bool {
    plan.result.outcome == Outcome::Solved
}

fn region(spec: &GridSpec, plan: &TargetPlan) -> Plane {
    let mut region = Plane::empty(spec.rows, spec.cols);
    region.draw_line(spec, &plan.result.path, ASIDE_M);
    region
}

fn plan(
    map: &CollisionMap,
    goals: &[Pose2],
    regions: Option<&[Plane]>,
    method: Method,
) -> Vec<TargetPlan> {
    let config = PlanConfig {
        method,
        max_expansions: if method == Method::Weighted {
            MAX_EXPANSIONS_BEFORE
        } else {
            MAX_EXPANSIONS
        },
        ..PlanConfig::default()
    };
    let plans = Planner::new().plan(map, goals, regions, &config);
    plans.expect("there is a region for each goal")
}

fn print_rows(
    name: &str,
    (plain, guided): (Method, Method),
    best: &[TargetPlan],
    plans: (&[TargetPlan], &[TargetPlan]),
) {
    let both: Vec<usize> = (0..best.len())
        .filter(|&target| is_solved(&plans.0[target]) && is_solved(&plans.1[target]))
        .collect();
    let sum = |plans: &[TargetPlan], of: &dyn Fn(&TargetPlan) -> f64| -> f64 {
        both.iter().map(|&target| of(&plans[target])).sum()
    };
    let steps = |plan: &TargetPlan| plan.result.steps as f64;
    let cpu_ms = |plan: &TargetPlan| millis(plan.cpu);
    let cost = |plan: &TargetPlan| plan.result.cost;
    for (method, of_method) in [(plain, plans.0), (guided, plans.1)] {
        println!(
            "{name:9} {:12} {:7} {:6} {:10} {:9.1} {:7.4} {:7.2} {:7.2}",
            method.name(),
            best.len(),
            of_method.iter().filter(|plan| is_solved(plan)).count(),
            sum(of_method, &steps),
            sum(of_method, &cpu_ms),
            sum(of_method, &cost) / sum(best, &cost),
            sum(of_method, &steps) / sum(plans.0, &steps),
            sum(of_method, &cpu_ms) / sum(plans.0, &cpu_ms),
        );
    }
}
