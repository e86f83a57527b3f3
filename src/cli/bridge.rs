//! The options of `swath bridge`.

use std::path::PathBuf;

use clap::{Args, Subcommand};

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
    },
    /// Publish a recording again, with its spacing
    #[command(after_help = "Example:\n  swath bridge replay run.mcap --rate 2 --topic '*/grid'")]
    Replay(ReplayOptions),
    /// Turn a drive log into obstacle grids
    #[command(after_help = "Example:
  swath bridge grids drive.mcap --out grids.mcap --pictures pictures")]
    Grids(GridsOptions),
    /// Draw the frames of a recording: grids with the plans that were made of them, and samples
    #[command(after_help = "Example:
  swath bridge pictures run.mcap --out pictures --every 10")]
    Pictures(PicturesOptions),
    /// Say what a recording holds
    Info {
        /// Recording
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
    },
}

#[derive(Debug, Args)]
pub(crate) struct ReplayOptions {
    /// Recording
    pub(crate) file: PathBuf,
    /// Speed, 1 is as recorded
    #[arg(long, default_value_t = 1.0)]
    pub(crate) rate: f64,
    /// Start over at the end
    #[arg(long = "loop")]
    pub(crate) repeat: bool,
    /// Start so many seconds into the recording
    #[arg(long, value_name = "S")]
    pub(crate) start: Option<f64>,
    /// End so many seconds into the recording
    #[arg(long, value_name = "S")]
    pub(crate) end: Option<f64>,
    /// Only these topics (* stands for anything); may be given again
    #[arg(long, value_name = "PATTERN")]
    pub(crate) topic: Vec<String>,
}

#[derive(Debug, Args)]
pub(crate) struct GridsOptions {
    /// Drive log: rosbag2-profile MCAP with PointCloud2 or LaserScan, Odometry and transforms
    pub(crate) log: PathBuf,
    /// Recording to write
    #[arg(long, value_name = "FILE")]
    pub(crate) out: PathBuf,
    /// Directory for pictures of the grids
    #[arg(long, value_name = "DIR")]
    pub(crate) pictures: Option<PathBuf>,
    /// Topic of the point clouds [default: the only one]
    #[arg(long, value_name = "TOPIC")]
    pub(crate) points: Option<String>,
    /// Topic of the laser scans [default: the only one]
    #[arg(long, value_name = "TOPIC")]
    pub(crate) scan: Option<String>,
    /// Topic of the odometry [default: the only one]
    #[arg(long, value_name = "TOPIC")]
    pub(crate) odom: Option<String>,
    /// Name of the vehicle in the keys
    #[arg(long, default_value = "v0", value_name = "NAME")]
    pub(crate) vehicle: String,
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
