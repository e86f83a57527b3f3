//! Publishing a recording again, with the spacing that it was recorded with.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use serde::Serialize;
use tokio::sync::mpsc::{Receiver, Sender, channel};
use tokio::time::Instant;

use super::log::Log;
use super::message::RawMessage;
use super::order::{Index, MOST_INDEXED, OrderedReader};
use super::pattern::matches;
use super::times::LogTimes;
use crate::Error;
use crate::keys::{self, Qos};
use crate::publisher::RawPublisher;
use crate::session::Session;

/// Messages that are read together where the recording is in order.
const BATCH_MESSAGES: usize = 16;
/// Bytes of messages that are read together where the recording is in order.
const BATCH_BYTES: usize = 16 * 1024 * 1024;
/// Batches that are read ahead: one is played while the next one is read.
const READ_AHEAD: usize = 1;
/// Most topics that an error lists.
const MOST_LISTED: usize = 40;
const NANOS_PER_S: f64 = 1e9;
const MS_PER_S: f64 = 1e3;

/// What to replay, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct ReplayOptions {
    /// The recording.
    pub path: PathBuf,
    /// How many times faster than recorded; more than 0. Infinite: as fast as it goes.
    pub rate: f64,
    /// Whether to begin again at the end.
    pub is_endless: bool,
    /// Where to begin, seconds behind the earliest message that has a time; 0 or more.
    pub start_s: f64,
    /// Where to end, seconds behind the earliest message that has a time; at least the beginning.
    pub end_s: f64,
    /// Topics or keys that are replayed; a `*` stands for anything. Empty for all.
    pub topics: Vec<String>,
}

impl ReplayOptions {
    /// All of a recording, once, as fast as it was recorded.
    pub fn all_of(path: impl Into<PathBuf>) -> Self {
        Self {
            path: path.into(),
            rate: 1.0,
            is_endless: false,
            start_s: 0.0,
            end_s: f64::INFINITY,
            topics: Vec::new(),
        }
    }

    fn wants(&self, topic: &str) -> bool {
        self.topics.is_empty() || self.topics.iter().any(|wanted| matches(wanted, topic))
    }

    /// Checks that every value is in its range.
    ///
    /// # Errors
    /// [`Error::BadSetting`] names it.
    pub fn check(&self) -> Result<(), Error> {
        let bad = |name, value: f64, expected| {
            Err(Error::BadSetting {
                name,
                value: value.to_string(),
                expected,
            })
        };
        if self.rate.is_nan() || self.rate <= 0.0 {
            return bad("rate", self.rate, "more than 0");
        }
        if !(self.start_s.is_finite() && self.start_s >= 0.0) {
            return bad("start", self.start_s, "0 or more seconds");
        }
        if self.end_s.is_nan() || self.end_s < self.start_s {
            return bad("end", self.end_s, "at least the start");
        }
        Ok(())
    }
}

/// What was replayed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct ReplayReport {
    /// Messages published.
    pub messages: u64,
    /// Times that the recording was gone through.
    pub rounds: u64,
    /// How long it took.
    pub elapsed_s: f64,
    /// Mean time between when a message was due and when it was published.
    pub mean_late_ms: f64,
    /// The longest such time.
    pub worst_late_ms: f64,
}

/// Publishes the messages of a recording, or of a rosbag2 folder, in the order of their log times.
///
/// Messages without a time are published at once; the clock begins at the first that has one. A
/// recording that is not in order is read by an index, so that no more of it than two windows is in
/// memory. `progress` is told of the bytes done and of all bytes, at each message.
///
/// # Errors
/// As [`ReplayOptions::check`]; [`Error::NoTopicMatches`] if a pattern chooses nothing, [`Error::Io`] and
/// [`Error::BadRecording`] if the file cannot be read, [`Error::BadFile`] if it is not in order and has
/// too many messages, [`Error::Network`] if the session is closed.
pub async fn replay(
    session: &Session,
    options: &ReplayOptions,
    progress: &mut (dyn FnMut(u64, u64) + Send),
) -> Result<ReplayReport, Error> {
    options.check()?;
    let scanned = {
        let options = options.clone();
        tokio::task::spawn_blocking(move || Plan::of(&options))
    };
    let mut plan = match scanned.await {
        Ok(plan) => plan?,
        Err(error) => std::panic::resume_unwind(error.into_panic()),
    };
    let mut player = Player {
        session,
        publishers: BTreeMap::new(),
        report: ReplayReport::default(),
        late_sum_ms: 0.0,
    };
    let begun = Instant::now();
    loop {
        plan = player.round(options, plan, progress).await?;
        player.report.rounds += 1;
        // A recording without such messages would be gone through forever at full speed.
        if !options.is_endless || player.report.messages == 0 {
            break;
        }
    }
    let mut report = player.report;
    report.elapsed_s = begun.elapsed().as_secs_f64();
    if report.messages > 0 {
        report.mean_late_ms = player.late_sum_ms / report.messages as f64;
    }
    Ok(report)
}

struct Player<'a> {
    session: &'a Session,
    publishers: BTreeMap<Arc<str>, RawPublisher>,
    report: ReplayReport,
    late_sum_ms: f64,
}

/// A message, when it is due, and how far the recording has been read.
struct Due {
    message: RawMessage,
    after_s: f64,
    position_bytes: u64,
    len_bytes: u64,
}

impl Player<'_> {
    async fn round(
        &mut self,
        options: &ReplayOptions,
        plan: Plan,
        progress: &mut (dyn FnMut(u64, u64) + Send),
    ) -> Result<Plan, Error> {
        let (sender, mut receiver) = channel(READ_AHEAD);
        let reading = options.clone();
        let reader = tokio::task::spawn_blocking(move || {
            let mut plan = plan;
            plan.read(&reading, &sender).map(|()| plan)
        });
        let played = self.play(options, &mut receiver, progress).await;
        drop(receiver);
        let read = reader.await;
        played?;
        match read {
            Ok(read) => read,
            Err(error) => std::panic::resume_unwind(error.into_panic()),
        }
    }

    async fn play(
        &mut self,
        options: &ReplayOptions,
        receiver: &mut Receiver<Vec<Due>>,
        progress: &mut (dyn FnMut(u64, u64) + Send),
    ) -> Result<(), Error> {
        let start = Instant::now();
        let mut batch = Vec::new().into_iter();
        loop {
            let Some(due) = batch.next() else {
                match receiver.recv().await {
                    Some(next) => batch = next.into_iter(),
                    None => break,
                }
                continue;
            };
            let after_s = (due.after_s / options.rate).max(0.0);
            let after = Duration::try_from_secs_f64(after_s).unwrap_or(Duration::ZERO);
            // Publishers are declared before the message is due, so that they do not delay it.
            let publisher = self.publisher(&due.message.topic).await?;
            tokio::time::sleep_until(start + after).await;
            let late = (start + after).elapsed();
            publisher.put(due.message.payload).await?;
            let late_ms = late.as_secs_f64() * MS_PER_S;
            self.late_sum_ms += late_ms;
            self.report.worst_late_ms = self.report.worst_late_ms.max(late_ms);
            self.report.messages += 1;
            progress(due.position_bytes, due.len_bytes);
        }
        Ok(())
    }

    async fn publisher(&mut self, topic: &Arc<str>) -> Result<&RawPublisher, Error> {
        if !self.publishers.contains_key(topic) {
            let key = keys::key_of_topic(topic);
            // Topics of others go out as what is merely looked at.
            let qos = keys::classify(key).map_or(Qos::Lossy, |(_, qos)| qos);
            let publisher = self.session.raw_publisher(key, qos).await?;
            self.publishers.insert(Arc::clone(topic), publisher);
        }
        Ok(&self.publishers[topic])
    }
}

/// How a recording is to be read, from a first look at all of it.
struct Plan {
    log: Log,
    /// Log time at which the clock begins, nanoseconds.
    begin_nanos: u64,
    /// The least log time that is one.
    least_nanos: u64,
    /// Where its messages are, if they are not in order.
    ordered: Option<Ordered>,
}

struct Ordered {
    reader: OrderedReader,
    len_bytes: u64,
}

impl Plan {
    /// Looks at every message: which topics there are, when the clock begins, and whether the
    /// recording is in order.
    fn of(options: &ReplayOptions) -> Result<Self, Error> {
        let log = Log::open(&options.path)?;
        for warning in log.warnings() {
            tracing::warn!("{warning}");
        }
        let mut reader = log.reader()?;
        let mut topics: BTreeMap<Arc<str>, bool> = BTreeMap::new();
        let mut times = LogTimes::default();
        let (mut index, mut is_indexed) = (Index::default(), true);
        let (mut is_sorted, mut last_nanos) = (true, 0);
        for message in &mut reader {
            let message = message?;
            times.add(message.log_nanos);
            let is_wanted = if let Some(is_wanted) = topics.get(&message.topic) {
                *is_wanted
            } else {
                let is_wanted = options.wants(&message.topic);
                topics.insert(Arc::clone(&message.topic), is_wanted);
                is_wanted
            };
            if !is_wanted {
                continue;
            }
            is_sorted &= message.log_nanos >= last_nanos;
            last_nanos = message.log_nanos;
            is_indexed = is_indexed
                && index
                    .entry(&message, message.log_nanos)
                    .is_some_and(|entry| index.push(entry));
        }
        check_patterns(options, &topics)?;
        if !is_sorted && !is_indexed {
            return Err(Error::BadFile {
                path: options.path.clone(),
                what: format!(
                    "is not in the order of its log times and has more than {MOST_INDEXED} messages: \
                     choose topics, or sort it first"
                ),
            });
        }
        let least_nanos = times.least();
        let mut plan = Self {
            log,
            begin_nanos: times.span(least_nanos).map_or(0, |(first, _)| first),
            least_nanos,
            ordered: None,
        };
        if !is_sorted {
            tracing::info!(
                "{} is not in the order of its log times: it is played in that order",
                options.path.display()
            );
            index.sort(|entry| plan.is_in_time(entry.key, options));
            let len_bytes = index.bytes();
            let wanted = options.clone();
            let reader = OrderedReader::new(
                plan.log.clone(),
                index,
                reader.into_definitions(),
                move |topic| wanted.wants(topic),
            );
            plan.ordered = Some(Ordered { reader, len_bytes });
        }
        Ok(plan)
    }

    /// When a message is due, seconds behind the beginning: those without a time at once.
    fn at_s(&self, log_nanos: u64) -> f64 {
        if log_nanos >= self.least_nanos {
            log_nanos.saturating_sub(self.begin_nanos) as f64 / NANOS_PER_S
        } else {
            0.0
        }
    }

    fn is_in_time(&self, log_nanos: u64, options: &ReplayOptions) -> bool {
        (options.start_s..=options.end_s).contains(&self.at_s(log_nanos))
    }

    /// Reads on a thread of its own, so that a slow disk does not delay what was read before.
    fn read(&mut self, options: &ReplayOptions, sender: &Sender<Vec<Due>>) -> Result<(), Error> {
        match self.ordered.take() {
            Some(mut ordered) => {
                let read = self.read_ordered(&mut ordered, options, sender);
                ordered.reader.rewind();
                self.ordered = Some(ordered);
                read
            }
            None => self.read_through(options, sender),
        }
    }

    fn read_ordered(
        &self,
        ordered: &mut Ordered,
        options: &ReplayOptions,
        sender: &Sender<Vec<Due>>,
    ) -> Result<(), Error> {
        let mut position_bytes = 0;
        loop {
            let window = ordered.reader.next_window()?;
            let mut batch = Vec::with_capacity(window.len());
            for (log_nanos, message) in window {
                position_bytes += u64::try_from(message.payload.len()).unwrap_or(0);
                batch.push(Due {
                    message,
                    after_s: self.at_s(log_nanos) - options.start_s,
                    position_bytes,
                    len_bytes: ordered.len_bytes,
                });
            }
            // Where the other side has failed, it says why.
            if batch.is_empty() || sender.blocking_send(batch).is_err() {
                return Ok(());
            }
        }
    }

    fn read_through(
        &self,
        options: &ReplayOptions,
        sender: &Sender<Vec<Due>>,
    ) -> Result<(), Error> {
        let wanted = options.clone();
        let mut reader = self
            .log
            .reader()?
            .with_topics(move |topic| wanted.wants(topic));
        let (mut batch, mut bytes) = (Vec::new(), 0);
        while let Some(message) = reader.next() {
            let message = message?;
            let at_s = self.at_s(message.log_nanos);
            if at_s > options.end_s {
                break;
            }
            if at_s < options.start_s {
                continue;
            }
            bytes += message.payload.len();
            batch.push(Due {
                message,
                after_s: at_s - options.start_s,
                position_bytes: reader.position_bytes(),
                len_bytes: reader.len_bytes(),
            });
            if batch.len() >= BATCH_MESSAGES || bytes >= BATCH_BYTES {
                bytes = 0;
                if sender.blocking_send(std::mem::take(&mut batch)).is_err() {
                    return Ok(());
                }
            }
        }
        // Where the other side has failed, it says why.
        let _ = sender.blocking_send(batch);
        Ok(())
    }
}

/// Checks that every pattern chooses something.
fn check_patterns(options: &ReplayOptions, topics: &BTreeMap<Arc<str>, bool>) -> Result<(), Error> {
    let chooses_nothing = |pattern: &&String| !topics.keys().any(|topic| matches(pattern, topic));
    let Some(pattern) = options.topics.iter().find(chooses_nothing) else {
        return Ok(());
    };
    let mut found: Vec<&str> = topics
        .keys()
        .take(MOST_LISTED)
        .map(|topic| &**topic)
        .collect();
    if topics.len() > MOST_LISTED {
        found.push("and more");
    }
    Err(Error::NoTopicMatches {
        path: options.path.clone(),
        pattern: pattern.clone(),
        found: if found.is_empty() {
            "no messages".to_owned()
        } else {
            found.join(", ")
        },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_are_chosen_by_name_or_pattern() {
        let mut options = ReplayOptions::all_of("a.mcap");
        assert!(options.wants("/anything"));
        options.topics = vec!["*/grid".to_owned(), "odom".to_owned()];
        assert!(options.wants("/swath/vehicle/v/grid"));
        assert!(options.wants("/odom"));
        assert!(!options.wants("/odometry"));
        assert!(!options.wants("/swath/sample/g"));
    }
}
