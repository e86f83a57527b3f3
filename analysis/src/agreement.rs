//! How well predicted regions match labels: intersection over union, from counts of cells.

use std::collections::BTreeMap;

use polars::prelude::DataFrame;

use crate::Error;
use crate::frames::{counts, names, numbers};
use crate::interval::{Interval, MIN_COMPARED_SAMPLES};
use crate::spread::ratio;

const TABLE: &str = "agreement";
/// Names of learned predictors begin with one of these; all others are baselines without learning.
const LEARNED_PREFIXES: [&str; 1] = ["enet"];

/// What an evaluation is of. Evaluations of the same thing add up.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Subject {
    /// Architecture, or the name of a baseline.
    pub(crate) predictor: String,
    /// Training run.
    pub(crate) run: String,
    /// What was evaluated on.
    pub(crate) split: String,
    /// Empty for all of it, else the part of it.
    pub(crate) group: String,
    /// Dilation of the labels, millimetres: integers have an order and are equal to themselves.
    pub(crate) dilation_mm: i64,
    /// Version of the weights.
    pub(crate) weights_version: u64,
}

impl Agreement {
    /// Whether this is what the paper's mIoU may stand beside: a learned predictor, over enough
    /// samples of all kinds.
    pub(crate) fn is_comparable(&self) -> bool {
        self.subject.is_learned()
            && self.subject.group.is_empty()
            && self.sums.samples >= MIN_COMPARED_SAMPLES
    }
}

impl Subject {
    /// Whether the predictor was trained.
    pub(crate) fn is_learned(&self) -> bool {
        LEARNED_PREFIXES
            .iter()
            .any(|prefix| self.predictor.starts_with(prefix))
    }

    /// The nearer end of a group of distances, metres.
    pub(crate) fn distance_m(&self) -> Option<f64> {
        let distances = self.group.strip_prefix("distance/")?;
        let digits = distances.find(|symbol: char| !symbol.is_ascii_digit())?;
        distances[..digits].parse().ok()
    }

    /// Whether two subjects are the same but for the version of the weights.
    fn is_version_of(&self, other: &Self) -> bool {
        Self {
            weights_version: other.weights_version,
            ..self.clone()
        } == *other
    }
}

/// The sums of a subject's evaluations.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Sums {
    /// Samples.
    pub(crate) samples: u64,
    intersection_path: f64,
    union_path: f64,
    intersection_background: f64,
    union_background: f64,
    joined: f64,
    elapsed_ms: f64,
}

impl Sums {
    /// Intersection over union of the path's cells.
    pub(crate) fn iou_path(&self) -> Option<f64> {
        ratio(self.intersection_path, self.union_path)
    }

    /// Intersection over union of all other cells.
    pub(crate) fn iou_background(&self) -> Option<f64> {
        ratio(self.intersection_background, self.union_background)
    }

    /// Mean of the two.
    pub(crate) fn miou(&self) -> Option<f64> {
        Some(f64::midpoint(self.iou_path()?, self.iou_background()?))
    }

    /// Where the mean of the two would lie over many more samples, with a probability of 95 %.
    pub(crate) fn miou_interval(&self) -> Option<Interval> {
        Interval::of_mean(self.miou()?, self.samples)
    }

    /// Share of regions that join vehicle and target.
    pub(crate) fn joined_share(&self) -> Option<f64> {
        ratio(self.joined, self.samples as f64)
    }

    /// Mean time of a prediction.
    pub(crate) fn ms_per_sample(&self) -> Option<f64> {
        ratio(self.elapsed_ms, self.samples as f64)
    }
}

/// A subject and how it did.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Agreement {
    /// What was evaluated.
    pub(crate) subject: Subject,
    /// Counts of cells.
    pub(crate) sums: Sums,
    /// Whether no later version of the same weights was evaluated.
    pub(crate) is_newest: bool,
}

/// Every subject's agreement, ordered by subject. Evaluations add up, but those with the same counts
/// are one that was made or recorded twice, and count once.
///
/// # Errors
/// [`Error::Table`] if a column is missing.
pub(crate) fn agreements(evaluations: &DataFrame) -> Result<Vec<Agreement>, Error> {
    let mut sums: BTreeMap<Subject, Sums> = BTreeMap::new();
    for (subject, part) in distinct_evaluations(evaluations)? {
        let whole = sums.entry(subject).or_default();
        whole.samples += part.samples;
        whole.intersection_path += part.intersection_path;
        whole.union_path += part.union_path;
        whole.intersection_background += part.intersection_background;
        whole.union_background += part.union_background;
        whole.joined += part.joined;
        whole.elapsed_ms += part.elapsed_ms;
    }
    let subjects: Vec<Subject> = sums.keys().cloned().collect();
    // Versions come last in the order, so a later version of the same would be the next.
    let is_newest = |index: usize| {
        subjects
            .get(index + 1)
            .is_none_or(|next: &Subject| !next.is_version_of(&subjects[index]))
    };
    Ok(sums
        .into_iter()
        .enumerate()
        .map(|(index, (subject, sums))| Agreement {
            subject,
            sums,
            is_newest: is_newest(index),
        })
        .collect())
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "float to integer casts saturate, and dilations are metres"
)]
fn distinct_evaluations(evaluations: &DataFrame) -> Result<Vec<(Subject, Sums)>, Error> {
    let name = |column| names(evaluations, column, TABLE);
    let count = |column| counts(evaluations, column, TABLE);
    let (predictors, runs, splits) = (name("predictor")?, name("run")?, name("split")?);
    let groups = name("group")?;
    let dilations_m = numbers(evaluations, "dilation_m", TABLE)?;
    let (versions, samples) = (count("weights_version")?, count("samples")?);
    let joined = count("joined")?;
    let path = (count("intersection_path")?, count("union_path")?);
    let background = (
        count("intersection_background")?,
        count("union_background")?,
    );
    let ms_per_sample = numbers(evaluations, "ms_per_sample", TABLE)?;
    let mut seen = std::collections::BTreeSet::new();
    let mut distinct = Vec::new();
    for row in 0..evaluations.height() {
        let subject = Subject {
            predictor: predictors[row].clone(),
            run: runs[row].clone(),
            split: splits[row].clone(),
            group: groups[row].clone(),
            dilation_mm: (dilations_m[row] * 1000.0).round() as i64,
            weights_version: versions[row],
        };
        let cells = [
            path.0[row],
            path.1[row],
            background.0[row],
            background.1[row],
        ];
        if !seen.insert((subject.clone(), samples[row], cells)) {
            continue;
        }
        distinct.push((
            subject,
            Sums {
                samples: samples[row],
                intersection_path: cells[0] as f64,
                union_path: cells[1] as f64,
                intersection_background: cells[2] as f64,
                union_background: cells[3] as f64,
                joined: joined[row] as f64,
                elapsed_ms: ms_per_sample[row] * samples[row] as f64,
            },
        ));
    }
    Ok(distinct)
}
