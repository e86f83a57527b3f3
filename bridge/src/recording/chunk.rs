//! Unpacking chunks, which hold most of the records of a recording.

use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::record::{ChunkRecord, HEAD_BYTES, head, op};

/// Most bytes that a chunk may have, packed or unpacked.
pub(super) const MOST_CHUNK_BYTES: usize = 256 * 1024 * 1024;
/// A record of no known kind and without a body, which marks the end of what was filled in.
const END_MARK: [u8; HEAD_BYTES] = [END_KIND, 0, 0, 0, 0, 0, 0, 0, 0];
const END_KIND: u8 = 0xff;

/// Takes the records out of one chunk after the other.
pub(super) struct Unpacker {
    reader: LinearReader,
}

/// Which chunks to take records from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Trust {
    /// Those that are whole and match their checksum.
    Whole,
    /// The beginning of one that was cut off.
    Beginning,
}

impl Unpacker {
    pub(super) fn new(trust: Trust) -> Self {
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(trust == Trust::Whole)
            .with_record_length_limit(MOST_CHUNK_BYTES);
        Self {
            reader: LinearReader::new_with_options(options),
        }
    }

    /// Fills in a chunk, whose records [`next`](Self::next) then gives.
    ///
    /// # Errors
    /// What is wrong with the chunk.
    pub(super) fn fill(&mut self, body: &[u8]) -> Result<(), String> {
        let chunk = ChunkRecord::parse(body)?;
        let most = u64::try_from(MOST_CHUNK_BYTES).unwrap_or(u64::MAX);
        if chunk.unpacked_len > most {
            return Err(format!(
                "a chunk claims {} bytes uncompressed, expected at most {most}",
                chunk.unpacked_len
            ));
        }
        if chunk.compression.is_empty() {
            check_records(chunk.packed)?;
        }
        self.feed(&record_head(body.len()));
        self.feed(body);
        self.feed(&END_MARK);
        Ok(())
    }

    /// Fills in the beginning of a chunk that was to have a body of `claimed_len` bytes.
    ///
    /// The records of it end with an error, since the last one is cut off.
    pub(super) fn fill_beginning(&mut self, claimed_len: u64, part: &[u8]) {
        self.feed(&[op::CHUNK]);
        self.feed(&claimed_len.to_le_bytes());
        self.feed(part);
    }

    fn feed(&mut self, bytes: &[u8]) {
        if !bytes.is_empty() {
            self.reader.insert(bytes.len()).copy_from_slice(bytes);
            self.reader.notify_read(bytes.len());
        }
    }

    /// The next record of the chunk, or `None` behind the last one.
    ///
    /// # Errors
    /// What is wrong with the chunk; nothing more can be read then.
    pub(super) fn next(&mut self) -> Option<Result<(u8, &[u8]), String>> {
        match self.reader.next_event()? {
            Ok(LinearReadEvent::Record { data: [], opcode }) if opcode == END_KIND => None,
            Ok(LinearReadEvent::Record { data, opcode }) => Some(Ok((opcode, data))),
            Ok(LinearReadEvent::ReadRequest(_)) => {
                Some(Err("the chunk ends inside a record".to_owned()))
            }
            Err(error) => Some(Err(format!("damaged chunk: {error}"))),
        }
    }
}

fn record_head(len: usize) -> [u8; HEAD_BYTES] {
    let mut bytes = [op::CHUNK; HEAD_BYTES];
    bytes[1..].copy_from_slice(&u64::try_from(len).unwrap_or(u64::MAX).to_le_bytes());
    bytes
}

/// Checks that the records of an uncompressed chunk fill it exactly.
fn check_records(mut bytes: &[u8]) -> Result<(), String> {
    while !bytes.is_empty() {
        let body = bytes.split_first_chunk().and_then(|(&first, rest)| {
            let len = usize::try_from(head(first).1).ok()?;
            rest.get(len..)
        });
        bytes = body
            .ok_or_else(|| format!("the last {} byte(s) of a chunk are no record", bytes.len()))?;
    }
    Ok(())
}
