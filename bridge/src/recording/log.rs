//! A log as users have it: a file, a file that was compressed as a whole, or a rosbag2 folder whose
//! files are one log.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::chunk::MOST_RECORD_BYTES;
use super::definitions::DefinitionsByFile;
use super::message::RawMessage;
use super::metadata::{self, METADATA, MOST_FILES};
use super::reader::{Reader, Wanted};
use crate::Error;

/// The endings of the names of recordings.
const PLAIN: &str = ".mcap";
const PACKED: &str = ".mcap.zstd";

/// The files of a log, in their order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Log {
    path: PathBuf,
    files: Vec<PathBuf>,
    has_packed_messages: bool,
    warnings: Vec<String>,
}

impl Log {
    /// Finds the files of a log: the file itself, or those of a rosbag2 folder, which `metadata.yaml`
    /// names in their order. A folder without that file is taken to hold the files of one log, in the
    /// order of their names.
    ///
    /// # Errors
    /// [`Error::Io`] if it cannot be read, [`Error::BadFile`] if a file is missing or cannot be read
    /// for another reason, with what to do.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        if !path.is_dir() {
            return Ok(Self {
                path: path.to_owned(),
                files: vec![path.to_owned()],
                has_packed_messages: false,
                warnings: Vec::new(),
            });
        }
        let metadata = path.join(METADATA);
        if metadata.exists() {
            Self::of_metadata(path, &metadata)
        } else {
            Self::of_names(path)
        }
    }

    fn of_metadata(folder: &Path, path: &Path) -> Result<Self, Error> {
        let metadata = metadata::read(path)?;
        let mut files = Vec::with_capacity(metadata.files.len());
        for name in &metadata.files {
            let Some(file) = find(folder, name) else {
                return Err(Error::BadFile {
                    path: folder.join(name),
                    what: format!(
                        "is named by {}, but is not there: put it back, or give the other files one \
                         by one",
                        path.display()
                    ),
                });
            };
            files.push(file);
        }
        let mut warnings = Vec::new();
        for other in recordings_in(folder)? {
            if !files.iter().any(|file| is_same_file_name(file, &other)) {
                warnings.push(format!(
                    "{} is left out: {METADATA} does not name it",
                    other.display()
                ));
            }
        }
        Ok(Self {
            path: folder.to_owned(),
            files,
            has_packed_messages: metadata.has_packed_messages,
            warnings,
        })
    }

    fn of_names(folder: &Path) -> Result<Self, Error> {
        let mut found = recordings_in(folder)?;
        // A file that lies beside its compressed twin is one file.
        let plain: Vec<PathBuf> = found.clone();
        found.retain(|file| {
            !plain
                .iter()
                .any(|other| other != file && is_same_file_name(file, other) && !is_packed(other))
        });
        if found.is_empty() {
            return Err(Error::BadFile {
                path: folder.to_owned(),
                what: format!(
                    "a folder without {METADATA} and without a file *{PLAIN} or *{PACKED}, expected \
                     a recording"
                ),
            });
        }
        let mut warnings = Vec::new();
        if found.len() > 1 {
            warnings.push(format!(
                "{} has no {METADATA}: its {} files are taken for one log, in the order of their \
                 names",
                folder.display(),
                found.len()
            ));
        }
        Ok(Self {
            path: folder.to_owned(),
            files: found,
            has_packed_messages: false,
            warnings,
        })
    }

    /// The path as it was given.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The files, in their order.
    pub fn files(&self) -> &[PathBuf] {
        &self.files
    }

    /// What a reader of the log has to know.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// The messages of all files, one file after the other.
    ///
    /// # Errors
    /// As [`Reader::open`], for each of the files.
    pub fn reader(&self) -> Result<LogReader, Error> {
        let mut len_bytes = 0;
        let mut lens = Vec::with_capacity(self.files.len());
        for file in &self.files {
            // This also finds a file that cannot be read before the work begins.
            let len = Reader::open(file)?.len_bytes();
            lens.push(len);
            len_bytes += len;
        }
        Ok(LogReader {
            log: self.clone(),
            lens,
            len_bytes,
            done_bytes: 0,
            part: 0,
            reader: None,
            wanted: Arc::new(|_| true),
            definitions: DefinitionsByFile::new(),
            has_failed: false,
        })
    }

    /// The reader of one of the files, and its messages as [`LogReader`] gives them.
    pub(super) fn part(&self, part: u32, wanted: Wanted) -> Result<Reader, Error> {
        let none = || Error::BadFile {
            path: self.path.clone(),
            what: format!("has no file number {part}"),
        };
        let index = usize::try_from(part).unwrap_or(usize::MAX);
        let file = self.files.get(index).ok_or_else(none)?;
        Ok(Reader::open(file)?.with_wanted(wanted))
    }

    /// A message as the log means it.
    pub(super) fn finish(&self, mut message: RawMessage, part: u32) -> RawMessage {
        message.part = part;
        if self.has_packed_messages
            && let Some(payload) = unpacked(&message.payload)
        {
            message.payload = payload;
        }
        message
    }
}

/// What is in a message that was compressed by itself; `None` if that cannot be, which decoding it
/// then says.
fn unpacked(packed: &[u8]) -> Option<Vec<u8>> {
    let most = u64::try_from(MOST_RECORD_BYTES).unwrap_or(u64::MAX);
    let decoder = zstd::stream::read::Decoder::with_buffer(packed).ok()?;
    let mut payload = Vec::new();
    let read = decoder.take(most + 1).read_to_end(&mut payload).ok()?;
    (u64::try_from(read).unwrap_or(u64::MAX) <= most).then_some(payload)
}

/// The file that a folder's metadata mean by a name: in the folder, or beside it as older versions
/// name it, and packed or unpacked since.
fn find(folder: &Path, name: &str) -> Option<PathBuf> {
    let own = Path::new(name).file_name().map(Path::new);
    let names = [Some(Path::new(name)), own];
    for name in names.into_iter().flatten() {
        let plain = folder.join(name);
        let text = plain.to_string_lossy().into_owned();
        let mut candidates = vec![plain.clone(), PathBuf::from(format!("{text}.zstd"))];
        candidates.extend(text.strip_suffix(".zstd").map(PathBuf::from));
        if let Some(found) = candidates.into_iter().find(|path| path.is_file()) {
            return Some(found);
        }
    }
    None
}

fn is_packed(path: &Path) -> bool {
    path.to_string_lossy().ends_with(PACKED)
}

/// Whether two files have one name, but for being compressed.
fn is_same_file_name(a: &Path, b: &Path) -> bool {
    let bare = |path: &Path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.strip_suffix(".zstd").unwrap_or(&name).to_owned()
    };
    bare(a) == bare(b)
}

/// The recordings that lie in a folder, in the order of their names, whose numbers count as numbers.
fn recordings_in(folder: &Path) -> Result<Vec<PathBuf>, Error> {
    let io = |source| Error::Io {
        path: folder.to_owned(),
        source,
    };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        let name = path.to_string_lossy();
        if (name.ends_with(PLAIN) || name.ends_with(PACKED)) && path.is_file() {
            found.push(path);
        }
        if found.len() > MOST_FILES {
            return Err(Error::BadFile {
                path: folder.to_owned(),
                what: format!("more than {MOST_FILES} recordings"),
            });
        }
    }
    found.sort_by_cached_key(|path| name_key(&path.to_string_lossy()));
    Ok(found)
}

/// A name in parts: text as it is, numbers by their length without zeros in front, then their digits.
fn name_key(name: &str) -> Vec<(usize, String)> {
    let mut parts = Vec::new();
    let mut rest = name;
    while let Some(first) = rest.chars().next() {
        let is_number = first.is_ascii_digit();
        let end = rest
            .find(|character: char| character.is_ascii_digit() != is_number)
            .unwrap_or(rest.len());
        let (part, behind) = rest.split_at(end);
        parts.push(if is_number {
            let digits = part.trim_start_matches('0');
            (digits.len() + 1, digits.to_owned())
        } else {
            (0, part.to_owned())
        });
        rest = behind;
    }
    parts
}

/// The messages of a log in the order of its files. Nothing follows an error.
pub struct LogReader {
    log: Log,
    lens: Vec<u64>,
    len_bytes: u64,
    /// Bytes of the files that have been read to their end.
    done_bytes: u64,
    part: u32,
    reader: Option<Reader>,
    wanted: Wanted,
    definitions: DefinitionsByFile,
    has_failed: bool,
}

impl std::fmt::Debug for LogReader {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("LogReader")
            .field("log", &self.log)
            .field("part", &self.part)
            .finish_non_exhaustive()
    }
}

impl LogReader {
    /// Leaves out every message whose topic is not wanted.
    #[must_use]
    pub fn with_topics(mut self, wanted: impl Fn(&str) -> bool + Send + Sync + 'static) -> Self {
        self.wanted = Arc::new(wanted);
        self
    }

    /// Size of all files in bytes.
    pub const fn len_bytes(&self) -> u64 {
        self.len_bytes
    }

    /// How far the files have been read, in bytes.
    pub fn position_bytes(&self) -> u64 {
        let within = self.reader.as_ref().map_or(0, Reader::position_bytes);
        self.done_bytes + within
    }

    /// What has been learnt of the topics of each file that was read to its end.
    pub(crate) fn into_definitions(self) -> DefinitionsByFile {
        self.definitions
    }

    fn next_message(&mut self) -> Result<Option<RawMessage>, Error> {
        while let Some(len) = self
            .lens
            .get(usize::try_from(self.part).unwrap_or(usize::MAX))
        {
            if self.reader.is_none() {
                self.reader = Some(self.log.part(self.part, Arc::clone(&self.wanted))?);
            }
            if let Some(message) = self.reader.as_mut().and_then(Iterator::next) {
                return Ok(Some(self.log.finish(message?, self.part)));
            }
            self.done_bytes += len;
            if let Some(reader) = self.reader.take() {
                self.definitions
                    .insert(self.part, reader.into_definitions());
            }
            self.part += 1;
        }
        Ok(None)
    }
}

impl Iterator for LogReader {
    type Item = Result<RawMessage, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.has_failed {
            return None;
        }
        let message = self.next_message();
        self.has_failed = message.is_err();
        message.transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names_count_as_numbers() {
        let mut names = ["b_10.mcap", "b_9.mcap", "b_0.mcap", "b_1.mcap", "a_2.mcap"];
        names.sort_by_cached_key(|name| name_key(name));
        assert_eq!(
            names,
            ["a_2.mcap", "b_0.mcap", "b_1.mcap", "b_9.mcap", "b_10.mcap"]
        );
    }
}
