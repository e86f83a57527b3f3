//! Recording what is on the wire.
//!
//! Zenoh's threads put messages into a bounded queue; one thread of its own writes them. If the disk
//! is slower than the network for long, messages are dropped and counted.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TrySendError, sync_channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use serde::Serialize;

use super::claim::Existing;
use super::writer::{Stamps, Writer};
use crate::Error;
use crate::keys::{self, Qos};
use crate::queue::{Arrived, Inbox};
use crate::session::Session;
use crate::subscriber::RawSubscriber;

/// Most messages that wait to be written.
const MOST_QUEUED: usize = 65_536;
/// Most bytes of messages that wait to be written.
const MOST_QUEUED_BYTES: u64 = 256 * 1024 * 1024;
/// Longest time for which a message is in memory only.
const FLUSH_EVERY: Duration = Duration::from_secs(1);
/// Offset of the stamp that every message of swath begins with, and its end.
const STAMP: std::ops::Range<usize> = 4..12;

/// What to record, and where to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordOptions {
    /// The file, which is created.
    pub path: PathBuf,
    /// What becomes of a file that is there already.
    pub existing: Existing,
    /// Beginnings of the keys that are recorded, for example `swath/vehicle/`; empty for all.
    pub keys: Vec<String>,
}

/// What has become of the messages for a recorder.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct RecordCounts {
    /// Messages written.
    pub written: u64,
    /// Bytes of these messages, before compression.
    pub written_bytes: u64,
    /// Messages that came while the queue was full.
    pub dropped: u64,
    /// Messages on keys that are none of swath's.
    pub unknown: u64,
    /// Messages that were sent and did not arrive, where the publisher counts.
    pub missed: u64,
}

#[derive(Debug, Default)]
struct Shared {
    written: AtomicU64,
    written_bytes: AtomicU64,
    queued_bytes: AtomicU64,
    dropped: AtomicU64,
    unknown: AtomicU64,
    missed: AtomicU64,
}

/// Records every message of swath until it is finished.
#[derive(Debug)]
pub struct Recorder {
    subscribers: Vec<RawSubscriber>,
    shared: Arc<Shared>,
    thread: JoinHandle<Result<(), Error>>,
}

/// The recorder's end of zenoh's threads.
#[derive(Debug)]
struct Intake {
    sender: SyncSender<Arrived>,
    shared: Arc<Shared>,
    keys: Vec<String>,
}

impl Inbox for Intake {
    fn push(&self, arrived: Arrived) {
        let is_wanted = |begin: &String| arrived.key.starts_with(begin.as_str());
        if !self.keys.is_empty() && !self.keys.iter().any(is_wanted) {
            return;
        }
        let len = u64::try_from(arrived.payload.len()).unwrap_or(u64::MAX);
        let queued = self.shared.queued_bytes.fetch_add(len, Ordering::Relaxed);
        let sent = if queued.saturating_add(len) > MOST_QUEUED_BYTES {
            Err(TrySendError::Full(arrived))
        } else {
            self.sender.try_send(arrived)
        };
        if sent.is_err() {
            self.shared.queued_bytes.fetch_sub(len, Ordering::Relaxed);
            self.shared.dropped.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn add_missed(&self, count: u64) {
        self.shared.missed.fetch_add(count, Ordering::Relaxed);
    }

    fn close(&self) {}
}

/// Every key of swath with how it is carried, so that late recorders get what is kept for them.
fn topics() -> Vec<(String, Qos)> {
    macro_rules! any {
        ($($topic:ident),*) => {
            vec![$({
                let topic = keys::$topic("*");
                (topic.key().to_owned(), topic.qos())
            }),*]
        };
    }
    any![
        sample,
        weights,
        train_status,
        evaluation,
        grid,
        odom,
        reference,
        targets,
        plan,
        path,
        region,
        explored
    ]
}

impl Recorder {
    /// Subscribes to every topic of swath and begins to write.
    ///
    /// # Errors
    /// [`Error::Exists`] if the file is there and must stay, [`Error::Io`] if it cannot be written,
    /// [`Error::Network`] if the session is closed.
    pub async fn start(session: &Session, options: &RecordOptions) -> Result<Self, Error> {
        let writer = Writer::create_with(&options.path, options.existing)?;
        let shared = Arc::new(Shared::default());
        let (sender, receiver) = sync_channel(MOST_QUEUED);
        let intake: Arc<dyn Inbox> = Arc::new(Intake {
            sender,
            shared: Arc::clone(&shared),
            keys: options.keys.clone(),
        });
        let sink = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("swath recorder".to_owned())
            .spawn(move || write_all(writer, &receiver, &sink));
        let thread = thread.map_err(|source| Error::Io {
            path: options.path.clone(),
            source,
        })?;
        let mut subscribers = Vec::new();
        for (key, qos) in topics() {
            let intake = Arc::clone(&intake);
            subscribers.push(session.raw_subscriber(&key, qos, intake).await?);
        }
        Ok(Self {
            subscribers,
            shared,
            thread,
        })
    }

    /// What has become of the messages so far.
    pub fn counts(&self) -> RecordCounts {
        self.shared.counts()
    }

    /// Whether it still writes; if not, [`finish`](Self::finish) says why.
    pub fn is_running(&self) -> bool {
        !self.thread.is_finished()
    }

    /// Writes what has arrived, and the recording's index.
    ///
    /// # Errors
    /// [`Error::Io`] if the file could not be written.
    pub async fn finish(self) -> Result<RecordCounts, Error> {
        let Self {
            subscribers,
            shared,
            thread,
        } = self;
        // With the last subscriber the queue's sender goes, and with that the thread ends.
        drop(subscribers);
        let joined = tokio::task::spawn_blocking(move || thread.join()).await;
        match joined {
            Ok(Ok(written)) => written.map(|()| shared.counts()),
            Ok(Err(panic)) => std::panic::resume_unwind(panic),
            Err(error) => std::panic::resume_unwind(error.into_panic()),
        }
    }
}

impl Shared {
    fn counts(&self) -> RecordCounts {
        RecordCounts {
            written: self.written.load(Ordering::Relaxed),
            written_bytes: self.written_bytes.load(Ordering::Relaxed),
            dropped: self.dropped.load(Ordering::Relaxed),
            unknown: self.unknown.load(Ordering::Relaxed),
            missed: self.missed.load(Ordering::Relaxed),
        }
    }
}

fn write_all(
    mut writer: Writer,
    receiver: &Receiver<Arrived>,
    shared: &Shared,
) -> Result<(), Error> {
    let mut flushed = Instant::now();
    loop {
        match receiver.recv_timeout(FLUSH_EVERY.saturating_sub(flushed.elapsed())) {
            Ok(arrived) => {
                let len = u64::try_from(arrived.payload.len()).unwrap_or(0);
                shared.queued_bytes.fetch_sub(len, Ordering::Relaxed);
                write_one(&mut writer, &arrived, shared)?;
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return writer.finish(),
        }
        if flushed.elapsed() >= FLUSH_EVERY {
            writer.flush()?;
            flushed = Instant::now();
        }
    }
}

fn write_one(writer: &mut Writer, arrived: &Arrived, shared: &Shared) -> Result<(), Error> {
    let Some((type_name, _)) = keys::classify(&arrived.key) else {
        shared.unknown.fetch_add(1, Ordering::Relaxed);
        return Ok(());
    };
    let payload = arrived.payload.to_bytes();
    let stamps = Stamps {
        log_nanos: arrived.received_nanos,
        publish_nanos: arrived
            .sent_nanos
            .or_else(|| stamp_nanos(&payload))
            .unwrap_or(arrived.received_nanos),
    };
    writer.write_raw(
        &keys::topic_of_key(&arrived.key),
        type_name,
        &payload,
        stamps,
    )?;
    let len = u64::try_from(payload.len()).unwrap_or(0);
    shared.written.fetch_add(1, Ordering::Relaxed);
    shared.written_bytes.fetch_add(len, Ordering::Relaxed);
    Ok(())
}

/// The stamp of a message that begins with a header, in little-endian CDR.
fn stamp_nanos(payload: &[u8]) -> Option<u64> {
    let [0, 1, ..] = payload else {
        return None;
    };
    let (&sec, nanosec) = payload.get(STAMP)?.split_first_chunk()?;
    let sec = u64::try_from(i32::from_le_bytes(sec)).ok()?;
    let nanosec = u32::from_le_bytes(*nanosec.first_chunk()?);
    sec.checked_mul(1_000_000_000)?.checked_add(nanosec.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cdr;
    use crate::msg::header::Header;
    use crate::msg::nav::Path;

    #[test]
    fn every_topic_that_is_classified_is_recorded() {
        for (key, qos) in topics() {
            let one = key.replace('*', "one");
            assert_eq!(keys::classify(&one).map(|(_, qos)| qos), Some(qos), "{key}");
        }
    }

    #[test]
    fn the_stamp_of_a_message_is_read_without_decoding_it() {
        let message = Path {
            header: Header::at(1_234_567_890_123, "a"),
            poses: Vec::new(),
        };
        let payload = cdr::to_vec(&message).unwrap();
        assert_eq!(stamp_nanos(&payload), Some(1_234_567_890_123));
        for len in 0..12 {
            assert_eq!(stamp_nanos(&payload[..len]), None);
        }
    }
}
