//! How the pipeline did.

use std::collections::BTreeMap;

use super::Section;
use crate::format::{NOTHING, count, median, optional, percent, share};
use crate::grid::Grid;
use crate::health::{
    Health, LATE_MS, OutcomeCount, PlannerHealth, RejectionCount, SampleHealth, StopCount,
    TrainerHealth, WeightsHealth,
};
use crate::spread::Spread;

/// The section.
pub(crate) fn section(health: &Health, drawn: &[String]) -> Section {
    let mut section = Section::titled("Pipeline health");
    samples(&mut section, &health.samples, drawn);
    trainers(&mut section, &health.trainers);
    weights(&mut section, &health.weights, drawn);
    planners(&mut section, &health.planners, drawn);
    stops(&mut section, &health.stops);
    rejections(&mut section, &health.rejections);
    let known = swath_bridge::Outcome::ALL.map(swath_bridge::Outcome::name);
    section.heading("Outcomes");
    if health.outcomes.is_empty() {
        section.paragraph("No target was planned to.");
    }
    counted(&mut section, &health.outcomes, ("targets", &known));
    section.heading("Paths");
    let mut known = swath_bridge::Drivability::ALL.map(swath_bridge::Drivability::name);
    // What cannot be driven comes last.
    known.rotate_left(1);
    if health.drivabilities.is_empty() {
        section.paragraph("No path was made drivable.");
    }
    counted(&mut section, &health.drivabilities, ("paths", &known));
    section
}

fn samples(section: &mut Section, health: &SampleHealth, drawn: &[String]) {
    section.heading("Samples");
    if health.samples == 0 {
        section.paragraph("No samples were recorded.");
        return;
    }
    section.paragraph(&match health.rate_per_s {
        Some(rate) => format!(
            "{} samples, {} a second over the time in which they came.",
            count(health.samples),
            crate::format::significant(rate)
        ),
        None => format!(
            "{} samples. They were not recorded as they came (a generated file bears the stamps of \
             its samples, which are made from their index), so there is no rate.",
            count(health.samples)
        ),
    });
    let mut grid = Grid::new([
        "generator",
        "samples",
        "a second",
        "missing",
        "duplicates",
        "with a path",
    ]);
    for generator in &health.generators {
        let sequence = &generator.sequence;
        grid.row([
            generator.generator.clone(),
            count(sequence.received),
            optional(generator.rate_per_s),
            count(sequence.missing),
            count(sequence.duplicates),
            share(generator.solved, sequence.received),
        ]);
    }
    section.table(&grid);
    let mut grid = Grid::new(["scene", "samples", "scenes", "with a path"]);
    for scene in &health.scenes {
        grid.row([
            scene.scene.clone(),
            count(scene.samples),
            count(scene.scenes),
            share(scene.solved, scene.samples),
        ]);
    }
    section.table(&grid);
    section.plot(drawn, "samples_per_s.svg", "Samples a second");
}

fn trainers(section: &mut Section, trainers: &[TrainerHealth]) {
    section.heading("Training");
    if trainers.is_empty() {
        section.paragraph("No trainer told its status.");
        return;
    }
    let mut grid = Grid::new([
        "run",
        "steps",
        "steps per second",
        "samples",
        "samples per second",
        "received",
        "missing",
        "duplicates",
        "rejected",
        "loss",
        "mIoU",
    ]);
    for trainer in trainers {
        grid.row([
            trainer.run.clone(),
            count(trainer.step),
            optional(trainer.steps_per_s),
            count(trainer.samples),
            crate::format::significant(trainer.samples_per_s),
            count(trainer.received),
            count(trainer.gaps),
            count(trainer.duplicates),
            count(trainer.rejected),
            crate::format::significant(trainer.loss),
            percent(Some(trainer.miou)),
        ]);
    }
    section.table(&grid);
}

fn weights(section: &mut Section, weights: &[WeightsHealth], drawn: &[String]) {
    section.heading("Weights");
    if weights.is_empty() {
        section.paragraph("No weights were published, and no plan used any.");
        return;
    }
    let mut grid = Grid::new([
        "run",
        "versions published",
        "versions applied",
        "newest published",
        "newest applied",
        "plans with them",
        "age at a plan, median (s)",
        "age at a plan, p99 (s)",
    ]);
    let version = |version: Option<u64>| version.map_or_else(|| NOTHING.to_owned(), count);
    for run in weights {
        grid.row([
            run.run.clone(),
            count(run.published as u64),
            count(run.applied as u64),
            version(run.newest_published),
            version(run.newest_applied),
            count(run.plans as u64),
            median(run.age_s.as_ref()),
            optional(run.age_s.map(|age| age.p99)),
        ]);
    }
    section.table(&grid);
    section.plot(drawn, "weights_age.svg", "Age of the weights at each plan");
}

fn planners(section: &mut Section, planners: &[PlannerHealth], drawn: &[String]) {
    section.heading("Planners");
    if planners.is_empty() {
        section.paragraph("No grids and no plans were recorded.");
        return;
    }
    let mut grid = Grid::new([
        "vehicle",
        "grids recorded",
        "planned",
        "skipped",
        "with a network",
        "targets",
        "solved",
        "stops",
        "late",
        "over the deadline, most (ms)",
        "latency p50 (ms)",
        "p99 (ms)",
        "most (ms)",
    ]);
    for planner in planners {
        let latency = |of: fn(&Spread) -> f64| optional(planner.latency_ms.as_ref().map(of));
        grid.row([
            planner.vehicle.clone(),
            count(planner.grids),
            count(planner.plans),
            count(planner.skipped),
            count(planner.with_network),
            count(planner.targets),
            count(planner.solved),
            count(planner.stops),
            count(planner.late),
            optional(planner.late_ms.map(|late| late.most)),
            latency(|spread| spread.median),
            latency(|spread| spread.p99),
            latency(|spread| spread.most),
        ]);
    }
    section.table(&grid);
    section.paragraph(&format!(
        "A plan is late if it is ready more than {LATE_MS:.0} ms after its deadline. A stop is a plan of a \
         live grid without a path to follow."
    ));
    section.plot(drawn, "latency.svg", "Latency of plans");
}

fn stops(section: &mut Section, stops: &[StopCount]) {
    section.heading("Stops");
    if stops.is_empty() {
        section.paragraph("No planner said that its path was empty.");
        return;
    }
    let mut grid = Grid::new(["vehicle", "reason", "reports", "the newest of them says"]);
    for stop in stops {
        grid.row([
            stop.vehicle.clone(),
            stop.reason.clone(),
            count(stop.reports),
            stop.newest_detail.clone(),
        ]);
    }
    section.table(&grid);
}

fn rejections(section: &mut Section, rejections: &[RejectionCount]) {
    section.heading("Messages that planners could not use");
    if rejections.is_empty() {
        section.paragraph("There were none.");
        return;
    }
    let mut grid = Grid::new(["vehicle", "topic", "cause", "messages"]);
    for rejection in rejections {
        grid.row([
            rejection.vehicle.clone(),
            rejection.topic.clone(),
            rejection.cause.clone(),
            count(rejection.messages),
        ]);
    }
    section.table(&grid);
}

/// Counts by method, a column for each name: those that are known first, as far as there are any.
fn counted(section: &mut Section, counts: &[OutcomeCount], (what, known): (&str, &[&str])) {
    if counts.is_empty() {
        return;
    }
    let mut by_method: BTreeMap<&str, BTreeMap<&str, u64>> = BTreeMap::new();
    for counted in counts {
        let of_method = by_method.entry(&counted.method).or_default();
        of_method.insert(&counted.outcome, counted.targets);
    }
    let mut columns: Vec<&str> = known.to_vec();
    for of_method in by_method.values() {
        columns.extend(of_method.keys().filter(|name| !known.contains(*name)));
    }
    columns[known.len()..].sort_unstable();
    columns.dedup();
    columns.retain(|name| {
        by_method
            .values()
            .any(|of_method| of_method.contains_key(name))
    });
    let mut grid = Grid::new(["method", what].iter().chain(&columns));
    for (method, of_method) in &by_method {
        let cells = columns
            .iter()
            .map(|name| count(of_method.get(name).copied().unwrap_or(0)));
        let all = count(of_method.values().sum());
        grid.row([(*method).to_owned(), all].into_iter().chain(cells));
    }
    section.table(&grid);
}
