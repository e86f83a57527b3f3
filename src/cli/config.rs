//! The options of `swath config`.

use clap::Args;

/// Print every key of the configuration with its value, unit and range.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  swath config > swath.toml                  every key with its default, to be changed
  swath --config swath.toml config           what a file amounts to")]
pub(crate) struct ConfigOptions {
    /// Print docs/configuration.md in place of TOML
    #[arg(long)]
    pub(crate) markdown: bool,
}
