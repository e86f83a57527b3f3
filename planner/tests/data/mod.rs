//! The six real problems, for tests and benches.

use std::error::Error;
use std::path::{Path, PathBuf};

use swath_bridge::{GridSpec, Pose2, goals, map as maps};
use swath_planner::Plane;

/// Their names.
pub(crate) const NAMES: [&str; 6] = [
    "s_road",
    "traffic",
    "left_turn",
    "parking",
    "clutter",
    "slalom",
];

/// The directory of the problems, below `$SWATH_DATA` or `../shared/data`; says so if there is none.
pub(crate) fn problems() -> Option<PathBuf> {
    let data = std::env::var_os("SWATH_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data")),
        PathBuf::from,
    );
    let problems = data.join("problems");
    if problems.is_dir() {
        return Some(problems);
    }
    #[allow(clippy::print_stderr, reason = "what is skipped says so")]
    {
        eprintln!(
            "SKIPPED: no problems at {}; set SWATH_DATA",
            problems.display()
        );
    }
    None
}

/// Obstacles and goals of a problem.
pub(crate) fn read(directory: &Path, name: &str) -> Result<(Plane, Vec<Pose2>), Box<dyn Error>> {
    let map = directory.join(format!("{name}.pgm"));
    let occupancy = maps::read_map(&map, &GridSpec::default())?;
    let goals = goals::read_poses(&map.with_extension("goals.txt"))?;
    Ok((Plane::from_occupancy(&occupancy, 50, false), goals))
}
