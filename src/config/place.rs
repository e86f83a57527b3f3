//! Where in a configuration file a value stands that cannot be used.

use toml::de::{DeTable, DeValue};

/// The line, counted from 1, of the key in a section that an error speaks of; that of the section if it
/// names none of the file's keys, and none if the section is not there.
pub(super) fn line_of(text: &str, section: &str, said: &str) -> Option<usize> {
    let found = Section::find(text, section)?;
    let named = found.keys.iter().filter(|key| key.is_named(said));
    let named = named.max_by_key(|key| key.path.len());
    line_at(text, named.map_or(found.start, |key| key.start))
}

/// The line, counted from 1, of a key in a section, if the file has it.
pub(super) fn line_of_key(text: &str, section: &str, path: &str) -> Option<usize> {
    let found = Section::find(text, section)?;
    let key = found.keys.iter().find(|key| key.path == path)?;
    line_at(text, key.start)
}

fn line_at(text: &str, start: usize) -> Option<usize> {
    Some(1 + text.get(..start)?.matches('\n').count())
}

/// Where a section begins, in bytes, and its keys.
struct Section {
    start: usize,
    keys: Vec<Key>,
}

impl Section {
    fn find(text: &str, section: &str) -> Option<Self> {
        let file = DeTable::parse(text).ok()?.into_inner();
        let (name, value) = file.iter().find(|(name, _)| name.get_ref() == section)?;
        let mut keys = Vec::new();
        if let DeValue::Table(table) = value.get_ref() {
            collect(table, "", &mut keys);
        }
        Some(Self {
            start: name.span().start,
            keys,
        })
    }
}

/// A key of a section, with the keys that lead to it.
struct Key {
    path: String,
    start: usize,
}

impl Key {
    /// Whether a text has the key as a whole word.
    fn is_named(&self, said: &str) -> bool {
        let is_of_word = |symbol: char| symbol.is_alphanumeric() || symbol == '_';
        said.match_indices(&self.path).any(|(start, found)| {
            let before = said[..start].chars().next_back();
            let after = said[start + found.len()..].chars().next();
            !before.is_some_and(is_of_word) && !after.is_some_and(is_of_word)
        })
    }
}

fn collect(table: &DeTable<'_>, above: &str, keys: &mut Vec<Key>) {
    for (name, value) in table {
        let path = format!("{above}{}", name.get_ref());
        if let DeValue::Table(inner) = value.get_ref() {
            collect(inner, &format!("{path}."), keys);
        }
        keys.push(Key {
            path,
            start: name.span().start,
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "# words\n[grid]\nrows = 0\ncols = 5\n\n[train]\nbatch = 4\nmicro_batch = 9\n\
                        [train.loss]\ndice_weight = -1.0\n";

    #[test]
    fn the_line_is_that_of_the_key_which_is_named() {
        assert_eq!(line_of(FILE, "grid", "rows is 0, expected 1"), Some(3));
        assert_eq!(line_of(FILE, "train", "micro_batch is 9"), Some(8));
        assert_eq!(line_of(FILE, "train", "batch is 0"), Some(7));
        assert_eq!(line_of(FILE, "train", "loss.dice_weight is -1"), Some(10));
        assert_eq!(line_of(FILE, "grid", "something else"), Some(2));
        assert_eq!(line_of(FILE, "plan", "epsilon is 0"), None);
        assert_eq!(line_of("no toml", "plan", "epsilon is 0"), None);
        assert_eq!(line_of_key(FILE, "train", "loss.dice_weight"), Some(10));
        assert_eq!(line_of_key(FILE, "train", "dice_weight"), None);
        let dotted = "a = 1\ngrid.rows = 0";
        assert_eq!(line_of(dotted, "grid", "rows is 0"), Some(2));
        let inline = "grid = { cols = 1,\n rows = 0 }";
        assert_eq!(line_of(inline, "grid", "rows is 0"), Some(2));
    }
}
