//! Lists of poses as text: goals and references, one `x y yaw` a line in metres and radians.

use std::path::Path;

use crate::Error;
use crate::geometry::Pose2;
use crate::map::read_limited;

/// Most poses that a file may hold.
pub const MAX_POSES: usize = 100_000;
/// Most bytes that a file may have.
const MAX_FILE_BYTES: u64 = 16 * 1024 * 1024;
/// Largest coordinate, metres.
const MAX_COORDINATE_M: f64 = 1e6;

/// Reads the poses of a file. Empty lines and what follows a `#` are passed over.
///
/// # Errors
/// [`Error::Io`] and [`Error::BadFile`] name the file, the line and what was expected there.
pub fn read_poses(path: &Path) -> Result<Vec<Pose2>, Error> {
    let bytes = read_limited(path, MAX_FILE_BYTES)?;
    let text = std::str::from_utf8(&bytes).map_err(|error| Error::BadFile {
        path: path.to_owned(),
        what: format!("byte {}: not UTF-8 text", error.valid_up_to()),
    })?;
    parse_poses(text, path)
}

/// The poses of a file's text; `path` is for errors only.
///
/// # Errors
/// [`Error::BadFile`] names the line and what was expected there.
pub fn parse_poses(text: &str, path: &Path) -> Result<Vec<Pose2>, Error> {
    let mut poses = Vec::new();
    let text = text.trim_start_matches('\u{feff}');
    for (number, line) in (1..).zip(text.lines()) {
        let content = line.split('#').next().unwrap_or_default().trim();
        if content.is_empty() {
            continue;
        }
        let bad = |what: String| Error::BadFile {
            path: path.to_owned(),
            what: format!("line {number}: {what}"),
        };
        if poses.len() == MAX_POSES {
            return Err(bad(format!("expected at most {MAX_POSES} poses")));
        }
        poses.push(pose_of(content).ok_or_else(|| {
            bad(format!(
                "found {:?}, expected \"x y yaw\" in metres and radians",
                shortened(content)
            ))
        })?);
    }
    Ok(poses)
}

/// The text of a file that holds these poses.
pub fn format_poses(poses: &[Pose2]) -> String {
    let header = "# x y yaw: metres and radians, vehicle frame\n".to_owned();
    let lines = poses
        .iter()
        .map(|pose| format!("{} {} {}\n", pose.x_m, pose.y_m, pose.yaw_rad));
    std::iter::once(header).chain(lines).collect()
}

fn pose_of(content: &str) -> Option<Pose2> {
    let mut numbers = content
        .split(|character: char| character.is_whitespace() || character == ',')
        .filter(|part| !part.is_empty())
        .map(|part| {
            part.parse::<f64>()
                .ok()
                .filter(|number| number.abs() <= MAX_COORDINATE_M)
        });
    let pose = Pose2::new(numbers.next()??, numbers.next()??, numbers.next()??);
    numbers.next().is_none().then_some(pose)
}

fn shortened(content: &str) -> String {
    content.chars().take(60).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn parse(text: &str) -> Result<Vec<Pose2>, Error> {
        parse_poses(text, Path::new("goals.txt"))
    }

    #[test]
    fn comments_commas_and_empty_lines_are_passed_over() {
        let poses = parse("# goals\n\n 1 -2.5 0.1 # first\r\n3,4,5e-1\n").unwrap();
        assert_eq!(
            poses,
            [Pose2::new(1.0, -2.5, 0.1), Pose2::new(3.0, 4.0, 0.5)]
        );
        assert_eq!(parse("").unwrap(), []);
        assert_eq!(parse("\u{feff}0 0 0\n").unwrap(), [Pose2::default()]);
    }

    #[test]
    fn errors_name_file_and_line() {
        for bad in [
            "1 2",
            "1 2 3 4",
            "1 2 x",
            "1 2 nan",
            "inf 0 0",
            "1e300 0 0",
            "\u{0}",
        ] {
            let error = parse(&format!("0 0 0\n{bad}\n")).unwrap_err().to_string();
            assert!(error.contains("goals.txt: line 2"), "{error}");
        }
    }

    #[test]
    fn a_file_that_is_not_text_is_an_error() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("goals.txt");
        std::fs::write(&path, b"1 2 3\n\xff\xfe").unwrap();
        let error = read_poses(&path).unwrap_err().to_string();
        assert!(error.contains("byte 6: not UTF-8"), "{error}");
    }

    proptest! {
        #[test]
        fn poses_are_read_back(
            numbers in proptest::collection::vec((-1e6..1e6f64, -1e6..1e6f64, -4.0..4.0f64), 0..20),
        ) {
            let poses: Vec<Pose2> = numbers.iter().map(|(x, y, yaw)| Pose2::new(*x, *y, *yaw)).collect();
            prop_assert_eq!(parse(&format_poses(&poses)).unwrap(), poses);
        }

        #[test]
        fn no_text_panics(text in "\\PC{0,60}") {
            let _either_way = parse(&text);
        }
    }
}
