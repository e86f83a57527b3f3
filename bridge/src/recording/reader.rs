//! Reading recordings, swath's own and those that others wrote.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::chunk::{MOST_CHUNK_BYTES, Trust, Unpacker};
use super::definitions::Definitions;
use super::message::RawMessage;
use super::record::{HEAD_BYTES, MAGIC, head, op};
use crate::Error;

/// Bytes read from the file at a time.
const BUFFER_BYTES: usize = 256 * 1024;

/// The messages of a recording in the order of the file.
///
/// Nothing follows an error.
pub struct Reader<R = BufReader<File>> {
    source: R,
    path: Arc<Path>,
    len: u64,
    /// Where the next record that is not in a chunk begins.
    offset: u64,
    body: Vec<u8>,
    unpacker: Unpacker,
    /// Where the chunk that is being unpacked begins.
    chunk_offset: Option<u64>,
    definitions: Definitions,
    wanted: Box<dyn Fn(&str) -> bool + Send>,
    part: Part,
}

/// The part of a file that is being read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Part {
    Data,
    Summary,
    Done,
}

impl<R> std::fmt::Debug for Reader<R> {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("Reader")
            .field("path", &self.path)
            .field("offset", &self.offset)
            .finish_non_exhaustive()
    }
}

impl Reader {
    /// Opens a file.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be read, [`Error::BadRecording`] if it does not begin like an MCAP
    /// file.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let file = File::open(path).map_err(|source| Error::Io {
            path: path.to_owned(),
            source,
        })?;
        Self::new(BufReader::with_capacity(BUFFER_BYTES, file), path)
    }
}

impl<R: Read + Seek> Reader<R> {
    /// Reads from any source; errors call it by the path.
    ///
    /// # Errors
    /// As [`open`](Reader::open).
    pub fn new(source: R, path: impl Into<PathBuf>) -> Result<Self, Error> {
        let path: PathBuf = path.into();
        let mut reader = Self {
            source,
            path: path.into(),
            len: 0,
            offset: 0,
            body: Vec::new(),
            unpacker: Unpacker::new(Trust::Whole),
            chunk_offset: None,
            definitions: Definitions::default(),
            wanted: Box::new(|_| true),
            part: Part::Data,
        };
        reader.begin()?;
        Ok(reader)
    }

    /// Leaves out every message whose topic is not wanted.
    #[must_use]
    pub fn with_topics(mut self, wanted: impl Fn(&str) -> bool + Send + 'static) -> Self {
        self.wanted = Box::new(wanted);
        self
    }

    /// Size of the file in bytes.
    pub const fn len_bytes(&self) -> u64 {
        self.len
    }

    /// How far the file has been read, in bytes.
    pub const fn position_bytes(&self) -> u64 {
        self.offset
    }

    fn begin(&mut self) -> Result<(), Error> {
        let len = self.source.seek(SeekFrom::End(0));
        self.len = len.map_err(|source| self.io(source))?;
        self.source.rewind().map_err(|source| self.io(source))?;
        if self.len == 0 {
            return Err(self.bad(0, "the file is empty, expected an MCAP file"));
        }
        let most = self.len.min(8);
        let mut magic = [0; MAGIC.len()];
        let found = &mut magic[..usize::try_from(most).unwrap_or(0)];
        if let Err(source) = self.source.read_exact(found) {
            return Err(self.io(source));
        }
        if magic != MAGIC {
            let what = format!("not an MCAP file: begins with {magic:02x?}, expected {MAGIC:02x?}");
            return Err(self.bad(0, what));
        }
        self.offset = 8;
        let (kind, body_len) = self.record_head()?;
        if kind != op::HEADER {
            let what = format!("a record of kind {kind:#04x}, expected a header (0x01)");
            return Err(self.bad(8, what));
        }
        self.skip(body_len)
    }

    fn io(&self, source: std::io::Error) -> Error {
        Error::Io {
            path: self.path.to_path_buf(),
            source,
        }
    }

    fn bad(&self, offset: u64, what: impl Into<String>) -> Error {
        Error::BadRecording {
            path: self.path.to_path_buf(),
            offset,
            what: what.into(),
        }
    }

    fn truncated(&self, what: &str, wanted: u64) -> Error {
        let left = self.len - self.offset;
        self.bad(
            self.offset,
            format!(
                "the file is cut off: {what} of {wanted} byte(s) expected, {left} left \
                 (`swath bridge recover` saves what comes before)"
            ),
        )
    }

    /// Reads what the next record is and how many bytes its body has, all of which are there.
    fn record_head(&mut self) -> Result<(u8, u64), Error> {
        let mut bytes = [0; HEAD_BYTES];
        if self.len - self.offset < 9 {
            return Err(self.truncated("a record", 9));
        }
        if let Err(source) = self.source.read_exact(&mut bytes) {
            return Err(self.io(source));
        }
        let (kind, body_len) = head(bytes);
        if body_len > self.len - self.offset - 9 {
            return Err(self.truncated(
                &format!("a record of kind {kind:#04x}"),
                body_len.saturating_add(9),
            ));
        }
        Ok((kind, body_len))
    }

    fn skip(&mut self, body_len: u64) -> Result<(), Error> {
        let moved = match i64::try_from(body_len) {
            Ok(distance) => self.source.seek_relative(distance),
            Err(_) => Err(std::io::ErrorKind::InvalidInput.into()),
        };
        moved.map_err(|source| self.io(source))?;
        self.offset += 9 + body_len;
        Ok(())
    }

    /// Loads the body of the record at the offset and moves on to the next one.
    fn load(&mut self, body_len: u64) -> Result<(), Error> {
        let len = match usize::try_from(body_len) {
            Ok(len) if len <= MOST_CHUNK_BYTES => len,
            _ => {
                let what =
                    format!("a record of {body_len} bytes, expected at most {MOST_CHUNK_BYTES}");
                return Err(self.bad(self.offset, what));
            }
        };
        self.body.resize(len, 0);
        if let Err(source) = self.source.read_exact(&mut self.body) {
            return Err(self.io(source));
        }
        self.offset += 9 + body_len;
        Ok(())
    }

    fn next_message(&mut self) -> Result<Option<RawMessage>, Error> {
        loop {
            if let Some(offset) = self.chunk_offset {
                match self.next_in_chunk(offset)? {
                    Some(message) => return Ok(Some(message)),
                    None => self.chunk_offset = None,
                }
            }
            let offset = self.offset;
            let (kind, body_len) = self.record_head()?;
            match (self.part, kind) {
                (Part::Data, op::SCHEMA | op::CHANNEL | op::MESSAGE) => {
                    self.load(body_len)?;
                    let taken = self.definitions.take(kind, &self.body, &self.wanted);
                    match taken {
                        Ok(Some(found)) => return Ok(Some(found.at(offset, &self.path))),
                        Ok(None) => {}
                        Err(what) => return Err(self.bad(offset, what)),
                    }
                }
                (Part::Data, op::CHUNK) => {
                    self.load(body_len)?;
                    if let Err(what) = self.unpacker.fill(&self.body) {
                        return Err(self.bad(offset, what));
                    }
                    self.chunk_offset = Some(offset);
                }
                (Part::Data, op::DATA_END) => {
                    self.skip(body_len)?;
                    self.part = Part::Summary;
                }
                (_, op::FOOTER) => {
                    self.skip(body_len)?;
                    return self.end().map(|()| None);
                }
                _ => self.skip(body_len)?,
            }
        }
    }

    fn next_in_chunk(&mut self, offset: u64) -> Result<Option<RawMessage>, Error> {
        loop {
            let taken = match self.unpacker.next() {
                None => return Ok(None),
                Some(Ok((kind, body))) => self.definitions.take(kind, body, &self.wanted),
                Some(Err(what)) => Err(what),
            };
            match taken {
                Ok(None) => {}
                Ok(Some(found)) => return Ok(Some(found.at(offset, &self.path))),
                Err(what) => return Err(self.bad(offset, what)),
            }
        }
    }

    fn end(&mut self) -> Result<(), Error> {
        if self.len - self.offset < 8 {
            return Err(self.truncated("the end mark", 8));
        }
        let mut magic = [0; MAGIC.len()];
        if let Err(source) = self.source.read_exact(&mut magic) {
            return Err(self.io(source));
        }
        if magic != MAGIC {
            let what = format!("{magic:02x?}, expected the end mark {MAGIC:02x?}");
            return Err(self.bad(self.offset, what));
        }
        self.offset += 8;
        Ok(())
    }
}

impl<R: Read + Seek> Iterator for Reader<R> {
    type Item = Result<RawMessage, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.part == Part::Done {
            return None;
        }
        let message = self.next_message();
        if !matches!(message, Ok(Some(_))) {
            self.part = Part::Done;
        }
        message.transpose()
    }
}
