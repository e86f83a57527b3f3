//! Messages that planners could not use, by topic and cause, as they counted them themselves.

use std::collections::BTreeMap;

use polars::prelude::DataFrame;
use swath_bridge::msg::swath::PlanReport;

use super::Record;
use super::rows::{Row as _, row_table};
use crate::Error;
use crate::error::InTable as _;

/// Maximum number of causes over all recordings, planners and topics.
const MAX_CAUSES: usize = 65_536;

row_table! {
    /// Messages of one topic that one planner could not use for one cause.
    pub(crate) struct RejectionRow in "rejections" {
        recording: u32,
        vehicle: String,
        topic: String,
        cause: String,
        messages: u64,
    }
}

#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct CountedBy {
    recording: u32,
    vehicle: String,
    topic: String,
    cause: String,
}

/// A planner's own count, which only grows until the planner is started anew.
#[derive(Debug, Clone, Copy, Default)]
struct Count {
    before_restart: u64,
    newest: u64,
}

/// Counts by recording, planner, topic and cause.
#[derive(Debug, Default)]
pub(super) struct RejectionCounts {
    counts: BTreeMap<CountedBy, Count>,
}

impl RejectionCounts {
    /// Takes the counts of a report, each of which holds all that its planner has counted.
    ///
    /// # Errors
    /// [`Error::TooManyRows`] when there are too many causes.
    pub(super) fn take(&mut self, record: &Record<'_>, report: &PlanReport) -> Result<(), Error> {
        for rejection in &report.rejected {
            let cause = CountedBy {
                recording: record.recording,
                vehicle: report.vehicle.clone(),
                topic: rejection.topic.clone(),
                cause: rejection.cause.clone(),
            };
            if self.counts.len() >= MAX_CAUSES && !self.counts.contains_key(&cause) {
                return Err(Error::TooManyRows {
                    table: RejectionRow::TABLE,
                    limit: MAX_CAUSES,
                });
            }
            let count = self.counts.entry(cause).or_default();
            if rejection.messages < count.newest {
                count.before_restart = count.before_restart.saturating_add(count.newest);
            }
            count.newest = rejection.messages;
        }
        Ok(())
    }

    pub(super) fn finish(self) -> Result<DataFrame, Error> {
        let rows: Vec<RejectionRow> = self
            .counts
            .into_iter()
            .map(|(cause, count)| RejectionRow {
                recording: cause.recording,
                vehicle: cause.vehicle,
                topic: cause.topic,
                cause: cause.cause,
                messages: count.before_restart.saturating_add(count.newest),
            })
            .collect();
        RejectionRow::columns(&rows).in_table(RejectionRow::TABLE)
    }
}
