//! The options of `swath plan`.

use std::path::{Path, PathBuf};

use clap::Args;
use swath_bridge::Pose2;
use swath_bridge::drawing::PictureFormat;
use swath_planner::{GoalTolerance, Method, PlanConfig};

use super::values;
use crate::config::Config;

/// Greatest speed, m/s.
const MAX_SPEED_M_PER_S: f64 = 60.0;
/// Longest time limit: an hour.
const MAX_TIME_MS: u64 = 3_600_000;
/// Largest coordinate of a start, metres, as that of a goal.
const MAX_COORDINATE_M: f64 = 1e6;

/// Plan to targets: once on a map, or as a node on live grids.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  swath plan --map F.pgm --goals F.txt --picture plan.png
  swath plan --map warehouse.yaml --start 2.5,-1,0.3 --goals F.txt --picture plan.svg
  swath plan --map F.pgm --goals F.txt --reference R.txt --method tiev-fcn \\
      --weights W.safetensors --json -
  swath plan --vehicle car-1                 a node: plans on grids as they come

Maps: a PGM or PNG picture with the YAML file of nav2's map server, or a picture alone of the size of
the configured grid. The frame of a map with a YAML file is the one that the file's origin is given
in. The frame of a picture alone is at the grid's ego cell (row 300 and column 75 of 401 x 151 unless
configured), with x up and y to the left.

With --start, the vehicle stands there in the map's frame, at any heading, and goals, reference and
results are in the map's frame too. Without --start, the vehicle stands at the origin of the map's
frame and heads along x, so that the map's frame is the vehicle's. The vehicle's point is the middle
of its rear axle. What lies beyond the map's edge is not driven on.

Exit codes: 0 at least one target was solved, 1 failure, 2 wrong usage, 4 no target was solved.")]
pub(crate) struct PlanOptions {
    /// Map: a PGM or PNG picture, or the YAML file beside it; without it this is a node
    #[arg(long, value_name = "FILE", requires = "goals")]
    pub(crate) map: Option<PathBuf>,
    /// Targets, a line each: x y yaw (metres and radians, in the map's frame)
    #[arg(long, value_name = "FILE", requires = "map")]
    pub(crate) goals: Option<PathBuf>,
    /// Where the vehicle stands in the map's frame: metres and radians [default: 0,0,0]
    #[arg(long, value_parser = parse_start, value_name = "X,Y,YAW", requires = "map", allow_hyphen_values = true)]
    pub(crate) start: Option<Pose2>,
    /// Rough reference path, a line a pose: x y yaw, in the map's frame
    #[arg(long, value_name = "FILE", requires = "map")]
    pub(crate) reference: Option<PathBuf>,
    /// Speed, which limits turns; a node follows the odometry
    #[arg(long, value_parser = values::number(0.0, MAX_SPEED_M_PER_S), value_name = "M_PER_S", allow_hyphen_values = true)]
    pub(crate) speed: Option<f64>,
    /// How near to its goal a path has to end, metres [default: 0.5]
    #[arg(long, value_parser = values::number(0.01, 10.0), value_name = "METRES", allow_hyphen_values = true)]
    pub(crate) goal_tolerance_m: Option<f64>,
    /// How far a path's end may be turned from its goal, radians [default: 0.262, which is 15 degrees]
    #[arg(long, value_parser = values::number(0.005, std::f64::consts::PI), value_name = "RADIANS", allow_hyphen_values = true)]
    pub(crate) goal_tolerance_rad: Option<f64>,
    /// Method: tiev, tiev-fcn, weighted, swath, hybrid, hybrid-fcn, rrt-star or rrt-star-fcn; those with
    /// -fcn search in the regions of a network [default: swath]
    #[arg(long, value_parser = parse_method, value_name = "METHOD")]
    pub(crate) method: Option<Method>,
    /// Weights of the network (safetensors), for tiev-fcn [default: those that come with swath]
    #[arg(long, value_name = "FILE")]
    pub(crate) weights: Option<PathBuf>,
    /// Longest search for one target, milliseconds; 0 for no limit; swath has --deadline-ms only
    /// [default: 0]
    #[arg(long, value_parser = values::whole(0, MAX_TIME_MS), allow_negative_numbers = true, value_name = "N")]
    pub(crate) time_limit_ms: Option<u64>,
    /// Deadline for all targets of a frame, milliseconds; 0 for none [default: 0 on a map, 100 as a
    /// node]
    #[arg(long, value_parser = values::whole(0, MAX_TIME_MS), allow_negative_numbers = true, value_name = "N")]
    pub(crate) deadline_ms: Option<u64>,
    /// Write the plans as JSON to a file, or to standard output for -
    #[arg(long, value_name = "FILE", requires = "map")]
    pub(crate) json: Option<PathBuf>,
    /// Write the probability of each cell to lie in each target's region, as a numpy array of targets x
    /// rows x cols; for a method that uses a network
    #[arg(long, value_name = "FILE.npy", requires = "map")]
    pub(crate) regions: Option<PathBuf>,
    /// Draw map, regions and paths into a .png or .svg file; with --start as the map's picture lies,
    /// else with the vehicle heading up
    #[arg(long, value_parser = parse_picture, value_name = "FILE", requires = "map")]
    pub(crate) picture: Option<PathBuf>,
    /// Name of the vehicle to plan for, as a node
    #[arg(long, value_parser = values::name, default_value = "v0", value_name = "NAME")]
    pub(crate) vehicle: String,
    /// Plan although another planner plans for this vehicle; else that is an error
    #[arg(long)]
    pub(crate) share_vehicle: bool,
}

impl PlanOptions {
    /// How to plan: what the configuration says, unless it is said here.
    pub(crate) fn plan_config(&self, config: &Config) -> PlanConfig {
        let plan = &config.plan;
        PlanConfig {
            method: self.method.unwrap_or(plan.method),
            speed_m_per_s: self.speed.unwrap_or(plan.speed_m_per_s),
            goal: GoalTolerance {
                tolerance_m: self.goal_tolerance_m.unwrap_or(plan.goal.tolerance_m),
                tolerance_rad: self.goal_tolerance_rad.unwrap_or(plan.goal.tolerance_rad),
            },
            time_limit_ms: self.time_limit_ms.unwrap_or(plan.time_limit_ms),
            frame_deadline_ms: self.deadline_ms.unwrap_or(plan.frame_deadline_ms),
            ..*plan
        }
    }
}

pub(super) fn parse_method(name: &str) -> Result<Method, String> {
    Method::from_name(name).ok_or_else(|| {
        let names: Vec<&str> = Method::ALL.iter().map(|method| method.name()).collect();
        format!("expected one of {}", names.join(", "))
    })
}

/// A pose: three numbers with commas between them.
fn parse_start(text: &str) -> Result<Pose2, String> {
    let numbers: Option<Vec<f64>> = text
        .split(',')
        .map(|part| part.trim().parse().ok())
        .collect();
    match numbers.as_deref() {
        Some(&[x_m, y_m, yaw_rad])
            if x_m.abs() <= MAX_COORDINATE_M
                && y_m.abs() <= MAX_COORDINATE_M
                && yaw_rad.abs() <= std::f64::consts::TAU =>
        {
            Ok(Pose2::new(x_m, y_m, yaw_rad))
        }
        _ => Err(
            "expected x,y,yaw: metres, metres and radians from -6.28 to 6.28, for example 2.5,-1,0.3"
                .to_owned(),
        ),
    }
}

/// The path of a picture in a format that can be written.
fn parse_picture(text: &str) -> Result<PathBuf, String> {
    match PictureFormat::of_path(Path::new(text)) {
        Some(_) => Ok(text.into()),
        None => Err(format!(
            "expected a name that ends in {}",
            PictureFormat::KNOWN
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_start_is_three_numbers() {
        assert_eq!(parse_start("1.5, -2,0.5"), Ok(Pose2::new(1.5, -2.0, 0.5)));
        for bad in [
            "", "1,2", "1,2,3,4", "a,b,c", "1 2 3", "nan,0,0", "0,inf,0", "1e7,0,0", "0,0,90",
        ] {
            assert!(parse_start(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn pictures_are_png_or_svg() {
        assert_eq!(parse_picture("a/b.svg"), Ok("a/b.svg".into()));
        for bad in ["plan.jpg", "plan", "plan.pdf", ""] {
            assert!(
                parse_picture(bad).unwrap_err().contains(".png or .svg"),
                "{bad}"
            );
        }
    }
}
