//! Samples: where they came from and what became of their label; their planes are not kept.

use swath_bridge::msg::swath::Sample;

use super::Record;
use super::plans::outcome_name;
use super::rows::{number, row_table};

row_table! {
    /// One sample.
    pub(crate) struct SampleRow in "samples" {
        recording: u32,
        log_nanos: u64,
        stamp_nanos: u64,
        generator: String,
        sequence: u64,
        seed: u64,
        index: u64,
        scene: String,
        scene_id: u64,
        speed_m_per_s: Option<f64>,
        outcome: String,
        cost: Option<f64>,
        steps: u64,
    }
}

impl SampleRow {
    pub(super) fn new(record: &Record<'_>, sample: Sample) -> Self {
        Self {
            recording: record.recording,
            log_nanos: record.message.log_nanos,
            stamp_nanos: sample.header.stamp.nanos(),
            sequence: sample.sequence,
            seed: sample.seed,
            index: sample.index,
            scene_id: sample.scene_id,
            speed_m_per_s: number(sample.speed_m_per_s),
            outcome: outcome_name(sample.outcome),
            cost: number(sample.cost),
            steps: sample.steps,
            generator: sample.generator,
            scene: sample.scene,
        }
    }
}
