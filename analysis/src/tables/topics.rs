//! Topics: what a recording holds, whether it is swath's or not.

use std::collections::BTreeMap;

use polars::prelude::DataFrame;
use swath_bridge::keys;

use super::Record;
use super::rows::{Row as _, row_table};
use crate::Error;
use crate::error::InTable as _;

/// Most topics over all recordings.
const MAX_TOPICS: usize = 65_536;
/// Most topics that an error lists.
const MAX_TOPICS_LISTED: usize = 20;

row_table! {
    /// One topic of one recording.
    pub(crate) struct TopicRow in "topics" {
        recording: u32,
        topic: String,
        type_name: String,
        messages: u64,
        undecodable: u64,
        bytes: u64,
        first_log_nanos: u64,
        last_log_nanos: u64,
    }
}

/// Counts by recording and topic.
#[derive(Debug, Default)]
pub(super) struct TopicCounts {
    rows: BTreeMap<(u32, String), TopicRow>,
}

impl TopicCounts {
    pub(super) fn count(&mut self, record: &Record<'_>, undecodable: bool) -> Result<(), Error> {
        let key = (record.recording, record.message.topic.to_string());
        if self.rows.len() >= MAX_TOPICS && !self.rows.contains_key(&key) {
            return Err(Error::TooManyRows {
                table: TopicRow::TABLE,
                limit: MAX_TOPICS,
            });
        }
        let row = self.rows.entry(key).or_insert_with(|| TopicRow {
            recording: record.recording,
            topic: record.message.topic.to_string(),
            type_name: record.message.type_name.to_string(),
            messages: 0,
            undecodable: 0,
            bytes: 0,
            first_log_nanos: record.message.log_nanos,
            last_log_nanos: record.message.log_nanos,
        });
        row.messages += 1;
        row.undecodable += u64::from(undecodable);
        row.bytes = row
            .bytes
            .saturating_add(record.message.payload.len() as u64);
        row.first_log_nanos = row.first_log_nanos.min(record.message.log_nanos);
        row.last_log_nanos = row.last_log_nanos.max(record.message.log_nanos);
        Ok(())
    }

    /// Messages of a record's topic so far that did not decode.
    pub(super) fn undecodable(&self, record: &Record<'_>) -> u64 {
        self.rows
            .get(&(record.recording, record.message.topic.to_string()))
            .map_or(0, |row| row.undecodable)
    }

    pub(super) fn messages(&self, recording: u32) -> u64 {
        self.of(recording).map(|row| row.messages).sum()
    }

    /// Nothing if one of the recording's topics is swath's, else a list of what there is.
    pub(super) fn swath_topics(&self, recording: u32) -> Result<(), String> {
        if self
            .of(recording)
            .any(|row| keys::classify(keys::key_of_topic(&row.topic)).is_some())
        {
            return Ok(());
        }
        let listed: Vec<String> = self
            .of(recording)
            .take(MAX_TOPICS_LISTED)
            .map(|row| format!("{} ({})", row.topic, row.type_name))
            .collect();
        let unlisted = self.of(recording).count() - listed.len();
        Err(match (listed.is_empty(), unlisted) {
            (true, _) => "nothing".to_owned(),
            (false, 0) => listed.join(", "),
            (false, more) => format!("{} and {more} more", listed.join(", ")),
        })
    }

    fn of(&self, recording: u32) -> impl Iterator<Item = &TopicRow> {
        self.rows
            .range((recording, String::new())..)
            .take_while(move |((number, _), _)| *number == recording)
            .map(|(_, row)| row)
    }

    pub(super) fn finish(self) -> Result<DataFrame, Error> {
        let rows: Vec<TopicRow> = self.rows.into_values().collect();
        TopicRow::columns(&rows).in_table(TopicRow::TABLE)
    }
}
