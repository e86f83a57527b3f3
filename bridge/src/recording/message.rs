//! A message as a recording holds it.

use std::path::Path;
use std::sync::Arc;

use super::channel::{CDR, Channel};
use crate::Error;
use crate::cdr;
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
    path: Arc<Path>,
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
        if self.channel.encoding != CDR {
            return Err(self.bad(&format!(
                "messages encoded as {:?}, expected {CDR}",
                self.channel.encoding
            )));
        }
        cdr::from_slice(&self.payload).map_err(|error| {
            let what = format!("not a {}: {error}", M::TYPE_NAME);
            match self.other_definition(M::TYPE_NAME) {
                Some(difference) => self.bad(&format!(
                    "{what}; the recording was made with another definition of it ({difference}): read \
                     it with the version of swath that wrote it"
                )),
                None => self.bad(&what),
            }
        })
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
    pub(super) fn at(self, offset: u64, path: &Arc<Path>) -> RawMessage {
        RawMessage {
            topic: Arc::clone(&self.channel.topic),
            type_name: Arc::clone(&self.channel.type_name),
            sequence: self.sequence,
            log_nanos: self.log_nanos,
            publish_nanos: self.publish_nanos,
            payload: self.payload,
            channel: self.channel,
            offset,
            path: Arc::clone(path),
        }
    }
}
