//! What the documents show holds: links, commands, topics, methods, the example.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use swath_planner::Method;

/// Most bytes of the README: what is read in five minutes.
const MOST_README_BYTES: usize = 8000;
const LANGUAGES_OF_COMMANDS: [&str; 3] = ["", "sh", "bash"];

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn read(name: &str) -> String {
    let path = root().join(name);
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// Names of all documents, relative to the root.
fn documents() -> Vec<String> {
    let mut names = [
        "README.md",
        "ARCHITECTURE.md",
        "CONTRIBUTING.md",
        "CHANGELOG.md",
        "trainer/weights/README.md",
    ]
    .map(str::to_owned)
    .to_vec();
    for entry in std::fs::read_dir(root().join("docs")).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        if Path::new(&name)
            .extension()
            .is_some_and(|extension| extension == "md")
        {
            names.push(format!("docs/{name}"));
        }
    }
    names
}

/// A part of a document: a fenced block with its language, or a line of text.
enum Part<'a> {
    Block { language: &'a str, text: String },
    Line(&'a str),
}

fn parts(text: &str) -> Vec<Part<'_>> {
    let mut found = Vec::new();
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        let Some(language) = line.trim_start().strip_prefix("```") else {
            found.push(Part::Line(line));
            continue;
        };
        let block = lines.by_ref().take_while(|line| line.trim_start() != "```");
        let block: Vec<&str> = block.collect();
        found.push(Part::Block {
            language,
            text: block.join("\n"),
        });
    }
    found
}

/// The name by which a heading is linked to.
fn anchor(heading: &str) -> String {
    let kept = heading.to_lowercase();
    let kept = kept
        .chars()
        .filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

fn anchors(name: &str) -> BTreeSet<String> {
    let text = read(name);
    let headings = parts(&text).into_iter().filter_map(|part| match part {
        Part::Line(line) if line.starts_with('#') => {
            Some(anchor(line.trim_start_matches('#').trim()))
        }
        _ => None,
    });
    headings.collect()
}

/// Targets of the links of a line.
fn links(line: &str) -> Vec<&str> {
    let ends = line.match_indices("](").map(|(at, _)| &line[at + 2..]);
    ends.filter_map(|rest| rest.split_once(')').map(|(target, _)| target))
        .collect()
}

#[test]
fn the_readme_is_short() {
    let bytes = read("README.md").len();
    assert!(bytes <= MOST_README_BYTES, "README.md has {bytes} bytes");
}

/// What is wrong with a link of a document, if anything is.
fn fault_of_link(name: &str, target: &str) -> Option<String> {
    if target.contains("://") {
        return None;
    }
    let (file, heading) = target.split_once('#').unwrap_or((target, ""));
    let folder = Path::new(name).parent().unwrap();
    let path = if file.is_empty() {
        PathBuf::from(name)
    } else {
        folder.join(file)
    };
    if !root().join(&path).exists() {
        return Some(format!("{name} links to {target}: there is no such file"));
    }
    let is_there = heading.is_empty() || anchors(path.to_str().unwrap()).contains(heading);
    (!is_there).then(|| format!("{name} links to {target}: there is no such heading"))
}

#[test]
fn every_link_leads_somewhere() {
    let (mut faults, mut count) = (Vec::new(), 0);
    for name in documents() {
        let text = read(&name);
        for part in parts(&text) {
            let Part::Line(line) = part else { continue };
            for target in links(line) {
                count += 1;
                faults.extend(fault_of_link(&name, target));
            }
        }
    }
    assert!(count > 30, "only {count} links were found");
    assert_none(&faults);
}

/// Words of a command line as a shell would have them, up to a comment or another command.
fn words(line: &str) -> Vec<String> {
    let (mut words, mut word, mut quote) = (Vec::new(), None::<String>, None);
    for character in line.chars() {
        match (quote, character) {
            (Some(end), _) if character == end => quote = None,
            (None, '\'' | '"') => {
                quote = Some(character);
                word.get_or_insert_default();
            }
            (None, '#' | '>' | '|' | '&' | ';') if word.is_none() => break,
            (None, ' ') => words.extend(word.take()),
            _ => word.get_or_insert_default().push(character),
        }
    }
    words.extend(word);
    words
}

/// The arguments of swath in a line of a block, if it runs swath.
fn arguments(line: &str) -> Option<Vec<String>> {
    let line = line.trim();
    let rest = ["swath ", "cargo run --release -- "]
        .iter()
        .find_map(|start| line.strip_prefix(start))?;
    Some(words(rest))
}

/// Every command of swath that documents show in blocks: where, and its arguments.
fn commands_in_blocks() -> Vec<(String, Vec<String>)> {
    let mut found = Vec::new();
    for name in documents() {
        let text = read(&name);
        for part in parts(&text) {
            let Part::Block { language, text } = part else {
                continue;
            };
            if !LANGUAGES_OF_COMMANDS.contains(&language) {
                continue;
            }
            let text = text.replace("\\\n", " ");
            let commands = text.lines().filter_map(arguments);
            found.extend(commands.map(|command| (name.clone(), command)));
        }
    }
    found
}

/// Every command of swath that documents name within a line.
fn commands_in_lines() -> Vec<(String, Vec<String>)> {
    let mut found = Vec::new();
    for name in documents() {
        let text = read(&name);
        // A command may be broken over lines of text.
        let lines = parts(&text).into_iter().map(|part| match part {
            Part::Line("") | Part::Block { .. } => "\n",
            Part::Line(line) => line,
        });
        let text = lines.collect::<Vec<_>>().join(" ");
        for paragraph in text.lines() {
            let code = paragraph.split('`').skip(1).step_by(2);
            let commands = code.filter_map(arguments);
            found.extend(commands.map(|command| (name.clone(), command)));
        }
    }
    found
}

fn swath() -> Command {
    Command::cargo_bin("swath").unwrap()
}

/// The help text of a command, if there is such a command.
fn help(command: &[&str]) -> Option<String> {
    let output = swath().args(command).arg("--help").output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    output.status.success().then_some(text)
}

/// Shows all faults at once.
fn assert_none(faults: &[String]) {
    assert!(
        faults.is_empty(),
        "{} faults:\n{}",
        faults.len(),
        faults.join("\n")
    );
}

/// Names of the commands that a help text lists.
fn listed(help: &str) -> Vec<String> {
    let commands = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let commands = commands.take_while(|line| line.starts_with("  "));
    // Lines that go on with a description are indented further.
    let first = commands.filter(|line| !line.starts_with("   "));
    let names = first.filter_map(|line| line.split_whitespace().next());
    names
        .filter(|name| *name != "help")
        .map(str::to_owned)
        .collect()
}

#[test]
fn every_command_in_a_block_is_one_that_swath_understands() {
    let commands = commands_in_blocks();
    assert!(
        commands.len() > 20,
        "only {} commands were found",
        commands.len()
    );
    let mut faults = Vec::new();
    for (name, command) in commands {
        // Help comes once everything before it was parsed.
        let output = swath().args(&command).arg("--help").output().unwrap();
        if !output.status.success() {
            let error = String::from_utf8_lossy(&output.stderr);
            let error = error.lines().next().unwrap_or_default();
            faults.push(format!("{name}: swath {}: {error}", command.join(" ")));
        }
    }
    assert_none(&faults);
}

#[test]
fn every_configuration_in_a_block_is_one_that_swath_takes() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("block.toml");
    let (mut faults, mut count) = (Vec::new(), 0);
    for name in documents() {
        let text = read(&name);
        for part in parts(&text) {
            let Part::Block { language, text } = part else {
                continue;
            };
            if language != "toml" {
                continue;
            }
            count += 1;
            std::fs::write(&path, text).unwrap();
            let output = swath().arg("--config").arg(&path).arg("config").output();
            let output = output.unwrap();
            if !output.status.success() {
                let error = String::from_utf8_lossy(&output.stderr);
                faults.push(format!("{name}: {error}"));
            }
        }
    }
    assert!(count > 0, "no configuration was found");
    assert_none(&faults);
}

#[test]
fn every_option_in_the_text_belongs_to_its_command() {
    let commands = commands_in_lines();
    assert!(
        commands.len() > 20,
        "only {} commands were found",
        commands.len()
    );
    let mut faults = Vec::new();
    for (name, command) in commands {
        let path: Vec<&str> = command.iter().map(String::as_str).collect();
        let path = match path[..] {
            ["bridge", second, ..] if !second.starts_with('-') => vec!["bridge", second],
            [first, ..] if !first.starts_with('-') => vec![first],
            _ => Vec::new(),
        };
        let Some(help) = help(&path) else {
            faults.push(format!(
                "{name}: there is no command swath {}",
                path.join(" ")
            ));
            continue;
        };
        let options = command.iter().filter(|word| word.starts_with("--"));
        for option in options {
            let option = option.split('=').next().unwrap();
            let mut shown = help.split(|c: char| c.is_whitespace() || c == ',');
            if !shown.any(|word| word == option) {
                faults.push(format!("{name}: swath {} has no {option}", path.join(" ")));
            }
        }
    }
    assert_none(&faults);
}

#[test]
fn the_readme_lists_every_command() {
    let readme = read("README.md");
    for command in listed(&help(&[]).unwrap()) {
        if command == "bridge" {
            for part in listed(&help(&["bridge"]).unwrap()) {
                assert!(
                    readme.contains(&format!("| `swath bridge {part}` |")),
                    "bridge {part}"
                );
            }
            continue;
        }
        assert!(
            readme.contains(&format!("| `swath {command}` |")),
            "{command}"
        );
    }
}

#[test]
fn the_readme_lists_every_method() {
    let readme = read("README.md");
    for method in Method::ALL {
        assert!(
            readme.contains(&format!("| `{}` |", method.name())),
            "{}",
            method.name()
        );
    }
}

/// A key with a sign in place of each name that varies.
fn pattern(key: &str) -> String {
    let parts = key.split('/').map(|part| {
        let varies = part.starts_with(['{', '<']);
        if varies { "*" } else { part }
    });
    parts.collect::<Vec<_>>().join("/")
}

#[test]
fn the_readme_lists_every_key() {
    let readme = read("README.md");
    let shown: BTreeSet<String> = readme
        .split('`')
        .skip(1)
        .step_by(2)
        .filter(|code| code.starts_with("swath/"))
        .map(pattern)
        .collect();
    let source = read("bridge/src/keys.rs");
    let keys = source.match_indices("format!(\"swath/").map(|(at, _)| {
        let rest = &source[at + "format!(\"".len()..];
        pattern(&rest[..rest.find('"').unwrap()])
    });
    let keys: BTreeSet<String> = keys.collect();
    assert!(keys.len() > 10, "{keys:?}");
    let missing = keys
        .difference(&shown)
        .map(|key| format!("README.md does not list {key}"));
    let extra = shown
        .difference(&keys)
        .map(|key| format!("there is no key {key}, but README.md lists it"));
    assert_none(&missing.chain(extra).collect::<Vec<_>>());
}

#[test]
fn the_example_of_the_readme_is_one_that_is_built() {
    let (readme, example) = (read("README.md"), read("planner/examples/plan.rs"));
    let blocks: Vec<String> = parts(&readme)
        .into_iter()
        .filter_map(|part| match part {
            Part::Block {
                language: "rust",
                text,
            } => Some(text),
            _ => None,
        })
        .collect();
    assert_eq!(blocks.len(), 1);
    assert!(
        example.contains(&blocks[0]),
        "planner/examples/plan.rs differs from README.md"
    );
}
