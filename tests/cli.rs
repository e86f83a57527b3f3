//! The commands as a person or a script meets them: results, errors, exit codes.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use serde_json::Value;
use swath_bridge::Vehicle;
use tempfile::TempDir;

const ROWS: usize = 401;
const COLS: usize = 151;
/// Trainings of which one is to be killed on its way.
const ATTEMPTS: usize = 20;

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
fn values_out_of_range_are_wrong_usage_and_their_range_is_said() {
    let name = "letters, digits";
    for (arguments, said) in [
        ("generate --count 0", "1 or more"),
        ("generate --count -1", "1 or more"),
        ("generate --workers 100000", "0 to 256"),
        ("generate --id a/b", name),
        ("generate --id a*", name),
        ("generate --id $a", name),
        ("generate --seed -1", "-1"),
        ("--namespace a//b generate", name),
        ("bench --out b --scenes 0", "1 or more"),
        ("bench --out b --targets 0", "1 to 256"),
        ("bench --out b --targets 1,257", "1 to 256"),
        ("train --out t --batch 0", "1 to 4096"),
        ("train --out t --epochs 0", "1 to 1000000"),
        ("train --out t --learning-rate -1", "0.000000001 to 1"),
        ("train --out t --learning-rate nan", "0.000000001 to 1"),
        ("train --out t --hard 1.5", "0 to 1"),
        ("train --out t --keep 0", "1 to "),
        ("train --out t --publish-every 0", "1 or more"),
        ("train --out t --run a/b", name),
        ("train --out t --data a.mcap:0", "1 to 255"),
        ("train --out t --data a.mcap:256", "1 to 255"),
        ("evaluate --data a --dilation-m -1", "0.1 to 10"),
        ("evaluate --data a --picture a.svg", ".png"),
        ("demo --seconds 1", "5 to 86400"),
    ] {
        let assert = swath().args(arguments.split(' ')).assert().code(2);
        let stderr = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
        assert!(stderr.contains(said), "{arguments}: {stderr}");
    }
    for empty in [["generate", "--id", ""], ["train", "--run", ""]] {
        swath().args(empty).assert().code(2);
    }
    let most = u64::MAX.to_string();
    let arguments = ["generate", "--seed", &most, "--count", "1", "--out"];
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("made/for/it.mcap");
    swath().args(arguments).arg(&out).assert().success();
    assert!(out.exists(), "its folder is made");
}

#[test]
fn places_that_cannot_be_written_to_are_refused_before_the_work_begins() {
    let folder = tempfile::tempdir().unwrap();
    let text = |path: PathBuf| path.display().to_string();
    let file = text(write(&folder, "file", ""));
    let below = format!("{file}/out.png");
    // None of the inputs is there: the outputs are looked at first.
    for arguments in [
        ["generate", "--log", "none.mcap", "--out", &below],
        ["train", "--data", "none.mcap", "--out", &file],
        ["bench", "--log", "none.mcap", "--out", &below],
        ["evaluate", "--data", "none.mcap", "--out", &below],
        ["evaluate", "--data", "none.mcap", "--picture", &below],
        ["export", "--weights", "none", "--onnx", &below],
        ["demo", "--log", "none.mcap", "--out", &file],
    ] {
        fails(&arguments, &file, "expected a folder");
    }
    fails(
        &["report", "none.mcap", "--out", &file],
        &file,
        "expected a folder",
    );
    let here = text(folder.path().to_owned());
    fails(&["export", "--onnx", &here], &here, "it is a folder");
    for arguments in [
        ["generate", "--log", &file, "--out", &file],
        ["evaluate", "--data", &file, "--out", &file],
        ["export", "--weights", &file, "--onnx", &file],
    ] {
        fails(&arguments, &file, "made from");
    }
}

/// Files that cannot be used, where the fault is, and what is said of it.
const BAD_CONFIGURATIONS: &[(&str, &str, &str)] = &[
    (
        "[grid]\nrows = 0\n",
        "line 2, [grid]",
        "rows is 0, expected 1 to 4096",
    ),
    (
        "[grid]\nrows = 200\n",
        "[grid]",
        "ego_row is 300, expected 0 to 199",
    ),
    (
        "[vehicle]\nfront_m = -1.0\n",
        "line 2, [vehicle]",
        "front_m is -1",
    ),
    (
        "\n[targets]\ncount = 300\n",
        "line 3, [targets]",
        "count is 300, expected 0 to 256",
    ),
    (
        "[obstacles]\nthreshold_percent = 0\n",
        "line 2, [obstacles]",
        "expected 1 to 100",
    ),
    (
        "[train]\nbatch = 0\n",
        "line 2, [train]",
        "batch is 0, expected 1 to 4096",
    ),
    (
        "[train.loss]\ndice_weight = -1.0\n",
        "line 2, [train]",
        "loss.dice_weight",
    ),
    (
        "[follow]\nexpires_s = -1\n",
        "line 2, [follow]",
        "expires_s is -1",
    ),
    (
        "[ingest]\nclear_m = nan\n",
        "line 2, [ingest]",
        "clear_m is NaN, expected 0 to 1000",
    ),
    (
        "[generator.lidar]\ndropout = 2.0\n",
        "line 2, [generator]",
        "lidar.dropout",
    ),
    (
        "[generator.grid]\nrows = 350\n",
        "line 1, [generator]",
        "grid differs from [grid]",
    ),
    ("[grid]\nrows = -1\n", "line 2", "expected u32"),
    ("[grid]\nlines = 1\n", "line 2", "unknown field `lines`"),
];

#[test]
fn a_configuration_that_cannot_be_used_is_named_by_line_section_and_key_and_the_cause_once() {
    let folder = tempfile::tempdir().unwrap();
    for &(lines, place, said) in BAD_CONFIGURATIONS {
        let file = write(&folder, "swath.toml", lines).display().to_string();
        let onnx = folder.path().join("out.onnx").display().to_string();
        let arguments = ["--config", &file, "export", "--onnx", &onnx];
        fails(&arguments, &file, place);
        fails(&arguments, &file, said);
    }
    let missing = folder.path().join("missing").display().to_string();
    for arguments in [
        &["--config", &missing, "export", "--onnx", "out.onnx"][..],
        &["report", &missing, "--out", "out"],
        &["evaluate", "--data", &missing],
        &["evaluate", "--data", &missing, "--weights", &missing],
        &["generate", "--log", &missing, "--out", "/dev/null"],
        &["train", "--data", &missing, "--out", "out"],
    ] {
        let assert = swath().args(arguments).assert().code(1);
        let stderr = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
        assert_eq!(stderr.matches("No such file").count(), 1, "{stderr}");
        assert_eq!(stderr.matches(&missing).count(), 1, "{stderr}");
    }
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

    // One that has ended before it could be killed proves nothing, and is tried again.
    let was_killed = || {
        let _ = std::fs::remove_dir_all(&broken);
        let mut child = train(&broken, &[]);
        while !broken.join("checkpoint.safetensors").exists() {
            assert!(
                child
                    .try_wait()
                    .unwrap()
                    .is_none_or(|status| status.success()),
                "ended without a checkpoint"
            );
            std::thread::yield_now();
        }
        child.kill().unwrap();
        !child.wait().unwrap().success()
    };
    assert!((0..ATTEMPTS).any(|_| was_killed()), "never killed in time");
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
