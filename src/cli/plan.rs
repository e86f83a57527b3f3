//! The options of `swath plan`.

use std::path::PathBuf;

use clap::Args;
use swath_planner::{Method, PlanConfig};

use crate::config::Config;

/// Plan to targets: once on a map, or as a node on live grids.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  swath plan --map F.pgm --goals F.txt --picture plan.png
  swath plan --map F.pgm --goals F.txt --reference R.txt --method tiev-fcn \\
      --weights W.safetensors --json -
  swath plan --vehicle car-1                 a node: plans on grids as they come")]
pub(crate) struct PlanOptions {
    /// Map, a PGM picture (or the YAML file beside it); without it this is a node
    #[arg(long, value_name = "FILE", requires = "goals")]
    pub(crate) map: Option<PathBuf>,
    /// Targets, a line each: x y yaw (metres and radians, vehicle frame)
    #[arg(long, value_name = "FILE", requires = "map")]
    pub(crate) goals: Option<PathBuf>,
    /// Rough reference path, a line a pose: x y yaw
    #[arg(long, value_name = "FILE")]
    pub(crate) reference: Option<PathBuf>,
    /// Speed, which limits turns; a node follows the odometry
    #[arg(long, value_name = "M_PER_S")]
    pub(crate) speed: Option<f64>,
    /// Method: tiev, tiev-fcn (in the regions of a network), weighted or swath [default: swath]
    #[arg(long, value_parser = parse_method, value_name = "METHOD")]
    pub(crate) method: Option<Method>,
    /// Weights of the network (safetensors), for tiev-fcn [default: those that come with swath]
    #[arg(long, value_name = "FILE")]
    pub(crate) weights: Option<PathBuf>,
    /// Most time for one target's search; 0 for no limit; not for swath [default: 0]
    #[arg(long, value_name = "N")]
    pub(crate) time_limit_ms: Option<u64>,
    /// Most time for all targets of a frame; 0 for no limit [default: 0 on a map, 100 as a node]
    #[arg(long, value_name = "N")]
    pub(crate) deadline_ms: Option<u64>,
    /// Write the plans as JSON to a file, or to standard output for -
    #[arg(long, value_name = "FILE")]
    pub(crate) json: Option<PathBuf>,
    /// Write the probability of each cell to lie in each target's region, as a numpy array of targets x
    /// rows x cols; for a method that uses a network
    #[arg(long, value_name = "FILE.npy", requires = "map")]
    pub(crate) regions: Option<PathBuf>,
    /// Draw map, regions and paths
    #[arg(long, value_name = "FILE")]
    pub(crate) picture: Option<PathBuf>,
    /// Name of the vehicle to plan for, as a node
    #[arg(long, default_value = "v0", value_name = "NAME")]
    pub(crate) vehicle: String,
}

impl PlanOptions {
    /// How to plan: what the configuration says, unless it is said here.
    pub(crate) fn plan_config(&self, config: &Config) -> PlanConfig {
        let plan = &config.plan;
        PlanConfig {
            method: self.method.unwrap_or(plan.method),
            speed_m_per_s: self.speed.unwrap_or(plan.speed_m_per_s),
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
