//! The schemas and topics of a recording, which its messages refer to by number.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::channel::{Channel, full_type_name};
use super::message::Found;
use super::record::{ChannelRecord, MessageRecord, SchemaRecord, op};

/// Most bytes that all schemas and topics of a recording may have together.
const MOST_DEFINITION_BYTES: usize = 64 * 1024 * 1024;

/// What each file of a log has named, by the number of the file.
pub(crate) type DefinitionsByFile = BTreeMap<u32, Definitions>;

/// The schemas and topics that a recording has named so far.
#[derive(Debug, Clone, Default)]
pub(crate) struct Definitions {
    schemas: BTreeMap<u16, Schema>,
    channels: BTreeMap<u16, Arc<Channel>>,
    bytes: usize,
}

#[derive(Debug, Clone)]
struct Schema {
    name: String,
    encoding: String,
    data: Arc<[u8]>,
}

impl Definitions {
    /// Takes note of a schema or topic, or gives the message if a record is one and is wanted.
    pub(super) fn take(
        &mut self,
        kind: u8,
        body: &[u8],
        wanted: &dyn Fn(&str) -> bool,
    ) -> Result<Option<Found>, String> {
        match kind {
            op::SCHEMA => self.take_schema(&SchemaRecord::parse(body)?, body.len())?,
            op::CHANNEL => self.take_channel(ChannelRecord::parse(body)?, body.len())?,
            op::MESSAGE => {
                let message = MessageRecord::parse(body)?;
                let Some(channel) = self.channels.get(&message.channel_id) else {
                    return Err(format!(
                        "a message on channel {}, which the file has not named",
                        message.channel_id
                    ));
                };
                if wanted(&channel.topic) {
                    return Ok(Some(Found {
                        channel: Arc::clone(channel),
                        sequence: message.sequence,
                        log_nanos: message.log_nanos,
                        publish_nanos: message.publish_nanos,
                        payload: message.payload.to_vec(),
                    }));
                }
            }
            _ => {}
        }
        Ok(None)
    }

    fn count_bytes(&mut self, more: usize) -> Result<(), String> {
        self.bytes = self.bytes.saturating_add(more);
        if self.bytes > MOST_DEFINITION_BYTES {
            return Err(format!(
                "schemas and topics of more than {MOST_DEFINITION_BYTES} bytes"
            ));
        }
        Ok(())
    }

    fn take_schema(&mut self, schema: &SchemaRecord<'_>, len: usize) -> Result<(), String> {
        let name = full_type_name(schema.name);
        // Some writers repeat what they said in every chunk.
        let known = self.schemas.get(&schema.id).is_some_and(|known| {
            known.name == name && known.encoding == schema.encoding && *known.data == *schema.data
        });
        if !known {
            self.count_bytes(len)?;
            let copy = Schema {
                name,
                encoding: schema.encoding.to_owned(),
                data: schema.data.into(),
            };
            self.schemas.insert(schema.id, copy);
        }
        Ok(())
    }

    fn take_channel(&mut self, record: ChannelRecord<'_>, len: usize) -> Result<(), String> {
        let schema = match (record.schema_id, self.schemas.get(&record.schema_id)) {
            (0, _) => None,
            (_, Some(schema)) => Some(schema),
            (id, None) => {
                return Err(format!(
                    "{} has schema {id}, which the file has not named",
                    record.topic
                ));
            }
        };
        let known = self.channels.get(&record.id).is_some_and(|known| {
            *known.topic == *record.topic
                && known.encoding == record.encoding
                && known.metadata == record.metadata
                && *known.type_name == *schema.map_or("", |schema| &schema.name)
        });
        if !known {
            let channel = Channel {
                topic: record.topic.into(),
                type_name: schema.map_or("", |schema| &schema.name).into(),
                encoding: record.encoding.to_owned(),
                schema_encoding: schema.map_or_else(String::new, |schema| schema.encoding.clone()),
                schema: schema.map_or_else(Vec::new, |schema| schema.data.to_vec()),
                metadata: record.metadata,
            };
            self.count_bytes(len + channel.schema.len())?;
            self.channels.insert(record.id, Arc::new(channel));
        }
        Ok(())
    }
}
