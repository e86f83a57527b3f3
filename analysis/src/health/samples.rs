//! Samples: how many, how fast, and which never came.

use std::collections::BTreeMap;

use polars::prelude::DataFrame;

use crate::Error;
use crate::frames::{counts, names};
use crate::sequence::SequenceCount;
use crate::spread::ratio;

const TABLE: &str = "sample_health";
const NANOS_PER_S: u64 = 1_000_000_000;
/// Most points of a recording's rate over time; longer recordings get wider ones.
const MAX_RATE_POINTS: u64 = 600;

/// Samples of one generator.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct GeneratorHealth {
    /// Generator.
    pub(crate) generator: String,
    /// Gaps and duplicates, recording by recording and added up.
    pub(crate) sequence: SequenceCount,
    /// Samples whose target has a path.
    pub(crate) solved: u64,
    /// Over the time between its first and its last sample, if that was recorded live.
    pub(crate) rate_per_s: Option<f64>,
}

/// Samples of one kind of scene.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct SceneHealth {
    /// Kind of scene.
    pub(crate) scene: String,
    /// Samples.
    pub(crate) samples: u64,
    /// Different scenes.
    pub(crate) scenes: u64,
    /// Samples whose target has a path.
    pub(crate) solved: u64,
}

/// The rate at a time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct RatePoint {
    /// Recording.
    pub(crate) recording: u64,
    /// Since the recording's first sample.
    pub(crate) time_s: f64,
    /// Samples a second, around that time.
    pub(crate) rate_per_s: f64,
}

/// Samples of all generators.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct SampleHealth {
    /// Samples.
    pub(crate) samples: u64,
    /// All generators together, if samples were recorded live.
    pub(crate) rate_per_s: Option<f64>,
    /// By generator, ordered by name.
    pub(crate) generators: Vec<GeneratorHealth>,
    /// By kind of scene, ordered by name.
    pub(crate) scenes: Vec<SceneHealth>,
    /// Over time, by recording.
    pub(crate) rates: Vec<RatePoint>,
}

/// Columns of the table of samples.
struct Columns {
    recordings: Vec<u64>,
    generators: Vec<String>,
    sequences: Vec<u64>,
    log_nanos: Vec<u64>,
    stamp_nanos: Vec<u64>,
    scenes: Vec<String>,
    scene_ids: Vec<u64>,
    solved: Vec<bool>,
}

impl Columns {
    fn of(samples: &DataFrame) -> Result<Self, Error> {
        let count = |column| counts(samples, column, TABLE);
        let outcomes = names(samples, "outcome", TABLE)?;
        Ok(Self {
            recordings: count("recording")?,
            generators: names(samples, "generator", TABLE)?,
            sequences: count("sequence")?,
            log_nanos: count("log_nanos")?,
            stamp_nanos: count("stamp_nanos")?,
            scenes: names(samples, "scene", TABLE)?,
            scene_ids: count("scene_id")?,
            solved: outcomes.iter().map(|outcome| outcome == "solved").collect(),
        })
    }

    /// Log times by recording, ascending, of the samples that were recorded live: a generated file
    /// is logged at its stamps, which are made from the index and say nothing about time.
    fn live_times(&self, generator: Option<&str>) -> BTreeMap<u64, Vec<u64>> {
        let mut times: BTreeMap<u64, Vec<u64>> = BTreeMap::new();
        for (row, &recording) in self.recordings.iter().enumerate() {
            let is_chosen = generator.is_none_or(|name| self.generators[row] == name);
            if is_chosen && self.log_nanos[row] != self.stamp_nanos[row] {
                times
                    .entry(recording)
                    .or_default()
                    .push(self.log_nanos[row]);
            }
        }
        for nanos in times.values_mut() {
            nanos.sort_unstable();
        }
        times
    }
}

impl SampleHealth {
    pub(super) fn of(samples: &DataFrame) -> Result<Self, Error> {
        let columns = Columns::of(samples)?;
        let times = columns.live_times(None);
        Ok(Self {
            samples: columns.recordings.len() as u64,
            rate_per_s: rate_per_s(&times),
            generators: generators(&columns),
            scenes: scenes(&columns),
            rates: rates(&times),
        })
    }
}

/// Samples after the first by the time since the first, over all recordings.
fn rate_per_s(times: &BTreeMap<u64, Vec<u64>>) -> Option<f64> {
    let (mut later_samples, mut span_nanos) = (0, 0);
    for nanos in times.values() {
        if let (Some(first), Some(last)) = (nanos.first(), nanos.last()) {
            later_samples += nanos.len() - 1;
            span_nanos += last - first;
        }
    }
    ratio(later_samples as f64, span_nanos as f64 / NANOS_PER_S as f64)
}

fn rates(times: &BTreeMap<u64, Vec<u64>>) -> Vec<RatePoint> {
    let mut points = Vec::new();
    for (&recording, nanos) in times {
        let (Some(&first), Some(&last)) = (nanos.first(), nanos.last()) else {
            continue;
        };
        let width = ((last - first) / MAX_RATE_POINTS).max(NANOS_PER_S);
        let width_s = width as f64 / NANOS_PER_S as f64;
        // The last bin is left out when it is not whole: its rate would look like a drop.
        let whole_bins = (last - first) / width;
        let mut arrived: BTreeMap<u64, u64> = (0..whole_bins).map(|bin| (bin, 0)).collect();
        for time in nanos {
            if let Some(count) = arrived.get_mut(&((time - first) / width)) {
                *count += 1;
            }
        }
        points.extend(arrived.into_iter().map(|(bin, count)| RatePoint {
            recording,
            time_s: (bin as f64 + 0.5) * width_s,
            rate_per_s: count as f64 / width_s,
        }));
    }
    points
}

fn generators(columns: &Columns) -> Vec<GeneratorHealth> {
    let mut arrived: BTreeMap<&str, BTreeMap<u64, Vec<u64>>> = BTreeMap::new();
    let mut solved: BTreeMap<&str, u64> = BTreeMap::new();
    for (row, generator) in columns.generators.iter().enumerate() {
        let by_recording = arrived.entry(generator).or_default();
        let sequences = by_recording.entry(columns.recordings[row]).or_default();
        sequences.push(columns.sequences[row]);
        *solved.entry(generator).or_default() += u64::from(columns.solved[row]);
    }
    arrived
        .into_iter()
        .map(|(generator, by_recording)| {
            let mut sequence = SequenceCount::default();
            for arrived in by_recording.into_values() {
                let part = SequenceCount::of(arrived);
                sequence.received += part.received;
                sequence.duplicates += part.duplicates;
                sequence.missing = sequence.missing.saturating_add(part.missing);
            }
            GeneratorHealth {
                generator: generator.to_owned(),
                sequence,
                solved: solved.get(generator).copied().unwrap_or(0),
                rate_per_s: rate_per_s(&columns.live_times(Some(generator))),
            }
        })
        .collect()
}

fn scenes(columns: &Columns) -> Vec<SceneHealth> {
    let mut ids: BTreeMap<&str, Vec<u64>> = BTreeMap::new();
    let mut solved: BTreeMap<&str, u64> = BTreeMap::new();
    for (row, scene) in columns.scenes.iter().enumerate() {
        ids.entry(scene).or_default().push(columns.scene_ids[row]);
        *solved.entry(scene).or_default() += u64::from(columns.solved[row]);
    }
    ids.into_iter()
        .map(|(scene, mut ids)| {
            let samples = ids.len() as u64;
            ids.sort_unstable();
            ids.dedup();
            SceneHealth {
                scene: scene.to_owned(),
                samples,
                scenes: ids.len() as u64,
                solved: solved.get(scene).copied().unwrap_or(0),
            }
        })
        .collect()
}
