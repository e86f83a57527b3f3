//! What each key of the configuration means, with its unit and range: one table (`keys.txt`), from
//! which the check of a file, `swath config` and `docs/configuration.md` are made.

use anyhow::Context;
use toml::Value;

use super::Config;

/// The table's text.
const TABLE: &str = include_str!("keys.txt");

/// Sections of crates in whose place `[grid]` and `[vehicle]` count, which all nodes share.
const SHARED_INSTEAD: [&str; 4] = [
    "ingest.spec",
    "ingest.vehicle",
    "generator.grid",
    "generator.vehicle",
];

/// A key or a section of the configuration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Key {
    /// Names of sections and key, parted by dots.
    pub(crate) path: &'static str,
    /// Unit; empty for numbers without one, names and sections.
    pub(crate) unit: &'static str,
    /// The allowed values in words; empty for sections.
    pub(crate) range: &'static str,
    /// What it says: a sentence.
    pub(crate) says: &'static str,
    /// A value, for a key without a default.
    pub(crate) example: Option<&'static str>,
}

/// The numbers that a key may hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Range {
    /// Least value.
    pub(crate) least: f64,
    /// Whether the least value itself is refused.
    pub(crate) above: bool,
    /// Largest value.
    pub(crate) most: f64,
}

impl Key {
    /// The key of a line of the table.
    fn of_line(line: &'static str) -> Option<Self> {
        let mut fields = line.split('|').map(str::trim);
        Some(Self {
            path: fields.next()?,
            unit: fields.next()?,
            range: fields.next()?,
            says: fields.next()?,
            example: fields.next(),
        })
    }

    /// The section that the key is in; empty for a section of the first level.
    pub(crate) fn section(&self) -> &'static str {
        self.path
            .rsplit_once('.')
            .map_or("", |(section, _)| section)
    }

    /// The name within the section.
    pub(crate) fn name(&self) -> &'static str {
        self.path.rsplit('.').next().unwrap_or(self.path)
    }

    /// The numbers that the key may hold, if the range is one of numbers.
    pub(crate) fn numbers(&self) -> Option<Range> {
        let number = |text: &str| text.parse::<f64>().ok();
        if let Some(least) = self.range.strip_suffix(" or more") {
            return Some(Range {
                least: number(least)?,
                above: false,
                most: f64::INFINITY,
            });
        }
        let (least, most) = self.range.split_once(" to ")?;
        let above = least.strip_prefix("above ");
        Some(Range {
            least: number(above.unwrap_or(least))?,
            above: above.is_some(),
            most: number(most)?,
        })
    }
}

impl Range {
    /// Whether a number is in the range. The ends may be those of single precision, which some keys have.
    pub(crate) fn holds(&self, number: f64) -> bool {
        #[expect(clippy::cast_possible_truncation, reason = "that is what is asked")]
        let single = |end: f64| f64::from(end as f32);
        let least = self.least.min(single(self.least));
        let is_enough = if self.above {
            number > self.least
        } else {
            number >= least
        };
        is_enough && number <= self.most.max(single(self.most))
    }
}

/// Every section and key, in the order in which they are shown.
pub(crate) fn all() -> impl Iterator<Item = Key> {
    let lines = TABLE.lines().filter(|line| !line.starts_with('#'));
    lines.filter_map(Key::of_line)
}

/// The value at a path, if there is one.
pub(crate) fn value_at<'a>(root: &'a Value, path: &str) -> Option<&'a Value> {
    path.split('.')
        .try_fold(root, |value, name| value.get(name))
}

/// A configuration as sections and keys, without those that are taken from shared sections.
pub(crate) fn tree_of(config: &Config) -> anyhow::Result<Value> {
    let mut tree = Value::try_from(config).context("the configuration as TOML")?;
    for path in SHARED_INSTEAD {
        let section = path
            .split_once('.')
            .and_then(|(section, name)| Some((tree.get_mut(section)?.as_table_mut()?, name)));
        if let Some((section, name)) = section {
            section.remove(name);
        }
    }
    Ok(tree)
}

/// Checks that every number is in its range.
pub(super) fn check(config: &Config) -> anyhow::Result<()> {
    let tree = tree_of(config)?;
    for key in all() {
        if let (Some(range), Some(value)) = (key.numbers(), value_at(&tree, key.path)) {
            check_numbers(&key, range, value)?;
        }
    }
    Ok(())
}

fn check_numbers(key: &Key, range: Range, value: &Value) -> anyhow::Result<()> {
    let number = match value {
        Value::Array(values) => {
            return values
                .iter()
                .try_for_each(|value| check_numbers(key, range, value));
        }
        Value::Integer(number) => *number as f64,
        Value::Float(number) => *number,
        _ => return Ok(()),
    };
    let unit = match key.unit {
        "" => String::new(),
        unit => format!(" {unit}"),
    };
    anyhow::ensure!(
        range.holds(number),
        "{} is {}, expected {}{unit}",
        key.path,
        super::show::inline(value),
        key.range
    );
    Ok(())
}
