//! Unpacking chunks, which hold most of the records of a recording.
//!
//! A chunk of usual size is unpacked in memory and checked before any of its records is given. A larger
//! one is read from the file piece by piece, twice: once for its checksum, once for its records. So a
//! chunk may be far larger than the memory that reading it takes.

use std::io::{self, Read, Seek, SeekFrom};

use mcap::McapError;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::record::{ChunkHead, HEAD_BYTES, head, op};

/// Most bytes that one record, a message among them, may have.
pub(super) const MOST_RECORD_BYTES: usize = 256 * 1024 * 1024;
/// Most bytes that a chunk may claim, packed or unpacked.
pub(super) const MOST_CHUNK_BYTES: u64 = 16 * 1024 * 1024 * 1024;
/// Most bytes, packed and unpacked, of a chunk that is unpacked in memory.
const MOST_IN_MEMORY_BYTES: u64 = 64 * 1024 * 1024;
/// Most bytes that are fed to the decompressor at a time.
const PIECE_BYTES: usize = 1024 * 1024;
/// What an unfinished chunk is said to hold unpacked: more than any has.
const UNKNOWN_LEN: u64 = u64::MAX / 4;
/// A record of no known kind and without a body, which marks the end of what was filled in.
const END_MARK: [u8; HEAD_BYTES] = [END_KIND, 0, 0, 0, 0, 0, 0, 0, 0];
const END_KIND: u8 = 0xff;

/// Why the next record of a chunk cannot be given.
#[derive(Debug)]
pub(super) enum Broken {
    /// The file could not be read.
    Io(io::Error),
    /// What is wrong with the chunk.
    Damage(String),
}

/// Whether the checksum of a chunk is looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Check {
    /// Before the first record is given; the chunk is held in memory for it.
    Before,
    /// Behind the last record.
    After,
    No,
}

/// Takes the records out of a chunk.
pub(super) struct Unpacker {
    reader: LinearReader,
    /// Bytes of the chunk that are still in the source.
    left: u64,
    has_ended: bool,
    record: Vec<u8>,
}

impl Unpacker {
    fn new(check: Check, left: u64) -> Self {
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(check == Check::Before)
            .with_validate_chunk_crcs(check != Check::No)
            .with_record_length_limit(MOST_RECORD_BYTES);
        Self {
            reader: LinearReader::new_with_options(options),
            left,
            has_ended: false,
            record: Vec::new(),
        }
    }

    /// The records of a whole chunk whose body is in memory; [`next`](Self::next) reads nothing more.
    fn of_body(head: &ChunkHead, body: &[u8]) -> Result<Self, String> {
        if head.compression.is_empty() {
            let from = usize::try_from(head.head_len).unwrap_or(usize::MAX);
            let packed = usize::try_from(head.packed_len).unwrap_or(usize::MAX);
            let records = body
                .get(from..)
                .and_then(|rest| rest.get(..packed))
                .ok_or("the chunk ends before its records do")?;
            check_records(records)?;
        }
        let mut unpacker = Self::new(Check::Before, 0);
        let len = u64::try_from(body.len()).unwrap_or(u64::MAX);
        unpacker.put(&[op::CHUNK]);
        unpacker.put(&len.to_le_bytes());
        unpacker.put(body);
        Ok(unpacker)
    }

    /// The records of a chunk that is read piece by piece; the source stands behind the chunk's head.
    fn of_source(head: &ChunkHead, is_checked: bool) -> Self {
        let check = if is_checked { Check::After } else { Check::No };
        let mut unpacker = Self::new(check, head.packed_len);
        unpacker.put_head(head, head.unpacked_len);
        unpacker
    }

    /// The records of a chunk that its writer did not finish, of which `packed_len` bytes are there;
    /// the source stands behind the chunk's head. They end with an error, wherever that is.
    pub(super) fn of_beginning(head: &ChunkHead, packed_len: u64) -> Self {
        let known = ChunkHead {
            packed_len,
            ..head.clone()
        };
        let mut unpacker = Self::new(Check::No, packed_len);
        // A mark behind the cut would be taken for the end of a record that is cut off.
        unpacker.has_ended = true;
        unpacker.put_head(&known, UNKNOWN_LEN);
        unpacker
    }

    fn put_head(&mut self, head: &ChunkHead, unpacked_len: u64) {
        let text = head.compression.as_bytes();
        let text_len = u32::try_from(text.len()).unwrap_or(u32::MAX);
        let mut body = Vec::with_capacity(64);
        body.extend([0; 16]);
        body.extend(unpacked_len.to_le_bytes());
        body.extend(head.checksum.to_le_bytes());
        body.extend(text_len.to_le_bytes());
        body.extend(text);
        body.extend(head.packed_len.to_le_bytes());
        let body_len = u64::try_from(body.len()).unwrap_or(0);
        let record_len = body_len.saturating_add(head.packed_len);
        self.put(&[op::CHUNK]);
        self.put(&record_len.to_le_bytes());
        self.put(&body);
    }

    fn put(&mut self, bytes: &[u8]) {
        if !bytes.is_empty() {
            self.reader.insert(bytes.len()).copy_from_slice(bytes);
            self.reader.notify_read(bytes.len());
        }
    }

    /// Moves on to the next record of the chunk, and gives what it is; `None` behind the last one.
    ///
    /// # Errors
    /// What is wrong with the chunk or the source; nothing more can be read then.
    pub(super) fn next(&mut self, source: &mut impl Read) -> Result<Option<u8>, Broken> {
        loop {
            let wanted = match self.reader.next_event() {
                None => return Ok(None),
                Some(Ok(LinearReadEvent::Record { data: [], opcode })) if opcode == END_KIND => {
                    return Ok(None);
                }
                Some(Ok(LinearReadEvent::Record { data, opcode })) => {
                    self.record.clear();
                    self.record.extend_from_slice(data);
                    return Ok(Some(opcode));
                }
                Some(Ok(LinearReadEvent::ReadRequest(wanted))) => wanted,
                Some(Err(error)) => return Err(Broken::Damage(describe(&error))),
            };
            self.feed(source, wanted)?;
        }
    }

    /// The record that [`next`](Self::next) moved on to.
    pub(super) fn record(&self) -> &[u8] {
        &self.record
    }

    fn feed(&mut self, source: &mut impl Read, wanted: usize) -> Result<(), Broken> {
        if self.left == 0 {
            if self.has_ended {
                return Err(Broken::Damage("the chunk ends inside a record".to_owned()));
            }
            self.has_ended = true;
            self.put(&END_MARK);
            return Ok(());
        }
        let left = usize::try_from(self.left).unwrap_or(usize::MAX);
        let count = wanted.clamp(1, PIECE_BYTES).min(left);
        let space = self.reader.insert(count);
        source.read_exact(space).map_err(Broken::Io)?;
        self.reader.notify_read(count);
        self.left -= u64::try_from(count).unwrap_or(0);
        Ok(())
    }
}

fn describe(error: &McapError) -> String {
    match error {
        McapError::UnsupportedCompression(found) => format!(
            "a chunk is compressed with {found:?}, expected \"zstd\", \"lz4\" or nothing: convert \
             the recording"
        ),
        other => format!("damaged chunk: {other}"),
    }
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

/// Checks that the records of an uncompressed chunk of `len` bytes fill it exactly; the source is
/// read, not kept.
fn check_records_of(source: &mut impl Read, mut len: u64) -> Result<(), Broken> {
    while len > 0 {
        let mut first = [0; HEAD_BYTES];
        let no_record =
            || Broken::Damage(format!("the last {len} byte(s) of a chunk are no record"));
        let behind = len.checked_sub(9).ok_or_else(no_record)?;
        source.read_exact(&mut first).map_err(Broken::Io)?;
        let body_len = head(first).1;
        let rest = behind.checked_sub(body_len).ok_or_else(no_record)?;
        let skipped = io::copy(&mut source.take(body_len), &mut io::sink()).map_err(Broken::Io)?;
        if skipped != body_len {
            return Err(Broken::Io(io::ErrorKind::UnexpectedEof.into()));
        }
        len = rest;
    }
    Ok(())
}

/// A chunk whose records are to be taken.
pub(super) struct Opened {
    pub(super) unpacker: Unpacker,
    /// Whether the records are read from the source piece by piece.
    pub(super) is_streamed: bool,
}

/// Makes ready to take the records of a chunk that is whole: those of one that does not match its
/// checksum are not given.
///
/// `body` holds the first bytes of the chunk, behind which the source stands; its records begin at
/// `records` in the source.
pub(super) fn open_whole<R: Read + Seek>(
    source: &mut R,
    head: &ChunkHead,
    records: u64,
    body: &mut Vec<u8>,
) -> Result<Opened, Broken> {
    let body_len = head.len();
    if body_len.max(head.unpacked_len) <= MOST_IN_MEMORY_BYTES {
        // What was read already is not read again: going back is slow in compressed files.
        let begun = body.len();
        body.resize(usize::try_from(body_len).unwrap_or(0), 0);
        if let Some(rest) = body.get_mut(begun..) {
            source.read_exact(rest).map_err(Broken::Io)?;
        }
        let unpacker = Unpacker::of_body(head, body).map_err(Broken::Damage)?;
        return Ok(Opened {
            unpacker,
            is_streamed: false,
        });
    }
    let go_back = |source: &mut R| source.seek(SeekFrom::Start(records)).map_err(Broken::Io);
    if head.compression.is_empty() {
        go_back(source)?;
        check_records_of(source, head.packed_len)?;
    }
    if head.checksum != 0 {
        go_back(source)?;
        let mut unpacker = Unpacker::of_source(head, true);
        while unpacker.next(source)?.is_some() {}
    }
    go_back(source)?;
    Ok(Opened {
        unpacker: Unpacker::of_source(head, false),
        is_streamed: true,
    })
}

/// Checks what a chunk claims against the limits.
///
/// # Errors
/// Names the limit.
pub(super) fn check_claims(chunk: &ChunkHead) -> Result<(), String> {
    for (len, what) in [
        (chunk.unpacked_len, "uncompressed"),
        (chunk.packed_len, "compressed"),
    ] {
        if len > MOST_CHUNK_BYTES {
            return Err(format!(
                "a chunk claims {len} bytes {what}, expected at most {MOST_CHUNK_BYTES} \
                 (`swath bridge recover` saves the messages that are in it)"
            ));
        }
    }
    Ok(())
}
