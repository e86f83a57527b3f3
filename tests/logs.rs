//! Logs and recordings on the command line: nothing is overwritten, causes are said once, wrong values are
//! wrong usage.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use serde_json::Value;
use swath_bridge::msg::geometry::{PoseWithCovariance, Twist, TwistWithCovariance, Vector3};
use swath_bridge::msg::header::Header;
use swath_bridge::msg::nav::Odometry;
use swath_bridge::msg::sensor::LaserScan;
use swath_bridge::poses::ros_pose;
use swath_bridge::recording::Writer;
use swath_bridge::{Pose2, keys};
use tempfile::TempDir;

const NOW: u64 = 1_700_000_000_000_000_000;

fn swath() -> Command {
    Command::cargo_bin("swath").unwrap()
}

/// Runs a command that is to fail with a code, and gives what it says on standard error.
fn fails(arguments: &[&str], code: i32) -> String {
    let assert = swath().args(arguments).assert().code(code);
    let stderr = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
    assert!(!stderr.contains("panicked"), "{stderr}");
    stderr
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A log of a vehicle that drives along a wall on its left; nobody says where its scanner is.
fn write_log(path: &Path, steps: std::ops::Range<u64>) {
    let still = Vector3 {
        x: 0.0,
        y: 0.0,
        z: 0.0,
    };
    let mut writer = Writer::create(path).unwrap();
    for step in steps {
        let nanos = NOW + step * 100_000_000;
        let odometry = Odometry {
            header: Header::at(nanos, "odom"),
            child_frame_id: "base_link".to_owned(),
            pose: PoseWithCovariance {
                pose: ros_pose(&Pose2::new(0.5 * step as f64, 0.0, 0.0)),
                covariance: [0.0; 36],
            },
            twist: TwistWithCovariance {
                twist: Twist {
                    linear: still.clone(),
                    angular: still.clone(),
                },
                covariance: [0.0; 36],
            },
        };
        writer.write_as("/odom", &odometry, nanos, nanos).unwrap();
        let scan = LaserScan {
            header: Header::at(nanos, "laser"),
            angle_min: 0.3,
            angle_max: 2.8,
            angle_increment: 0.02,
            time_increment: 0.0,
            scan_time: 0.1,
            range_min: 0.1,
            range_max: 40.0,
            ranges: (0..126u8)
                .map(|beam| 6.0 / (0.3 + 0.02 * f32::from(beam)).sin())
                .collect(),
            intensities: Vec::new(),
        };
        writer.write_as("/scan", &scan, nanos, nanos).unwrap();
    }
    writer.finish().unwrap();
}

fn generate(out: &Path, more: &[&str]) -> assert_cmd::assert::Assert {
    let mut command = swath();
    command
        .args(["generate", "--count", "6", "--out"])
        .arg(out)
        .args(more);
    command.assert()
}

/// A folder with a recording, one that was not finished, and a log.
struct Given {
    folder: TempDir,
    samples: PathBuf,
    unfinished: PathBuf,
    log: PathBuf,
}

fn given() -> Given {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (samples, unfinished, log) = (path("samples.mcap"), path("cut.mcap"), path("log.mcap"));
    generate(&samples, &[]).success();
    let bytes = std::fs::read(&samples).unwrap();
    std::fs::write(&unfinished, &bytes[..bytes.len() * 2 / 3]).unwrap();
    write_log(&log, 0..40);
    Given {
        folder,
        samples,
        unfinished,
        log,
    }
}

#[test]
fn no_command_overwrites_a_recording_unless_forced() {
    let given = given();
    let (samples, log) = (text(&given.samples), text(&given.log));
    let mount = "--mount=0,0,0,0,0,0";
    let commands: &[&[&str]] = &[
        &["generate", "--count", "3"],
        &[
            "bench",
            "--scenes",
            "1",
            "--targets",
            "1",
            "--methods",
            "weighted",
        ],
        &["evaluate", "--data", samples],
        &["bridge", "grids", log, mount],
        &["bridge", "recover", log],
    ];
    for arguments in commands {
        for (out, is_unfinished) in [("whole.mcap", false), ("cut-too.mcap", true)] {
            let out = given.folder.path().join(out);
            let original = if is_unfinished {
                &given.unfinished
            } else {
                &given.samples
            };
            std::fs::copy(original, &out).unwrap();
            let before = std::fs::read(&out).unwrap();
            let with_out = [arguments, &["--out", text(&out)][..]].concat();
            let said = fails(&with_out, 1);
            assert!(
                said.contains(text(&out)) && said.contains("--force"),
                "{said}"
            );
            assert_eq!(
                said.contains("swath bridge recover"),
                is_unfinished,
                "{said}"
            );
            assert!(std::fs::read(&out).unwrap() == before, "{arguments:?}");
            let forced = [&with_out[..], &["--force"]].concat();
            swath().args(&forced).assert().success();
            assert!(std::fs::read(&out).unwrap() != before, "{arguments:?}");
            std::fs::remove_file(&out).unwrap();
        }
    }
    let said = fails(&["bridge", "record", "--seconds", "1", "--out", samples], 1);
    assert!(
        said.contains("samples.mcap") && said.contains("--force"),
        "{said}"
    );
    // Without a file to replace, --force means nothing.
    fails(&["generate", "--force"], 2);
}

#[test]
fn a_demo_leaves_an_earlier_one_and_a_running_one_alone() {
    let given = given();
    let out = given.folder.path().join("demo");
    std::fs::create_dir(&out).unwrap();
    std::fs::copy(&given.unfinished, out.join("run.mcap")).unwrap();
    let demo = ["demo", "--seconds", "5", "--out", text(&out)];
    let said = fails(&demo, 1);
    assert!(
        said.contains("run.mcap") && said.contains("--force"),
        "{said}"
    );
    assert_eq!(
        std::fs::read_dir(&out).unwrap().count(),
        1,
        "nothing else was written"
    );
    std::fs::remove_file(out.join("run.mcap")).unwrap();
    let running = std::fs::File::open(&out).unwrap();
    running.lock().unwrap();
    for more in [&[][..], &["--force"]] {
        let said = fails(&[&demo[..], more].concat(), 1);
        assert!(said.contains("another demo is running"), "{said}");
    }
    assert_eq!(std::fs::read_dir(&out).unwrap().count(), 0);
}

#[test]
fn a_recording_that_is_given_twice_counts_once() {
    let given = given();
    let path = |name: &str| given.folder.path().join(name);
    std::fs::copy(&given.samples, path("copy.mcap")).unwrap();
    std::os::unix::fs::symlink(&given.samples, path("link.mcap")).unwrap();
    let round = given.folder.path().join(".").join("samples.mcap");
    let report = |files: &[&Path]| {
        let mut command = swath();
        command
            .args(["report", "--json", "--out"])
            .arg(path("report"))
            .args(files);
        let output = command.assert().success().get_output().clone();
        let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
        (
            summary,
            String::from_utf8_lossy(&output.stderr).into_owned(),
        )
    };
    let (once, said) = report(&[&given.samples]);
    assert!(!said.contains("counts once"), "{said}");
    let (copy, link) = (path("copy.mcap"), path("link.mcap"));
    let (again, said) = report(&[&given.samples, &copy, &link, &round]);
    assert_eq!(again, once);
    assert_eq!(said.matches("counts once").count(), 3, "{said}");
}

#[test]
fn the_cause_of_a_file_that_cannot_be_read_is_said_once() {
    let folder = tempfile::tempdir().unwrap();
    let none = folder.path().join("none.mcap");
    let (none, out) = (text(&none), folder.path().join("out"));
    let out = text(&out);
    for arguments in [
        &["bridge", "info", none][..],
        &["bridge", "grids", none, "--out", out],
        &["bridge", "recover", none, "--out", out],
        &["bridge", "replay", none],
        &["report", none, "--out", out],
        &["train", "--data", none, "--out", out],
        &["evaluate", "--data", none],
        &["generate", "--log", none, "--out", out],
        &["bench", "--log", none, "--out", out],
    ] {
        let said = fails(arguments, 1);
        assert_eq!(
            said.matches("No such file or directory").count(),
            1,
            "{said}"
        );
        assert_eq!(said.matches(none).count(), 1, "{said}");
    }
    let said = fails(&["bridge", "info", text(folder.path())], 1);
    assert!(said.contains("expected a recording"), "{said}");
}

#[test]
fn replay_refuses_values_and_patterns_that_cannot_be_meant() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let mut writer = Writer::create(&path).unwrap();
    let message = swath_bridge::msg::nav::Path {
        header: Header::at(NOW, "base_link"),
        poses: Vec::new(),
    };
    writer.write(&keys::path("v0"), &message, NOW, NOW).unwrap();
    writer.finish().unwrap();
    let path = text(&path);
    for values in [
        &["--rate", "0"][..],
        &["--rate", "nan"],
        &["--rate", "-1"],
        &["--rate", "fast"],
        &["--start", "-1"],
        &["--end", "nan"],
        &["--start", "3", "--end", "2"],
    ] {
        fails(&[&["bridge", "replay", path], values].concat(), 2);
    }
    let said = fails(&["bridge", "replay", path, "--topic", "*/grid"], 1);
    for part in ["run.mcap", "\"*/grid\"", "/swath/vehicle/v0/path"] {
        assert!(said.contains(part), "{said}");
    }
    swath()
        .args([
            "bridge", "replay", path, "--topic", "*/path", "--rate", "inf",
        ])
        .assert()
        .success();
}

#[test]
fn a_folder_is_a_log_for_every_command_that_takes_logs() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("bag");
    std::fs::create_dir(&bag).unwrap();
    write_log(&bag.join("bag_0.mcap"), 0..60);
    write_log(&bag.join("bag_1.mcap"), 60..120);
    let metadata = "rosbag2_bagfile_information:\n  storage_identifier: mcap\n  \
                    relative_file_paths: [bag_0.mcap, bag_1.mcap]\n";
    std::fs::write(bag.join("metadata.yaml"), metadata).unwrap();
    let grids = folder.path().join("grids.mcap");
    let (bag, out) = (text(&bag), text(&grids));
    // Nobody says where the scanner is.
    let said = fails(&["bridge", "grids", bag, "--out", out], 1);
    assert!(said.contains("--mount /scan="), "{said}");
    assert!(!grids.exists());
    let mount = "--mount=/scan=0,0,0.3,0,0,0";
    let assert = swath()
        .args([
            "bridge", "grids", bag, "--out", out, mount, "--clock", "record",
        ])
        .assert()
        .success();
    let said = String::from_utf8_lossy(&assert.get_output().stdout).into_owned();
    assert!(said.contains("120 grids of 120 sweeps on /scan"), "{said}");
    let samples = folder.path().join("samples.mcap");
    generate(&samples, &["--log", bag, mount]).success();
    let bench = folder.path().join("bench.mcap");
    swath()
        .args([
            "bench",
            "--log",
            bag,
            mount,
            "--scenes",
            "1",
            "--targets",
            "1",
        ])
        .args(["--methods", "weighted", "--out", text(&bench)])
        .assert()
        .success();
    // The same from the configuration.
    let config = folder.path().join("swath.toml");
    let section = "[ingest]\nclock = \"record\"\nscan_topics = [\"/scan\"]\n\
                   mount = [{ topic = \"/scan\", z_m = 0.3 }]\n";
    std::fs::write(&config, section).unwrap();
    let again = folder.path().join("again.mcap");
    swath()
        .args([
            "--config",
            text(&config),
            "bridge",
            "grids",
            bag,
            "--out",
            text(&again),
        ])
        .assert()
        .success();
    assert_eq!(
        std::fs::read(&grids).unwrap(),
        std::fs::read(&again).unwrap()
    );
    let packed = fails(&["bridge", "grids", bag, "--out", out, "--mount", "1,2"], 2);
    assert!(packed.contains("x,y,z,roll,pitch,yaw"), "{packed}");
}
