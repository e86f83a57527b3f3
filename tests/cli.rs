//! The commands as a person or a script meets them: results, errors, exit codes.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use assert_cmd::Command;
use serde_json::Value;
use swath_bridge::Vehicle;
use tempfile::TempDir;

const ROWS: usize = 401;
const COLS: usize = 151;

fn swath() -> Command {
    Command::cargo_bin("swath").unwrap()
}

/// A map with a wall across the road that leaves a gap on the left.
fn write_map(folder: &Path) -> PathBuf {
    let path = folder.join("map.pgm");
    let mut bytes = format!("P5\n{COLS} {ROWS}\n255\n").into_bytes();
    for row in 0..ROWS {
        for col in 0..COLS {
            let is_wall = (200..203).contains(&row) && col > 55;
            bytes.push(if is_wall { 0 } else { 255 });
        }
    }
    std::fs::write(&path, bytes).unwrap();
    path
}

fn write(folder: &TempDir, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn numbers(value: &Value) -> Vec<f64> {
    value
        .as_array()
        .unwrap()
        .iter()
        .map(|number| number.as_f64().unwrap())
        .collect()
}

#[test]
fn plan_prints_the_json_it_promises() {
    let folder = tempfile::tempdir().unwrap();
    let map = write_map(folder.path());
    let goals = write(
        &folder,
        "goals.txt",
        "# x y yaw\n40 0 0\n19.9 0 0\n500 0 0\n",
    );
    let output = swath()
        .args(["plan", "--json", "-", "--picture"])
        .arg(folder.path().join("plan.png"))
        .arg("--map")
        .arg(&map)
        .arg("--goals")
        .arg(&goals)
        .assert()
        .success();
    let plan: Value = serde_json::from_slice(&output.get_output().stdout).unwrap();
    assert_eq!(plan["method"], "swath");
    for time in ["network_ms", "search_ms", "cpu_ms", "total_ms", "smooth_ms"] {
        assert!(plan[time].as_f64().unwrap() >= 0.0, "{time}");
    }
    let targets = plan["targets"].as_array().unwrap();
    let statuses: Vec<&str> = targets
        .iter()
        .map(|t| t["status"].as_str().unwrap())
        .collect();
    assert_eq!(statuses, ["solved", "goal_occupied", "out_of_bounds"]);
    assert!(targets[1]["cost"].is_null() && targets[1]["path"].as_array().unwrap().is_empty());

    let path: Vec<Vec<f64>> = targets[0]["path"]
        .as_array()
        .unwrap()
        .iter()
        .map(numbers)
        .collect();
    assert_eq!(path[0], [0.0, 0.0, 0.0]);
    let last = &path[path.len() - 1];
    assert!((last[0] - 40.0).hypot(last[1]) <= 0.5 && last[2].abs() <= 15f64.to_radians());
    assert_eq!(targets[0]["drivability"], "at_speed");
    let curvatures = numbers(&targets[0]["curvature_per_m"]);
    assert_eq!(curvatures.len(), path.len());
    let tightest = 1.0 / Vehicle::default().min_turning_radius_m;
    assert!(
        curvatures
            .iter()
            .all(|curvature| curvature.abs() <= tightest + 1e-9)
    );
    for pair in path.windows(2) {
        let step_m = (pair[1][0] - pair[0][0]).hypot(pair[1][1] - pair[0][1]);
        assert!(step_m <= 0.2 + 1e-9);
        assert!((pair[1][2] - pair[0][2]).abs() <= tightest * step_m + 1e-3);
    }
    assert!(folder.path().join("plan.png").metadata().unwrap().len() > 1000);
}

/// Fails, with the code of a failure, naming the file and what was found.
fn fails(arguments: &[&str], file: &str, said: &str) {
    let assert = swath().args(arguments).assert().code(1);
    let stderr = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
    assert!(
        stderr.contains(file),
        "{arguments:?} does not name {file}: {stderr}"
    );
    assert!(
        stderr.contains(said),
        "{arguments:?} does not say {said}: {stderr}"
    );
    assert!(!stderr.contains("panicked"), "{stderr}");
}

#[test]
fn wrong_maps_goals_and_weights_are_named_with_the_place_and_what_was_expected() {
    let folder = tempfile::tempdir().unwrap();
    let map = write_map(folder.path());
    let cut = std::fs::read(&map).unwrap()[..1000].to_vec();
    let text = |path: PathBuf| path.display().to_string();
    let map = text(map);
    let goals = text(write(&folder, "goals.txt", "10 0 0\n"));
    let bad_goals = text(write(&folder, "bad-goals.txt", "10 0 0\n12 zero 0\n"));
    let empty = text(write(&folder, "empty", ""));
    let junk = text(write(&folder, "junk", [0x5a; 300]));
    let cut = text(write(&folder, "cut.pgm", cut));
    let missing = text(folder.path().join("missing"));
    for (map, said) in [
        (&missing, "No such file"),
        (&empty, "byte 0"),
        (&junk, "byte 0"),
        (&cut, "byte"),
    ] {
        fails(&["plan", "--map", map, "--goals", &goals], map, said);
    }
    fails(
        &["plan", "--map", &map, "--goals", &bad_goals],
        &bad_goals,
        "line 2",
    );
    for weights in [&junk, &empty] {
        let arguments = [
            "plan",
            "--map",
            &map,
            "--goals",
            &goals,
            "--method",
            "tiev-fcn",
            "--weights",
            weights,
        ];
        fails(&arguments, weights, "expected");
    }
}

#[test]
fn wrong_recordings_are_named_with_the_place_and_what_was_expected() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out").display().to_string();
    for (name, bytes) in [("junk", vec![0x5a; 300]), ("empty", Vec::new())] {
        let file = write(&folder, name, bytes).display().to_string();
        fails(&["bridge", "info", &file], &file, "byte 0");
        fails(
            &["bridge", "recover", &file, "--out", &out],
            &file,
            "byte 0",
        );
        fails(&["bridge", "grids", &file, "--out", &out], &file, "byte 0");
        fails(&["train", "--data", &file, "--out", &out], &file, "byte 0");
        fails(&["report", &file, "--out", &out], &file, "byte 0");
    }
    let junk = folder.path().join("junk").display().to_string();
    fails(&["--config", &junk, "demo"], &junk, "line 1");
}

#[test]
fn wrong_usage_is_told_apart_and_says_what_to_do() {
    swath().arg("fly").assert().code(2);
    swath()
        .args(["plan", "--map", "only-a-map.pgm"])
        .assert()
        .code(2);
    swath().args(["plan", "--method", "magic"]).assert().code(2);
}

#[test]
fn the_network_that_comes_with_swath_plans_where_it_fits() {
    let folder = tempfile::tempdir().unwrap();
    let map = write_map(folder.path());
    let goals = write(&folder, "goals.txt", "30 0 0\n");
    let reference = write(&folder, "reference.txt", "0 0 0\n55 0 0\n");
    let plan = |more: &[&str]| -> Value {
        let assert = swath()
            .args(["plan", "--json", "-", "--map"])
            .arg(&map)
            .arg("--goals")
            .arg(&goals)
            .arg("--reference")
            .arg(&reference)
            .args(more)
            .assert()
            .success();
        serde_json::from_slice(&assert.get_output().stdout).unwrap()
    };
    let with = plan(&["--method", "tiev-fcn"]);
    assert_eq!(with["method"], "tiev-fcn");
    assert!(with["network_ms"].as_f64().unwrap() > 0.0);
    assert_eq!(with["targets"][0]["status"], "solved");
    assert_eq!(plan(&[])["network_ms"], 0.0);
    for method in [
        "weighted",
        "hybrid",
        "hybrid-fcn",
        "rrt-star",
        "rrt-star-fcn",
    ] {
        let planned = plan(&["--method", method]);
        assert_eq!(planned["method"], method);
        assert_eq!(planned["targets"][0]["status"], "solved", "{method}");
        let has_region = planned["network_ms"].as_f64().unwrap() > 0.0;
        assert_eq!(has_region, method.ends_with("-fcn"));
    }
}

#[test]
fn every_command_has_help_with_an_example() {
    for command in [
        "demo", "generate", "train", "evaluate", "export", "plan", "bench", "report",
    ] {
        let assert = swath().args([command, "--help"]).assert().success();
        let help = String::from_utf8_lossy(&assert.get_output().stdout).into_owned();
        assert!(help.contains(&format!("swath {command}")), "{help}");
        assert!(help.contains("Example"), "{help}");
    }
}

fn generate(out: &Path, count: &str) {
    swath()
        .args(["generate", "--seed", "7", "--count", count, "--out"])
        .arg(out)
        .assert()
        .success();
}

#[test]
fn a_seed_gives_the_same_file_and_a_killed_training_ends_as_an_unbroken_one() {
    let folder = tempfile::tempdir().unwrap();
    let (data, again) = (folder.path().join("a.mcap"), folder.path().join("b.mcap"));
    generate(&data, "40");
    generate(&again, "40");
    assert_eq!(
        std::fs::read(&data).unwrap(),
        std::fs::read(&again).unwrap()
    );

    let train = |out: &Path, more: &[&str]| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_swath"));
        command.args(["train", "--epochs", "4", "--batch", "8", "--size", "half"]);
        command
            .args(more)
            .arg("--data")
            .arg(&data)
            .arg("--out")
            .arg(out);
        command.stdout(std::process::Stdio::null()).spawn().unwrap()
    };
    let (whole, broken) = (folder.path().join("whole"), folder.path().join("broken"));
    assert!(train(&whole, &[]).wait().unwrap().success());

    let mut child = train(&broken, &[]);
    let began = Instant::now();
    while !broken.join("checkpoint.safetensors").exists() {
        assert!(
            began.elapsed() < Duration::from_mins(2),
            "no checkpoint was written"
        );
        assert!(
            child.try_wait().unwrap().is_none(),
            "ended before it could be killed"
        );
        std::thread::yield_now();
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let weights = |folder: &Path| std::fs::read(folder.join("weights.safetensors")).unwrap();
    assert!(train(&broken, &["--resume"]).wait().unwrap().success());
    assert!(
        weights(&whole) == weights(&broken),
        "resumed training differs"
    );

    let evaluated = swath()
        .args(["evaluate", "--json", "--data"])
        .arg(&data)
        .arg("--weights")
        .arg(whole.join("weights.safetensors"))
        .assert()
        .success();
    let scores: Value = serde_json::from_slice(&evaluated.get_output().stdout).unwrap();
    for key in [
        "samples",
        "miou",
        "iou_path",
        "iou_background",
        "ms_per_sample",
    ] {
        assert!(scores[key].as_f64().unwrap() > 0.0, "{key}");
    }
    assert_eq!(scores["baselines"].as_array().unwrap().len(), 2);
}

#[test]
fn a_truncated_recording_is_recovered_and_the_loss_is_an_exit_code() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("a.mcap");
    generate(&data, "60");
    let bytes = std::fs::read(&data).unwrap();
    let cut = write(&folder, "cut.mcap", &bytes[..bytes.len() * 2 / 3]);
    let good = folder.path().join("good.mcap");
    swath()
        .args(["bridge", "recover"])
        .arg(&cut)
        .arg("--out")
        .arg(&good)
        .assert()
        .code(3);
    let assert = swath()
        .args(["bridge", "info", "--json"])
        .arg(&good)
        .assert()
        .success();
    let info: Value = serde_json::from_slice(&assert.get_output().stdout).unwrap();
    assert!(info["messages"].as_u64().unwrap() > 0 && info["damage"].is_null());
}
