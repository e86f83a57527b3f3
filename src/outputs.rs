//! Whether results can be written where they are wanted: asked before the work begins, so that an
//! hour's work does not end with a missing folder.

use std::fs::{self, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

/// Tests that files can be written into a folder. It is made later if it is missing, and so is what
/// is missing above it.
///
/// # Errors
/// Names the folder, and why nothing can be written there.
pub(crate) fn test_folder(path: &Path) -> anyhow::Result<()> {
    let there = nearest_existing(path);
    let found = fs::metadata(&there).with_context(|| named(&there))?;
    if !found.is_dir() {
        bail!(
            "{}: nothing can be written there, because {} is not a folder",
            path.display(),
            there.display()
        );
    }
    try_a_file(&there).with_context(|| format!("{}: nothing can be written there", path.display()))
}

/// Tests that a file can be written, and makes the folder that it is to be in.
///
/// # Errors
/// Names the file, and why it cannot be written.
pub(crate) fn test_file(path: &Path) -> anyhow::Result<()> {
    match fs::metadata(path) {
        Ok(found) if found.is_dir() => {
            bail!("{}: it is a folder, expected a file", path.display())
        }
        // A pipe or a device is opened once only, by who writes to it.
        Ok(found) if found.is_file() => {
            let opened = OpenOptions::new().append(true).open(path);
            opened.map(drop).with_context(|| named(path))
        }
        Ok(_) => Ok(()),
        Err(_missing) => {
            let folder = match path.parent() {
                Some(folder) if !folder.as_os_str().is_empty() => folder,
                _ => Path::new("."),
            };
            test_folder(folder)?;
            fs::create_dir_all(folder).with_context(|| named(folder))?;
            // The name itself may not do: too long, or with a slash at its end.
            let made = OpenOptions::new().write(true).create_new(true).open(path);
            made.and_then(|_| fs::remove_file(path))
                .with_context(|| named(path))
        }
    }
}

fn named(path: &Path) -> String {
    path.display().to_string()
}

/// The path itself, or the nearest folder above it that is there.
fn nearest_existing(path: &Path) -> PathBuf {
    let mut above = path.ancestors();
    above
        .find(|path| !path.as_os_str().is_empty() && path.symlink_metadata().is_ok())
        .map_or_else(|| PathBuf::from("."), Path::to_owned)
}

/// Makes a file in a folder and takes it away again.
fn try_a_file(folder: &Path) -> io::Result<()> {
    let probe = folder.join(format!(".swath-write-test-{}", std::process::id()));
    OpenOptions::new()
        .write(true)
        .create_new(true)
        .open(&probe)?;
    fs::remove_file(probe)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn entries(folder: &Path) -> usize {
        fs::read_dir(folder).unwrap().count()
    }

    #[test]
    fn testing_a_folder_makes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        test_folder(folder.path()).unwrap();
        test_folder(&folder.path().join("a/b/c")).unwrap();
        assert_eq!(entries(folder.path()), 0);
    }

    #[test]
    fn testing_a_file_makes_its_folder_and_keeps_what_is_there() {
        let folder = tempfile::tempdir().unwrap();
        let new = folder.path().join("a/b/new.mcap");
        test_file(&new).unwrap();
        assert!(new.parent().unwrap().is_dir() && !new.exists());
        let old = folder.path().join("old.mcap");
        fs::write(&old, "kept").unwrap();
        test_file(&old).unwrap();
        assert_eq!(fs::read(&old).unwrap(), b"kept");
        test_file(Path::new("/dev/null")).unwrap();
    }

    #[test]
    fn what_is_in_the_way_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        for below in [file.join("out"), file.join("a/b")] {
            for tested in [test_folder(&below), test_file(&below)] {
                let said = format!("{:#}", tested.unwrap_err());
                assert!(said.contains(&file.display().to_string()), "{said}");
                assert!(said.contains("not a folder"), "{said}");
            }
        }
        let said = test_folder(&file).unwrap_err().to_string();
        assert!(said.contains("not a folder"), "{said}");
        let said = test_file(folder.path()).unwrap_err().to_string();
        assert!(said.contains("it is a folder"), "{said}");
        let long = folder.path().join("x".repeat(300));
        let said = format!("{:#}", test_file(&long).unwrap_err());
        assert!(said.contains("xxx"), "{said}");
    }
}
