//! The options of `swath bridge`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

use super::LogOptions;

/// Recordings and logs.
#[derive(Debug, Args)]
pub(crate) struct BridgeOptions {
    #[command(subcommand)]
    pub(crate) command: BridgeCommand,
}

#[derive(Debug, Subcommand)]
pub(crate) enum BridgeCommand {
    /// Record every swath topic into an MCAP file until stopped, and keep the newest weights beside it
    /// for planners that start when their trainer is gone
    #[command(after_help = "Example:\n  swath bridge record --out run.mcap")]
    Record {
        /// Recording to write
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
        /// Stop after so many seconds
        #[arg(long, value_name = "S")]
        seconds: Option<u64>,
        /// Replace the recording if it is there
        #[arg(long)]
        force: bool,
    },
    /// Publish a recording again, with its spacing, in the order of its log times
    #[command(after_help = "Example:\n  swath bridge replay run.mcap --rate 2 --topic '*/grid'")]
    Replay(ReplayOptions),
    /// Turn a drive log into obstacle grids
    #[command(after_help = "Example:
  swath bridge grids drive.mcap --out grids.mcap --pictures pictures
  swath bridge grids rosbag2-folder --out grids.mcap --mount /scan=1,0,0.3,0,0,0")]
    Grids(GridsOptions),
    /// Draw the frames of a recording: grids with the plans that were made of them, and samples
    #[command(after_help = "Example:
  swath bridge pictures run.mcap --out pictures --every 10")]
    Pictures(PicturesOptions),
    /// Say what a recording holds
    Info {
        /// Recording (.mcap or .mcap.zstd) or rosbag2 folder
        file: PathBuf,
        /// Print JSON
        #[arg(long)]
        json: bool,
    },
    /// Make a good recording of a damaged one
    Recover {
        /// Damaged recording
        file: PathBuf,
        /// Recording to write
        #[arg(long, value_name = "FILE")]
        out: PathBuf,
        /// Replace the recording to write if it is there
        #[arg(long)]
        force: bool,
    },
}

#[derive(Debug, Args)]
pub(crate) struct ReplayOptions {
    /// Recording (.mcap or .mcap.zstd) or rosbag2 folder
    pub(crate) file: PathBuf,
    /// Speed: 1 is as recorded, inf is as fast as it goes
    #[arg(long, default_value_t = 1.0, value_parser = parse_rate, allow_hyphen_values = true)]
    pub(crate) rate: f64,
    /// Start over at the end
    #[arg(long = "loop")]
    pub(crate) repeat: bool,
    /// Start so many seconds behind the earliest message
    #[arg(long, value_name = "S", value_parser = parse_seconds, allow_hyphen_values = true)]
    pub(crate) start: Option<f64>,
    /// End so many seconds behind the earliest message
    #[arg(long, value_name = "S", value_parser = parse_seconds, allow_hyphen_values = true)]
    pub(crate) end: Option<f64>,
    /// Only these topics; may be given again. A * stands for anything, slashes included; the slash in
    /// front may be left out
    #[arg(long, value_name = "PATTERN")]
    pub(crate) topic: Vec<String>,
}

fn parse_rate(text: &str) -> Result<f64, String> {
    let rate = text.parse::<f64>().ok().filter(|rate| *rate > 0.0);
    rate.ok_or_else(|| "expected a number of more than 0".to_owned())
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse::<f64>().ok();
    let seconds = seconds.filter(|seconds| seconds.is_finite() && *seconds >= 0.0);
    seconds.ok_or_else(|| "expected 0 or more seconds".to_owned())
}

#[derive(Debug, Args)]
pub(crate) struct GridsOptions {
    /// Drive log with PointCloud2 or LaserScan, Odometry and transforms: an MCAP file, plain or as
    /// .mcap.zstd, or a rosbag2 folder
    pub(crate) log: PathBuf,
    /// Recording to write
    #[arg(long, value_name = "FILE")]
    pub(crate) out: PathBuf,
    /// Replace the recording if it is there
    #[arg(long)]
    pub(crate) force: bool,
    /// Directory for pictures of the grids
    #[arg(long, value_name = "DIR")]
    pub(crate) pictures: Option<PathBuf>,
    /// Name of the vehicle in the keys
    #[arg(long, default_value = "v0", value_name = "NAME")]
    pub(crate) vehicle: String,
    #[command(flatten)]
    pub(crate) ingest: LogOptions,
}

#[derive(Debug, Args)]
pub(crate) struct PicturesOptions {
    /// Recording
    pub(crate) file: PathBuf,
    /// Folder for the pictures, one PNG file a frame, named so that they sort
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Draw every Nth frame of a vehicle, and every Nth sample of a generator [default: so that
    /// --count is kept]
    #[arg(long, value_parser = super::values::whole(1u64, u64::MAX), value_name = "N")]
    pub(crate) every: Option<u64>,
    /// Draw at most N frames of a vehicle, and N samples of a generator [default: 50, or all that
    /// --every leaves]
    #[arg(long, value_parser = super::values::whole(1u64, 1_000_000), value_name = "N")]
    pub(crate) count: Option<u64>,
}
