//! The configuration as commented TOML, and as the page `docs/configuration.md`.

use std::fmt::Write;

use toml::Value;

use super::Config;
use super::keys::{self, Key};

/// The beginning of `docs/configuration.md`.
const PAGE: &str = "\
# Configuration

`--config FILE` gives a command its configuration. Give all nodes of a system the same file, so that they
agree on the vehicle and the grid. A section or key that the file leaves out has its default. A key
that is not in these tables, and a number that is out of its range, is an error that names the key.

```
swath config > swath.toml              # every key with its default, to be changed
swath --config swath.toml config       # what a file amounts to, with the defaults of what it changes
```

Options of a command take precedence over the file. Lengths are in metres, angles in radians, and
angles and curvatures are positive to the left.

This page is made by `swath config --markdown > docs/configuration.md`.
";

/// Longest line of a comment.
const COMMENT_COLUMNS: usize = 100;

/// A configuration as commented TOML that reads back as the same; what differs from the defaults is
/// followed by the default.
pub(crate) fn toml_of(config: &Config) -> anyhow::Result<String> {
    let (tree, defaults) = (keys::tree_of(config)?, keys::tree_of(&Config::default())?);
    let mut text = String::new();
    for key in keys::all() {
        let value = keys::value_at(&tree, key.path);
        let default = keys::value_at(&defaults, key.path);
        if value.is_some_and(Value::is_table) {
            if !text.is_empty() {
                text.push('\n');
            }
            comment(&mut text, key.says);
            writeln!(text, "[{}]", key.path)?;
            continue;
        }
        comment(&mut text, &sentence(&key));
        let Some(value) = value else {
            writeln!(
                text,
                "# {} = {}",
                key.name(),
                key.example.unwrap_or_default()
            )?;
            continue;
        };
        write!(text, "{} = {}", key.name(), lines_of(value))?;
        if default != Some(value) {
            let default = default.map_or_else(|| "none".to_owned(), inline);
            write!(text, " # default: {default}")?;
        }
        text.push('\n');
    }
    Ok(text)
}

/// The page `docs/configuration.md`.
pub(crate) fn page() -> anyhow::Result<String> {
    let defaults = keys::tree_of(&Config::default())?;
    let mut text = PAGE.to_owned();
    let mut section = "";
    for key in keys::all() {
        let value = keys::value_at(&defaults, key.path);
        if value.is_some_and(Value::is_table) {
            writeln!(text, "\n## [{}]\n\n{}", key.path, key.says)?;
            continue;
        }
        if key.section() != section {
            section = key.section();
            text.push_str("\n| key | default | unit | range | what it says |\n");
            text.push_str("| --- | --- | --- | --- | --- |\n");
        }
        let default =
            value.map_or_else(|| "none".to_owned(), |value| format!("`{}`", inline(value)));
        writeln!(
            text,
            "| `{}` | {default} | {} | {} | {} |",
            key.name(),
            key.unit,
            key.range,
            key.says
        )?;
    }
    Ok(text)
}

/// What a key says, with its unit and its range.
fn sentence(key: &Key) -> String {
    let (says, range) = (key.says, key.range);
    match key.unit {
        "" => format!("{says} Range: {range}."),
        unit => format!("{says} Unit: {unit}. Range: {range}."),
    }
}

/// Adds a comment, broken into lines between words.
fn comment(text: &mut String, says: &str) {
    let mut line = "#".to_owned();
    for word in says.split(' ') {
        if line.chars().count() + 1 + word.chars().count() > COMMENT_COLUMNS {
            text.push_str(&line);
            text.push('\n');
            "#".clone_into(&mut line);
        }
        line.push(' ');
        line.push_str(word);
    }
    text.push_str(&line);
    text.push('\n');
}

/// A value as it is set in a file: a list of tables has a line for each.
fn lines_of(value: &Value) -> String {
    match value {
        Value::Array(rows) if rows.iter().any(Value::is_table) => {
            let rows: Vec<String> = rows
                .iter()
                .map(|row| format!("    {},\n", inline(row)))
                .collect();
            format!("[\n{}]", rows.concat())
        }
        other => inline(other),
    }
}

/// A value on one line.
///
/// A number that single precision holds is shown with as few digits as tell it from its neighbours there.
pub(super) fn inline(value: &Value) -> String {
    match value {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::float_cmp,
            reason = "what single precision does not hold is shown in full"
        )]
        Value::Float(number) if f64::from(*number as f32) == *number => {
            Value::Float((*number as f32).to_string().parse().unwrap_or(*number)).to_string()
        }
        Value::Array(values) => {
            let values: Vec<String> = values.iter().map(inline).collect();
            format!("[{}]", values.join(", "))
        }
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests;
