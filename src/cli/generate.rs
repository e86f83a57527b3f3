//! The options of `swath generate`.

use std::path::PathBuf;

use clap::Args;
use swath_generator::MAX_WORKERS;

use super::values;

/// Make labelled samples: into a file, or as a node that publishes them.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  swath generate --count 3000 --seed 1 --out samples.mcap
  swath generate --log drive.mcap --count 500 --out drive-samples.mcap
  swath generate --id lab-1                  a node: publishes until stopped")]
pub(crate) struct GenerateOptions {
    /// Number of samples [default: 1000 into a file, endless as a node]
    #[arg(long, value_name = "N", value_parser = values::at_least(1), allow_negative_numbers = true)]
    pub(crate) count: Option<u64>,
    /// Seed; the same seed gives the same bytes
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Drive log to take scenes from; may be given again
    #[arg(long, value_name = "FILE")]
    pub(crate) log: Vec<PathBuf>,
    /// Recording to write; without it this is a node
    #[arg(long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
    /// Name of the generator; generators with different names make different samples
    #[arg(long, default_value = "generator-0", value_name = "NAME", value_parser = values::name)]
    pub(crate) id: String,
    /// Threads of a node, at most 256; 0 for as many as there are cores
    #[arg(
        long,
        default_value_t = 0,
        value_name = "N",
        value_parser = values::whole(0usize, MAX_WORKERS),
        allow_negative_numbers = true
    )]
    pub(crate) workers: usize,
    /// Print a JSON summary
    #[arg(long)]
    pub(crate) json: bool,
}
