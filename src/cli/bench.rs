//! The options of `swath bench` and `report`.

use std::path::PathBuf;

use clap::Args;
use swath_planner::{MAX_TARGETS, Method};

use super::plan::parse_method;
use super::values;

/// Measure methods side by side, as the paper's tables do.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  swath bench --scenes 50 --weights W.safetensors --out bench.mcap
  swath report bench.mcap --out report
  swath bench --scenes 200 --targets 50 --methods swath --deadline-ms 100,5000 --check \\
      --out frames.mcap")]
pub(crate) struct BenchOptions {
    /// Number of generated scenes, or of frames a log
    #[arg(
        long,
        default_value_t = 50,
        value_name = "N",
        value_parser = values::at_least(1),
        allow_negative_numbers = true
    )]
    pub(crate) scenes: u64,
    /// Seed of the scenes
    #[arg(long, default_value_t = 1000)]
    pub(crate) seed: u64,
    /// Drive log to take frames from instead; may be given again
    #[arg(long, value_name = "FILE")]
    pub(crate) log: Vec<PathBuf>,
    /// Numbers of targets, each from 1 to 256
    #[arg(
        long,
        value_delimiter = ',',
        default_value = "1,3,7,10,15,20,30,40,50",
        value_name = "N",
        value_parser = values::whole(1usize, MAX_TARGETS),
        allow_negative_numbers = true
    )]
    pub(crate) targets: Vec<usize>,
    /// Methods to compare, also hybrid, hybrid-fcn, rrt-star and rrt-star-fcn [default: tiev, tiev-fcn,
    /// weighted and swath, if they can run]
    #[arg(long, value_delimiter = ',', value_parser = parse_method)]
    pub(crate) methods: Vec<Method>,
    /// Weights of the network [default: those that come with swath]
    #[arg(long, value_name = "FILE")]
    pub(crate) weights: Option<PathBuf>,
    /// Most time for one target's search; 0 for no limit
    #[arg(long, default_value_t = 1000, value_name = "N")]
    pub(crate) time_limit_ms: u64,
    /// Deadlines of a frame for swath, milliseconds; 0 for none; each but that is a method of its own in
    /// the report [default: the configuration's]
    #[arg(long, value_delimiter = ',', value_name = "N")]
    pub(crate) deadline_ms: Vec<u64>,
    /// Make paths drivable, and have the independent checker look at every one
    #[arg(long)]
    pub(crate) check: bool,
    /// Recording to write
    #[arg(long, value_name = "FILE")]
    pub(crate) out: PathBuf,
}

/// Turn recordings into tables, plots and a report.
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  swath report run.mcap bench.mcap --out report")]
pub(crate) struct ReportOptions {
    /// Recordings
    #[arg(required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// Directory for report.md, tables.tex, CSV, Parquet and SVG files
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Print the summary as JSON
    #[arg(long)]
    pub(crate) json: bool,
}
