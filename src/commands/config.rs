//! `swath config`: every key of the configuration.

use crate::cli::ConfigOptions;
use crate::config::{Config, show};
use crate::output::{self, Failure};

/// Runs the command.
pub(crate) fn run(options: &ConfigOptions, config: &Config) -> Result<(), Failure> {
    let text = if options.markdown {
        show::page()?
    } else {
        show::toml_of(config)?
    };
    output::line(text.trim_end())?;
    Ok(())
}
