//! The YAML file that ROS `map_server` puts beside a picture.

use std::fmt;
use std::path::Path;

use super::document::{Node, Value, entries};
use crate::Error;
use crate::geometry::Pose2;
use crate::occupancy::{FREE, OCCUPIED, UNKNOWN};

/// How brightness becomes occupancy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Mode {
    /// Free, occupied or unknown, by the two thresholds.
    #[default]
    Trinary,
    /// A percentage between the thresholds; what is not opaque is unknown.
    Scale,
    /// The brightness of 0 to 255 is the percentage; above 100 is unknown.
    Raw,
}

/// One pixel of any picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Shade {
    /// Mean of red, green and blue, 0 to 1.
    pub brightness: f64,
    /// From 0 for transparent to 1 for opaque; `None` where the picture has no such channel.
    pub opacity: Option<f64>,
}

/// What a map's YAML file says.
#[derive(Debug, Clone, PartialEq)]
pub struct MapYaml {
    /// Path of the picture, relative to the YAML file.
    pub image: String,
    /// Side of a pixel, metres.
    pub resolution_m: f64,
    /// The picture's lower left corner in the map's frame; its yaw is by how much the picture is turned.
    pub origin: Pose2,
    /// Whether white is occupied rather than black.
    pub negate: bool,
    /// Cells darker than this part of black are occupied.
    pub occupied_threshold: f64,
    /// Cells lighter than this part of black are free.
    pub free_threshold: f64,
    /// How brightness becomes occupancy.
    pub mode: Mode,
}

impl Default for MapYaml {
    /// The values of `map_server` where a file does not say.
    fn default() -> Self {
        Self {
            image: String::new(),
            resolution_m: 0.0,
            origin: Pose2::default(),
            negate: false,
            occupied_threshold: 0.65,
            free_threshold: 0.196,
            mode: Mode::Trinary,
        }
    }
}

impl MapYaml {
    /// What a file's text says; `path` is for messages only.
    ///
    /// Keys that `map_server` does not know are passed over, with a warning.
    ///
    /// # Errors
    /// [`Error::BadFile`] says what was found and expected, of which key on which line.
    pub fn parse(text: &str, path: &Path) -> Result<Self, Error> {
        let bad = |what: String| Error::BadFile {
            path: path.to_owned(),
            what,
        };
        let entries = entries(text.trim_start_matches('\u{feff}')).map_err(bad)?;
        let mut yaml = Self::default();
        for (key, node) in &entries {
            yaml.set(key, node, path).map_err(|wanted| {
                let (line, found) = (node.line, node.found());
                bad(format!("line {line}: {key} is {found}, expected {wanted}"))
            })?;
        }
        for name in ["image", "resolution", "origin"] {
            if !entries.iter().any(|(key, _)| key == name) {
                return Err(bad(format!(
                    "there is no {name:?}, expected image, resolution and origin"
                )));
            }
        }
        Ok(yaml)
    }

    /// Sets one key; the error says what was expected.
    fn set(&mut self, key: &str, node: &Node, path: &Path) -> Result<(), &'static str> {
        let text = node.text().unwrap_or_default();
        let part = || {
            number_of(node)
                .filter(|part| (0.0..=1.0).contains(part))
                .ok_or("a number from 0 to 1")
        };
        match key {
            "image" => {
                text.clone_into(&mut self.image);
                let is_path = !text.is_empty() && text != "~";
                is_path.then_some(()).ok_or("the path of a picture")?;
            }
            "resolution" => {
                self.resolution_m = number_of(node)
                    .filter(|metres| (0.01..=10.0).contains(metres))
                    .ok_or("0.01 to 10 metres a pixel")?;
            }
            "origin" => self.origin = origin_of(node)?,
            "negate" => self.negate = flag_of(text).ok_or("true, false, 1 or 0")?,
            "occupied_thresh" => self.occupied_threshold = part()?,
            "free_thresh" => self.free_threshold = part()?,
            "mode" => {
                self.mode = match text.to_ascii_lowercase().as_str() {
                    "trinary" => Mode::Trinary,
                    "scale" => Mode::Scale,
                    "raw" => Mode::Raw,
                    _ => return Err("trinary, scale or raw"),
                };
            }
            _ => tracing::warn!(
                "{}: line {}: {key:?} is no key of a map and is passed over",
                path.display(),
                node.line
            ),
        }
        Ok(())
    }

    /// The occupancy that a pixel stands for, as nav2's `map_server` has it: in the mode `trinary` the
    /// opacity counts as a fourth channel, in the mode `scale` what is not opaque is unknown.
    pub fn occupancy_of(&self, shade: Shade) -> i8 {
        let brightness = match (self.mode, shade.opacity) {
            (Mode::Trinary, Some(opacity)) => (3.0 * shade.brightness + opacity) / 4.0,
            _ => shade.brightness,
        };
        if self.mode == Mode::Raw {
            let percent = libm::round(brightness * 255.0);
            return if percent <= f64::from(OCCUPIED) {
                whole(percent)
            } else {
                UNKNOWN
            };
        }
        let black = if self.negate {
            brightness
        } else {
            1.0 - brightness
        };
        let is_opaque = shade.opacity.is_none_or(|opacity| opacity >= 1.0);
        if self.mode == Mode::Scale && !is_opaque {
            UNKNOWN
        } else if black > self.occupied_threshold {
            OCCUPIED
        } else if black < self.free_threshold {
            FREE
        } else if self.mode == Mode::Scale {
            let span = (self.occupied_threshold - self.free_threshold).max(f64::EPSILON);
            whole(libm::rint(100.0 * (black - self.free_threshold) / span))
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
        let Pose2 { x_m, y_m, yaw_rad } = self.origin;
        // A string of JSON is one of YAML.
        writeln!(formatter, "image: {}", serde_json::json!(self.image))?;
        writeln!(formatter, "mode: {mode}")?;
        writeln!(formatter, "resolution: {}", self.resolution_m)?;
        writeln!(formatter, "origin: [{x_m}, {y_m}, {yaw_rad}]")?;
        writeln!(formatter, "negate: {}", u8::from(self.negate))?;
        writeln!(formatter, "occupied_thresh: {}", self.occupied_threshold)?;
        writeln!(formatter, "free_thresh: {}", self.free_threshold)
    }
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "clamped to percentages first"
)]
fn whole(percent: f64) -> i8 {
    percent.clamp(f64::from(FREE), f64::from(OCCUPIED)) as i8
}

fn number_of(node: &Node) -> Option<f64> {
    let number = node.text()?.parse::<f64>().ok()?;
    number.is_finite().then_some(number)
}

/// A truth value in any spelling of YAML 1.1, or a whole number.
fn flag_of(text: &str) -> Option<bool> {
    match text.to_ascii_lowercase().as_str() {
        "true" | "yes" | "on" | "y" => Some(true),
        "false" | "no" | "off" | "n" => Some(false),
        number => number.parse::<i64>().ok().map(|number| number != 0),
    }
}

fn origin_of(node: &Node) -> Result<Pose2, &'static str> {
    const WANTED: &str = "[x, y, yaw] in metres and radians";
    let Value::List(items) = &node.value else {
        return Err(WANTED);
    };
    let numbers: Option<Vec<f64>> = items.iter().map(number_of).collect();
    let Some([x_m, y_m, yaw_rad]) = numbers.as_deref() else {
        return Err(WANTED);
    };
    let is_near = x_m.abs() <= MAX_ORIGIN_M && y_m.abs() <= MAX_ORIGIN_M && yaw_rad.abs() <= 7.0;
    is_near
        .then(|| Pose2::new(*x_m, *y_m, *yaw_rad))
        .ok_or("at most 1e7 m for x and y and 7 rad for yaw")
}

/// Farthest that a picture may lie from its frame's origin along an axis.
const MAX_ORIGIN_M: f64 = 1e7;

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
        assert_eq!(yaml.origin, Pose2::new(-10.0, 2.0, 0.0));
        assert_eq!(yaml.mode, Mode::Scale);
        assert_eq!(parse(&yaml.to_string()).unwrap(), yaml);
    }

    #[test]
    fn every_spelling_that_map_server_takes_is_read() {
        let plain = parse(GOOD).unwrap();
        for (from, to) in [
            ("# a map", "\u{feff}# a map"),
            ("# a map", "%YAML 1.2\n---"),
            ("# a map", "\u{feff}%YAML 1.1\n--- # a map"),
            ("negate: 0", "negate: False"),
            ("negate: 0", "negate: no"),
            ("negate: 0", "negate: 'OFF'"),
            ("negate: 0", "\"negate\": n"),
            ("scale", "Scale"),
            ("scale", "SCALE"),
            ("scale", "\"sCaLe\""),
            ("0.05", "'0.05'"),
            ("0.05", "5e-2"),
            ("0.05", "!!float \".05\""),
            ("\"a map.pgm\"", "a map.pgm"),
            ("\"a map.pgm\"", "'a map.pgm'  # quoted"),
            ("\"a map.pgm\"", ">-\n  a\n  map.pgm"),
            (
                "origin:\n- -10.0\n- 2\n- 0",
                "origin: [-10,\n  2.0,\n  0.0]",
            ),
            (
                "origin:\n- -10.0\n- 2\n- 0",
                "origin: [\"-10.0\", '2', 0, ]",
            ),
            (
                "origin:\n- -10.0\n- 2\n- 0",
                "origin:\n    -  -10.0\n    -  2\n    -  0",
            ),
            (
                "origin:\n- -10.0\n- 2\n- 0",
                "x: &o [-10, 2, 0]\norigin: *o",
            ),
            (
                "mode: scale\n",
                "mode: scale\nmap_id: {a: [1, 2], b: c}\n...\nanother: document\n",
            ),
            ("\n", "\r\n"),
        ] {
            let text = if from == "\n" {
                GOOD.replace(from, to)
            } else {
                assert!(GOOD.contains(from));
                GOOD.replacen(from, to, 1)
            };
            assert_eq!(parse(&text).unwrap(), plain, "{text}");
        }
        for yes in ["1", "true", "True", "TRUE", "yes", "Y", "on", "\"1\""] {
            let text = GOOD.replacen("negate: 0", &format!("negate: {yes}"), 1);
            assert!(parse(&text).unwrap().negate, "{yes}");
        }
        let turned = parse(&GOOD.replacen("- 0\n", "- 0.3\n", 1)).unwrap();
        assert_eq!(turned.origin.yaw_rad, 0.3);
        let flow = "{image: a map.pgm, resolution: 0.05, origin: [-10, 2, 0], mode: scale, free_thresh: .25}";
        assert_eq!(parse(flow).unwrap(), plain);
    }

    #[test]
    fn errors_name_key_line_what_was_found_and_what_was_expected() {
        for (from, to, what) in [
            (
                "0.05",
                "zero",
                "line 3: resolution is \"zero\", expected 0.01",
            ),
            ("0.05", ".inf", "line 3: resolution is \".inf\""),
            ("0.05", "-0.05", "line 3: resolution"),
            ("0.05", "", "line 3: resolution is empty"),
            ("0.05", "[0.05]", "line 3: resolution is a list"),
            (
                "- 2\n",
                "- 2, 7\n",
                "line 5: origin is a list, [\"-10.0\", \"2, 7\"",
            ),
            ("- 2\n", "", "expected [x, y, yaw]"),
            ("- -10.0", "- .nan", "expected [x, y, yaw]"),
            ("- -10.0", "- 1e300", "at most 1e7"),
            (
                "scale",
                "grey",
                "line 11: mode is \"grey\", expected trinary, scale or raw",
            ),
            (
                "negate: 0",
                "negate: maybe",
                "line 8: negate is \"maybe\", expected true, false",
            ),
            ("negate: 0", "negate", "line 9: simple key expect"),
            ("resolution:", "resolutoin:", "there is no \"resolution\""),
            ("image:", "picture:", "there is no \"image\""),
            ("\"a map.pgm\"", "", "line 2: image is empty"),
            (
                "0.25",
                "25",
                "line 10: free_thresh is \"25\", expected a number from 0 to 1",
            ),
            (
                "negate: 0",
                "mode: raw",
                "line 11: mode stands on line 8 already",
            ),
        ] {
            assert!(GOOD.contains(from));
            let error = parse(&GOOD.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(
                error.contains("map.yaml") && error.contains(what),
                "{what} is not in: {error}"
            );
        }
    }

    fn grey(value: u8) -> Shade {
        Shade {
            brightness: f64::from(value) / 255.0,
            opacity: None,
        }
    }

    #[test]
    fn brightness_becomes_what_map_server_makes_of_it() {
        let mut yaml = MapYaml::default();
        let of =
            |yaml: &MapYaml| [0, 89, 90, 205, 206, 255].map(|value| yaml.occupancy_of(grey(value)));
        assert_eq!(of(&yaml), [100, 100, -1, -1, 0, 0]);
        yaml.negate = true;
        assert_eq!(of(&yaml), [0, -1, -1, 100, 100, 100]);
        yaml.mode = Mode::Raw;
        assert_eq!(of(&yaml), [0, 89, 90, -1, -1, -1]);
        yaml = MapYaml {
            mode: Mode::Scale,
            ..MapYaml::default()
        };
        // rint(100 · (1 − v/255 − 0.196) / 0.454)
        assert_eq!(of(&yaml), [100, 100, 99, 0, 0, 0]);
        assert_eq!(yaml.occupancy_of(grey(150)), 48);
    }

    #[test]
    fn opacity_is_a_channel_of_trinary_and_makes_scale_unknown() {
        let of = |mode, brightness, opacity| {
            let yaml = MapYaml {
                mode,
                ..MapYaml::default()
            };
            yaml.occupancy_of(Shade {
                brightness,
                opacity: Some(opacity),
            })
        };
        // White and transparent: (1 + 1 + 1 + 0) / 4 is between the thresholds.
        assert_eq!(of(Mode::Trinary, 1.0, 0.0), UNKNOWN);
        assert_eq!(of(Mode::Trinary, 1.0, 1.0), FREE);
        assert_eq!(of(Mode::Trinary, 0.0, 1.0), OCCUPIED);
        assert_eq!(of(Mode::Scale, 0.0, 0.99), UNKNOWN);
        assert_eq!(of(Mode::Scale, 0.0, 1.0), OCCUPIED);
        assert_eq!(of(Mode::Raw, 0.2, 0.0), 51);
    }

    proptest! {
        #[test]
        fn no_text_panics(text in "[a-z:#\\[\\],.&*{}|>'\"%?0-9 \n-]{0,80}", prefix in 0usize..3) {
            let _either_way = parse(&format!("{}{text}", ["", "origin: ", GOOD][prefix]));
        }
    }
}
