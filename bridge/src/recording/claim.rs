//! Creating the file of a recording, so that none is overwritten by mistake and none has two writers.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, SeekFrom};
use std::path::Path;

use super::record::MAGIC;
use crate::Error;

/// What becomes of a file that is there already.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Existing {
    /// It stays as it is, and the new recording is refused.
    #[default]
    Refuse,
    /// It is removed, unless somebody writes it right now.
    Replace,
}

impl Existing {
    /// What a switch `--force` means.
    pub const fn of_force(is_forced: bool) -> Self {
        if is_forced {
            Self::Replace
        } else {
            Self::Refuse
        }
    }
}

/// Checks that a recording can be created, before the work for it begins. The file may still come up
/// meanwhile, which creating it then finds.
///
/// # Errors
/// [`Error::Exists`] with what to do, [`Error::Io`] for a folder.
pub fn check_out(path: impl AsRef<Path>, existing: Existing) -> Result<(), Error> {
    let path = path.as_ref();
    if std::fs::symlink_metadata(path).is_err() || is_device(path) {
        return Ok(());
    }
    match state_of(path)? {
        State::InUse => Err(exists(path, State::InUse)),
        _ if existing == Existing::Replace => Ok(()),
        state => Err(exists(path, state)),
    }
}

/// Creates the file and locks it for as long as it is open.
pub(super) fn create(path: &Path, existing: Existing) -> Result<File, Error> {
    let io = |source| Error::Io {
        path: path.to_owned(),
        source,
    };
    if is_device(path) {
        return OpenOptions::new().write(true).open(path).map_err(io);
    }
    if existing == Existing::Replace && std::fs::symlink_metadata(path).is_ok() {
        check_out(path, existing)?;
        // Another file takes its place, so that whoever has the old one open keeps it as it is.
        match std::fs::remove_file(path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(io(error)),
            _ => {}
        }
    }
    match OpenOptions::new().write(true).create_new(true).open(path) {
        Ok(file) => {
            // Some file systems have no locks; there the name alone has to do.
            let _ = file.lock();
            Ok(file)
        }
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
            Err(exists(path, state_of(path)?))
        }
        Err(error) => Err(io(error)),
    }
}

/// Whether writing there overwrites nothing.
fn is_device(path: &Path) -> bool {
    std::fs::metadata(path).is_ok_and(|found| !found.is_file() && !found.is_dir())
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    InUse,
    Unfinished,
    Other,
}

fn state_of(path: &Path) -> Result<State, Error> {
    let io = |source| Error::Io {
        path: path.to_owned(),
        source,
    };
    if path.is_dir() {
        return Err(io(io::ErrorKind::IsADirectory.into()));
    }
    let Ok(mut file) = File::open(path) else {
        // A link that leads nowhere, or a file that may not be read.
        return Ok(State::Other);
    };
    if matches!(file.try_lock(), Err(TryLockError::WouldBlock)) {
        return Ok(State::InUse);
    }
    Ok(if is_unfinished(&mut file).unwrap_or(false) {
        State::Unfinished
    } else {
        State::Other
    })
}

/// Whether a file begins like a recording, but does not end like one.
fn is_unfinished(file: &mut File) -> io::Result<bool> {
    let mut mark = [0; MAGIC.len()];
    file.read_exact(&mut mark)?;
    if mark != MAGIC {
        return Ok(false);
    }
    file.seek(SeekFrom::End(-8))?;
    file.read_exact(&mut mark)?;
    Ok(mark != MAGIC || file.stream_position()? < 16)
}

fn exists(path: &Path, state: State) -> Error {
    let shown = path.display();
    Error::Exists {
        path: path.to_owned(),
        what: match state {
            State::InUse => "another process is writing it right now: give another name".to_owned(),
            State::Unfinished => format!(
                "it is a recording that was not finished: `swath bridge recover {shown} --out OTHER` \
                 saves its messages; give another name, or --force to replace it"
            ),
            State::Other => "give another name, or --force to replace it".to_owned(),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::Writer;
    use tempfile::TempDir;

    fn said(result: Result<impl std::fmt::Debug, Error>) -> String {
        result.unwrap_err().to_string()
    }

    #[test]
    fn a_file_that_is_there_stays_as_it_is() {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("a.mcap");
        std::fs::write(&path, b"mine").unwrap();
        let error = said(Writer::create(&path));
        assert!(
            error.contains("a.mcap") && error.contains("--force"),
            "{error}"
        );
        assert!(!error.contains("recover"), "{error}");
        assert_eq!(said(check_out(&path, Existing::Refuse)), error);
        assert_eq!(std::fs::read(&path).unwrap(), b"mine");
        check_out(&path, Existing::Replace).unwrap();
        Writer::create_with(&path, Existing::Replace)
            .unwrap()
            .finish()
            .unwrap();
        assert_eq!(std::fs::read(&path).unwrap()[..8], MAGIC);
        assert!(!said(Writer::create(&path)).contains("recover"));
        assert!(said(Writer::create(folder.path())).contains("directory"));
    }

    #[test]
    fn an_unfinished_recording_names_what_saves_it() {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("a.mcap");
        let writer = Writer::create(&path).unwrap();
        drop(writer);
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() - 3]).unwrap();
        let error = said(Writer::create(&path));
        assert!(
            error.contains("swath bridge recover") && error.contains("--force"),
            "{error}"
        );
    }

    #[test]
    fn a_recording_has_one_writer_even_where_it_may_be_replaced() {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("a.mcap");
        let first = Writer::create(&path).unwrap();
        for existing in [Existing::Refuse, Existing::Replace] {
            let error = said(Writer::create_with(&path, existing));
            assert!(error.contains("another process"), "{error}");
            assert!(!error.contains("--force"), "{error}");
        }
        first.finish().unwrap();
        Writer::create_with(&path, Existing::Replace).unwrap();
    }

    #[test]
    #[cfg(unix)]
    fn links_are_replaced_and_devices_are_written_to() {
        let folder = TempDir::new().unwrap();
        let [target, link] = ["a", "b"].map(|name| folder.path().join(name));
        std::os::unix::fs::symlink(&target, &link).unwrap();
        assert!(said(Writer::create(&link)).contains("--force"));
        std::fs::write(&target, b"mine").unwrap();
        Writer::create_with(&link, Existing::Replace)
            .unwrap()
            .finish()
            .unwrap();
        assert_eq!(std::fs::read(&target).unwrap(), b"mine");
        Writer::create("/dev/null").unwrap().finish().unwrap();
    }
}
