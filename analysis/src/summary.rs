//! What a report came to, for a terminal or a program.

use std::path::PathBuf;

use serde::Serialize;

use crate::agreement::Agreement;
use crate::comparison::{Comparison, PairSet};
use crate::format::{count, interval, optional, percent, share, significant, times};
use crate::health::{Health, PlannerHealth, TrainerHealth};
use crate::interval::Interval;
use crate::paper;
use crate::tables::Tables;

/// A method against the baseline on one number of targets, medians over all pairs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MethodSummary {
    /// The method that is compared.
    pub method: String,
    /// The method that it is compared with.
    pub baseline: String,
    /// Number of targets of each plan.
    pub targets: u32,
    /// Frames that both methods planned.
    pub pairs: usize,
    /// Elapsed search time of the compared method.
    pub search_ms: Option<f64>,
    /// The same of the baseline.
    pub baseline_search_ms: Option<f64>,
    /// The first by the second.
    pub search_ratio: Option<f64>,
    /// Median expansions of the compared method by those of the baseline.
    pub steps_ratio: Option<f64>,
}

/// How well a predictor's regions match labels.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PredictorSummary {
    /// Architecture, or the name of a baseline.
    pub predictor: String,
    /// Whether it learned nothing.
    pub is_baseline: bool,
    /// What it was evaluated on.
    pub split: String,
    /// Samples.
    pub samples: u64,
    /// Mean intersection over union.
    pub miou: Option<f64>,
    /// Where it would lie over many more samples, with a probability of 95 %.
    pub interval: Option<Interval>,
    /// Whether there are enough samples for the paper's mIoU to stand beside it.
    pub is_comparable: bool,
}

/// What a planner did.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlannerSummary {
    /// Vehicle.
    pub vehicle: String,
    /// Frames planned, one per grid.
    pub frames: u64,
    /// Grids that a newer one replaced before they were planned on.
    pub skipped: u64,
    /// Frames that were ready well after their deadline.
    pub late: u64,
    /// Targets of all frames.
    pub targets: u64,
    /// Targets to which a path was found.
    pub solved: u64,
    /// Frames of live grids without a path to follow.
    pub stops: u64,
    /// Why, as the planner names it, with the number of frames.
    pub stops_by_reason: Vec<(String, u64)>,
    /// Median time from a grid to its plan, milliseconds; only of live grids.
    pub latency_ms: Option<f64>,
}

/// How a training run went.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrainerSummary {
    /// Run.
    pub run: String,
    /// Steps done.
    pub steps: u64,
    /// Steps per second.
    pub steps_per_s: Option<f64>,
    /// Samples that came from the stream.
    pub received: u64,
    /// Samples of the stream that never came.
    pub missing: u64,
}

/// What a report came to.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Files that were written, the report first.
    pub written: Vec<PathBuf>,
    /// Plans in the recordings.
    pub plans: usize,
    /// Samples in the recordings.
    pub samples: usize,
    /// Samples a second, if they were recorded as they came.
    pub samples_per_s: Option<f64>,
    /// Samples that never came.
    pub samples_missing: u64,
    /// Versions of weights published, of all runs.
    pub weights_published: usize,
    /// Versions of weights that plans used, of all runs.
    pub weights_applied: usize,
    /// Comparisons with the baseline.
    pub methods: Vec<MethodSummary>,
    /// Newest evaluation of each predictor.
    pub predictors: Vec<PredictorSummary>,
    /// Planners, ordered by vehicle.
    pub planners: Vec<PlannerSummary>,
    /// Training runs, ordered by name.
    pub trainers: Vec<TrainerSummary>,
}

impl Summary {
    pub(crate) fn new(
        tables: &Tables,
        comparisons: &[Comparison],
        agreements: &[Agreement],
        health: &Health,
        written: Vec<PathBuf>,
    ) -> Self {
        let all_pairs = comparisons.iter().filter(|c| c.set == PairSet::All);
        let newest = agreements
            .iter()
            .filter(|agreement| agreement.is_newest && agreement.subject.group.is_empty());
        let generators = health.samples.generators.iter();
        Self {
            written,
            plans: tables.plans.height(),
            samples: tables.samples.height(),
            samples_per_s: health.samples.rate_per_s,
            samples_missing: generators.fold(0, |sum: u64, generator| {
                sum.saturating_add(generator.sequence.missing)
            }),
            weights_published: health.weights.iter().map(|run| run.published).sum(),
            weights_applied: health.weights.iter().map(|run| run.applied).sum(),
            methods: all_pairs.map(MethodSummary::of).collect(),
            predictors: newest.map(PredictorSummary::of).collect(),
            planners: health.planners.iter().map(PlannerSummary::of).collect(),
            trainers: health.trainers.iter().map(TrainerSummary::of).collect(),
        }
    }

    /// The key figures, a line each.
    pub fn lines(&self) -> Vec<String> {
        let mut lines = vec![format!("{} plans", count(self.plans as u64))];
        let rate = self.samples_per_s.map_or_else(String::new, |rate| {
            format!(", {} a second", significant(rate))
        });
        lines.push(format!(
            "{} samples{rate}, {} missing",
            count(self.samples as u64),
            count(self.samples_missing)
        ));
        lines.push(format!(
            "{} versions of weights published, {} applied",
            self.weights_published, self.weights_applied
        ));
        for trainer in &self.trainers {
            lines.push(format!(
                "training run {}: {} steps, {} a second; {} samples came, {} were lost",
                trainer.run,
                count(trainer.steps),
                optional(trainer.steps_per_s),
                count(trainer.received),
                count(trainer.missing)
            ));
        }
        for planner in self.planners.iter().filter(|planner| planner.frames > 0) {
            lines.extend(planner.lines());
        }
        for method in &self.methods {
            lines.push(format!(
                "{} target(s): {} takes {} of the time and {} of the steps of {} ({} frames)",
                method.targets,
                method.method,
                times(method.search_ratio),
                times(method.steps_ratio),
                method.baseline,
                method.pairs
            ));
        }
        for predictor in &self.predictors {
            let mark = if predictor.is_baseline {
                " (baseline)"
            } else {
                ""
            };
            lines.push(format!(
                "{}{mark} on {}: mIoU {} (95 % interval {}) over {} samples",
                predictor.predictor,
                predictor.split,
                percent(predictor.miou),
                interval(predictor.interval),
                count(predictor.samples)
            ));
        }
        lines.extend(self.beside_the_paper());
        lines
    }
}

impl Summary {
    /// The paper's mIoU, or why it does not stand beside those of this report.
    fn beside_the_paper(&self) -> Option<String> {
        let mut learned = self.predictors.iter().filter(|one| !one.is_baseline);
        let most = learned.clone().map(|one| one.samples).max()?;
        if learned.any(|one| one.is_comparable) {
            return Some(format!(
                "the paper: mIoU {} (95 % interval {}) over {} samples",
                percent(Some(paper::MIOU)),
                interval(Interval::of_mean(paper::MIOU, paper::TEST_SAMPLES)),
                count(paper::TEST_SAMPLES)
            ));
        }
        Some(format!(
            "not compared with the paper's mIoU: {} samples are too few, it takes {}",
            count(most),
            crate::MIN_COMPARED_SAMPLES
        ))
    }
}

impl PlannerSummary {
    fn of(planner: &PlannerHealth) -> Self {
        let reasons = planner.stops_by_reason.iter();
        Self {
            vehicle: planner.vehicle.clone(),
            frames: planner.plans,
            skipped: planner.skipped,
            late: planner.late,
            targets: planner.targets,
            solved: planner.solved,
            stops: planner.stops,
            stops_by_reason: reasons
                .map(|(reason, frames)| (reason.clone(), *frames))
                .collect(),
            latency_ms: planner.latency_ms.map(|spread| spread.median),
        }
    }

    /// What it did, in words: a line for targets and frames, and one for each reason of a stop.
    pub fn lines(&self) -> Vec<String> {
        let latency = self.latency_ms.map_or_else(String::new, |latency_ms| {
            format!(", half of them within {} ms", significant(latency_ms))
        });
        let mut lines = vec![format!(
            "planner {}: {} of {} targets solved ({}) in {} frames{latency}",
            self.vehicle,
            count(self.solved),
            count(self.targets),
            share(self.solved, self.targets),
            count(self.frames)
        )];
        for (reason, frames) in &self.stops_by_reason {
            let frames = match frames {
                1 => "1 frame was".to_owned(),
                _ => format!("{} frames were", count(*frames)),
            };
            lines.push(format!(
                "planner {}: {frames} stopped: {reason}",
                self.vehicle
            ));
        }
        lines
    }
}

impl TrainerSummary {
    fn of(trainer: &TrainerHealth) -> Self {
        Self {
            run: trainer.run.clone(),
            steps: trainer.step,
            steps_per_s: trainer.steps_per_s,
            received: trainer.received,
            missing: trainer.gaps,
        }
    }
}

impl MethodSummary {
    fn of(comparison: &Comparison) -> Self {
        Self {
            method: comparison.compared.method.clone(),
            baseline: comparison.baseline.method.clone(),
            targets: comparison.targets,
            pairs: comparison.pairs,
            search_ms: comparison.compared.search_ms.map(|spread| spread.median),
            baseline_search_ms: comparison.baseline.search_ms.map(|spread| spread.median),
            search_ratio: comparison.search.of_medians,
            steps_ratio: comparison.steps.of_medians,
        }
    }
}

impl PredictorSummary {
    fn of(agreement: &Agreement) -> Self {
        Self {
            predictor: agreement.subject.predictor.clone(),
            is_baseline: !agreement.subject.is_learned(),
            split: agreement.subject.split.clone(),
            samples: agreement.sums.samples,
            miou: agreement.sums.miou(),
            interval: agreement.sums.miou_interval(),
            is_comparable: agreement.is_comparable(),
        }
    }
}
