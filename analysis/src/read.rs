//! Recordings into tables, message by message.

use std::path::{Path, PathBuf};

use swath_bridge::recording::Reader;

use crate::tables::{Record, Tables, TablesBuilder};
use crate::{Error, ReportOptions};

/// Messages between two words on progress.
const MESSAGES_PER_PROGRESS: u64 = 256;

/// How far the reading of the recordings is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress<'a> {
    /// The recording that is being read.
    pub path: &'a Path,
    /// Bytes read, of all recordings together.
    pub read_bytes: u64,
    /// Bytes of all recordings together.
    pub total_bytes: u64,
    /// Messages read, of all recordings together.
    pub messages: u64,
}

/// Reads every recording; the payload of one message at a time is in memory.
///
/// # Errors
/// [`Error::NoRecordings`], [`Error::Recording`] if one cannot be read, [`Error::NoSwathTopics`] if
/// one holds nothing of swath's, [`Error::TooManyRows`].
pub(crate) fn read(
    recordings: &[PathBuf],
    options: &ReportOptions,
    mut progress: impl FnMut(&Progress<'_>),
) -> Result<Tables, Error> {
    if recordings.is_empty() {
        return Err(Error::NoRecordings);
    }
    let mut total_bytes = 0;
    for path in recordings {
        total_bytes += Reader::open(path)?.len_bytes();
    }
    let mut builder = TablesBuilder::new(options);
    let (mut read_bytes, mut messages) = (0, 0);
    for (recording, path) in (0..).zip(recordings) {
        let mut reader = Reader::open(path)?;
        while let Some(message) = reader.next() {
            builder.push(&Record {
                recording,
                message: &message?,
            })?;
            messages += 1;
            if messages % MESSAGES_PER_PROGRESS == 0 {
                progress(&Progress {
                    path,
                    read_bytes: read_bytes + reader.position_bytes(),
                    total_bytes,
                    messages,
                });
            }
        }
        read_bytes += reader.len_bytes();
        progress(&Progress {
            path,
            read_bytes,
            total_bytes,
            messages,
        });
        builder
            .swath_topics(recording)
            .map_err(|found| Error::NoSwathTopics {
                path: path.clone(),
                messages: builder.messages(recording),
                found,
            })?;
    }
    builder.finish()
}
