//! Training: what the trainer says of itself, and how its weights reached the plans.

use std::collections::{BTreeMap, BTreeSet};

use polars::prelude::DataFrame;

use crate::Error;
use crate::frames::{counts, names, numbers};
use crate::spread::{Spread, ratio};
use crate::tables::Tables;

const TABLE: &str = "training_health";
const NANOS_PER_S: f64 = 1e9;

/// The last word of a training run.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct TrainerHealth {
    /// Run.
    pub(crate) run: String,
    /// Statuses recorded.
    pub(crate) statuses: u64,
    /// Steps done.
    pub(crate) step: u64,
    /// Samples consumed.
    pub(crate) samples: u64,
    /// Samples received from the stream.
    pub(crate) received: u64,
    /// Sequence numbers that never came.
    pub(crate) gaps: u64,
    /// Samples that came twice.
    pub(crate) duplicates: u64,
    /// Samples that did not decode or did not fit.
    pub(crate) rejected: u64,
    /// Steps per second between its statuses, by their stamps; time between recordings does not count.
    pub(crate) steps_per_s: Option<f64>,
    /// Samples per second, as the last status says.
    pub(crate) samples_per_s: f64,
    /// Loss.
    pub(crate) loss: f64,
    /// NaN when nothing was evaluated.
    pub(crate) miou: f64,
}

/// What a status tells of the pace.
#[derive(Debug, Clone, Copy)]
struct Told {
    recording: u64,
    step: u64,
    stamp_nanos: u64,
}

/// Steps and the time that they took.
#[derive(Debug, Default)]
struct Pace {
    last: Option<Told>,
    steps: u64,
    nanos: u64,
}

impl Pace {
    /// Counts from the last status of the same recording to this one, unless the run began anew.
    fn add(&mut self, told: Told) {
        let before = self.last.filter(|last| {
            last.recording == told.recording
                && last.step <= told.step
                && last.stamp_nanos <= told.stamp_nanos
        });
        if let Some(before) = before {
            self.steps += told.step - before.step;
            self.nanos += told.stamp_nanos - before.stamp_nanos;
        }
        self.last = Some(told);
    }

    fn steps_per_s(&self) -> Option<f64> {
        ratio(self.steps as f64, self.nanos as f64 / NANOS_PER_S)
    }
}

/// The last status of each run, ordered by run.
pub(super) fn trainers(status: &DataFrame) -> Result<Vec<TrainerHealth>, Error> {
    let count = |column| counts(status, column, TABLE);
    let number = |column| numbers(status, column, TABLE);
    let runs = names(status, "run", TABLE)?;
    let steps = count("step")?;
    let (samples, received) = (count("samples")?, count("received")?);
    let (gaps, duplicates) = (count("gaps")?, count("duplicates")?);
    let rejected = count("rejected")?;
    let (rates, losses, mious) = (number("samples_per_s")?, number("loss")?, number("miou")?);
    let stamps = count("stamp_nanos")?;
    let mut last: BTreeMap<&str, TrainerHealth> = BTreeMap::new();
    let recordings = count("recording")?;
    let mut paces: BTreeMap<&str, Pace> = BTreeMap::new();
    for (row, run) in runs.iter().enumerate() {
        let before = last.get(run.as_str());
        // The last status need not come with an evaluation; the last one that did counts.
        let miou = match before {
            Some(before) if !mious[row].is_finite() => before.miou,
            _ => mious[row],
        };
        let pace = paces.entry(run).or_default();
        pace.add(Told {
            recording: recordings[row],
            step: steps[row],
            stamp_nanos: stamps[row],
        });
        let newest = TrainerHealth {
            run: run.clone(),
            statuses: before.map_or(0, |before| before.statuses) + 1,
            step: steps[row],
            samples: samples[row],
            received: received[row],
            gaps: gaps[row],
            duplicates: duplicates[row],
            rejected: rejected[row],
            steps_per_s: pace.steps_per_s(),
            samples_per_s: rates[row],
            loss: losses[row],
            miou,
        };
        last.insert(run, newest);
    }
    Ok(last.into_values().collect())
}

/// The way of a run's weights from the trainer into plans.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct WeightsHealth {
    /// Run.
    pub(crate) run: String,
    /// Versions that were published, as recorded.
    pub(crate) published: usize,
    /// Versions that a plan used.
    pub(crate) applied: usize,
    /// The newest version that was published.
    pub(crate) newest_published: Option<u64>,
    /// The newest version that a plan used.
    pub(crate) newest_applied: Option<u64>,
    /// Plans that used weights of this run.
    pub(crate) plans: usize,
    /// Age of the weights at each plan, seconds.
    pub(crate) age_s: Option<Spread>,
    /// mIoU of the newest version, as its trainer says; NaN when it says none.
    pub(crate) miou: f64,
}

#[derive(Default)]
struct Run {
    published: BTreeSet<u64>,
    applied: BTreeSet<u64>,
    ages_s: Vec<f64>,
    mious: BTreeMap<u64, f64>,
}

/// Each run's weights, ordered by run.
pub(super) fn weights(tables: &Tables) -> Result<Vec<WeightsHealth>, Error> {
    let mut runs: BTreeMap<String, Run> = BTreeMap::new();
    let published = names(&tables.weights, "run", TABLE)?;
    let versions = counts(&tables.weights, "version", TABLE)?;
    let mious = numbers(&tables.weights, "miou", TABLE)?;
    for (row, run) in published.into_iter().enumerate() {
        let run = runs.entry(run).or_default();
        run.published.insert(versions[row]);
        run.mious.insert(versions[row], mious[row]);
    }
    let used = names(&tables.plans, "weights_run", TABLE)?;
    let versions = counts(&tables.plans, "weights_version", TABLE)?;
    let ages_s = numbers(&tables.plans, "weights_age_s", TABLE)?;
    for (row, run) in used.into_iter().enumerate() {
        if versions[row] == 0 {
            continue;
        }
        let run = runs.entry(run).or_default();
        run.applied.insert(versions[row]);
        run.ages_s.push(ages_s[row]);
    }
    Ok(runs
        .into_iter()
        .map(|(name, run)| WeightsHealth {
            run: name,
            published: run.published.len(),
            applied: run.applied.len(),
            newest_published: run.published.last().copied(),
            newest_applied: run.applied.last().copied(),
            plans: run.ages_s.len(),
            age_s: Spread::of(run.ages_s),
            miou: run.mious.into_values().next_back().unwrap_or(f64::NAN),
        })
        .collect())
}
