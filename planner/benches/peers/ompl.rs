//! The Open Motion Planning Library, through a driver of ours that is built with the system's compiler.

use std::error::Error;
use std::fmt::Write as _;
use std::fs::File;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

use swath_planner::{GOAL_TOLERANCE_M, GOAL_TOLERANCE_RAD};
use tempfile::TempDir;

use crate::problem::Problem;
use crate::run::{Drive, Run};

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// Distance between the poses that the library tests along a motion, metres: half a cell.
const TESTED_EVERY_M: f64 = 0.1;
const PROGRAM: &str = "ompl";
const SOURCES: [&str; 5] = [
    "footprint.cpp",
    "goal_region.cpp",
    "main.cpp",
    "planning.cpp",
    "problem.cpp",
];
const MISSING: &str = "OMPL is not installed here: apt install libompl-dev g++ pkg-config";

/// The driver, built.
pub(crate) struct Ompl {
    /// Holds the program and the problem that it reads.
    folder: TempDir,
    /// The library's version.
    pub(crate) version: String,
}

impl Ompl {
    /// Builds the driver.
    ///
    /// # Errors
    /// What to install, if compiler or library are missing; else what the compiler said.
    pub(crate) fn build() -> Result<Self> {
        let version = ask_pkg_config(&["--modversion", "ompl"])?;
        // The library's own flags only: the Debian package names libraries that it does not install.
        let flags = ask_pkg_config(&["--cflags", "ompl", "eigen3"])?;
        let folder = TempDir::new()?;
        let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/peers/ompl");
        let status = Command::new("g++")
            .current_dir(sources)
            .args(["-O2", "-Wall", "-Wextra"])
            .args(flags.split_whitespace())
            .arg("-std=c++17")
            .args(SOURCES)
            .args(["-lompl", "-o"])
            .arg(folder.path().join(PROGRAM))
            .status()
            .map_err(|error| format!("g++: {error}; {MISSING}"))?;
        if !status.success() {
            return Err(
                format!("the driver cannot be built; if a header is missing: {MISSING}").into(),
            );
        }
        Ok(Self { folder, version })
    }

    /// All planners on all goals, one after the other.
    pub(crate) fn run_all(&self, problem: &Problem) -> Result<Vec<Run>> {
        let file = self.folder.path().join("problem.txt");
        File::create(&file)?.write_all(describe(problem).as_bytes())?;
        let output = Command::new(self.folder.path().join(PROGRAM))
            .stdin(File::open(&file)?)
            .stderr(Stdio::null())
            .output()?;
        if !output.status.success() {
            return Err(format!("the driver ended with {}", output.status).into());
        }
        let mut runs: Vec<Run> = Vec::new();
        for line in String::from_utf8(output.stdout)?.lines() {
            let [planner, goal, report] = line.splitn(3, ' ').collect::<Vec<_>>()[..] else {
                return Err(format!("the driver says {line:.80}").into());
            };
            if runs.last().is_none_or(|run| run.planner != planner) {
                let reverses = planner.ends_with("reeds-shepp");
                let drive = if reverses {
                    Drive::Reversing
                } else {
                    Drive::Forward
                };
                runs.push(Run::new(planner.to_owned(), drive));
            }
            let run = runs.last_mut().ok_or("no planner")?;
            if goal.parse::<usize>()? != run.fates.len() {
                return Err(format!("{planner}: a goal before {goal} has no line").into());
            }
            run.add(report)?;
        }
        Ok(runs)
    }
}

fn ask_pkg_config(arguments: &[&str]) -> Result<String> {
    let output = Command::new("pkg-config")
        .args(arguments)
        .output()
        .map_err(|error| format!("pkg-config: {error}; {MISSING}"))?;
    if output.status.success() {
        Ok(String::from_utf8(output.stdout)?.trim().to_owned())
    } else {
        Err(MISSING.into())
    }
}

/// A problem in the words of `problem.hpp`.
fn describe(problem: &Problem) -> String {
    let Problem { spec, vehicle, .. } = problem;
    let mut text = format!(
        "grid {} {} {} {} {}\n",
        spec.rows, spec.cols, spec.resolution_m, spec.ego_row, spec.ego_col
    );
    for index in 0..problem.obstacles.len() {
        text.push(if problem.obstacles.get_index(index) {
            '1'
        } else {
            '0'
        });
        if (index + 1) % spec.cols as usize == 0 {
            text.push('\n');
        }
    }
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "vehicle {} {} {} {}\ntolerance {GOAL_TOLERANCE_M} {GOAL_TOLERANCE_RAD}\n\
         limit {}\ntested_every {TESTED_EVERY_M}\ngoals {}",
        vehicle.front_m,
        vehicle.rear_m,
        vehicle.half_width_m,
        vehicle.min_turning_radius_m,
        problem.limit_s,
        problem.goals.len()
    );
    for goal in &problem.goals {
        let _ = writeln!(text, "{} {} {}", goal.x_m, goal.y_m, goal.yaw_rad);
    }
    text
}
