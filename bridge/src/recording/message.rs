//! A message as a recording holds it.

use std::path::Path;
use std::sync::Arc;

use super::channel::{CDR, Channel};
use crate::Error;
use crate::cdr;
use crate::msg::header::Header;
use crate::msg::{Message, schema_of};

/// A message of a recording, still encoded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RawMessage {
    /// Topic, with the slash in front that ROS gives it.
    pub topic: Arc<str>,
    /// Type as ROS 2 writes it, for example `nav_msgs/msg/Path`; empty if the file does not say.
    pub type_name: Arc<str>,
    /// Number of the message on its topic, as its sender or recorder counted; 0 if nobody did.
    pub sequence: u32,
    /// When it was recorded, nanoseconds since the Unix epoch by the recorder's clock.
    pub log_nanos: u64,
    /// When it was sent, nanoseconds since the Unix epoch by the sender's clock.
    pub publish_nanos: u64,
    /// The message in CDR.
    pub payload: Vec<u8>,
    /// All that the recording says about the topic.
    pub channel: Arc<Channel>,
    /// Byte of the file at which the message's record, or the chunk that holds it, begins.
    pub offset: u64,
    /// Number of the message within the chunk that begins at the offset.
    pub(super) number: u32,
    /// Number of the file, where a log has several.
    pub(super) part: u32,
    path: Arc<Path>,
}

/// Where a message is in its file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Place {
    /// Byte of the file at which the message's record, or the chunk that holds it, begins.
    pub(super) offset: u64,
    /// Number of the message within the chunk.
    pub(super) number: u32,
}

impl RawMessage {
    /// Decodes the message.
    ///
    /// # Errors
    /// [`Error::BadRecording`] if it is of another type or encoding, or no message of its type.
    pub fn decode<M: Message>(&self) -> Result<M, Error> {
        if *self.type_name != *M::TYPE_NAME {
            return Err(self.bad(&format!(
                "messages of type {:?}, expected {}",
                self.type_name,
                M::TYPE_NAME
            )));
        }
        self.check_encoding()
            .and_then(|()| {
                cdr::from_slice(&self.payload).map_err(|error| {
                    let what = format!("not a {}: {error}", M::TYPE_NAME);
                    match self.other_definition(M::TYPE_NAME) {
                        Some(difference) => format!(
                            "{what}; the recording was made with another definition of it \
                             ({difference}): read it with the version of swath that wrote it"
                        ),
                        None => what,
                    }
                })
            })
            .map_err(|what| self.bad(&what))
    }

    /// Decodes the header that a message of many types begins with.
    pub(crate) fn header(&self) -> Result<Header, Error> {
        self.check_encoding()
            .and_then(|()| {
                cdr::beginning_of(&self.payload)
                    .map_err(|error| format!("not a {}: {error}", self.type_name))
            })
            .map_err(|what| self.bad(&what))
    }

    /// The error says how the message is encoded or packed instead, and what to do.
    fn check_encoding(&self) -> Result<(), String> {
        let encoding = self.channel.encoding.as_str();
        if encoding != CDR {
            let advice = match encoding {
                "ros1" => "convert the recording to ROS 2, for example with rosbags-convert",
                _ => "record it through ROS 2, or convert it",
            };
            return Err(format!(
                "messages encoded as {encoding:?}, expected {CDR:?}: {advice}"
            ));
        }
        let packed = match self.payload.first_chunk() {
            Some([0x28, 0xb5, 0x2f, 0xfd]) => "zstd",
            Some([0x04, 0x22, 0x4d, 0x18]) => "lz4",
            _ => return Ok(()),
        };
        Err(format!(
            "each message is compressed with {packed} by itself, which the file does not say: give the \
             rosbag2 folder with its metadata.yaml (compression_mode MESSAGE, compression_format zstd), \
             or record with compression_mode FILE or NONE"
        ))
    }

    /// How the recording's definition of a type differs from the one that is decoded here, if it does.
    fn other_definition(&self, type_name: &str) -> Option<String> {
        let recorded = std::str::from_utf8(&self.channel.schema).ok()?;
        let known = schema_of(type_name)?;
        let (recorded, known) = (fields_of(recorded), fields_of(&known));
        if recorded.is_empty() || recorded == known {
            return None;
        }
        let lacks = known.iter().find(|field| !recorded.contains(field));
        let has = recorded.iter().find(|field| !known.contains(field));
        Some(match (lacks, has) {
            (Some(field), _) => format!("it lacks {field:?}"),
            (None, Some(field)) => format!("it has {field:?}"),
            (None, None) => "its fields have another order".to_owned(),
        })
    }

    fn bad(&self, what: &str) -> Error {
        Error::BadRecording {
            path: self.path.to_path_buf(),
            offset: self.offset,
            what: format!("{}: {what}", self.topic),
        }
    }
}

/// The fields of all types of a schema, without comments, constants and spaces that do not matter.
fn fields_of(schema: &str) -> Vec<String> {
    let lines = schema
        .lines()
        .filter_map(|line| line.split('#').next())
        .filter(|line| !line.contains('=') && !line.trim().is_empty());
    lines
        .map(|line| line.split_whitespace().collect::<Vec<_>>().join(" "))
        .collect()
}

/// A message, but for the place where it was found.
pub(super) struct Found {
    pub(super) channel: Arc<Channel>,
    pub(super) sequence: u32,
    pub(super) log_nanos: u64,
    pub(super) publish_nanos: u64,
    pub(super) payload: Vec<u8>,
}

impl Found {
    pub(super) fn at(self, place: Place, path: &Arc<Path>) -> RawMessage {
        RawMessage {
            topic: Arc::clone(&self.channel.topic),
            type_name: Arc::clone(&self.channel.type_name),
            sequence: self.sequence,
            log_nanos: self.log_nanos,
            publish_nanos: self.publish_nanos,
            payload: self.payload,
            channel: self.channel,
            offset: place.offset,
            number: place.number,
            part: 0,
            path: Arc::clone(path),
        }
    }
}
