//! `cargo run` and `cargo test --workspace` share the builds of their dependencies: the same features,
//! whether dev-dependencies count or not. Otherwise the first test after a demo builds polars again.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::collections::BTreeMap;
use std::process::Command;

/// Features of each package in a tree of dependencies, by name and version. A package that is built for
/// the host and for the target appears with the features of both.
fn features(arguments: &[&str]) -> BTreeMap<String, Vec<String>> {
    let output = Command::new(env!("CARGO"))
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .args(["tree", "--locked", "--prefix", "none"])
        .args(["--format", "{p}|{f}"])
        .args(arguments)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let mut found: BTreeMap<String, Vec<String>> = BTreeMap::new();
    for line in String::from_utf8(output.stdout).unwrap().lines() {
        if let Some((package, features)) = line.split_once('|') {
            let features = features.trim_end_matches(" (*)");
            let kinds = found.entry(package.to_owned()).or_default();
            if !kinds.iter().any(|known| known == features) {
                kinds.push(features.to_owned());
            }
        }
    }
    found
}

#[test]
fn running_and_testing_build_dependencies_with_the_same_features() {
    let run = features(&["--package", "swath", "--edges", "normal,build"]);
    let test = features(&["--workspace", "--edges", "normal,build,dev"]);
    assert!(run.len() > 100, "{} packages", run.len());
    let mut differences = Vec::new();
    for (package, kinds) in &run {
        let in_tests = &test[package];
        for kind in kinds {
            if !in_tests.contains(kind) {
                differences.push(format!("{package}: `{kind}` to run, {in_tests:?} to test"));
            }
        }
    }
    assert!(
        differences.is_empty(),
        "name these features in the root's Cargo.toml:\n{}",
        differences.join("\n")
    );
}
