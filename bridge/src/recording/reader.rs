//! Reading recordings, swath's own and those that others wrote.

use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::chunk::{Broken, MOST_RECORD_BYTES, Unpacker, check_claims, open_whole};
use super::definitions::Definitions;
use super::message::{Place, RawMessage};
use super::record::{
    ChunkHead, HEAD_BYTES, LEAST_CHUNK_HEAD_BYTES, MAGIC, MOST_CHUNK_HEAD_BYTES, head, op,
};
use super::source::Source;
use crate::Error;

/// Which topics are given.
pub(super) type Wanted = Arc<dyn Fn(&str) -> bool + Send + Sync>;

/// The messages of a recording in the order of the file.
///
/// Nothing follows an error.
pub struct Reader<R = Source> {
    source: R,
    path: Arc<Path>,
    len: u64,
    /// Where the next record that is not in a chunk begins.
    offset: u64,
    body: Vec<u8>,
    chunk: Option<OpenChunk>,
    definitions: Definitions,
    wanted: Wanted,
    part: Part,
    /// Why the source ends early, if it does.
    damage: Option<String>,
}

/// A chunk whose records are being taken.
struct OpenChunk {
    unpacker: Unpacker,
    /// Where it begins.
    offset: u64,
    /// Whether the source does not stand behind it once its records are taken.
    is_elsewhere: bool,
    /// Messages taken so far.
    messages: u32,
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
    /// Opens a file, also one that was compressed with zstd as a whole. Offsets in errors are those of
    /// the unpacked file.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be read, [`Error::BadRecording`] if it does not begin like an MCAP
    /// file, [`Error::BadFile`] for a folder.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let source = Source::open(path)?;
        let damage = source.damage().map(str::to_owned);
        Self::with_damage(source, path.to_owned(), damage)
    }
}

impl<R: Read + Seek> Reader<R> {
    /// Reads from any source; errors call it by the path.
    ///
    /// # Errors
    /// As [`open`](Reader::open).
    pub fn new(source: R, path: impl Into<PathBuf>) -> Result<Self, Error> {
        Self::with_damage(source, path.into(), None)
    }

    fn with_damage(source: R, path: PathBuf, damage: Option<String>) -> Result<Self, Error> {
        let mut reader = Self {
            source,
            path: path.into(),
            len: 0,
            offset: 0,
            body: Vec::new(),
            chunk: None,
            definitions: Definitions::default(),
            wanted: Arc::new(|_| true),
            part: Part::Data,
            damage,
        };
        reader.begin()?;
        Ok(reader)
    }

    /// Leaves out every message whose topic is not wanted.
    #[must_use]
    pub fn with_topics(self, wanted: impl Fn(&str) -> bool + Send + Sync + 'static) -> Self {
        self.with_wanted(Arc::new(wanted))
    }

    pub(super) fn with_wanted(mut self, wanted: Wanted) -> Self {
        self.wanted = wanted;
        self
    }

    /// Begins with what another reader of the same file came to know of its topics.
    pub(super) fn with_definitions(mut self, definitions: Definitions) -> Self {
        self.definitions = definitions;
        self
    }

    /// What is known of the file's topics so far.
    pub(super) fn into_definitions(self) -> Definitions {
        self.definitions
    }

    /// Goes on with the record that begins at this offset, which [`Place::offset`] of a message names.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read.
    pub(super) fn go_to(&mut self, offset: u64) -> Result<(), Error> {
        self.seek(offset)?;
        self.offset = offset;
        self.chunk = None;
        self.part = Part::Data;
        Ok(())
    }

    fn seek(&mut self, offset: u64) -> Result<(), Error> {
        let sought = self.source.seek(SeekFrom::Start(offset));
        sought.map(drop).map_err(|source| self.io(source))
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
            let what = self.damage.as_deref().unwrap_or("the file is empty");
            return Err(self.bad(0, format!("{what}, expected an MCAP file")));
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
            match &self.damage {
                Some(damage) => {
                    format!("{damage} (`swath bridge recover` saves what comes before)")
                }
                None => format!(
                    "the file is cut off: {what} of {wanted} byte(s) expected, {left} left \
                     (`swath bridge recover` saves what is there)"
                ),
            },
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
            Ok(len) if len <= MOST_RECORD_BYTES => len,
            _ => {
                let what =
                    format!("a record of {body_len} bytes, expected at most {MOST_RECORD_BYTES}");
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
            if let Some(mut chunk) = self.chunk.take() {
                if let Some(message) = self.next_in_chunk(&mut chunk)? {
                    self.chunk = Some(chunk);
                    return Ok(Some(message));
                }
                if chunk.is_elsewhere {
                    self.seek(self.offset)?;
                }
            }
            let offset = self.offset;
            let (kind, body_len) = self.record_head()?;
            match (self.part, kind) {
                (Part::Data, op::SCHEMA | op::CHANNEL | op::MESSAGE) => {
                    self.load(body_len)?;
                    let taken = self.definitions.take(kind, &self.body, &*self.wanted);
                    match taken {
                        Ok(Some(found)) => {
                            let place = Place { offset, number: 0 };
                            return Ok(Some(found.at(place, &self.path)));
                        }
                        Ok(None) => {}
                        Err(what) => return Err(self.bad(offset, what)),
                    }
                }
                (Part::Data, op::CHUNK) => {
                    self.chunk = Some(self.open_chunk(offset, body_len)?);
                    self.offset = offset + 9 + body_len;
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

    /// Makes ready to take the records of the chunk at an offset, behind whose first bytes the source
    /// stands. Nothing is given of a chunk that does not match its checksum.
    fn open_chunk(&mut self, offset: u64, body_len: u64) -> Result<OpenChunk, Error> {
        let head_len = body_len.min(u64::try_from(MOST_CHUNK_HEAD_BYTES).unwrap_or(0));
        self.body.resize(usize::try_from(head_len).unwrap_or(0), 0);
        if let Err(source) = self.source.read_exact(&mut self.body) {
            return Err(self.io(source));
        }
        if self.body.len() < LEAST_CHUNK_HEAD_BYTES {
            let what = format!(
                "a chunk of {body_len} bytes, expected at least {LEAST_CHUNK_HEAD_BYTES}: its writer \
                 did not finish it (`swath bridge recover` saves what is there)"
            );
            return Err(self.bad(offset, what));
        }
        let head = ChunkHead::parse(&self.body)
            .and_then(|head| check_claims(&head).map(|()| head))
            .map_err(|what| self.bad(offset, what))?;
        if head.packed_len > body_len - head.head_len {
            let what = format!(
                "a chunk of {} byte(s) does not fit into the {} left of its record",
                head.packed_len,
                body_len - head.head_len
            );
            return Err(self.bad(offset, what));
        }
        if head.packed_len == 0 && body_len > head.head_len {
            let what = "a chunk whose size is not filled in: its writer did not finish it (`swath bridge \
                        recover` saves what is there)";
            return Err(self.bad(offset, what));
        }
        let records = offset + 9 + head.head_len;
        let read = u64::try_from(self.body.len()).unwrap_or(0);
        match open_whole(&mut self.source, &head, records, &mut self.body) {
            Ok(opened) => Ok(OpenChunk {
                // The source has to be put behind the chunk if it is not there already.
                is_elsewhere: opened.is_streamed || read.max(head.len()) != body_len,
                unpacker: opened.unpacker,
                offset,
                messages: 0,
            }),
            Err(broken) => Err(self.broken(offset, broken)),
        }
    }

    fn broken(&self, offset: u64, broken: Broken) -> Error {
        match broken {
            Broken::Io(source) => self.io(source),
            Broken::Damage(what) => self.bad(offset, what),
        }
    }

    fn next_in_chunk(&mut self, chunk: &mut OpenChunk) -> Result<Option<RawMessage>, Error> {
        loop {
            let kind = match chunk.unpacker.next(&mut self.source) {
                Ok(None) => return Ok(None),
                Ok(Some(kind)) => kind,
                Err(broken) => return Err(self.broken(chunk.offset, broken)),
            };
            let record = chunk.unpacker.record();
            let taken = self.definitions.take(kind, record, &*self.wanted);
            let place = Place {
                offset: chunk.offset,
                number: chunk.messages,
            };
            chunk.messages = chunk
                .messages
                .saturating_add(u32::from(kind == op::MESSAGE));
            match taken {
                Ok(None) => {}
                Ok(Some(found)) => return Ok(Some(found.at(place, &self.path))),
                Err(what) => return Err(self.bad(chunk.offset, what)),
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
