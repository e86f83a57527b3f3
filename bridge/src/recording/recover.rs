//! Making a good recording of what is left of a damaged one.

use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Arc;

use serde::Serialize;

use super::chunk::{Broken, MOST_CHUNK_BYTES, MOST_RECORD_BYTES, Unpacker, open_whole};
use super::claim::{Existing, check_out};
use super::definitions::Definitions;
use super::message::Place;
use super::reader::Reader;
use super::record::{
    ChunkHead, Fields, HEAD_BYTES, LEAST_CHUNK_HEAD_BYTES, MAGIC, MOST_CHUNK_HEAD_BYTES, head, op,
};
use super::source::Source;
use super::writer::Writer;
use crate::Error;

/// Most places of damage that are told of.
const MOST_DAMAGE: usize = 1000;
/// Fewest bytes of a chunk: its head.
const LEAST_CHUNK_BYTES: u64 = LEAST_CHUNK_HEAD_BYTES as u64;

/// What was saved from a damaged recording, and what was not.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct RecoverReport {
    /// Size of the damaged file.
    pub bytes: u64,
    /// Bytes of it that could not be made use of.
    pub bytes_lost: u64,
    /// Messages saved.
    pub messages: u64,
    /// Messages that are known to have been in damaged parts; behind a cut nobody knows.
    pub messages_lost: u64,
    /// Whether the end is missing: nobody knows what came there.
    pub has_no_end: bool,
    /// Every damage, with its place; none if the recording was whole.
    pub damage: Vec<String>,
}

/// Copies every message that can be read to a new recording.
///
/// `progress` is told of the bytes done and of all bytes. Chunks that do not match their checksum are
/// left out, since any of their messages may be wrong; of a chunk that was cut off or not finished, the
/// messages before its end are saved, whatever it claims of itself.
///
/// # Errors
/// [`Error::Io`] if a file cannot be read or written, [`Error::BadRecording`] if the input is no
/// recording at all, [`Error::BadFile`] if both paths name the same file, [`Error::Exists`] if the
/// output is there and must stay.
pub fn recover(
    input: impl AsRef<Path>,
    output: impl AsRef<Path>,
    existing: Existing,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<RecoverReport, Error> {
    let (input, output) = (input.as_ref(), output.as_ref());
    // This names a file that is no recording as such.
    Reader::open(input)?;
    if same_file(input, output) {
        return Err(Error::BadFile {
            path: output.to_owned(),
            what: "is the recording itself, expected another file".to_owned(),
        });
    }
    check_out(output, existing)?;
    let mut salvage = Salvage::open(input, Writer::create_with(output, existing)?)?;
    salvage.read_index()?;
    while salvage.step()? {
        progress(salvage.offset, salvage.report.bytes);
    }
    salvage.writer.finish()?;
    Ok(salvage.report)
}

fn same_file(a: &Path, b: &Path) -> bool {
    match (a.canonicalize(), b.canonicalize()) {
        (Ok(a), Ok(b)) => a == b,
        _ => false,
    }
}

struct Salvage {
    source: Source,
    path: Arc<Path>,
    offset: u64,
    body: Vec<u8>,
    definitions: Definitions,
    writer: Writer,
    report: RecoverReport,
    /// Whether the last chunk was left out, so that the index behind it tells what is missing.
    has_lost_chunk: bool,
    has_data_end: bool,
}

impl Salvage {
    fn open(path: &Path, writer: Writer) -> Result<Self, Error> {
        let io = |source| Error::Io {
            path: path.to_owned(),
            source,
        };
        let mut source = Source::open(path)?;
        let bytes = source.seek(SeekFrom::End(0)).map_err(io)?;
        let start = u64::try_from(MAGIC.len()).unwrap_or(0);
        source.seek(SeekFrom::Start(start)).map_err(io)?;
        let damage = source.damage().map(str::to_owned);
        Ok(Self {
            source,
            path: path.into(),
            offset: start,
            body: Vec::new(),
            definitions: Definitions::default(),
            writer,
            report: RecoverReport {
                bytes,
                has_no_end: damage.is_some(),
                damage: damage.into_iter().collect(),
                ..RecoverReport::default()
            },
            has_lost_chunk: false,
            has_data_end: false,
        })
    }

    /// Takes schemas and topics from the index at the end of the file, if it is there: those in
    /// front may be in a chunk that is damaged.
    fn read_index(&mut self) -> Result<(), Error> {
        let start = self.offset;
        let mut is_index = false;
        let mut bytes = [0; HEAD_BYTES];
        while self.report.bytes - self.offset >= 9 {
            if let Err(source) = self.source.read_exact(&mut bytes) {
                return Err(self.io(source));
            }
            let (kind, body_len) = head(bytes);
            let is_unfinished = kind == op::CHUNK && body_len < LEAST_CHUNK_BYTES;
            let is_cut = body_len > self.report.bytes - self.offset - 9;
            if is_cut || is_unfinished || kind == op::FOOTER {
                break;
            }
            if is_index && matches!(kind, op::SCHEMA | op::CHANNEL) {
                self.load(body_len)?;
                // What cannot be read here is told of when it is missed.
                let _ = self.definitions.take(kind, &self.body, &|_| true);
            } else {
                self.skip(body_len)?;
            }
            is_index |= kind == op::DATA_END;
            self.offset += 9 + body_len;
        }
        self.offset = start;
        let rewound = self.source.seek(SeekFrom::Start(start));
        rewound.map(drop).map_err(|source| self.io(source))
    }

    fn skip(&mut self, body_len: u64) -> Result<(), Error> {
        let distance = i64::try_from(body_len).unwrap_or(i64::MAX);
        let moved = self.source.seek_relative(distance);
        moved.map_err(|source| self.io(source))
    }

    fn io(&self, source: std::io::Error) -> Error {
        Error::Io {
            path: self.path.to_path_buf(),
            source,
        }
    }

    fn damaged(&mut self, what: &str) {
        let damage = &mut self.report.damage;
        match damage.len() {
            ..MOST_DAMAGE => damage.push(format!("at byte {}: {what}", self.offset)),
            MOST_DAMAGE => damage.push("further damage is counted, not listed".to_owned()),
            _ => {}
        }
    }

    /// Reads a body of `len` bytes, at most as much as a record may have.
    fn load(&mut self, len: u64) -> Result<(), Error> {
        let len = usize::try_from(len).unwrap_or(usize::MAX);
        self.body.resize(len.min(MOST_RECORD_BYTES), 0);
        match self.source.read_exact(&mut self.body) {
            Ok(()) => Ok(()),
            Err(source) => Err(self.io(source)),
        }
    }

    /// Takes the next record; false behind the last one.
    fn step(&mut self) -> Result<bool, Error> {
        let left = self.report.bytes - self.offset;
        if left < 9 {
            self.cut_off(left, "the file ends where a record was expected");
            return Ok(false);
        }
        let mut bytes = [0; HEAD_BYTES];
        if let Err(source) = self.source.read_exact(&mut bytes) {
            return Err(self.io(source));
        }
        let (kind, body_len) = head(bytes);
        if kind == op::CHUNK && !self.has_data_end {
            return self.take_chunk(body_len, left - 9);
        }
        if body_len > left - 9 {
            let what = format!(
                "the file is cut off: {} byte(s) are left of a record of kind {kind:#04x} and \
                 {body_len} bytes",
                left - 9
            );
            self.cut_off(left, &what);
            return Ok(false);
        }
        if kind == op::FOOTER {
            return self.end(left - 9 - body_len, body_len).map(|()| false);
        }
        let is_read = matches!(
            kind,
            op::SCHEMA | op::CHANNEL | op::MESSAGE | op::MESSAGE_INDEX
        );
        if self.has_data_end || !is_read {
            self.has_data_end |= kind == op::DATA_END;
            self.skip(body_len)?;
        } else if usize::try_from(body_len).is_ok_and(|len| len <= MOST_RECORD_BYTES) {
            self.load(body_len)?;
            self.take(kind)?;
        } else {
            self.damaged(&format!(
                "a record of {body_len} bytes, expected at most {MOST_RECORD_BYTES}"
            ));
            self.lose(body_len);
            self.skip(body_len)?;
        }
        self.offset += 9 + body_len;
        Ok(true)
    }

    fn cut_off(&mut self, left: u64, what: &str) {
        self.report.has_no_end |= !self.has_data_end;
        if self.has_data_end {
            self.damaged("the index at the end is not complete");
        } else {
            self.damaged(what);
        }
        self.report.bytes_lost += left;
    }

    fn end(&mut self, left: u64, body_len: u64) -> Result<(), Error> {
        self.load(body_len)?;
        let mut magic = [0; MAGIC.len()];
        if left < 8 || self.source.read_exact(&mut magic).is_err() || magic != MAGIC {
            self.damaged("the end mark is missing");
        }
        Ok(())
    }

    fn take(&mut self, kind: u8) -> Result<(), Error> {
        if kind == op::MESSAGE_INDEX {
            if self.has_lost_chunk {
                self.report.messages_lost += indexed_messages(&self.body);
            }
            return Ok(());
        }
        self.has_lost_chunk = false;
        match self.definitions.take(kind, &self.body, &|_| true) {
            Ok(None) => {}
            Ok(Some(found)) => {
                self.report.messages += 1;
                self.writer.copy(&found.at(self.place(), &self.path))?;
            }
            Err(what) => {
                self.damaged(&what);
                self.report.messages_lost += u64::from(kind == op::MESSAGE);
                self.lose(u64::try_from(self.body.len()).unwrap_or(0));
            }
        }
        Ok(())
    }

    const fn place(&self) -> Place {
        Place {
            offset: self.offset,
            number: 0,
        }
    }

    const fn lose(&mut self, body_len: u64) {
        self.report.bytes_lost += 9 + body_len;
    }

    /// Copies the messages of a chunk whose record claims to have `body_len` bytes, of which `left`
    /// are in the file; false if nothing comes behind it.
    fn take_chunk(&mut self, body_len: u64, left: u64) -> Result<bool, Error> {
        let most = u64::try_from(MOST_CHUNK_HEAD_BYTES).unwrap_or(0);
        self.load(left.min(most))?;
        let Ok(head) = ChunkHead::parse(&self.body) else {
            return self.lose_chunk(body_len, left);
        };
        let room = left - head.head_len;
        let is_closed = body_len >= head.head_len && body_len <= left;
        let is_plausible = head.packed_len > 0 || body_len == head.head_len;
        if is_closed && is_plausible && head.packed_len <= body_len - head.head_len {
            self.take_whole_chunk(body_len, &head)?;
            return self.go_on(body_len);
        }
        // Place-holders, or a cut: the records themselves say where they end.
        let (packed_len, is_last) = if is_closed {
            (body_len - head.head_len, false)
        } else if head.packed_len > 0 && head.packed_len <= room {
            (head.packed_len, false)
        } else {
            (room, true)
        };
        let is_cut = is_last && body_len > left && (body_len - left) < MOST_CHUNK_BYTES;
        let why = if is_cut {
            format!("the file is cut off: {left} byte(s) are left of a chunk of {body_len} bytes")
        } else {
            "a chunk that its writer did not finish".to_owned()
        };
        self.take_beginning(&head, packed_len, &why)?;
        self.report.has_no_end |= is_last;
        if is_last {
            return Ok(false);
        }
        self.go_on(head.head_len + packed_len)
    }

    fn go_on(&mut self, body_len: u64) -> Result<bool, Error> {
        self.offset += 9 + body_len;
        let sought = self.source.seek(SeekFrom::Start(self.offset));
        sought.map(|_| true).map_err(|source| self.io(source))
    }

    /// Passes over a chunk of which not even the head can be read.
    fn lose_chunk(&mut self, body_len: u64, left: u64) -> Result<bool, Error> {
        if body_len < LEAST_CHUNK_BYTES || body_len > left {
            self.cut_off(left + 9, "the file is cut off inside the head of a chunk");
            return Ok(false);
        }
        self.damaged("the head of a chunk cannot be read");
        self.lose(body_len);
        self.has_lost_chunk = true;
        self.go_on(body_len)
    }

    /// Copies the messages of a chunk that is all there, if it can be trusted.
    fn take_whole_chunk(&mut self, body_len: u64, head: &ChunkHead) -> Result<(), Error> {
        let records = self.offset + 9 + head.head_len;
        let before = self.report.messages + self.report.messages_lost;
        let mut body = std::mem::take(&mut self.body);
        let opened = open_whole(&mut self.source, head, records, &mut body);
        self.body = body;
        let damage = match opened {
            Ok(opened) => self.copy_chunk(opened.unpacker)?.1,
            Err(Broken::Io(source)) => return Err(self.io(source)),
            Err(Broken::Damage(what)) => Some(what),
        };
        let Some(what) = damage else {
            self.has_lost_chunk = false;
            return Ok(());
        };
        let has_taken = self.report.messages + self.report.messages_lost > before;
        if !has_taken && has_place_holders(head) {
            return self.take_beginning(head, head.packed_len, &what);
        }
        self.damaged(&what);
        self.lose(body_len);
        self.has_lost_chunk = !has_taken;
        Ok(())
    }

    /// Copies the messages of a chunk of which `packed_len` bytes are there, up to the first that is
    /// not whole.
    fn take_beginning(
        &mut self,
        head: &ChunkHead,
        packed_len: u64,
        why: &str,
    ) -> Result<(), Error> {
        let records = self.offset + 9 + head.head_len;
        let sought = self.source.seek(SeekFrom::Start(records));
        sought.map_err(|source| self.io(source))?;
        let before = self.report.messages;
        let (taken, _) = self.copy_chunk(Unpacker::of_beginning(head, packed_len))?;
        let saved = self.report.messages - before;
        self.report.bytes_lost += if head.compression.is_empty() {
            packed_len.saturating_sub(taken)
        } else if saved == 0 {
            packed_len
        } else {
            // How many packed bytes the messages took nobody can tell.
            0
        };
        self.has_lost_chunk = false;
        self.damaged(&format!("{why}; {saved} message(s) of it are saved"));
        Ok(())
    }

    /// Copies what the unpacker gives, and tells how many unpacked bytes that were and what is wrong,
    /// if anything is.
    fn copy_chunk(&mut self, mut unpacker: Unpacker) -> Result<(u64, Option<String>), Error> {
        let (mut taken, mut damage) = (0, None);
        loop {
            let kind = match unpacker.next(&mut self.source) {
                Ok(None) => return Ok((taken, damage)),
                Ok(Some(kind)) => kind,
                Err(Broken::Io(source)) => return Err(self.io(source)),
                Err(Broken::Damage(what)) => return Ok((taken, Some(what))),
            };
            let record = unpacker.record();
            match self.definitions.take(kind, record, &|_| true) {
                Ok(None) => {}
                Ok(Some(found)) => {
                    self.report.messages += 1;
                    self.writer.copy(&found.at(self.place(), &self.path))?;
                }
                Err(what) => {
                    self.report.messages_lost += u64::from(kind == op::MESSAGE);
                    damage.get_or_insert(what);
                }
            }
            taken += 9 + u64::try_from(record.len()).unwrap_or(0);
        }
    }
}

/// Whether what a chunk says of itself cannot be, since its writer was to fill it in later.
const fn has_place_holders(head: &ChunkHead) -> bool {
    head.checksum == u32::MAX
        || head.unpacked_len > MOST_CHUNK_BYTES
        || (head.unpacked_len == 0 && head.packed_len > 0)
}

/// How many messages of one topic the index behind a chunk names.
fn indexed_messages(body: &[u8]) -> u64 {
    /// Log time and place.
    const ENTRY_BYTES: usize = 16;
    let mut fields = Fields::new(body);
    let entries = fields
        .u16("channel id")
        .and_then(|_| fields.bytes("message index"));
    entries.map_or(0, |entries| {
        u64::try_from(entries.len() / ENTRY_BYTES).unwrap_or(0)
    })
}

#[cfg(test)]
mod tests;
