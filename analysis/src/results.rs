//! Computed tables as frames, for CSV and Parquet.

use polars::prelude::DataFrame;

use crate::Error;
use crate::agreement::Agreement;
use crate::comparison::{Comparison, Ratio, Side};
use crate::error::InTable as _;
use crate::health::{GeneratorHealth, Health, PlannerHealth, WeightsHealth};
use crate::pairwise::Pairwise;
use crate::spread::Spread;
use crate::tables::{Row, row_table};

row_table! {
    /// One method's part of a comparison.
    struct ComparisonRow in "comparisons" {
        compared: String,
        baseline: String,
        pairs_with: String,
        targets: u32,
        pairs: u64,
        method: String,
        solved_mean: Option<f64>,
        search_ms_q1: Option<f64>,
        search_ms_median: Option<f64>,
        search_ms_q3: Option<f64>,
        cpu_ms_q1: Option<f64>,
        cpu_ms_median: Option<f64>,
        cpu_ms_q3: Option<f64>,
        total_ms_q1: Option<f64>,
        total_ms_median: Option<f64>,
        total_ms_q3: Option<f64>,
        network_ms_median: Option<f64>,
        steps_q1: Option<f64>,
        steps_median: Option<f64>,
        steps_q3: Option<f64>,
    }
}

row_table! {
    /// The ratios of a comparison.
    struct RatioRow in "ratios" {
        compared: String,
        baseline: String,
        pairs_with: String,
        targets: u32,
        pairs: u64,
        measure: String,
        of_medians: Option<f64>,
        of_pairs_q1: Option<f64>,
        of_pairs_median: Option<f64>,
        of_pairs_q3: Option<f64>,
        of_pairs_most: Option<f64>,
    }
}

row_table! {
    /// Targets of a comparison's pairs.
    struct ReachedRow in "reached" {
        compared: String,
        baseline: String,
        pairs_with: String,
        targets: u32,
        all: u64,
        by_both: u64,
        by_baseline_alone: u64,
        by_compared_alone: u64,
    }
}

row_table! {
    /// A method against the baseline, summed over the targets that both reached.
    struct PairwiseRow in "pairwise" {
        compared: String,
        baseline: String,
        targets: u32,
        scene: String,
        frames: u64,
        by_both: u64,
        by_baseline_alone: u64,
        by_compared_alone: u64,
        baseline_steps: f64,
        compared_steps: f64,
        baseline_ms: f64,
        compared_ms: f64,
        steps_ratio_but_costliest: Option<f64>,
        time_ratio_but_costliest: Option<f64>,
        cost_ratio_mean: Option<f64>,
        cost_ratio_most: Option<f64>,
        network_ms_mean: Option<f64>,
        frame_by_target_elapsed: Option<f64>,
        frame_by_target_cpu: Option<f64>,
    }
}

row_table! {
    /// A subject's agreement.
    struct AgreementRow in "agreement" {
        predictor: String,
        is_baseline: bool,
        run: String,
        weights_version: u64,
        is_newest: bool,
        split: String,
        group: String,
        dilation_m: f64,
        samples: u64,
        miou: Option<f64>,
        miou_low: Option<f64>,
        miou_high: Option<f64>,
        iou_path: Option<f64>,
        iou_background: Option<f64>,
        joined_share: Option<f64>,
        ms_per_sample: Option<f64>,
    }
}

row_table! {
    /// A generator's samples.
    struct GeneratorRow in "generators" {
        generator: String,
        received: u64,
        rate_per_s: Option<f64>,
        missing: u64,
        duplicates: u64,
        solved: u64,
    }
}

row_table! {
    /// A run's weights.
    struct WeightsHealthRow in "weights_health" {
        run: String,
        published: u64,
        applied: u64,
        newest_published: Option<u64>,
        newest_applied: Option<u64>,
        plans: u64,
        age_s_median: Option<f64>,
        age_s_p99: Option<f64>,
        miou: Option<f64>,
    }
}

row_table! {
    /// A vehicle's planner.
    struct PlannerRow in "planners" {
        vehicle: String,
        grids: u64,
        plans: u64,
        skipped: u64,
        with_network: u64,
        targets: u64,
        solved: u64,
        stops: u64,
        late: u64,
        latency_ms_median: Option<f64>,
        latency_ms_p99: Option<f64>,
        latency_ms_most: Option<f64>,
    }
}

row_table! {
    /// Targets by outcome.
    struct OutcomeRow in "outcomes" {
        method: String,
        outcome: String,
        targets: u64,
    }
}

/// Every computed table with its name.
///
/// # Errors
/// [`Error::Table`] if polars refuses a column.
pub(crate) fn frames(
    comparisons: &[Comparison],
    pairwise: &[Pairwise],
    agreements: &[Agreement],
    health: &Health,
) -> Result<Vec<(&'static str, DataFrame)>, Error> {
    let outcomes = health.outcomes.iter().map(|outcome| OutcomeRow {
        method: outcome.method.clone(),
        outcome: outcome.outcome.clone(),
        targets: outcome.targets,
    });
    Ok(vec![
        frame(comparisons.iter().flat_map(comparison_rows))?,
        frame(comparisons.iter().flat_map(ratio_rows))?,
        frame(comparisons.iter().map(reached_row))?,
        frame(pairwise.iter().map(pairwise_row))?,
        frame(agreements.iter().map(agreement_row))?,
        frame(health.samples.generators.iter().map(generator_row))?,
        frame(health.weights.iter().map(weights_row))?,
        frame(health.planners.iter().map(planner_row))?,
        frame(outcomes)?,
    ])
}

fn frame<R: Row>(rows: impl Iterator<Item = R>) -> Result<(&'static str, DataFrame), Error> {
    let frame = R::columns(&rows.collect::<Vec<R>>()).in_table(R::TABLE)?;
    Ok((R::TABLE, frame))
}

fn comparison_rows(comparison: &Comparison) -> [ComparisonRow; 2] {
    [&comparison.baseline, &comparison.compared].map(|side: &Side| {
        let [search, cpu, total, steps] =
            [side.search_ms, side.cpu_ms, side.total_ms, side.steps].map(quartiles);
        ComparisonRow {
            compared: comparison.compared.method.clone(),
            baseline: comparison.baseline.method.clone(),
            pairs_with: comparison.set.name().to_owned(),
            targets: comparison.targets,
            pairs: comparison.pairs as u64,
            method: side.method.clone(),
            solved_mean: side.solved_mean,
            search_ms_q1: search[0],
            search_ms_median: search[1],
            search_ms_q3: search[2],
            cpu_ms_q1: cpu[0],
            cpu_ms_median: cpu[1],
            cpu_ms_q3: cpu[2],
            total_ms_q1: total[0],
            total_ms_median: total[1],
            total_ms_q3: total[2],
            network_ms_median: side.network_ms.map(|spread| spread.median),
            steps_q1: steps[0],
            steps_median: steps[1],
            steps_q3: steps[2],
        }
    })
}

fn quartiles(spread: Option<Spread>) -> [Option<f64>; 3] {
    spread.map_or([None; 3], |spread| {
        [spread.lower_quartile, spread.median, spread.upper_quartile].map(Some)
    })
}

fn ratio_rows(comparison: &Comparison) -> [RatioRow; 7] {
    let by_target = &comparison.by_target;
    [
        ("search_ms", comparison.search),
        ("cpu_ms", comparison.cpu),
        ("total_ms", comparison.total),
        ("steps", comparison.steps),
        ("steps of targets that both reached", by_target.steps),
        ("time_ms of targets that both reached", by_target.time),
        ("cost of targets that both reached", by_target.cost),
    ]
    .map(|(measure, ratio): (&str, Ratio)| {
        let [q1, median, q3] = quartiles(ratio.of_pairs);
        RatioRow {
            compared: comparison.compared.method.clone(),
            baseline: comparison.baseline.method.clone(),
            pairs_with: comparison.set.name().to_owned(),
            targets: comparison.targets,
            pairs: comparison.pairs as u64,
            measure: measure.to_owned(),
            of_medians: ratio.of_medians,
            of_pairs_q1: q1,
            of_pairs_median: median,
            of_pairs_q3: q3,
            of_pairs_most: ratio.of_pairs.map(|spread| spread.most),
        }
    })
}

fn reached_row(comparison: &Comparison) -> ReachedRow {
    let by_target = &comparison.by_target;
    ReachedRow {
        compared: comparison.compared.method.clone(),
        baseline: comparison.baseline.method.clone(),
        pairs_with: comparison.set.name().to_owned(),
        targets: comparison.targets,
        all: by_target.targets as u64,
        by_both: by_target.both as u64,
        by_baseline_alone: by_target.baseline_only as u64,
        by_compared_alone: by_target.compared_only as u64,
    }
}

fn pairwise_row(pairwise: &Pairwise) -> PairwiseRow {
    PairwiseRow {
        compared: pairwise.compared.clone(),
        baseline: pairwise.baseline.clone(),
        targets: pairwise.targets,
        scene: pairwise.scene.clone(),
        frames: pairwise.frames as u64,
        by_both: pairwise.both as u64,
        by_baseline_alone: pairwise.baseline_only as u64,
        by_compared_alone: pairwise.compared_only as u64,
        baseline_steps: pairwise.all.baseline_steps,
        compared_steps: pairwise.all.compared_steps,
        baseline_ms: pairwise.all.baseline_ms,
        compared_ms: pairwise.all.compared_ms,
        steps_ratio_but_costliest: pairwise.but_costliest.steps_ratio(),
        time_ratio_but_costliest: pairwise.but_costliest.time_ratio(),
        cost_ratio_mean: pairwise.cost_ratio_mean,
        cost_ratio_most: pairwise.cost_ratio_most,
        network_ms_mean: pairwise.network_ms_mean,
        frame_by_target_elapsed: pairwise.frame_by_target_elapsed,
        frame_by_target_cpu: pairwise.frame_by_target_cpu,
    }
}

fn agreement_row(agreement: &Agreement) -> AgreementRow {
    let (subject, sums) = (&agreement.subject, &agreement.sums);
    AgreementRow {
        predictor: subject.predictor.clone(),
        is_baseline: !subject.is_learned(),
        run: subject.run.clone(),
        weights_version: subject.weights_version,
        is_newest: agreement.is_newest,
        split: subject.split.clone(),
        group: subject.group.clone(),
        dilation_m: subject.dilation_mm as f64 / 1000.0,
        samples: sums.samples,
        miou: sums.miou(),
        miou_low: sums.miou_interval().map(|interval| interval.low),
        miou_high: sums.miou_interval().map(|interval| interval.high),
        iou_path: sums.iou_path(),
        iou_background: sums.iou_background(),
        joined_share: sums.joined_share(),
        ms_per_sample: sums.ms_per_sample(),
    }
}

fn generator_row(generator: &GeneratorHealth) -> GeneratorRow {
    GeneratorRow {
        generator: generator.generator.clone(),
        received: generator.sequence.received,
        rate_per_s: generator.rate_per_s,
        missing: generator.sequence.missing,
        duplicates: generator.sequence.duplicates,
        solved: generator.solved,
    }
}

fn weights_row(weights: &WeightsHealth) -> WeightsHealthRow {
    WeightsHealthRow {
        run: weights.run.clone(),
        published: weights.published as u64,
        applied: weights.applied as u64,
        newest_published: weights.newest_published,
        newest_applied: weights.newest_applied,
        plans: weights.plans as u64,
        age_s_median: weights.age_s.map(|spread| spread.median),
        age_s_p99: weights.age_s.map(|spread| spread.p99),
        miou: Some(weights.miou).filter(|miou| miou.is_finite()),
    }
}

fn planner_row(planner: &PlannerHealth) -> PlannerRow {
    PlannerRow {
        vehicle: planner.vehicle.clone(),
        grids: planner.grids,
        plans: planner.plans,
        skipped: planner.skipped,
        with_network: planner.with_network,
        targets: planner.targets,
        solved: planner.solved,
        stops: planner.stops,
        late: planner.late,
        latency_ms_median: planner.latency_ms.map(|spread| spread.median),
        latency_ms_p99: planner.latency_ms.map(|spread| spread.p99),
        latency_ms_most: planner.latency_ms.map(|spread| spread.most),
    }
}
