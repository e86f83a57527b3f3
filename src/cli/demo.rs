//! The options of `swath demo`.

use std::path::PathBuf;

use clap::Args;

use super::values;

/// Run everything at once: generators, a trainer, two planners on live grids, a recorder.
///
/// A machine of fewer than four processors gets one generator and five grids a second, others two
/// generators and ten grids.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  swath demo
  swath demo --seconds 60 --log drive.mcap --out runs/demo")]
pub(crate) struct DemoOptions {
    /// How long to run, 5 to 86400 seconds
    #[arg(long, default_value_t = 120, value_parser = values::whole(5u64, 86_400))]
    pub(crate) seconds: u64,
    /// Drive log (rosbag2-profile MCAP) for scenes and live grids; may be given again
    #[arg(long, value_name = "FILE")]
    pub(crate) log: Vec<PathBuf>,
    /// Directory for recording, weights and report
    #[arg(long, default_value = "runs/demo", value_name = "DIR")]
    pub(crate) out: PathBuf,
}
