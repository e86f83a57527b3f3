//! The flat YAML file that ROS `map_server` puts beside a picture.

use std::fmt;
use std::path::Path;

use crate::Error;
use crate::occupancy::{FREE, OCCUPIED, UNKNOWN};

/// How grey becomes occupancy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Mode {
    /// Free, occupied or unknown, by the two thresholds.
    #[default]
    Trinary,
    /// A percentage between the thresholds.
    Scale,
    /// The pixel is the percentage; above 100 is unknown.
    Raw,
}

/// What a map's YAML file says.
#[derive(Debug, Clone, PartialEq)]
pub struct MapYaml {
    /// Path of the picture, relative to the YAML file.
    pub image: String,
    /// Side of a pixel, metres.
    pub resolution_m: f64,
    /// The picture's lower left corner: x and y in metres, yaw in radians, which has to be 0.
    pub origin: [f64; 3],
    /// Whether white is occupied rather than black.
    pub negate: bool,
    /// Cells darker than this part of black are occupied.
    pub occupied_threshold: f64,
    /// Cells lighter than this part of black are free.
    pub free_threshold: f64,
    /// How grey becomes occupancy.
    pub mode: Mode,
}

impl Default for MapYaml {
    /// The values of `map_server` where a file does not say.
    fn default() -> Self {
        Self {
            image: String::new(),
            resolution_m: 0.0,
            origin: [0.0; 3],
            negate: false,
            occupied_threshold: 0.65,
            free_threshold: 0.196,
            mode: Mode::Trinary,
        }
    }
}

impl MapYaml {
    /// What a file's text says; `path` is for errors only.
    ///
    /// Keys that `map_server` does not know are passed over. Only the flat form that it writes is
    /// understood: `key: value`, the origin as a list on one line or one number a line.
    ///
    /// # Errors
    /// [`Error::BadFile`] says what was found and expected on which line.
    pub fn parse(text: &str, path: &Path) -> Result<Self, Error> {
        let bad = |what: String| Error::BadFile {
            path: path.to_owned(),
            what,
        };
        let mut yaml = Self::default();
        let (mut has_resolution, mut has_origin) = (false, false);
        let mut lines = (1..).zip(text.lines()).peekable();
        while let Some((number, line)) = lines.next() {
            let line = without_comment(line);
            if line.is_empty() || line == "---" {
                continue;
            }
            let Some((key, value)) = line.split_once(':') else {
                return Err(bad(format!(
                    "line {number}: {line:?}, expected \"key: value\""
                )));
            };
            let mut value = value.trim().to_owned();
            if key.trim() == "origin" && value.is_empty() {
                while let Some((_, item)) =
                    lines.next_if(|(_, next)| next.trim_start().starts_with("- "))
                {
                    let item = without_comment(item).trim_start_matches("- ").trim();
                    value = if value.is_empty() {
                        item.to_owned()
                    } else {
                        format!("{value}, {item}")
                    };
                }
            }
            has_resolution |= key.trim() == "resolution";
            has_origin |= key.trim() == "origin";
            yaml.set(key.trim(), &value).map_err(|wanted| {
                bad(format!(
                    "line {number}: {} is {value:?}, expected {wanted}",
                    key.trim()
                ))
            })?;
        }
        for (name, is_there) in [
            ("image", !yaml.image.is_empty()),
            ("resolution", has_resolution),
            ("origin", has_origin),
        ] {
            if !is_there {
                return Err(bad(format!(
                    "there is no {name:?}, expected image, resolution and origin"
                )));
            }
        }
        Ok(yaml)
    }

    /// Sets one key; the error says what was expected.
    fn set(&mut self, key: &str, value: &str) -> Result<(), &'static str> {
        let number = || {
            value
                .parse::<f64>()
                .ok()
                .filter(|number| number.is_finite())
        };
        let part = || {
            number()
                .filter(|part| (0.0..=1.0).contains(part))
                .ok_or("a number from 0 to 1")
        };
        match key {
            "image" => {
                value.trim_matches(['"', '\'']).clone_into(&mut self.image);
                (!self.image.is_empty())
                    .then_some(())
                    .ok_or("the path of a PGM file")?;
            }
            "resolution" => {
                self.resolution_m = number()
                    .filter(|metres| (0.01..=10.0).contains(metres))
                    .ok_or("0.01 to 10 metres a pixel")?;
            }
            "origin" => self.origin = origin_of(value)?,
            "negate" => {
                self.negate = match value {
                    "0" | "false" => false,
                    "1" | "true" => true,
                    _ => return Err("0 or 1"),
                };
            }
            "occupied_thresh" => self.occupied_threshold = part()?,
            "free_thresh" => self.free_threshold = part()?,
            "mode" => {
                self.mode = match value.trim_matches(['"', '\'']) {
                    "trinary" => Mode::Trinary,
                    "scale" => Mode::Scale,
                    "raw" => Mode::Raw,
                    _ => return Err("trinary, scale or raw"),
                };
            }
            _ => {}
        }
        Ok(())
    }

    /// The occupancy that a grey value stands for.
    pub fn occupancy_of(&self, grey: u8) -> i8 {
        if self.mode == Mode::Raw {
            return i8::try_from(grey)
                .ok()
                .filter(|percent| *percent <= OCCUPIED)
                .unwrap_or(UNKNOWN);
        }
        let level = if self.negate { grey } else { 255 - grey };
        let black = f64::from(level) / 255.0;
        if black > self.occupied_threshold {
            OCCUPIED
        } else if black < self.free_threshold {
            FREE
        } else if self.mode == Mode::Scale {
            let span = (self.occupied_threshold - self.free_threshold).max(f64::EPSILON);
            #[expect(
                clippy::cast_possible_truncation,
                reason = "the value is between 1 and 99"
            )]
            let percent = (99.0 * (black - self.free_threshold) / span).clamp(1.0, 99.0) as i8;
            percent
        } else {
            UNKNOWN
        }
    }
}

impl fmt::Display for MapYaml {
    /// The file's text.
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mode = match self.mode {
            Mode::Trinary => "trinary",
            Mode::Scale => "scale",
            Mode::Raw => "raw",
        };
        let [x_m, y_m, yaw_rad] = self.origin;
        writeln!(formatter, "image: {}", self.image)?;
        writeln!(formatter, "mode: {mode}")?;
        writeln!(formatter, "resolution: {}", self.resolution_m)?;
        writeln!(formatter, "origin: [{x_m}, {y_m}, {yaw_rad}]")?;
        writeln!(formatter, "negate: {}", u8::from(self.negate))?;
        writeln!(formatter, "occupied_thresh: {}", self.occupied_threshold)?;
        writeln!(formatter, "free_thresh: {}", self.free_threshold)
    }
}

/// A line up to its comment, which begins with a `#` at its start or behind a space.
fn without_comment(line: &str) -> &str {
    let end = line
        .char_indices()
        .find(|(index, character)| {
            *character == '#' && (*index == 0 || line[..*index].ends_with([' ', '\t']))
        })
        .map_or(line.len(), |(index, _)| index);
    line[..end].trim()
}

fn origin_of(value: &str) -> Result<[f64; 3], &'static str> {
    const WANTED: &str = "[x, y, yaw] in metres and radians, yaw 0";
    let mut origin = [0.0; 3];
    let mut parts = value
        .trim_start_matches('[')
        .trim_end_matches(']')
        .split(',');
    for number in &mut origin {
        *number = parts
            .next()
            .and_then(|part| part.trim().parse().ok())
            .filter(|number: &f64| number.is_finite())
            .ok_or(WANTED)?;
    }
    let is_unturned = origin[2].abs() < 1e-4;
    if is_unturned && parts.next().is_none() {
        Ok(origin)
    } else {
        Err(WANTED)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn parse(text: &str) -> Result<MapYaml, Error> {
        MapYaml::parse(text, Path::new("map.yaml"))
    }

    const GOOD: &str = "# a map\nimage: \"a map.pgm\"\nresolution: 0.05 # m\norigin:\n- -10.0\n- 2\n\
                        - 0\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\nmode: scale\n";

    #[test]
    fn both_forms_of_the_origin_and_comments_are_read() {
        let yaml = parse(GOOD).unwrap();
        assert_eq!(yaml.image, "a map.pgm");
        assert_eq!(yaml.origin, [-10.0, 2.0, 0.0]);
        assert_eq!(yaml.mode, Mode::Scale);
        assert_eq!(parse(&yaml.to_string()).unwrap(), yaml);
    }

    #[test]
    fn errors_name_the_line() {
        for (from, to, what) in [
            ("0.05", "zero", "line 3: resolution is \"zero\""),
            ("- 2\n", "- 2, 7\n", "line 4: origin"),
            ("- 0\n", "- 0.3\n", "yaw 0"),
            ("scale", "grey", "line 11: mode is \"grey\""),
            (
                "negate: 0",
                "negate",
                "line 8: \"negate\", expected \"key: value\"",
            ),
            ("resolution:", "resolutoin:", "there is no \"resolution\""),
            ("0.25", "25", "line 10: free_thresh"),
        ] {
            let error = parse(&GOOD.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(
                error.contains("map.yaml") && error.contains(what),
                "{error}"
            );
        }
    }

    #[test]
    fn grey_becomes_what_map_server_makes_of_it() {
        let mut yaml = MapYaml::default();
        let of = |yaml: &MapYaml| [0, 89, 90, 205, 206, 255].map(|grey| yaml.occupancy_of(grey));
        assert_eq!(of(&yaml), [100, 100, -1, -1, 0, 0]);
        yaml.negate = true;
        assert_eq!(of(&yaml), [0, -1, -1, 100, 100, 100]);
        yaml.mode = Mode::Raw;
        assert_eq!(of(&yaml), [0, 89, 90, -1, -1, -1]);
        yaml = MapYaml {
            mode: Mode::Scale,
            ..MapYaml::default()
        };
        assert_eq!(of(&yaml), [100, 100, 98, 1, 0, 0]);
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "[a-z:#\\[\\],.0-9 \n-]{0,80}", prefix in 0usize..3) {
            let _either_way = parse(&format!("{}{text}", ["", "origin: ", GOOD][prefix]));
        }
    }
}
