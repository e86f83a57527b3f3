//! The records of an MCAP file, read from bytes that may hold anything.
//!
//! Source: MCAP specification, version 0, section "Records".

use std::collections::BTreeMap;

/// Bytes at both ends of a file.
pub(super) const MAGIC: [u8; 8] = [0x89, b'M', b'C', b'A', b'P', b'0', b'\r', b'\n'];
/// Bytes of a record before its body: what it is and how long it is.
pub(super) const HEAD_BYTES: usize = 9;

/// What a record is.
pub(super) mod op {
    pub(in super::super) const HEADER: u8 = 0x01;
    pub(in super::super) const FOOTER: u8 = 0x02;
    pub(in super::super) const SCHEMA: u8 = 0x03;
    pub(in super::super) const CHANNEL: u8 = 0x04;
    pub(in super::super) const MESSAGE: u8 = 0x05;
    pub(in super::super) const CHUNK: u8 = 0x06;
    pub(in super::super) const MESSAGE_INDEX: u8 = 0x07;
    pub(in super::super) const DATA_END: u8 = 0x0f;
}

/// The kind and length that a record begins with.
pub(super) fn head(bytes: [u8; HEAD_BYTES]) -> (u8, u64) {
    let [kind, len @ ..] = bytes;
    (kind, u64::from_le_bytes(len))
}

/// The fields of a record's body, read one after the other.
///
/// Errors say what was expected; the caller adds where.
#[derive(Debug)]
pub(super) struct Fields<'a> {
    body: &'a [u8],
}

impl<'a> Fields<'a> {
    pub(super) const fn new(body: &'a [u8]) -> Self {
        Self { body }
    }

    pub(super) const fn rest(&self) -> &'a [u8] {
        self.body
    }

    fn take(&mut self, count: usize, what: &str) -> Result<&'a [u8], String> {
        let Some((taken, rest)) = self.body.split_at_checked(count) else {
            return Err(format!(
                "{what} of {count} byte(s) does not fit into the {} left of its record",
                self.body.len()
            ));
        };
        self.body = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], String> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(N, what)?);
        Ok(bytes)
    }

    pub(super) fn u16(&mut self, what: &str) -> Result<u16, String> {
        self.array(what).map(u16::from_le_bytes)
    }

    pub(super) fn u32(&mut self, what: &str) -> Result<u32, String> {
        self.array(what).map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self, what: &str) -> Result<u64, String> {
        self.array(what).map(u64::from_le_bytes)
    }

    pub(super) fn bytes(&mut self, what: &str) -> Result<&'a [u8], String> {
        let len = self.u32(what)?;
        self.take(usize::try_from(len).unwrap_or(usize::MAX), what)
    }

    pub(super) fn text(&mut self, what: &str) -> Result<&'a str, String> {
        std::str::from_utf8(self.bytes(what)?).map_err(|error| format!("{what}: {error}"))
    }

    pub(super) fn text_map(&mut self, what: &str) -> Result<BTreeMap<String, String>, String> {
        let mut fields = Self::new(self.bytes(what)?);
        let mut map = BTreeMap::new();
        while !fields.body.is_empty() {
            let key = fields.text(what)?.to_owned();
            map.insert(key, fields.text(what)?.to_owned());
        }
        Ok(map)
    }
}

/// A schema record.
#[derive(Debug)]
pub(super) struct SchemaRecord<'a> {
    pub(super) id: u16,
    pub(super) name: &'a str,
    pub(super) encoding: &'a str,
    pub(super) data: &'a [u8],
}

impl<'a> SchemaRecord<'a> {
    pub(super) fn parse(body: &'a [u8]) -> Result<Self, String> {
        let mut fields = Fields::new(body);
        Ok(Self {
            id: fields.u16("schema id")?,
            name: fields.text("schema name")?,
            encoding: fields.text("schema encoding")?,
            data: fields.bytes("schema")?,
        })
    }
}

/// A channel record.
#[derive(Debug)]
pub(super) struct ChannelRecord<'a> {
    pub(super) id: u16,
    pub(super) schema_id: u16,
    pub(super) topic: &'a str,
    pub(super) encoding: &'a str,
    pub(super) metadata: BTreeMap<String, String>,
}

impl<'a> ChannelRecord<'a> {
    pub(super) fn parse(body: &'a [u8]) -> Result<Self, String> {
        let mut fields = Fields::new(body);
        Ok(Self {
            id: fields.u16("channel id")?,
            schema_id: fields.u16("schema id of a channel")?,
            topic: fields.text("topic")?,
            encoding: fields.text("message encoding")?,
            metadata: fields.text_map("channel metadata")?,
        })
    }
}

/// A message record.
#[derive(Debug)]
pub(super) struct MessageRecord<'a> {
    pub(super) channel_id: u16,
    pub(super) sequence: u32,
    pub(super) log_nanos: u64,
    pub(super) publish_nanos: u64,
    pub(super) payload: &'a [u8],
}

impl<'a> MessageRecord<'a> {
    pub(super) fn parse(body: &'a [u8]) -> Result<Self, String> {
        let mut fields = Fields::new(body);
        Ok(Self {
            channel_id: fields.u16("channel id of a message")?,
            sequence: fields.u32("sequence number")?,
            log_nanos: fields.u64("log time")?,
            publish_nanos: fields.u64("publish time")?,
            payload: fields.rest(),
        })
    }
}

/// The part of a chunk record before the records in it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ChunkHead {
    pub(super) unpacked_len: u64,
    /// Of the unpacked records; 0 if there is none.
    pub(super) checksum: u32,
    pub(super) compression: String,
    pub(super) packed_len: u64,
    /// Bytes of this part.
    pub(super) head_len: u64,
}

/// Most bytes of a chunk's head: it is as long as the name of its compression makes it.
pub(super) const MOST_CHUNK_HEAD_BYTES: usize = LEAST_CHUNK_HEAD_BYTES + 32;
/// Fewest bytes of a chunk's head.
pub(super) const LEAST_CHUNK_HEAD_BYTES: usize = 40;

impl ChunkHead {
    /// Bytes of this part and of the packed records.
    pub(super) const fn len(&self) -> u64 {
        self.head_len.saturating_add(self.packed_len)
    }

    /// Reads it from the first bytes of a chunk's body.
    pub(super) fn parse(body: &[u8]) -> Result<Self, String> {
        let mut fields = Fields::new(body);
        fields.u64("start time of a chunk")?;
        fields.u64("end time of a chunk")?;
        let unpacked_len = fields.u64("uncompressed size of a chunk")?;
        let checksum = fields.u32("checksum of a chunk")?;
        let compression = fields.text("compression of a chunk")?.to_owned();
        let packed_len = fields.u64("size of a chunk")?;
        let head_len = body.len() - fields.rest().len();
        Ok(Self {
            unpacked_len,
            checksum,
            compression,
            packed_len,
            head_len: u64::try_from(head_len).unwrap_or(u64::MAX),
        })
    }
}
