//! Training: publications of weights and the status of runs; parameters are not kept.

use swath_bridge::msg::swath::{TrainStatus, Weights};

use super::Record;
use super::rows::{number, row_table};

row_table! {
    /// One publication of weights.
    pub(crate) struct WeightsRow in "weights" {
        recording: u32,
        log_nanos: u64,
        stamp_nanos: u64,
        run: String,
        version: u64,
        step: u64,
        epoch: u64,
        architecture: String,
        input_rows: u32,
        input_cols: u32,
        loss: Option<f64>,
        miou: Option<f64>,
        iou_path: Option<f64>,
        iou_background: Option<f64>,
        bytes: u64,
    }
}

impl WeightsRow {
    pub(super) fn new(record: &Record<'_>, weights: Weights) -> Self {
        Self {
            recording: record.recording,
            log_nanos: record.message.log_nanos,
            stamp_nanos: weights.header.stamp.nanos(),
            version: weights.version,
            step: weights.step,
            epoch: weights.epoch,
            input_rows: weights.input_rows,
            input_cols: weights.input_cols,
            loss: number(weights.loss),
            miou: number(weights.miou),
            iou_path: number(weights.iou_path),
            iou_background: number(weights.iou_background),
            bytes: weights.safetensors.len() as u64,
            run: weights.run,
            architecture: weights.architecture,
        }
    }
}

row_table! {
    /// One status of a run.
    pub(crate) struct StatusRow in "status" {
        recording: u32,
        log_nanos: u64,
        stamp_nanos: u64,
        run: String,
        step: u64,
        epoch: u64,
        epochs: u64,
        samples: u64,
        samples_per_s: Option<f64>,
        received: u64,
        gaps: u64,
        duplicates: u64,
        rejected: u64,
        buffered: u32,
        learning_rate: Option<f64>,
        loss: Option<f64>,
        miou: Option<f64>,
        weights_version: u64,
        eta_s: Option<f64>,
    }
}

impl StatusRow {
    pub(super) fn new(record: &Record<'_>, status: TrainStatus) -> Self {
        Self {
            recording: record.recording,
            log_nanos: record.message.log_nanos,
            stamp_nanos: status.header.stamp.nanos(),
            step: status.step,
            epoch: status.epoch,
            epochs: status.epochs,
            samples: status.samples,
            samples_per_s: number(status.samples_per_s),
            received: status.received,
            gaps: status.gaps,
            duplicates: status.duplicates,
            rejected: status.rejected,
            buffered: status.buffered,
            learning_rate: number(status.learning_rate),
            loss: number(status.loss),
            miou: number(status.miou),
            weights_version: status.weights_version,
            eta_s: number(status.eta_s),
            run: status.run,
        }
    }
}
