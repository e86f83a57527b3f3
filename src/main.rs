//! The `swath` binary: argument parsing and wiring, nothing else.

mod cli;
mod commands;
mod config;
mod human;
mod network;
mod output;
mod outputs;
mod progress;
mod reporter;
mod runtime;

use std::process::ExitCode;

use clap::Parser;

use crate::cli::{Cli, Command};
use crate::output::Failure;

fn main() -> ExitCode {
    let cli = Cli::parse();
    output::start_logging(cli.verbose, cli.quiet);
    match run(&cli) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => output::report_failure(&error),
    }
}

fn run(cli: &Cli) -> Result<(), Failure> {
    let config = config::Config::load(cli.config.as_deref())?;
    let network = &cli.network;
    match &cli.command {
        Command::Demo(options) => commands::demo::run(options, cli.config.as_deref(), &config),
        Command::Generate(options) => commands::generate::run(options, network, &config),
        Command::Train(options) => commands::train::run(options, network, &config),
        Command::Evaluate(options) => commands::evaluate::run(options, &config),
        Command::Export(options) => commands::export::run(options),
        Command::Plan(options) => commands::plan::run(options, network, &config),
        Command::Bench(options) => commands::bench::run(options, &config),
        Command::Bridge(options) => commands::bridge::run(&options.command, network, &config),
        Command::Report(options) => commands::report::run(options),
        Command::Config(options) => commands::config::run(options, &config),
    }
}
