//! Writing recordings.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use mcap::records::MessageHeader;
use mcap::{Compression, McapError, WriteOptions};

use super::channel::Channel;
use super::claim::{self, Existing};
use super::message::RawMessage;
use crate::Error;
use crate::cdr;
use crate::keys::{Topic, topic_of_key};
use crate::msg::Message;

/// Log time after which what is buffered goes to the file.
const MOST_UNWRITTEN_NANOS: u64 = 1_000_000_000;
/// Size at which a chunk is closed, before compression.
const CHUNK_BYTES: u64 = 1024 * 1024;

/// A recording that is being written.
///
/// What is in it depends on the messages alone, never on the clock: the same messages give the same
/// bytes. A chunk goes to the file when it is full or spans a second of log time; a recorder of
/// something live also calls [`flush`](Self::flush) every second. So that a program which is killed
/// loses no more than that, no record is patched after it was written.
pub struct Writer {
    path: PathBuf,
    out: mcap::Writer<BufWriter<File>>,
    channels: BTreeMap<String, OpenChannel>,
    /// Topics of other recordings.
    copied: Vec<(Arc<Channel>, u16)>,
    first_unwritten_nanos: Option<u64>,
    messages: u64,
}

#[derive(Debug)]
struct OpenChannel {
    id: u16,
    type_name: String,
    next_sequence: u32,
}

impl std::fmt::Debug for Writer {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("Writer")
            .field("path", &self.path)
            .field("messages", &self.messages)
            .finish_non_exhaustive()
    }
}

impl Writer {
    /// Creates the file, which must not be there.
    ///
    /// # Errors
    /// [`Error::Exists`] if it is there, [`Error::Io`] if it cannot be written.
    pub fn create(path: impl AsRef<Path>) -> Result<Self, Error> {
        Self::create_with(path, Existing::Refuse)
    }

    /// Creates the file, which may be there if it is to be replaced. Nobody else can write it as long
    /// as this writer lives.
    ///
    /// # Errors
    /// [`Error::Exists`] if it is there and must stay, [`Error::Io`] if it cannot be written.
    pub fn create_with(path: impl AsRef<Path>, existing: Existing) -> Result<Self, Error> {
        let path = path.as_ref().to_owned();
        let file = claim::create(&path, existing)?;
        let out = WriteOptions::new()
            .profile("ros2")
            .library(concat!("swath ", env!("CARGO_PKG_VERSION")))
            .compression(Some(Compression::Zstd))
            // Threads of the compressor would make the bytes depend on the machine.
            .compression_threads(0)
            .chunk_size(Some(CHUNK_BYTES))
            // Chunks are put together in memory and written in one piece.
            .disable_seeking(true)
            .create(BufWriter::new(file))
            .map_err(|error| write_error(&path, error))?;
        Ok(Self {
            path,
            out,
            channels: BTreeMap::new(),
            copied: Vec::new(),
            first_unwritten_nanos: None,
            messages: 0,
        })
    }

    /// Writes a message on a topic of swath.
    ///
    /// # Errors
    /// [`Error::Encode`] if the message has no form in CDR, else as [`write_raw`](Self::write_raw).
    pub fn write<M: Message>(
        &mut self,
        topic: &Topic<M>,
        message: &M,
        log_nanos: u64,
        publish_nanos: u64,
    ) -> Result<(), Error> {
        self.write_as(
            &topic_of_key(topic.key()),
            message,
            log_nanos,
            publish_nanos,
        )
    }

    /// Writes a message on any topic (`/tf_static`, `/odom`).
    ///
    /// # Errors
    /// [`Error::Encode`] if the message has no form in CDR, else as [`write_raw`](Self::write_raw).
    pub fn write_as<M: Message>(
        &mut self,
        topic: &str,
        message: &M,
        log_nanos: u64,
        publish_nanos: u64,
    ) -> Result<(), Error> {
        let payload = cdr::to_vec(message).map_err(|source| Error::Encode {
            topic: topic.to_owned(),
            type_name: M::TYPE_NAME,
            source,
        })?;
        let stamps = Stamps {
            log_nanos,
            publish_nanos,
        };
        self.write_raw(topic, M::TYPE_NAME, &payload, stamps)
    }

    /// Writes a message that is encoded already.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be written, [`Error::BadFile`] if the topic was written with
    /// another type before.
    pub fn write_raw(
        &mut self,
        topic: &str,
        type_name: &str,
        payload: &[u8],
        stamps: Stamps,
    ) -> Result<(), Error> {
        if !self.channels.contains_key(topic) {
            let open = OpenChannel {
                id: self.declare(&Channel::cdr(topic, type_name))?,
                type_name: type_name.to_owned(),
                next_sequence: 0,
            };
            self.channels.insert(topic.to_owned(), open);
        }
        let Some(channel) = self.channels.get_mut(topic) else {
            return Ok(());
        };
        if channel.type_name != type_name {
            let what = format!(
                "{topic} has messages of {}, a {type_name} cannot be added",
                channel.type_name
            );
            return Err(Error::BadFile {
                path: self.path.clone(),
                what,
            });
        }
        let header = MessageHeader {
            channel_id: channel.id,
            sequence: channel.next_sequence,
            log_time: stamps.log_nanos,
            publish_time: stamps.publish_nanos,
        };
        channel.next_sequence = channel.next_sequence.wrapping_add(1);
        self.append(&header, payload)
    }

    /// Writes a message of another recording, with its number and all that is said of its topic.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be written.
    pub fn copy(&mut self, message: &RawMessage) -> Result<(), Error> {
        let channel = &message.channel;
        let known = self
            .copied
            .iter()
            .find(|(known, _)| Arc::ptr_eq(known, channel));
        let id = if let Some((_, id)) = known {
            *id
        } else {
            let id = self.declare(channel)?;
            self.copied.push((Arc::clone(channel), id));
            id
        };
        let header = MessageHeader {
            channel_id: id,
            sequence: message.sequence,
            log_time: message.log_nanos,
            publish_time: message.publish_nanos,
        };
        self.append(&header, &message.payload)
    }

    /// Makes everything written so far safe from the end of this process.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be written.
    pub fn flush(&mut self) -> Result<(), Error> {
        if self.first_unwritten_nanos.take().is_some() {
            self.out
                .flush()
                .map_err(|error| write_error(&self.path, error))?;
        }
        Ok(())
    }

    /// Messages written.
    pub const fn messages(&self) -> u64 {
        self.messages
    }

    /// Ends the recording with its index and hands it to the disk.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be written.
    pub fn finish(mut self) -> Result<(), Error> {
        self.out
            .finish()
            .map_err(|error| write_error(&self.path, error))?;
        let buffer = self.out.into_inner();
        let io = |source| Error::Io {
            path: self.path.clone(),
            source,
        };
        let file = buffer
            .into_inner()
            .map_err(|error| io(error.into_error()))?;
        match file.sync_all() {
            // Pipes and devices cannot be synchronised.
            Err(error) if error.kind() == std::io::ErrorKind::InvalidInput => Ok(()),
            synced => synced.map_err(io),
        }
    }

    fn declare(&mut self, channel: &Channel) -> Result<u16, Error> {
        let path = &self.path;
        let bad = |error| write_error(path, error);
        let schema_id = if channel.type_name.is_empty() && channel.schema.is_empty() {
            0
        } else {
            let name = &channel.type_name;
            self.out
                .add_schema(name, &channel.schema_encoding, &channel.schema)
                .map_err(bad)?
        };
        self.out
            .add_channel(
                schema_id,
                &channel.topic,
                &channel.encoding,
                &channel.metadata,
            )
            .map_err(bad)
    }

    fn append(&mut self, header: &MessageHeader, payload: &[u8]) -> Result<(), Error> {
        self.out
            .write_to_known_channel(header, payload)
            .map_err(|error| write_error(&self.path, error))?;
        self.messages += 1;
        let first_nanos = *self.first_unwritten_nanos.get_or_insert(header.log_time);
        if header.log_time.abs_diff(first_nanos) >= MOST_UNWRITTEN_NANOS {
            self.flush()?;
        }
        Ok(())
    }
}

/// When a message was recorded and sent, in nanoseconds since the Unix epoch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamps {
    /// By the recorder's clock.
    pub log_nanos: u64,
    /// By the sender's clock.
    pub publish_nanos: u64,
}

fn write_error(path: &Path, error: McapError) -> Error {
    match error {
        McapError::Io(source) => Error::Io {
            path: path.to_owned(),
            source,
        },
        other => Error::BadFile {
            path: path.to_owned(),
            what: format!("cannot be written: {other}"),
        },
    }
}
