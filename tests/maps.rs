//! Maps, starts on them and pictures, as a person meets them.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::{Path, PathBuf};
use std::sync::Arc;

use assert_cmd::Command;
use serde_json::Value;
use swath_bridge::msg::header::Header;
use swath_bridge::msg::swath::PlanReport;
use swath_bridge::recording::Writer;
use swath_bridge::{FREE, GridSpec, OCCUPIED, Occupancy, Pose2, Vehicle, keys};
use swath_planner::{FrameInput, FramePlanner, MotionModel, PlanConfig, Plane, Start, plan_report};
use tempfile::TempDir;

fn swath() -> Command {
    Command::cargo_bin("swath").unwrap()
}

fn write(folder: &TempDir, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

/// A hall of 300 x 200 pixels of 0.2 m, with a wall from below that leaves a way around its end.
struct Hall {
    pixels: Vec<u8>,
}

const WIDTH: usize = 300;
const HEIGHT: usize = 200;
const CELL_M: f64 = 0.2;
const ORIGIN: Pose2 = Pose2::new(100.0, -50.0, 0.6);

impl Hall {
    fn new() -> Self {
        let mut pixels = vec![254; WIDTH * HEIGHT];
        for row in 60..HEIGHT {
            for col in 150..154 {
                pixels[row * WIDTH + col] = 0;
            }
        }
        Self { pixels }
    }

    fn write(&self, folder: &TempDir) -> PathBuf {
        let mut pgm = format!("P5\n{WIDTH} {HEIGHT}\n255\n").into_bytes();
        pgm.extend_from_slice(&self.pixels);
        write(folder, "hall.pgm", pgm);
        let text = format!(
            "%YAML 1.2\n---\nimage: \"hall.pgm\"\nmode: Trinary\nresolution: '{CELL_M}'\norigin: \
             [{},\n  {}, {}]\nnegate: False\noccupied_thresh: 0.65\nfree_thresh: 0.25\n",
            ORIGIN.x_m, ORIGIN.y_m, ORIGIN.yaw_rad
        );
        write(folder, "hall.yaml", text)
    }

    /// Whether a point of the map's frame lies in a black pixel.
    fn is_black(&self, x_m: f64, y_m: f64) -> bool {
        let (dx, dy) = (x_m - ORIGIN.x_m, y_m - ORIGIN.y_m);
        let (sin, cos) = ORIGIN.yaw_rad.sin_cos();
        let right = ((cos * dx + sin * dy) / CELL_M).floor();
        let up = ((cos * dy - sin * dx) / CELL_M).floor();
        if right < 0.0 || up < 0.0 || right >= WIDTH as f64 || up >= HEIGHT as f64 {
            return false;
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "on the picture"
        )]
        let (right, up) = (right as usize, up as usize);
        self.pixels[(HEIGHT - 1 - up) * WIDTH + right] == 0
    }

    /// Whether the vehicle's rectangle holds a point that is black; points lie 5 cm apart.
    fn is_hit(&self, pose: &Pose2, vehicle: &Vehicle) -> bool {
        let steps = |from: f64, to: f64| {
            let count = ((to - from) / 0.05).ceil();
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a few hundred"
            )]
            let count = count as usize;
            (0..=count).map(move |step| from + (to - from) * step as f64 / count as f64)
        };
        steps(-vehicle.rear_m, vehicle.front_m).any(|along_m| {
            steps(-vehicle.half_width_m, vehicle.half_width_m).any(|across_m| {
                let point = pose.then(&Pose2::new(along_m, across_m, 0.0));
                self.is_black(point.x_m, point.y_m)
            })
        })
    }
}

/// A pose of the picture (metres from its lower left corner) in the map's frame.
fn in_map(x_m: f64, y_m: f64, yaw_rad: f64) -> Pose2 {
    ORIGIN.then(&Pose2::new(x_m, y_m, yaw_rad))
}

fn text_of(pose: &Pose2, separator: &str) -> String {
    [pose.x_m, pose.y_m, pose.yaw_rad]
        .map(|number| number.to_string())
        .join(separator)
}

fn pose_of(value: &Value) -> Pose2 {
    let numbers: Vec<f64> = value
        .as_array()
        .unwrap()
        .iter()
        .map(|number| number.as_f64().unwrap())
        .collect();
    Pose2::new(numbers[0], numbers[1], numbers[2])
}

#[test]
fn a_start_at_any_heading_on_a_turned_map_gives_paths_in_the_maps_frame() {
    let folder = tempfile::tempdir().unwrap();
    let hall = Hall::new();
    let map = hall.write(&folder);
    let goal = in_map(45.0, 10.0, -1.2);
    let off = in_map(61.0, 10.0, 0.0);
    let goals = format!("{}\n{}\n", text_of(&goal, " "), text_of(&off, " "));
    let goals = write(&folder, "goals.txt", goals);
    for heading_rad in [0.3, 1.9, -2.6] {
        let start = in_map(15.0, 12.0, heading_rad);
        let assert = swath()
            .args(["plan", "--json", "-", "--start", &text_of(&start, ",")])
            .arg("--map")
            .arg(&map)
            .arg("--goals")
            .arg(&goals)
            .arg("--picture")
            .arg(folder.path().join("plan.svg"))
            .assert()
            .success();
        let plan: Value = serde_json::from_slice(&assert.get_output().stdout).unwrap();
        let target = &plan["targets"][0];
        assert_eq!(target["status"], "solved", "{heading_rad}");
        assert_eq!(plan["targets"][1]["status"], "out_of_bounds");
        assert_eq!(pose_of(&target["goal"]), goal);
        assert!(pose_of(&plan["start"]).distance_m(&start) < 1e-6);
        let path: Vec<Pose2> = target["path"]
            .as_array()
            .unwrap()
            .iter()
            .map(pose_of)
            .collect();
        assert!(path[0].distance_m(&start) < 1e-6, "{:?} {start:?}", path[0]);
        assert!(path[path.len() - 1].distance_m(&goal) <= 0.5);
        for pose in &path {
            assert!(!hall.is_hit(pose, &Vehicle::default()), "{pose:?}");
        }
        let picture = std::fs::read_to_string(folder.path().join("plan.svg")).unwrap();
        assert!(picture.contains("1 of 2 solved") && picture.contains("out of bounds"));
    }
}

#[test]
fn a_start_off_the_map_or_in_an_obstacle_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let map = Hall::new().write(&folder);
    let goals = write(&folder, "goals.txt", text_of(&in_map(45.0, 10.0, 0.0), " "));
    let said = |start: &Pose2, code: i32| {
        let assert = swath()
            .args(["plan", "--start", &text_of(start, ",")])
            .arg("--map")
            .arg(&map)
            .arg("--goals")
            .arg(&goals)
            .assert()
            .code(code);
        String::from_utf8_lossy(&assert.get_output().stderr).into_owned()
    };
    let off = said(&in_map(-1.0, 10.0, 0.0), 1);
    assert!(
        off.contains("hall.yaml") && off.contains("off the map"),
        "{off}"
    );
    let inside = said(&in_map(29.0, 10.0, 0.0), 4);
    assert!(inside.contains("stands in an obstacle"), "{inside}");
    let none = swath()
        .args(["plan"])
        .arg("--map")
        .arg(&map)
        .arg("--goals")
        .arg(&goals)
        .assert()
        .code(1);
    let none = String::from_utf8_lossy(&none.get_output().stderr).into_owned();
    assert!(none.contains("off the map"), "{none}");
}

#[test]
fn wrong_values_are_wrong_usage_before_anything_is_read() {
    for (option, value, expected) in [
        ("--speed", "200", "0 to 60"),
        ("--speed", "-1", "0 to 60"),
        ("--speed", "NaN", "0 to 60"),
        ("--time-limit-ms", "99999999999", "whole number from 0 to"),
        ("--deadline-ms", "-5", "whole number"),
        ("--deadline-ms", "1.5", "whole number"),
        ("--start", "1,2", "x,y,yaw"),
        ("--start", "1,2,nan", "x,y,yaw"),
        ("--vehicle", "a/b", "letters, digits"),
        ("--picture", "plan.jpg", ".png or .svg"),
        ("--picture", "plan", ".png or .svg"),
    ] {
        let assert = swath()
            .args([
                "plan", "--map", "none.pgm", "--goals", "none.txt", option, value,
            ])
            .assert()
            .code(2);
        let stderr = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
        assert!(stderr.contains(expected), "{option} {value}: {stderr}");
    }
    swath().args(["plan", "--start", "0,0,0"]).assert().code(2);
}

#[test]
fn nothing_solved_and_no_goals_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let map = Hall::new().write(&folder);
    let start = text_of(&in_map(15.0, 12.0, 0.0), ",");
    let plan = |goals: &Path, code: i32| {
        let assert = swath()
            .args(["plan", "--start", &start])
            .arg("--map")
            .arg(&map)
            .arg("--goals")
            .arg(goals)
            .assert()
            .code(code);
        String::from_utf8_lossy(&assert.get_output().stderr).into_owned()
    };
    let occupied = write(
        &folder,
        "occupied.txt",
        text_of(&in_map(30.2, 10.0, 0.0), " "),
    );
    let said = plan(&occupied, 4);
    assert!(said.contains("1 goal_occupied"), "{said}");
    let empty = write(&folder, "empty.txt", "# x y yaw\n\n");
    let said = plan(&empty, 1);
    assert!(said.contains("empty.txt: there is no goal"), "{said}");
}

#[test]
fn what_cannot_be_written_is_said_before_the_work() {
    let folder = tempfile::tempdir().unwrap();
    let file = write(&folder, "file", "");
    for option in ["--json", "--picture"] {
        let out = file.join("plan.png");
        let assert = swath()
            .args(["plan", "--map", "none.pgm", "--goals", "none.txt", option])
            .arg(&out)
            .assert()
            .code(1);
        let stderr = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
        assert!(
            stderr.contains("plan.png") || stderr.contains("file"),
            "{stderr}"
        );
        assert!(!stderr.contains("none.pgm"), "{stderr}");
    }
}

#[test]
fn a_network_of_another_vehicle_is_warned_of() {
    let folder = tempfile::tempdir().unwrap();
    let mut pgm = b"P5\n151 401\n255\n".to_vec();
    pgm.resize(pgm.len() + 151 * 401, 254);
    let map = write(&folder, "map.pgm", pgm);
    let goals = write(&folder, "goals.txt", "20 0 0\n");
    let config = write(&folder, "config.toml", "[vehicle]\nfront_m = 3.9\n");
    let plan = |more: &[&str]| {
        let assert = swath()
            .args(more)
            .args(["plan", "--method", "tiev-fcn"])
            .arg("--map")
            .arg(&map)
            .arg("--goals")
            .arg(&goals)
            .assert()
            .success();
        String::from_utf8_lossy(&assert.get_output().stderr).into_owned()
    };
    assert!(!plan(&[]).contains("may be of little use"));
    let said = plan(&["--config", &config.display().to_string()]);
    let other = Vehicle {
        front_m: 3.9,
        ..Vehicle::default()
    }
    .with_limits_of_its_size();
    assert!(
        said.contains(&other.digest()) && said.contains(&Vehicle::default().digest()),
        "{said}"
    );
}

/// The report of a plan to one goal ahead.
fn plan_on(occupancy: &Occupancy, header: Header) -> PlanReport {
    let model = MotionModel::new(&Vehicle::default(), occupancy.spec.resolution_m).unwrap();
    let input = FrameInput {
        spec: occupancy.spec,
        obstacles: &Plane::from_occupancy(occupancy, 50, false),
        reference: &[],
        goals: &[Pose2::new(5.0, 0.0, 0.0)],
        start: Start::default(),
    };
    let config = PlanConfig::default();
    let planner = FramePlanner::new(Arc::new(model));
    let plan = planner.plan(&input, None, &config).unwrap();
    plan_report(header, config.method, 1.0, &plan)
}

/// Records five grids of a vehicle, the second with its plan.
fn record_grids(run: &Path) {
    let spec = GridSpec {
        rows: 60,
        cols: 40,
        resolution_m: 0.2,
        ego_row: 40,
        ego_col: 20,
    };
    let mut occupancy = Occupancy::filled(spec, FREE);
    occupancy.cells[0] = OCCUPIED;
    let mut writer = Writer::create(run).unwrap();
    for number in 0..5u64 {
        let nanos = 1_000_000_000 * (number + 1);
        let header = Header::at(nanos, "base_link");
        let grid = occupancy.to_message(header.clone());
        writer
            .write(&keys::grid("car-1"), &grid, nanos, nanos)
            .unwrap();
        if number == 1 {
            let mut report = plan_on(&occupancy, header);
            report.chosen = 0;
            writer
                .write(&keys::plan("car-1"), &report, nanos, nanos)
                .unwrap();
        }
    }
    writer.finish().unwrap();
}

#[test]
fn every_kind_of_frame_of_a_recording_is_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run.mcap");
    record_grids(&run);
    let samples = folder.path().join("samples.mcap");
    swath()
        .args(["generate", "--seed", "3", "--count", "4", "--out"])
        .arg(&samples)
        .assert()
        .success();
    let pictures = |file: &Path, out: &str, more: &[&str]| {
        let out = folder.path().join(out);
        swath()
            .args(["bridge", "pictures"])
            .arg(file)
            .arg("--out")
            .arg(&out)
            .args(more)
            .assert()
            .success();
        let mut names: Vec<String> = std::fs::read_dir(&out)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        for name in &names {
            let bytes = std::fs::read(out.join(name)).unwrap();
            assert!(bytes.starts_with(b"\x89PNG"), "{name}");
        }
        names
    };
    let all = pictures(&run, "all", &[]);
    assert_eq!(all.len(), 5);
    let bytes_of = |number: usize| {
        let path = folder.path().join("all").join(&all[number]);
        path.metadata().unwrap().len()
    };
    // The path and its goal.
    assert!(bytes_of(1) > bytes_of(0) + 500 && bytes_of(0).abs_diff(bytes_of(2)) < 200);
    assert_eq!(all[4], "car-1-000004.png");
    assert_eq!(
        pictures(&run, "some", &["--every", "2", "--count", "2"]),
        ["car-1-000000.png", "car-1-000002.png"]
    );
    assert_eq!(pictures(&run, "few", &["--count", "2"]).len(), 2);
    assert_eq!(pictures(&samples, "samples", &["--every", "1"]).len(), 4);
    let junk = write(&folder, "junk.mcap", [0x5a; 300]);
    let assert = swath()
        .args(["bridge", "pictures"])
        .arg(&junk)
        .arg("--out")
        .arg(folder.path().join("none"))
        .assert()
        .code(1);
    let stderr = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
    assert!(
        stderr.contains("junk.mcap") && !folder.path().join("none").exists(),
        "{stderr}"
    );
}
