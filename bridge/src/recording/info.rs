//! What is in a recording.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Serialize;

use super::reader::Reader;
use crate::Error;

const NANOS_PER_S: f64 = 1e9;

/// What is in a recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Info {
    /// Path as it was given.
    pub path: PathBuf,
    /// Size of the file.
    pub bytes: u64,
    /// Messages that can be read.
    pub messages: u64,
    /// Log time of the first message, nanoseconds since the Unix epoch; 0 without messages.
    pub first_log_nanos: u64,
    /// Log time of the last message, nanoseconds since the Unix epoch; 0 without messages.
    pub last_log_nanos: u64,
    /// Time between the two.
    pub duration_s: f64,
    /// Every topic with messages, by name.
    pub topics: Vec<TopicInfo>,
    /// Why reading ended before the end of the file, if it did.
    pub damage: Option<String>,
}

/// A topic of a recording.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TopicInfo {
    /// Topic.
    pub topic: String,
    /// Type as ROS 2 writes it.
    pub type_name: String,
    /// Encoding of the messages.
    pub encoding: String,
    /// Messages.
    pub messages: u64,
    /// Size of all messages, before compression.
    pub payload_bytes: u64,
    /// Messages a second between the topic's first and last; 0 with fewer than two.
    pub rate_hz: f64,
}

#[derive(Debug)]
struct Tally {
    encoding: String,
    messages: u64,
    payload_bytes: u64,
    first_nanos: u64,
    last_nanos: u64,
}

/// Reads a recording to its end and tells what is in it.
///
/// `progress` is told of the bytes done and of all bytes.
///
/// # Errors
/// [`Error::Io`] if it cannot be read, [`Error::BadRecording`] if it is none. What is damaged later is
/// told in [`Info::damage`].
pub fn info(path: impl AsRef<Path>, progress: &mut dyn FnMut(u64, u64)) -> Result<Info, Error> {
    let path = path.as_ref();
    let mut reader = Reader::open(path)?;
    let mut tallies: BTreeMap<(Arc<str>, Arc<str>), Tally> = BTreeMap::new();
    let mut damage = None;
    while let Some(message) = reader.next() {
        let message = match message {
            Ok(message) => message,
            Err(error @ Error::Io { .. }) => return Err(error),
            Err(error) => {
                damage = Some(error.to_string());
                break;
            }
        };
        let tally = tallies
            .entry((message.topic, message.type_name))
            .or_insert_with(|| Tally {
                encoding: message.channel.encoding.clone(),
                messages: 0,
                payload_bytes: 0,
                first_nanos: u64::MAX,
                last_nanos: 0,
            });
        tally.messages += 1;
        tally.payload_bytes += u64::try_from(message.payload.len()).unwrap_or(0);
        tally.first_nanos = tally.first_nanos.min(message.log_nanos);
        tally.last_nanos = tally.last_nanos.max(message.log_nanos);
        progress(reader.position_bytes(), reader.len_bytes());
    }
    let first_log_nanos = tallies.values().map(|tally| tally.first_nanos).min();
    let first_log_nanos = first_log_nanos.unwrap_or(0);
    let last_log_nanos = tallies.values().map(|tally| tally.last_nanos).max();
    let last_log_nanos = last_log_nanos.unwrap_or(0);
    Ok(Info {
        path: path.to_owned(),
        bytes: reader.len_bytes(),
        messages: tallies.values().map(|tally| tally.messages).sum(),
        first_log_nanos,
        last_log_nanos,
        duration_s: (last_log_nanos - first_log_nanos) as f64 / NANOS_PER_S,
        topics: tallies.into_iter().map(TopicInfo::from).collect(),
        damage,
    })
}

impl From<((Arc<str>, Arc<str>), Tally)> for TopicInfo {
    fn from(((topic, type_name), tally): ((Arc<str>, Arc<str>), Tally)) -> Self {
        let span_s = (tally.last_nanos - tally.first_nanos) as f64 / NANOS_PER_S;
        let rate_hz = if span_s > 0.0 {
            (tally.messages - 1) as f64 / span_s
        } else {
            0.0
        };
        Self {
            topic: topic.to_string(),
            type_name: type_name.to_string(),
            encoding: tally.encoding,
            messages: tally.messages,
            payload_bytes: tally.payload_bytes,
            rate_hz,
        }
    }
}

impl fmt::Display for Info {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            formatter,
            "{}: {} bytes, {} messages in {:.1} s",
            self.path.display(),
            self.bytes,
            self.messages,
            self.duration_s
        )?;
        let width = |name: fn(&TopicInfo) -> &str| {
            let lens = self.topics.iter().map(|topic| name(topic).chars().count());
            lens.max().unwrap_or(0)
        };
        let (topic_width, type_width) = (width(|t| &t.topic), width(|t| &t.type_name));
        for topic in &self.topics {
            writeln!(
                formatter,
                "  {:topic_width$}  {:type_width$}  {:>9} messages  {:>9.2} Hz  {:>12} bytes",
                topic.topic, topic.type_name, topic.messages, topic.rate_hz, topic.payload_bytes
            )?;
        }
        if let Some(damage) = &self.damage {
            writeln!(formatter, "  damaged: {damage}")?;
        }
        Ok(())
    }
}
