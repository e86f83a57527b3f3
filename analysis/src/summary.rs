//! What a report came to, for a terminal or a program.

use std::path::PathBuf;

use serde::Serialize;

use crate::agreement::Agreement;
use crate::comparison::{Comparison, PairSet};
use crate::format::{count, percent, significant, times};
use crate::health::Health;
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
}

/// What a report came to.
#[derive(Debug, Clone, PartialEq, Serialize)]
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
                "{}{mark} on {}: mIoU {} over {} samples",
                predictor.predictor,
                predictor.split,
                percent(predictor.miou),
                count(predictor.samples)
            ));
        }
        lines
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
        }
    }
}
