//! Making a good recording of what is left of a damaged one.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Arc;

use serde::Serialize;

use super::chunk::{MOST_CHUNK_BYTES, Trust, Unpacker};
use super::definitions::Definitions;
use super::reader::Reader;
use super::record::{Fields, HEAD_BYTES, MAGIC, head, op};
use super::writer::Writer;
use crate::Error;

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
    /// Every damage, with its place; none if the recording was whole.
    pub damage: Vec<String>,
}

/// Copies every message that can be read to a new recording.
///
/// `progress` is told of the bytes done and of all bytes. Chunks that do not match their checksum are
/// left out, since any of their messages may be wrong; of a chunk that was cut off, the messages
/// before the cut are saved.
///
/// # Errors
/// [`Error::Io`] if a file cannot be read or written, [`Error::BadRecording`] if the input is no
/// recording at all, [`Error::BadFile`] if both paths name the same file.
pub fn recover(
    input: impl AsRef<Path>,
    output: impl AsRef<Path>,
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
    let mut salvage = Salvage::open(input, Writer::create(output)?)?;
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
    source: BufReader<File>,
    path: Arc<Path>,
    offset: u64,
    body: Vec<u8>,
    definitions: Definitions,
    unpacker: Unpacker,
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
        let mut file = File::open(path).map_err(io)?;
        let bytes = file.seek(SeekFrom::End(0)).map_err(io)?;
        let start = u64::try_from(MAGIC.len()).unwrap_or(0);
        file.seek(SeekFrom::Start(start)).map_err(io)?;
        Ok(Self {
            source: BufReader::new(file),
            path: path.into(),
            offset: start,
            body: Vec::new(),
            definitions: Definitions::default(),
            unpacker: Unpacker::new(Trust::Whole),
            writer,
            report: RecoverReport {
                bytes,
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
            if body_len > self.report.bytes - self.offset - 9 || kind == op::FOOTER {
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
        self.report
            .damage
            .push(format!("at byte {}: {what}", self.offset));
    }

    /// Reads a body of `len` bytes, at most as much as a chunk may have.
    fn load(&mut self, len: u64) -> Result<(), Error> {
        let len = usize::try_from(len).unwrap_or(usize::MAX);
        self.body.resize(len.min(MOST_CHUNK_BYTES), 0);
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
        if body_len > left - 9 {
            self.take_cut_record(kind, body_len, left - 9)?;
            return Ok(false);
        }
        if kind == op::FOOTER {
            return self.end(left - 9 - body_len, body_len).map(|()| false);
        }
        let is_read = matches!(
            kind,
            op::SCHEMA | op::CHANNEL | op::MESSAGE | op::CHUNK | op::MESSAGE_INDEX
        );
        if self.has_data_end || !is_read {
            self.has_data_end |= kind == op::DATA_END;
            self.skip(body_len)?;
        } else if usize::try_from(body_len).is_ok_and(|len| len <= MOST_CHUNK_BYTES) {
            self.load(body_len)?;
            self.take(kind)?;
        } else {
            self.damaged(&format!("a record of {body_len} bytes"));
            self.report.bytes_lost += left;
            return Ok(false);
        }
        self.offset += 9 + body_len;
        Ok(true)
    }

    fn cut_off(&mut self, left: u64, what: &str) {
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
        match kind {
            op::CHUNK => {
                let body = std::mem::take(&mut self.body);
                self.has_lost_chunk = !self.take_chunk(&body)?;
                self.body = body;
            }
            op::MESSAGE_INDEX => {
                if self.has_lost_chunk {
                    self.report.messages_lost += indexed_messages(&self.body);
                }
            }
            _ => {
                let taken = self.definitions.take(kind, &self.body, &|_| true);
                self.has_lost_chunk = false;
                match taken {
                    Ok(None) => {}
                    Ok(Some(found)) => {
                        self.report.messages += 1;
                        self.writer.copy(&found.at(self.offset, &self.path))?;
                    }
                    Err(what) => {
                        self.damaged(&what);
                        self.report.messages_lost += u64::from(kind == op::MESSAGE);
                        self.lose(self.body.len());
                    }
                }
            }
        }
        Ok(())
    }

    fn lose(&mut self, body_len: usize) {
        self.report.bytes_lost += 9 + u64::try_from(body_len).unwrap_or(0);
    }

    /// Copies the messages of a chunk; false if none of it can be trusted.
    fn take_chunk(&mut self, body: &[u8]) -> Result<bool, Error> {
        let before = self.report.messages + self.report.messages_lost;
        let damage = match self.unpacker.fill(body) {
            Ok(()) => self.copy_chunk()?,
            Err(what) => Some(what),
        };
        let Some(what) = damage else {
            return Ok(true);
        };
        self.unpacker = Unpacker::new(Trust::Whole);
        self.damaged(&what);
        self.lose(body.len());
        Ok(self.report.messages + self.report.messages_lost > before)
    }

    /// Copies what the unpacker gives and tells what is wrong at its end, if anything is.
    fn copy_chunk(&mut self) -> Result<Option<String>, Error> {
        let mut damage = None;
        while let Some(record) = self.unpacker.next() {
            let taken = match record {
                Ok((kind, body)) => (kind, self.definitions.take(kind, body, &|_| true)),
                Err(what) => return Ok(Some(what)),
            };
            match taken {
                (_, Ok(None)) => {}
                (_, Ok(Some(found))) => {
                    self.report.messages += 1;
                    self.writer.copy(&found.at(self.offset, &self.path))?;
                }
                (kind, Err(what)) => {
                    self.report.messages_lost += u64::from(kind == op::MESSAGE);
                    damage.get_or_insert(what);
                }
            }
        }
        Ok(damage)
    }

    fn take_cut_record(&mut self, kind: u8, claimed_len: u64, left: u64) -> Result<(), Error> {
        let what = format!(
            "the file is cut off: {left} byte(s) are left of a record of kind {kind:#04x} and \
             {claimed_len} bytes"
        );
        if kind == op::CHUNK && !self.has_data_end {
            self.load(left)?;
            self.unpacker = Unpacker::new(Trust::Beginning);
            self.unpacker.fill_beginning(claimed_len, &self.body);
            self.copy_chunk()?;
        }
        self.cut_off(left + 9, &what);
        Ok(())
    }
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
