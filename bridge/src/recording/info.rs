//! What is in a recording.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Serialize;

use super::log::Log;
use super::times::LogTimes;
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
    /// Earliest log time that is one, nanoseconds since the Unix epoch; 0 without messages.
    pub first_log_nanos: u64,
    /// Latest log time, nanoseconds since the Unix epoch; 0 without messages.
    pub last_log_nanos: u64,
    /// Messages without a time: their log time is 0, or from before the clock was set to a date.
    pub untimed: u64,
    /// Time between the two.
    pub duration_s: f64,
    /// Every topic with messages, by name.
    pub topics: Vec<TopicInfo>,
    /// Files of the log, if it is a folder of several.
    pub files: Vec<PathBuf>,
    /// What is odd about the folder.
    pub warnings: Vec<String>,
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
    /// Messages a second between the topic's earliest and latest that have a time; 0 with fewer
    /// than two.
    pub rate_hz: f64,
}

#[derive(Debug)]
struct Tally {
    encoding: String,
    messages: u64,
    payload_bytes: u64,
    times: LogTimes,
}

/// Reads a recording, or a rosbag2 folder, to its end and tells what is in it.
///
/// `progress` is told of the bytes done and of all bytes.
///
/// # Errors
/// [`Error::Io`] if it cannot be read, [`Error::BadRecording`] if it is none. What is damaged later is
/// told in [`Info::damage`].
pub fn info(path: impl AsRef<Path>, progress: &mut dyn FnMut(u64, u64)) -> Result<Info, Error> {
    let path = path.as_ref();
    let log = Log::open(path)?;
    let mut reader = log.reader()?;
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
                times: LogTimes::default(),
            });
        tally.messages += 1;
        tally.payload_bytes += u64::try_from(message.payload.len()).unwrap_or(0);
        tally.times.add(message.log_nanos);
        progress(reader.position_bytes(), reader.len_bytes());
    }
    let mut times = LogTimes::default();
    for tally in tallies.values() {
        times.merge(&tally.times);
    }
    let least = times.least();
    let (first_log_nanos, last_log_nanos) = times.span(least).unwrap_or((0, 0));
    let topics = tallies.into_iter();
    Ok(Info {
        path: path.to_owned(),
        bytes: reader.len_bytes(),
        messages: times.messages(),
        first_log_nanos,
        last_log_nanos,
        untimed: times.messages() - times.timed(least),
        duration_s: (last_log_nanos - first_log_nanos) as f64 / NANOS_PER_S,
        topics: topics.map(|topic| TopicInfo::new(topic, least)).collect(),
        files: match log.files() {
            [_] => Vec::new(),
            files => files.to_vec(),
        },
        warnings: log.warnings().to_vec(),
        damage,
    })
}

impl TopicInfo {
    fn new(((topic, type_name), tally): ((Arc<str>, Arc<str>), Tally), least: u64) -> Self {
        let span = tally.times.span(least);
        let span_s = span.map_or(0.0, |(first, last)| (last - first) as f64 / NANOS_PER_S);
        let rate_hz = if span_s > 0.0 {
            (tally.times.timed(least) - 1) as f64 / span_s
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
        if self.untimed > 0 {
            writeln!(
                formatter,
                "  {} of the messages have no log time (0, or from before the clock was set): the time \
                 counts from the first that has one",
                self.untimed
            )?;
        }
        for file in &self.files {
            writeln!(formatter, "  file: {}", file.display())?;
        }
        for warning in &self.warnings {
            writeln!(formatter, "  warning: {warning}")?;
        }
        if let Some(damage) = &self.damage {
            writeln!(formatter, "  damaged: {damage}")?;
        }
        Ok(())
    }
}
