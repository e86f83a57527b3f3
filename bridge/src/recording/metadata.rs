//! `metadata.yaml` of a rosbag2 folder: the files of a log and how they are packed.

use std::path::Path;

use saphyr::{LoadableYamlNode, Yaml};

use crate::Error;

/// Name of the file.
pub(super) const METADATA: &str = "metadata.yaml";
/// Most bytes that it may have.
const MOST_BYTES: u64 = 16 * 1024 * 1024;
/// Most files of a log.
pub(super) const MOST_FILES: usize = 10_000;

/// What `metadata.yaml` says of a log.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(super) struct Metadata {
    /// The files in their order, as they are named.
    pub(super) files: Vec<String>,
    /// Whether each message is compressed with zstd by itself.
    pub(super) has_packed_messages: bool,
}

/// Reads it.
///
/// # Errors
/// [`Error::Io`] if it cannot be read, [`Error::BadFile`] if it is none or names a way of storing that
/// cannot be read.
pub(super) fn read(path: &Path) -> Result<Metadata, Error> {
    let io = |source| Error::Io {
        path: path.to_owned(),
        source,
    };
    let bad = |what: String| Error::BadFile {
        path: path.to_owned(),
        what,
    };
    let bytes = std::fs::metadata(path).map_err(io)?.len();
    if bytes > MOST_BYTES {
        return Err(bad(format!("{bytes} bytes, expected at most {MOST_BYTES}")));
    }
    let text = std::fs::read(path).map_err(io)?;
    let text = String::from_utf8(text).map_err(|error| bad(format!("not UTF-8: {error}")))?;
    parse(&text).map_err(bad)
}

fn parse(text: &str) -> Result<Metadata, String> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let documents = Yaml::load_from_str(text).map_err(|error| format!("not YAML: {error}"))?;
    let root = documents.first().ok_or("empty, expected YAML")?;
    let bag = root
        .as_mapping_get("rosbag2_bagfile_information")
        .ok_or("no \"rosbag2_bagfile_information\", expected the metadata of a rosbag2 folder")?;
    let word = |key: &str| {
        bag.as_mapping_get(key)
            .and_then(Yaml::as_str)
            .unwrap_or_default()
            .to_lowercase()
    };
    let storage = word("storage_identifier");
    if storage != "mcap" {
        return Err(format!(
            "storage_identifier is {storage:?}, expected \"mcap\": convert the log with `ros2 bag \
             convert`"
        ));
    }
    let (mode, format) = (word("compression_mode"), word("compression_format"));
    let has_packed_messages = match mode.as_str() {
        "" | "none" | "file" => false,
        "message" => true,
        other => {
            return Err(format!(
                "compression_mode is {other:?}, expected \"\", \"FILE\" or \"MESSAGE\""
            ));
        }
    };
    if !matches!(mode.as_str(), "" | "none") && format != "zstd" {
        return Err(format!(
            "compression_format is {format:?}, expected \"zstd\": convert the log with `ros2 bag \
             convert`"
        ));
    }
    Ok(Metadata {
        files: files_of(bag)?,
        has_packed_messages,
    })
}

fn files_of(bag: &Yaml<'_>) -> Result<Vec<String>, String> {
    let listed = bag
        .as_mapping_get("relative_file_paths")
        .and_then(Yaml::as_sequence)
        .filter(|listed| !listed.is_empty())
        .ok_or("no \"relative_file_paths\", expected the names of the log's files")?;
    if listed.len() > MOST_FILES {
        return Err(format!(
            "{} files, expected at most {MOST_FILES}",
            listed.len()
        ));
    }
    let mut files: Vec<String> = Vec::with_capacity(listed.len());
    for (number, name) in listed.iter().enumerate() {
        let name = name
            .as_str()
            .filter(|name| !name.is_empty())
            .ok_or_else(|| format!("relative_file_paths: entry {number} is no name of a file"))?;
        // A file that is named twice is one file.
        if !files.iter().any(|known| known == name) {
            files.push(name.to_owned());
        }
    }
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(mode: &str, format: &str, storage: &str) -> String {
        format!(
            "rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: {storage}\n  \
             compression_format: {format}\n  compression_mode: {mode}\n  relative_file_paths:\n    \
             - a_0.mcap\n    - \"a_1.mcap\"\n    - a_0.mcap\n"
        )
    }

    #[test]
    fn files_are_named_in_their_order_and_once() {
        let metadata = parse(&text("\"\"", "\"\"", "mcap")).unwrap();
        assert_eq!(metadata.files, ["a_0.mcap", "a_1.mcap"]);
        assert!(!metadata.has_packed_messages);
        let packed = parse(&text("MESSAGE", "zstd", "mcap")).unwrap();
        assert!(packed.has_packed_messages);
        assert!(
            !parse(&text("FILE", "zstd", "mcap"))
                .unwrap()
                .has_packed_messages
        );
    }

    #[test]
    fn what_cannot_be_read_is_refused_with_the_key() {
        for (text, said) in [
            (text("FILE", "fake_comp", "mcap"), "compression_format"),
            (text("CHUNK", "zstd", "mcap"), "compression_mode"),
            (text("\"\"", "\"\"", "sqlite3"), "storage_identifier"),
            ("a: [1".to_owned(), "not YAML"),
            (String::new(), "empty"),
            ("a: 1".to_owned(), "rosbag2_bagfile_information"),
            (
                "rosbag2_bagfile_information:\n  storage_identifier: mcap\n".to_owned(),
                "relative_file_paths",
            ),
        ] {
            let error = parse(&text).unwrap_err();
            assert!(error.contains(said), "{error}");
        }
    }
}
