//! Plans the six problems with this crate, with the Open Motion Planning Library and with the crate
//! `rust_robotics_planning`, in one run: the same maps, vehicle, goals and tolerances.
//!
//! `cargo bench --workspace --bench peers-planning [-- SECONDS [MAP...]]`: processor time for one goal,
//! 1 s by default, and the maps, else all. It builds a driver of OMPL with g++ first and says what to
//! install if that cannot be. The maps are looked for where `SWATH_DATA` points, else in
//! `../shared/data`.
//!
//! `swath` decides all goals however long it takes; the others may take so long for each (`tiev` and
//! `weighted` count elapsed time). OMPL's planners stop at their first path, and test the whole
//! rectangle every 0.1 m of a motion. Every path is judged by the same rules (`judge.rs`); one that
//! breaks them counts as refused, not as solved. The two lengths are the mean and the largest ratio to
//! the path of `swath`, for goals that both solve.

#![expect(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a program that prints a table"
)]

use std::error::Error;
use std::path::Path;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use swath_bridge::{GridSpec, Vehicle};
use swath_planner::{CollisionMap, MotionModel};

use judge::Judge;
use ompl::Ompl;
use problem::Problem;

#[path = "../../tests/data/mod.rs"]
mod data;
mod judge;
mod ompl;
mod ours;
mod problem;
mod run;
mod rust_robotics;
mod table;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

const LIMIT_S: f64 = 1.0;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let done = match arguments
        .iter()
        .position(|word| word == rust_robotics::MODE)
    {
        Some(mode) => plan_one(&arguments[mode + 1..]),
        None => compare(&arguments),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn compare(arguments: &[String]) -> Result<()> {
    let Some(problems) = data::problems() else {
        return Ok(());
    };
    let limit_s = arguments.iter().find_map(|word| word.parse().ok());
    let limit_s = limit_s.unwrap_or(LIMIT_S);
    duration(limit_s)?;
    let named = |name: &str| arguments.iter().any(|word| word == name);
    let all = !data::NAMES.into_iter().any(named);
    let ompl = Ompl::build()?;
    println!(
        "processor and elapsed time in ms of all goals; at most {limit_s} s for one; OMPL {}, \
         rust_robotics_planning (rr) 0.1",
        ompl.version
    );
    table::print_head();
    let model = MotionModel::new(&Vehicle::default(), GridSpec::default().resolution_m)?;
    let model = Arc::new(model);
    let mut ratios = Vec::new();
    for name in data::NAMES.into_iter().filter(|name| all || named(name)) {
        let problem = read(&problems, name, limit_s)?;
        let map = CollisionMap::new(Arc::clone(&model), problem.spec, &problem.obstacles)?;
        let judge = Judge {
            map: &map,
            spec: problem.spec,
            turning_radius_m: problem.vehicle.min_turning_radius_m,
        };
        let ours = ours::run_all(&problem, &model)?;
        let theirs = ompl.run_all(&problem)?;
        let others = rust_robotics::run_all(&problem)?;
        let rows = |runs| table::rows(&problem, &judge, &ours, runs);
        let (ours, theirs, others) = (rows(&ours), rows(&theirs), rows(&others));
        for row in ours.iter().chain(&theirs).chain(&others) {
            row.print(name);
        }
        ratios.push(table::ratios(name, &ours, &theirs));
    }
    println!();
    for line in ratios {
        println!("{line}");
    }
    Ok(())
}

/// Plans to one goal as a process of its own: planner, map, number of the goal, seconds.
fn plan_one(words: &[String]) -> Result<()> {
    let [planner, map, goal, limit_s, ..] = words else {
        return Err("expected PLANNER MAP GOAL SECONDS".into());
    };
    let problems = data::problems().ok_or("no problems")?;
    let problem = read(&problems, map, limit_s.parse()?)?;
    println!("{}", rust_robotics::plan(planner, &problem, goal.parse()?)?);
    Ok(())
}

fn read(problems: &Path, name: &str, limit_s: f64) -> Result<Problem> {
    let known = data::NAMES.into_iter().find(|known| *known == name);
    let name = known.ok_or_else(|| format!("{name}: no such problem"))?;
    Ok(Problem::new(name, data::read(problems, name)?, limit_s))
}

/// Seconds as a duration.
fn duration(seconds: f64) -> Result<Duration> {
    Duration::try_from_secs_f64(seconds).map_err(|error| format!("{seconds} s: {error}").into())
}
