//! Evaluations, as the counts of cells that they are.

use swath_bridge::msg::swath::Evaluation;

use super::Record;
use super::rows::{number, row_table};

row_table! {
    /// One evaluation.
    pub(crate) struct EvaluationRow in "evaluations" {
        recording: u32,
        log_nanos: u64,
        stamp_nanos: u64,
        run: String,
        weights_version: u64,
        predictor: String,
        split: String,
        group: String,
        dilation_m: Option<f64>,
        samples: u64,
        intersection_path: u64,
        union_path: u64,
        intersection_background: u64,
        union_background: u64,
        joined: u64,
        ms_per_sample: Option<f64>,
    }
}

impl EvaluationRow {
    pub(super) fn new(record: &Record<'_>, evaluation: Evaluation) -> Self {
        Self {
            recording: record.recording,
            log_nanos: record.message.log_nanos,
            stamp_nanos: evaluation.header.stamp.nanos(),
            weights_version: evaluation.weights_version,
            dilation_m: number(evaluation.dilation_m),
            samples: evaluation.samples,
            intersection_path: evaluation.intersection_path,
            union_path: evaluation.union_path,
            intersection_background: evaluation.intersection_background,
            union_background: evaluation.union_background,
            joined: evaluation.joined,
            ms_per_sample: number(evaluation.ms_per_sample),
            run: evaluation.run,
            predictor: evaluation.predictor,
            split: evaluation.split,
            group: evaluation.group,
        }
    }
}
