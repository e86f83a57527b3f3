//! The messages of a log in another order than that of its files, in bounded memory.
//!
//! An index says where each message is. The messages that come next in the wanted order and fit into a
//! window are read together, each chunk once. So a log that is nearly in order is read about once, and
//! one that is in no order at all as often as it has windows.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use super::definitions::DefinitionsByFile;
use super::log::Log;
use super::message::RawMessage;
use super::reader::{Reader, Wanted};
use crate::Error;

/// Most messages of a log that is not in order.
pub(crate) const MOST_INDEXED: usize = 16_000_000;
/// Most bytes of messages that are read together.
const WINDOW_BYTES: u64 = 32 * 1024 * 1024;
/// Most messages that are read together.
const WINDOW_MESSAGES: usize = 65_536;
/// Most files that are open at a time.
const MOST_OPEN: usize = 16;

/// Where messages are, and in which order they are wanted.
#[derive(Debug, Default)]
pub(crate) struct Index {
    /// Files and offsets at which messages, or the chunks that hold them, begin.
    blocks: Vec<Block>,
    entries: Vec<Entry>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Block {
    part: u32,
    offset: u64,
}

/// A message of an index.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Entry {
    /// What the message is ordered by; between equal ones, the order of the files.
    pub(crate) key: u64,
    block: u32,
    number: u32,
    bytes: u32,
}

impl Entry {
    /// The same message with another key.
    pub(crate) const fn with_key(self, key: u64) -> Self {
        Self { key, ..self }
    }

    /// The message's place in the files, for ties.
    pub(crate) const fn place(&self) -> (u32, u32) {
        (self.block, self.number)
    }
}

impl Index {
    /// The entry of a message, which may be added with a key; `None` if there are too many.
    ///
    /// Messages come in the order of the files.
    pub(crate) fn entry(&mut self, message: &RawMessage, key: u64) -> Option<Entry> {
        let block = Block {
            part: message.part,
            offset: message.offset,
        };
        if self.blocks.last() != Some(&block) {
            if self.blocks.len() >= MOST_INDEXED {
                return None;
            }
            self.blocks.push(block);
        }
        Some(Entry {
            key,
            block: u32::try_from(self.blocks.len() - 1).ok()?,
            number: message.number,
            bytes: u32::try_from(message.payload.len()).unwrap_or(u32::MAX),
        })
    }

    /// Adds an entry; false if there are too many.
    pub(crate) fn push(&mut self, entry: Entry) -> bool {
        let has_room = self.entries.len() < MOST_INDEXED;
        if has_room {
            self.entries.push(entry);
        }
        has_room
    }

    /// Puts the entries in the order of their keys and leaves out those that are not wanted.
    pub(crate) fn sort(&mut self, wanted: impl Fn(&Entry) -> bool) {
        self.entries.retain(wanted);
        self.entries
            .sort_by_key(|entry| (entry.key, entry.block, entry.number));
    }

    /// Bytes of all messages.
    pub(crate) fn bytes(&self) -> u64 {
        self.entries
            .iter()
            .map(|entry| u64::from(entry.bytes))
            .sum()
    }
}

/// Reads the messages of a log in the order of an index. Nothing follows an error.
pub(crate) struct OrderedReader {
    log: Log,
    index: Index,
    definitions: DefinitionsByFile,
    readers: BTreeMap<u32, Reader>,
    wanted: Wanted,
    next: usize,
    window: VecDeque<(u64, RawMessage)>,
}

impl std::fmt::Debug for OrderedReader {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("OrderedReader")
            .field("log", &self.log)
            .field("next", &self.next)
            .finish_non_exhaustive()
    }
}

impl OrderedReader {
    /// `definitions` are those of the reader that the index was made with; `wanted` are the topics of
    /// all messages in the index.
    pub(crate) fn new(
        log: Log,
        index: Index,
        definitions: DefinitionsByFile,
        wanted: impl Fn(&str) -> bool + Send + Sync + 'static,
    ) -> Self {
        Self {
            log,
            index,
            definitions,
            wanted: Arc::new(wanted),
            readers: BTreeMap::new(),
            next: 0,
            window: VecDeque::new(),
        }
    }

    /// Begins again.
    pub(crate) fn rewind(&mut self) {
        self.next = 0;
        self.window.clear();
    }

    /// The next messages with their keys, as many as fit into a window; empty behind the last one.
    ///
    /// # Errors
    /// As [`Reader`].
    pub(crate) fn next_window(&mut self) -> Result<Vec<(u64, RawMessage)>, Error> {
        let begin = self.next;
        let mut bytes = 0;
        while let Some(entry) = self.index.entries.get(self.next) {
            bytes += u64::from(entry.bytes);
            let count = self.next - begin;
            if count > 0 && (bytes > WINDOW_BYTES || count >= WINDOW_MESSAGES) {
                break;
            }
            self.next += 1;
        }
        // By their places in the files; each knows its place in the window.
        let entries = &self.index.entries[begin..self.next];
        let mut places: Vec<usize> = (0..entries.len()).collect();
        places.sort_by_key(|place| (entries[*place].block, entries[*place].number));
        let entries = entries.to_vec();
        let mut found: Vec<Option<RawMessage>> = vec![None; entries.len()];
        for of_block in places.chunk_by(|a, b| entries[*a].block == entries[*b].block) {
            self.read_block(of_block, &entries, &mut found)?;
        }
        let keys = entries.iter().map(|entry| entry.key);
        Ok(keys.zip(found.into_iter().flatten()).collect())
    }

    fn read_block(
        &mut self,
        places: &[usize],
        entries: &[Entry],
        found: &mut [Option<RawMessage>],
    ) -> Result<(), Error> {
        let Some(block) = places
            .first()
            .and_then(|place| self.index.blocks.get(entries[*place].block as usize))
            .copied()
        else {
            return Ok(());
        };
        self.open(block.part)?;
        let Some(reader) = self.readers.get_mut(&block.part) else {
            return Ok(());
        };
        reader.go_to(block.offset)?;
        for place in places {
            let wanted = entries[*place].number;
            let message = loop {
                match reader.next().transpose()? {
                    Some(message) if message.offset == block.offset && message.number == wanted => {
                        break message;
                    }
                    Some(message) if message.offset == block.offset => {}
                    // The file is not the one any more that the index was made of.
                    _ => {
                        return Err(Error::BadFile {
                            path: self.log.path().to_owned(),
                            what: "has changed while it was read".to_owned(),
                        });
                    }
                }
            };
            found[*place] = Some(self.log.finish(message, block.part));
        }
        Ok(())
    }

    fn open(&mut self, part: u32) -> Result<(), Error> {
        if self.readers.contains_key(&part) {
            return Ok(());
        }
        if self.readers.len() >= MOST_OPEN {
            self.readers.clear();
        }
        let definitions = self.definitions.get(&part).cloned().unwrap_or_default();
        let reader = self.log.part(part, Arc::clone(&self.wanted))?;
        self.readers
            .insert(part, reader.with_definitions(definitions));
        Ok(())
    }
}

impl Iterator for OrderedReader {
    type Item = Result<(u64, RawMessage), Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.window.is_empty() {
            match self.next_window() {
                Ok(window) => self.window = window.into(),
                Err(error) => {
                    self.next = self.index.entries.len();
                    return Some(Err(error));
                }
            }
        }
        self.window.pop_front().map(Ok)
    }
}
