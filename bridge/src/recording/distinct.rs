//! Finding recordings that were given twice, under whatever names.

use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::source::Source;
use crate::Error;

/// Bytes that are compared at a time.
const BLOCK_BYTES: usize = 256 * 1024;

/// Recordings, each once.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Distinct {
    /// The recordings, in the order in which they were given.
    pub files: Vec<PathBuf>,
    /// Those that hold the same as an earlier one, with the earlier one.
    pub repeated: Vec<(PathBuf, PathBuf)>,
}

/// Leaves out recordings that are the same file as an earlier one, through another path or a link, or
/// that have the same content.
///
/// # Errors
/// As [`Reader::open`](super::Reader::open).
pub fn distinct(paths: &[PathBuf]) -> Result<Distinct, Error> {
    let mut found = Distinct::default();
    let mut known: Vec<(PathBuf, u64)> = Vec::new();
    for path in paths {
        let len = opened(path)?.1;
        let mut twin = None;
        for (other, other_len) in &known {
            if *other_len == len && is_same(path, other)? {
                twin = Some(other.clone());
                break;
            }
        }
        if let Some(twin) = twin {
            found.repeated.push((path.clone(), twin));
        } else {
            known.push((path.clone(), len));
            found.files.push(path.clone());
        }
    }
    Ok(found)
}

fn opened(path: &Path) -> Result<(Source, u64), Error> {
    let mut source = Source::open(path)?;
    let sought = source
        .seek(SeekFrom::End(0))
        .and_then(|len| source.rewind().map(|()| len));
    match sought {
        Ok(len) => Ok((source, len)),
        Err(source) => Err(io_error(path, source)),
    }
}

fn io_error(path: &Path, source: std::io::Error) -> Error {
    Error::Io {
        path: path.to_owned(),
        source,
    }
}

fn is_same(a: &Path, b: &Path) -> Result<bool, Error> {
    if let (Ok(a), Ok(b)) = (a.canonicalize(), b.canonicalize())
        && a == b
    {
        return Ok(true);
    }
    let (mut in_a, len) = opened(a)?;
    let mut in_b = opened(b)?.0;
    let mut left = len;
    let [mut block_a, mut block_b] = [vec![0; BLOCK_BYTES], vec![0; BLOCK_BYTES]];
    while left > 0 {
        let count = BLOCK_BYTES.min(usize::try_from(left).unwrap_or(BLOCK_BYTES));
        let (part_a, part_b) = (&mut block_a[..count], &mut block_b[..count]);
        in_a.read_exact(part_a)
            .map_err(|error| io_error(a, error))?;
        in_b.read_exact(part_b)
            .map_err(|error| io_error(b, error))?;
        if part_a != part_b {
            return Ok(false);
        }
        left -= u64::try_from(count).unwrap_or(left);
    }
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use tempfile::TempDir;

    #[test]
    fn the_same_recording_under_other_names_is_found() {
        let folder = TempDir::new().unwrap();
        let path = |name: &str| folder.path().join(name);
        let content = vec![7; 3 * BLOCK_BYTES + 5];
        let mut other = content.clone();
        other[2 * BLOCK_BYTES] = 8;
        std::fs::write(path("a"), &content).unwrap();
        std::fs::write(path("copy"), &content).unwrap();
        std::fs::write(path("other"), &other).unwrap();
        let packed = zstd::encode_all(&content[..], 1).unwrap();
        std::fs::write(path("a.zstd"), packed).unwrap();
        std::fs::create_dir(path("folder")).unwrap();
        let round = path("folder").join("..").join("a");
        let given = ["a", "other", "copy", "a.zstd"].map(path);
        let given = [&given[..], &[round]].concat();
        let found = distinct(&given).unwrap();
        assert_eq!(found.files, [path("a"), path("other")]);
        assert_eq!(found.repeated.len(), 3);
        assert!(found.repeated.iter().all(|(_, first)| *first == path("a")));
        assert!(
            distinct(&[path("none")])
                .unwrap_err()
                .to_string()
                .contains("none")
        );
    }
}
