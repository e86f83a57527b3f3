//! What a trainer node tells the others.

use swath_bridge::clock;
use swath_bridge::msg::header::Header;
use swath_bridge::msg::swath::{Evaluation, TrainStatus, Weights};

use super::{NodeConfig, NodeSummary};
use crate::source::Live;
use crate::train::Learner;
use crate::{Evaluated, Report};

/// How the training stands, apart from what the summary and the source know.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Standing {
    pub(super) loss: f64,
    pub(super) rate: f64,
    pub(super) samples: u64,
    pub(super) samples_per_s: f64,
}

pub(super) fn status(
    config: &NodeConfig,
    summary: &NodeSummary,
    standing: &Standing,
    live: &Live,
) -> TrainStatus {
    let counts = live.replay.counts();
    let batch = config.train.batch as f64;
    let left = config
        .steps
        .map(|steps| steps.saturating_sub(summary.steps) as f64);
    let eta_s = left.map_or(f64::NAN, |left| left * batch / standing.samples_per_s);
    TrainStatus {
        header: Header::at(clock::now_nanos(), ""),
        run: config.run.clone(),
        step: summary.steps,
        epoch: summary.steps / live.steps_per_epoch.max(1),
        epochs: config
            .steps
            .map_or(0, |steps| steps / live.steps_per_epoch.max(1)),
        samples: standing.samples,
        samples_per_s: single(standing.samples_per_s),
        received: counts.received,
        gaps: counts.gaps,
        duplicates: counts.duplicates,
        rejected: counts.rejected,
        buffered: u32::try_from(live.replay.examples().len()).unwrap_or(u32::MAX),
        learning_rate: single(standing.rate),
        loss: single(standing.loss),
        miou: single(summary.miou.unwrap_or(f64::NAN)),
        weights_version: summary.version,
        eta_s: single(eta_s),
    }
}

/// The message without safetensors and signature.
pub(super) fn weights(
    config: &NodeConfig,
    learner: &Learner,
    (version, loss): (u64, f64),
    report: Option<&Report>,
) -> Weights {
    let info = learner.info();
    let (rows, cols) = info.encoding().input_size();
    let side = |pixels: usize| u32::try_from(pixels).unwrap_or(u32::MAX);
    let total = report.map(|report| report.scores.total);
    let score = |of: fn(&crate::Counts) -> f64| single(total.as_ref().map_or(f64::NAN, of));
    Weights {
        header: Header::at(0, ""),
        run: config.run.clone(),
        version,
        step: learner.progress().step,
        epoch: learner.progress().step / config.publish_every_steps.max(1),
        architecture: info.architecture.name().to_owned(),
        input_rows: side(rows),
        input_cols: side(cols),
        vehicle: info.vehicle.clone(),
        loss: single(loss),
        miou: score(crate::Counts::miou),
        iou_path: score(crate::Counts::iou_path),
        iou_background: score(crate::Counts::iou_background),
        digest: [0; 32],
        public_key: Vec::new(),
        signature: Vec::new(),
        safetensors: Vec::new(),
    }
}

pub(super) fn evaluations(weights: &Weights, report: &Report) -> Vec<Evaluation> {
    let of = Evaluated {
        run: &weights.run,
        version: weights.version,
        predictor: &weights.architecture,
        split: "scenes set aside",
    };
    crate::evaluations(of, report)
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "messages are of single precision"
)]
const fn single(value: f64) -> f32 {
    value as f32
}
