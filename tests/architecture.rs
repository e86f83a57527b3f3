//! The rules of ARCHITECTURE.md that a compiler does not hold.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use cargo_metadata::{DependencyKind, MetadataCommand};

/// What each crate may use of the workspace and of the libraries that are kept in one place.
const ALLOWED: &[(&str, &[&str])] = &[
    ("swath-bridge", &["zenoh", "zenoh-ext", "mcap"]),
    (
        "swath-planner",
        &["swath-bridge", "candle-core", "candle-nn"],
    ),
    ("swath-generator", &["swath-bridge", "swath-planner"]),
    (
        "swath-trainer",
        &["swath-bridge", "swath-planner", "candle-core", "candle-nn"],
    ),
    ("swath-analysis", &["swath-bridge", "polars"]),
    (
        "swath",
        &[
            "swath-analysis",
            "swath-bridge",
            "swath-generator",
            "swath-planner",
            "swath-trainer",
        ],
    ),
];

/// Libraries that only the crates that list them in [`ALLOWED`] may use.
const KEPT: &[&str] = &[
    "zenoh",
    "zenoh-ext",
    "mcap",
    "polars",
    "candle-core",
    "candle-nn",
];

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

/// Every source file of a crate below `src/`, with its text up to the inline tests.
fn sources(crate_folder: &str) -> BTreeMap<String, String> {
    fn visit(folder: &Path, found: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                visit(&path, found);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                found.push(path);
            }
        }
    }
    let mut found = Vec::new();
    visit(&root().join(crate_folder).join("src"), &mut found);
    let named = found.into_iter().map(|path| {
        let name = path
            .strip_prefix(root())
            .unwrap()
            .to_string_lossy()
            .replace('\\', "/");
        let text = std::fs::read_to_string(&path).unwrap();
        let code = text.split("#[cfg(test)]").next().unwrap().to_owned();
        (name, code)
    });
    named
        .filter(|(name, _)| !name.ends_with("tests.rs") && !name.contains("/tests/"))
        .collect()
}

/// Files that mention a word outside comments.
fn mentions(crate_folder: &str, word: &str) -> Vec<String> {
    let holds = |text: &String| {
        text.lines()
            .any(|line| line.split("//").next().unwrap_or_default().contains(word))
    };
    sources(crate_folder)
        .into_iter()
        .filter(|(_, text)| holds(text))
        .map(|(name, _)| name)
        .collect()
}

#[test]
fn crates_depend_only_on_what_the_design_allows() {
    let metadata = MetadataCommand::new()
        .current_dir(root())
        .no_deps()
        .exec()
        .unwrap();
    assert_eq!(metadata.packages.len(), ALLOWED.len());
    for package in &metadata.packages {
        let name = package.name.as_str();
        let (_, allowed) = ALLOWED.iter().find(|(known, _)| *known == name).unwrap();
        for dependency in &package.dependencies {
            let used = dependency.name.as_str();
            let is_ours = used.starts_with("swath-");
            if dependency.kind == DependencyKind::Normal && (is_ours || KEPT.contains(&used)) {
                assert!(allowed.contains(&used), "{name} must not depend on {used}");
            }
        }
    }
}

#[test]
fn only_nodes_talk_to_sessions() {
    for crate_folder in ["planner", "generator", "trainer", "analysis"] {
        for word in ["Session", "Publisher<", "Subscriber<", "tokio::"] {
            for file in mentions(crate_folder, word) {
                let is_node = file.ends_with("/node.rs") || file.contains("/node/");
                assert!(is_node, "{file} mentions {word}, which only a node may");
            }
        }
    }
}

#[test]
fn the_wall_clock_is_read_in_one_place() {
    for crate_folder in ["bridge", "planner", "generator", "trainer", "analysis", "."] {
        for file in mentions(crate_folder, "SystemTime::now") {
            assert_eq!(file, "bridge/src/clock.rs");
        }
    }
}

#[test]
fn cores_neither_read_files_nor_clocks() {
    let cores = [
        "action",
        "check",
        "collision",
        "dubins",
        "ground",
        "guidance",
        "hybrid",
        "kernel",
        "motion",
        "plane",
        "rrt_star",
        "search",
        "segment",
        "smooth",
        "targets",
    ];
    for word in ["std::fs", "Instant::now", "clock::now_nanos"] {
        for file in mentions("planner", word) {
            let module = file
                .trim_start_matches("planner/src/")
                .split(['/', '.'])
                .next()
                .unwrap();
            assert!(!cores.contains(&module), "{file} mentions {word}");
        }
        for file in mentions("generator", word) {
            assert!(file.contains("node"), "{file} mentions {word}");
        }
    }
}

#[test]
fn unsafe_code_stays_in_the_kernel_module() {
    for crate_folder in ["bridge", "planner", "generator", "trainer", "analysis", "."] {
        for file in mentions(crate_folder, "unsafe ") {
            assert!(
                file.starts_with("planner/src/network/engine/kernel"),
                "{file} has unsafe code"
            );
        }
    }
}
