//! Publishing a recording again, with the spacing that it was recorded with.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use serde::Serialize;
use tokio::sync::mpsc::{Receiver, Sender, channel};
use tokio::time::Instant;

use super::message::RawMessage;
use super::reader::Reader;
use crate::Error;
use crate::keys::{self, Qos};
use crate::publisher::RawPublisher;
use crate::session::Session;

/// Messages that are read ahead.
const READ_AHEAD: usize = 16;
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
    /// Where to begin, seconds behind the first message.
    pub start_s: f64,
    /// Where to end, seconds behind the first message.
    pub end_s: f64,
    /// Topics or keys that are replayed; a `*` at the end stands for anything. Empty for all.
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
        let key = keys::key_of_topic(topic);
        self.topics.is_empty()
            || self.topics.iter().any(|wanted| {
                let wanted = keys::key_of_topic(wanted);
                match wanted.strip_suffix('*') {
                    Some(begin) => key.starts_with(begin),
                    None => key == wanted,
                }
            })
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

/// Publishes the messages of a recording.
///
/// `progress` is told of the bytes of the file done and of all bytes, at each message.
///
/// # Errors
/// [`Error::BadSetting`] for a rate that is not more than 0, [`Error::Io`] and
/// [`Error::BadRecording`] if the file cannot be read, [`Error::Network`] if the session is closed.
pub async fn replay(
    session: &Session,
    options: &ReplayOptions,
    progress: &mut (dyn FnMut(u64, u64) + Send),
) -> Result<ReplayReport, Error> {
    if options.rate.is_nan() || options.rate <= 0.0 {
        return Err(Error::BadSetting {
            name: "rate",
            value: options.rate.to_string(),
            expected: "more than 0",
        });
    }
    let mut player = Player {
        session,
        publishers: BTreeMap::new(),
        report: ReplayReport::default(),
        late_sum_ms: 0.0,
    };
    let begun = Instant::now();
    loop {
        player.round(options, progress).await?;
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

/// A message, when it is due, and how far the file has been read.
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
        progress: &mut (dyn FnMut(u64, u64) + Send),
    ) -> Result<(), Error> {
        let (sender, mut receiver) = channel(READ_AHEAD);
        let reading = options.clone();
        let reader = tokio::task::spawn_blocking(move || read_ahead(&reading, &sender));
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
        receiver: &mut Receiver<Due>,
        progress: &mut (dyn FnMut(u64, u64) + Send),
    ) -> Result<(), Error> {
        let start = Instant::now();
        while let Some(due) = receiver.recv().await {
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

/// Reads on a thread of its own, so that a slow disk does not delay what was read before.
fn read_ahead(options: &ReplayOptions, sender: &Sender<Due>) -> Result<(), Error> {
    let mut reader = Reader::open(&options.path)?;
    let mut first_nanos = None;
    while let Some(message) = reader.next() {
        let message = message?;
        let first_nanos = *first_nanos.get_or_insert(message.log_nanos);
        let at_s = message.log_nanos.saturating_sub(first_nanos) as f64 / NANOS_PER_S;
        if at_s > options.end_s {
            break;
        }
        if at_s < options.start_s || !options.wants(&message.topic) {
            continue;
        }
        let due = Due {
            message,
            after_s: at_s - options.start_s,
            position_bytes: reader.position_bytes(),
            len_bytes: reader.len_bytes(),
        };
        if sender.blocking_send(due).is_err() {
            // The other side has failed and says why.
            break;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn topics_are_chosen_by_name_or_beginning() {
        let mut options = ReplayOptions::all_of("a.mcap");
        assert!(options.wants("/anything"));
        options.topics = vec!["/swath/vehicle/*".to_owned(), "odom".to_owned()];
        assert!(options.wants("/swath/vehicle/v/grid"));
        assert!(options.wants("/odom"));
        assert!(!options.wants("/odometry"));
        assert!(!options.wants("/swath/sample/g"));
    }
}
