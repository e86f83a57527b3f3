//! The top level of a small YAML file, as text: what a scalar means is for its reader to say.

use std::borrow::Cow;
use std::collections::BTreeMap;

use saphyr_parser::{Event, Parser, ScanError, Span, StrInput};

/// Deepest nesting.
const MAX_DEPTH: usize = 32;
/// Most scalars, lists and mappings, with those that aliases repeat.
const MAX_NODES: usize = 10_000;
/// Most characters of an error's evidence that are taken from a file.
const MAX_EVIDENCE: usize = 60;

/// A value, and the line on which it begins.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Node {
    pub(super) line: usize,
    pub(super) value: Value,
}

/// What stands there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Value {
    /// The text without its quotes.
    Scalar(String),
    /// A list in either form.
    List(Vec<Node>),
    /// A mapping, whose entries nobody asks for.
    Mapping(usize),
}

impl Node {
    /// The text of a scalar without the space around it.
    pub(super) fn text(&self) -> Option<&str> {
        match &self.value {
            Value::Scalar(text) => Some(text.trim()),
            Value::List(_) | Value::Mapping(_) => None,
        }
    }

    /// What was found, for an error.
    pub(super) fn found(&self) -> String {
        match &self.value {
            Value::Scalar(text) if text.is_empty() => "empty".to_owned(),
            Value::Scalar(text) => {
                format!("{:?}", text.chars().take(MAX_EVIDENCE).collect::<String>())
            }
            Value::List(items) => {
                let items: Vec<String> = items.iter().take(5).map(Self::found).collect();
                format!("a list, [{}]", items.join(", "))
            }
            Value::Mapping(_) => "a mapping".to_owned(),
        }
    }

    /// Scalars, lists and mappings in it.
    fn nodes(&self) -> usize {
        match &self.value {
            Value::Scalar(_) => 1,
            Value::List(items) => 1 + items.iter().map(Self::nodes).sum::<usize>(),
            Value::Mapping(nodes) => *nodes,
        }
    }
}

/// The entries of the mapping that a text's first document is, in their order.
///
/// # Errors
/// Says on which line what was found and what was expected.
pub(super) fn entries(text: &str) -> Result<Vec<(String, Node)>, String> {
    let mut reader = Reader {
        parser: Parser::new_from_str(text),
        anchors: BTreeMap::new(),
        nodes: 0,
    };
    let mut entries: Vec<(String, Node)> = Vec::new();
    loop {
        match reader.next()? {
            (Event::StreamStart | Event::DocumentStart(_) | Event::Nothing, _) => {}
            (Event::MappingStart(..), _) => break,
            (Event::StreamEnd | Event::DocumentEnd, _) => {
                return Err("the file is empty, expected lines of \"key: value\"".to_owned());
            }
            (_, span) => {
                let line = span.start.line();
                return Err(format!("line {line}: expected lines of \"key: value\""));
            }
        }
    }
    loop {
        let (event, span) = reader.next()?;
        if event == Event::MappingEnd {
            return Ok(entries);
        }
        let key = reader.node((event, span), 1)?;
        let line = key.line;
        let key = match key.text() {
            Some(text) => text.to_owned(),
            None => return Err(format!("line {line}: a key is {}", key.found())),
        };
        if let Some((_, first)) = entries.iter().find(|(other, _)| *other == key) {
            let first = first.line;
            return Err(format!("line {line}: {key} stands on line {first} already"));
        }
        let next = reader.next()?;
        let value = reader.node(next, 1)?;
        entries.push((key, value));
    }
}

struct Reader<'a> {
    parser: Parser<'a, StrInput<'a>>,
    anchors: BTreeMap<usize, Node>,
    nodes: usize,
}

impl<'a> Reader<'a> {
    fn next(&mut self) -> Result<(Event<'a>, Span), String> {
        match self.parser.next_event() {
            Some(Ok(event)) => Ok(event),
            Some(Err(error)) => Err(said(&error)),
            None => Err("the file ends where a value is expected".to_owned()),
        }
    }

    /// The node that an event begins.
    fn node(&mut self, (event, span): (Event<'a>, Span), depth: usize) -> Result<Node, String> {
        let line = span.start.line();
        if depth > MAX_DEPTH {
            return Err(format!(
                "line {line}: more than {MAX_DEPTH} values in one another"
            ));
        }
        let (value, anchor) = match event {
            Event::Scalar(text, _, anchor, _) => (Value::Scalar(Cow::into_owned(text)), anchor),
            Event::Alias(anchor) => {
                let Some(named) = self.anchors.get(&anchor) else {
                    return Err(format!("line {line}: an alias of what is not complete yet"));
                };
                (named.value.clone(), 0)
            }
            Event::SequenceStart(anchor, _) => {
                let mut items = Vec::new();
                loop {
                    let next = self.next()?;
                    if next.0 == Event::SequenceEnd {
                        break;
                    }
                    items.push(self.node(next, depth + 1)?);
                }
                (Value::List(items), anchor)
            }
            Event::MappingStart(anchor, _) => {
                let mut nodes = 1;
                loop {
                    let next = self.next()?;
                    if next.0 == Event::MappingEnd {
                        break;
                    }
                    nodes += self.node(next, depth + 1)?.nodes();
                }
                (Value::Mapping(nodes), anchor)
            }
            _ => return Err(format!("line {line}: expected a value")),
        };
        let node = Node { line, value };
        self.nodes += match &node.value {
            Value::Scalar(_) => 1,
            _ => node.nodes(),
        };
        if self.nodes > MAX_NODES {
            return Err(format!(
                "line {line}: more than {MAX_NODES} values, aliases counted as what they stand for"
            ));
        }
        if anchor > 0 {
            self.anchors.insert(anchor, node.clone());
        }
        Ok(node)
    }
}

fn said(error: &ScanError) -> String {
    format!("line {}: {}", error.marker().line(), error.info())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scalar(entries: &[(String, Node)], key: &str) -> String {
        let found = entries.iter().find(|(name, _)| name == key);
        found.unwrap().1.text().unwrap().to_owned()
    }

    #[test]
    fn directives_anchors_and_both_forms_of_lists_are_read() {
        let text =
            "%YAML 1.2\n---\na: &x 'one'\nb: *x\nc: [1,\n  2]\nd:\n- 1\n- 2\n...\ne: not read\n";
        let read = entries(text).unwrap();
        assert_eq!(
            (scalar(&read, "a"), scalar(&read, "b")),
            ("one".into(), "one".into())
        );
        let items = |index: usize| match &read[index].1.value {
            Value::List(items) => items
                .iter()
                .map(|item| item.text().unwrap().to_owned())
                .collect(),
            _ => Vec::new(),
        };
        assert_eq!(items(2), ["1", "2"]);
        assert_eq!(items(3), items(2));
        assert_eq!(read.len(), 4);
        assert_eq!(read[3].1.line, 8);
    }

    #[test]
    fn what_is_no_mapping_is_named_with_its_line() {
        for (text, what) in [
            ("", "empty"),
            ("# nothing\n", "empty"),
            ("just text", "line 1: expected lines of"),
            ("- a\n- b\n", "line 1: expected lines of"),
            ("a: 1\nb: 2\na: 3\n", "line 3: a stands on line 1 already"),
            ("a: [1\nb: 2", "line"),
            ("a: *nobody\n", "line 1"),
            ("a: 1\n\tb: 2\n", "found a tab"),
        ] {
            let error = entries(text).unwrap_err();
            assert!(error.contains(what), "{text:?}: {error}");
        }
    }

    #[test]
    fn neither_depth_nor_aliases_grow_without_limit() {
        for text in [
            format!("a: {}", "[".repeat(10_000)),
            format!("a:\n{}b", "- ".repeat(10_000)),
            format!("a: {{{}", "a: {".repeat(10_000)),
            format!("? {}", "? ".repeat(10_000)),
        ] {
            assert!(entries(&text).is_err());
        }
        let mut bomb = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n".to_owned();
        for level in 1..12 {
            let alias = format!("*a{}, ", level - 1).repeat(10);
            bomb = format!("{bomb}a{level}: &a{level} [{alias}]\n");
        }
        let error = entries(&bomb).unwrap_err();
        assert!(error.contains("aliases"), "{error}");
    }
}
