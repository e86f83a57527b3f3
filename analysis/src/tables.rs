//! The tables of a recording: one row a message, scalars only, whatever the messages' payloads.

mod evaluations;
mod plans;
mod rejections;
mod rows;
mod samples;
mod topics;
mod training;

use polars::prelude::DataFrame;
use swath_bridge::keys;
use swath_bridge::msg::Message;
use swath_bridge::msg::swath::{Evaluation, PlanReport, Sample, TrainStatus, Weights};
use swath_bridge::recording::RawMessage;

use crate::{Error, ReportOptions};

use evaluations::EvaluationRow;
use plans::{PlanRow, StopRow, TargetRow};
use rejections::{RejectionCounts, RejectionRow};
use rows::Rows;
use samples::SampleRow;
use topics::TopicCounts;
use training::{StatusRow, WeightsRow};

pub(crate) use rows::Row;
pub(crate) use rows::row_table;

/// A message and the recording that it lies in.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Record<'a> {
    /// Number of the recording, from 0.
    pub(crate) recording: u32,
    /// The message.
    pub(crate) message: &'a RawMessage,
}

/// The tables of one or several recordings.
#[derive(Debug, Clone)]
pub(crate) struct Tables {
    /// One row a planned frame.
    pub(crate) plans: DataFrame,
    /// One row a target of a plan report; `plan` is the row of its report.
    pub(crate) targets: DataFrame,
    /// One row a report of an empty path.
    pub(crate) stops: DataFrame,
    /// One row a cause for which a planner could not use messages.
    pub(crate) rejections: DataFrame,
    /// One row a sample.
    pub(crate) samples: DataFrame,
    /// One row a publication of weights.
    pub(crate) weights: DataFrame,
    /// One row a status of a training run.
    pub(crate) status: DataFrame,
    /// One row an evaluation.
    pub(crate) evaluations: DataFrame,
    /// One row a topic of a recording.
    pub(crate) topics: DataFrame,
}

impl Tables {
    /// Each table with its name, in the order of the report.
    pub(crate) fn named(&self) -> [(&'static str, &DataFrame); 9] {
        [
            (PlanRow::TABLE, &self.plans),
            (TargetRow::TABLE, &self.targets),
            (StopRow::TABLE, &self.stops),
            (RejectionRow::TABLE, &self.rejections),
            (SampleRow::TABLE, &self.samples),
            (WeightsRow::TABLE, &self.weights),
            (StatusRow::TABLE, &self.status),
            (EvaluationRow::TABLE, &self.evaluations),
            (topics::TopicRow::TABLE, &self.topics),
        ]
    }
}

/// Tables that are being filled, message by message.
#[derive(Debug)]
pub(crate) struct TablesBuilder {
    plans: Rows<PlanRow>,
    targets: Rows<TargetRow>,
    stops: Rows<StopRow>,
    rejections: RejectionCounts,
    samples: Rows<SampleRow>,
    weights: Rows<WeightsRow>,
    status: Rows<StatusRow>,
    evaluations: Rows<EvaluationRow>,
    topics: TopicCounts,
}

impl TablesBuilder {
    pub(crate) fn new(options: &ReportOptions) -> Self {
        let limit = options.max_rows;
        Self {
            plans: Rows::new(limit),
            targets: Rows::new(limit),
            stops: Rows::new(limit),
            rejections: RejectionCounts::default(),
            samples: Rows::new(limit),
            weights: Rows::new(limit),
            status: Rows::new(limit),
            evaluations: Rows::new(limit),
            topics: TopicCounts::default(),
        }
    }

    /// Takes a message's scalars. One that does not decode is counted, and logged when it is the
    /// first of its topic.
    ///
    /// # Errors
    /// [`Error::TooManyRows`] when a table is full.
    pub(crate) fn push(&mut self, record: &Record<'_>) -> Result<(), Error> {
        match self.take(record) {
            Err(Error::Recording(error)) => {
                if self.topics.undecodable(record) == 0 {
                    tracing::warn!(%error, "left out of the report");
                }
                self.topics.count(record, true)
            }
            Ok(()) => self.topics.count(record, false),
            full => full,
        }
    }

    fn take(&mut self, record: &Record<'_>) -> Result<(), Error> {
        let expected = keys::classify(keys::key_of_topic(&record.message.topic));
        match expected.map(|(type_name, _)| type_name) {
            Some(Sample::TYPE_NAME) => {
                let sample = record.message.decode()?;
                self.samples.push(SampleRow::new(record, sample))
            }
            Some(PlanReport::TYPE_NAME) => {
                let report = record.message.decode()?;
                self.take_plan(record, report)
            }
            Some(Weights::TYPE_NAME) => {
                let weights = record.message.decode()?;
                self.weights.push(WeightsRow::new(record, weights))
            }
            Some(TrainStatus::TYPE_NAME) => {
                let status = record.message.decode()?;
                self.status.push(StatusRow::new(record, status))
            }
            Some(Evaluation::TYPE_NAME) => {
                let evaluation = record.message.decode()?;
                self.evaluations
                    .push(EvaluationRow::new(record, evaluation))
            }
            _ => Ok(()),
        }
    }

    fn take_plan(&mut self, record: &Record<'_>, report: PlanReport) -> Result<(), Error> {
        self.rejections.take(record, &report)?;
        if !report.reason.is_empty() {
            self.stops.push(StopRow::new(record, &report))?;
        }
        // A report without a method only says why there is no path.
        if report.method.is_empty() {
            return Ok(());
        }
        let plan = self.plans.len() as u64;
        for (index, target) in (0..).zip(&report.targets) {
            self.targets.push(TargetRow::new(plan, index, target))?;
        }
        self.plans.push(PlanRow::new(plan, record, report))
    }

    /// Number of messages of one recording.
    pub(crate) fn messages(&self, recording: u32) -> u64 {
        self.topics.messages(recording)
    }

    /// Whether a recording has a topic of swath's, and else what it has.
    pub(crate) fn swath_topics(&self, recording: u32) -> Result<(), String> {
        self.topics.swath_topics(recording)
    }

    /// The finished tables.
    ///
    /// # Errors
    /// [`Error::Table`] if polars refuses a column.
    pub(crate) fn finish(self) -> Result<Tables, Error> {
        Ok(Tables {
            plans: self.plans.finish()?,
            targets: self.targets.finish()?,
            stops: self.stops.finish()?,
            rejections: self.rejections.finish()?,
            samples: self.samples.finish()?,
            weights: self.weights.finish()?,
            status: self.status.finish()?,
            evaluations: self.evaluations.finish()?,
            topics: self.topics.finish()?,
        })
    }
}
