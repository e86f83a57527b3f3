//! The vehicles that come with swath: each file plans on a map of its own size, and what it plans can be
//! driven by that vehicle, by the independent checker.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use serde::Deserialize;
use serde_json::Value;
use swath_bridge::{GridSpec, Pose2, Vehicle};
use swath_planner::check::{CheckLimits, Ends, Fault, check_path};
use swath_planner::{GoalTolerance, PathPoint, Plane};

/// What this test reads of a vehicle's file.
#[derive(Debug, Deserialize)]
struct File {
    vehicle: Vehicle,
    grid: GridSpec,
    #[serde(default)]
    plan: Plan,
}

#[derive(Debug, Deserialize)]
#[serde(default)]
struct Plan {
    speed_m_per_s: f64,
    goal: GoalTolerance,
}

impl Default for Plan {
    fn default() -> Self {
        Self {
            speed_m_per_s: 1.4,
            goal: GoalTolerance::default(),
        }
    }
}

fn file_of(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("vehicles")
        .join(name)
}

/// Posts of the vehicle's width in three rows ahead, two of its widths apart and more.
fn obstacles(file: &File) -> Plane {
    let (spec, vehicle) = (&file.grid, &file.vehicle);
    let width_m = 2.0 * vehicle.half_width_m;
    let mut plane = Plane::empty(spec.rows, spec.cols);
    for index in 0..spec.len() {
        let (x_m, y_m) = spec.centre_of(spec.cell_of_index(index));
        for (row, first_m) in [(2.0, 0.0), (3.5, 3.0), (5.0, 0.0)] {
            let ahead_m = row * vehicle.front_m + vehicle.front_m;
            let aside_m = (y_m / width_m - first_m).rem_euclid(6.0);
            if (x_m - ahead_m).abs() < 0.25 * width_m && (2.5..3.5).contains(&aside_m) {
                plane.set_index(index);
            }
        }
    }
    plane
}

fn write_map(path: &Path, plane: &Plane, spec: &GridSpec) {
    let mut bytes = format!("P5\n{} {}\n255\n", spec.cols, spec.rows).into_bytes();
    bytes.extend((0..spec.len()).map(|index| if plane.get_index(index) { 0 } else { 255 }));
    std::fs::write(path, bytes).unwrap();
}

/// Fifty goals behind the posts and between them, headings a little turned.
fn goals(file: &File) -> Vec<Pose2> {
    let vehicle = &file.vehicle;
    let width_m = 2.0 * vehicle.half_width_m;
    let mut goals = Vec::new();
    for row in 0..10 {
        for col in -2..=2 {
            let (row, col) = (f64::from(row), f64::from(col));
            goals.push(Pose2::new(
                (1.2 + 0.75 * row) * vehicle.front_m,
                1.5 * col * width_m,
                0.1 * col,
            ));
        }
    }
    goals
}

/// Plans with the binary; the targets of its JSON.
fn plan(file: &Path, map: &Path, goals: &Path) -> Vec<Value> {
    let output = Command::cargo_bin("swath")
        .unwrap()
        .arg("--config")
        .arg(file)
        .args(["plan", "--json", "-", "--map"])
        .arg(map)
        .arg("--goals")
        .arg(goals)
        .assert()
        .success();
    let plan: Value = serde_json::from_slice(&output.get_output().stdout).unwrap();
    plan["targets"].as_array().unwrap().clone()
}

fn points(target: &Value) -> Vec<PathPoint> {
    let number = |value: &Value| value.as_f64().unwrap();
    let mut at_m = 0.0;
    let mut last: Option<Pose2> = None;
    let poses = target["path"].as_array().unwrap().iter();
    poses
        .zip(target["curvature_per_m"].as_array().unwrap())
        .map(|(pose, curvature)| {
            let pose = Pose2::new(number(&pose[0]), number(&pose[1]), number(&pose[2]));
            at_m += last.map_or(0.0, |last| last.distance_m(&pose));
            last = Some(pose);
            PathPoint {
                pose,
                curvature_per_m: number(curvature),
                at_m,
            }
        })
        .collect()
}

fn every_path_can_be_driven(name: &str) {
    let path = file_of(name);
    let file: File = toml::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
    file.vehicle.validate().unwrap();
    let obstacles = obstacles(&file);
    let occupied = (0..obstacles.len()).filter(|&index| obstacles.get_index(index));
    assert!(occupied.count() > 100, "{name}: nothing to drive around");
    let folder = tempfile::tempdir().unwrap();
    let (map, list) = (
        folder.path().join("map.pgm"),
        folder.path().join("goals.txt"),
    );
    write_map(&map, &obstacles, &file.grid);
    let goals = goals(&file);
    let lines: Vec<String> = goals
        .iter()
        .map(|goal| format!("{} {} {}\n", goal.x_m, goal.y_m, goal.yaw_rad))
        .collect();
    std::fs::write(&list, lines.concat()).unwrap();

    let curvature_per_m = file.vehicle.curvature_limit_per_m(file.plan.speed_m_per_s);
    let limits = CheckLimits {
        goal_within_m: file.plan.goal.tolerance_m,
        goal_within_rad: file.plan.goal.tolerance_rad,
        tested_every_m: 0.25 * file.grid.resolution_m,
        ..CheckLimits::new(&file.vehicle, curvature_per_m)
    };
    let (mut driven, mut flagged) = (0, 0);
    for (target, goal) in plan(&path, &map, &list).iter().zip(&goals) {
        if target["drivability"] != "at_speed" {
            flagged += u32::from(target["status"] == "solved");
            continue;
        }
        driven += 1;
        let ends = Ends {
            start: Pose2::default(),
            start_curvature_per_m: None,
            goal: *goal,
        };
        let found = check_path((&file.grid, &obstacles), &limits, &ends, &points(target));
        // Lengths along the path are summed up here from chords, which are shorter.
        let found: Vec<_> = found
            .iter()
            .filter(|found| found.fault != Fault::ArcLength)
            .collect();
        assert!(found.is_empty(), "{name} to {goal:?}: {found:?}");
    }
    assert!(driven >= 25, "{name}: {driven} of 50 targets reached");
    assert!(flagged <= 1, "{name}: {flagged} paths cannot be driven");
}

#[test]
fn a_car_plans_on_a_map_of_its_size() {
    every_path_can_be_driven("car.toml");
}

#[test]
fn a_delivery_robot_plans_on_a_map_of_its_size() {
    every_path_can_be_driven("delivery-robot.toml");
}

#[test]
fn a_truck_plans_on_a_map_of_its_size() {
    every_path_can_be_driven("truck.toml");
}

#[test]
fn the_car_of_the_file_is_the_default_one() {
    let text = std::fs::read_to_string(file_of("car.toml")).unwrap();
    let file: File = toml::from_str(&text).unwrap();
    assert_eq!(file.vehicle, Vehicle::default());
    assert_eq!(file.grid, GridSpec::default());
}

#[test]
fn a_robot_turns_as_tightly_as_it_can() {
    // On an empty map of 20 x 20 m: to a place beside it, and around.
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("robot.toml");
    let text = "[vehicle]\nwheelbase_m = 0.5\nfront_m = 0.65\nrear_m = 0.15\nhalf_width_m = 0.3\n\
                min_turning_radius_m = 0.9\n[grid]\nrows = 400\ncols = 400\nresolution_m = 0.05\n\
                ego_row = 200\nego_col = 200\n[plan]\nspeed_m_per_s = 0.5\n";
    std::fs::write(&config, text).unwrap();
    let map = folder.path().join("map.pgm");
    let spec = GridSpec {
        rows: 400,
        cols: 400,
        ..GridSpec::default()
    };
    write_map(&map, &Plane::empty(400, 400), &spec);
    let goals = folder.path().join("goals.txt");
    std::fs::write(&goals, "0 8 1.5708\n0.5 3.0 3.14159\n").unwrap();
    for (target, most_m) in plan(&config, &map, &goals).iter().zip([9.5, 5.0]) {
        assert_eq!(target["status"], "solved", "{target}");
        assert_eq!(target["drivability"], "at_speed");
        let length_m = points(target).last().unwrap().at_m;
        assert!(length_m < most_m, "{length_m} m");
    }
}
