//! The command line.

mod bench;
mod bridge;
mod config;
mod demo;
mod generate;
mod log;
mod plan;
mod train;
mod values;

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};

pub(crate) use bench::{BenchOptions, ReportOptions};
pub(crate) use bridge::{
    BridgeCommand, BridgeOptions, GridsOptions, PicturesOptions, ReplayOptions,
};
pub(crate) use config::ConfigOptions;
pub(crate) use demo::DemoOptions;
pub(crate) use generate::GenerateOptions;
pub(crate) use log::LogOptions;
pub(crate) use plan::PlanOptions;
pub(crate) use train::{
    AsideOptions, EvaluateOptions, ExportOptions, Preset, Size, SplitBy, TrainOptions,
};

/// Learns the strip of ground a path will take, and plans through it.
///
/// One binary runs every node of a system that generates samples, trains a network on them and plans
/// for many targets at once. Nodes find one another over zenoh: on this machine without any
/// configuration, on a network when told so.
#[derive(Debug, Parser)]
#[command(
    name = "swath",
    version,
    max_term_width = 100,
    after_help = "Examples:
  swath demo                                 everything at once, for two minutes
  swath plan --map F.pgm --goals F.txt --picture plan.png
  swath generate --count 3000 --out samples.mcap
  swath train --data samples.mcap --size half --out runs/first
  swath plan                                 a planner node on live grids

A network is opened explicitly:
  swath --listen tcp/0.0.0.0:7447 train --out runs/fleet
  swath --connect tcp/trainer.local:7447 generate

Exit codes:
  0  success
  1  failure, also of a file or a configuration that cannot be used
  2  wrong usage, also a value that is out of range
  3  data were lost
  4  nothing was solved"
)]
pub(crate) struct Cli {
    /// TOML file of vehicle, grid and settings that nodes share
    #[arg(long, global = true, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) network: NetworkOptions,
    /// Say more (twice: everything)
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub(crate) verbose: u8,
    /// Say nothing but errors
    #[arg(short, long, global = true)]
    pub(crate) quiet: bool,
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// How nodes find one another.
#[derive(Debug, Clone, Default, Args)]
pub(crate) struct NetworkOptions {
    /// Listen here instead of on loopback and relay, for example tcp/0.0.0.0:7447
    #[arg(long, global = true, value_name = "ENDPOINT")]
    pub(crate) listen: Vec<String>,
    /// Connect there and stay connected, for example tcp/10.0.0.2:7447
    #[arg(long, global = true, value_name = "ENDPOINT")]
    pub(crate) connect: Vec<String>,
    /// Prefix of all keys, to keep systems apart; - for none [default: user-UID on
    /// loopback, none with --listen, --connect or a zenoh file that names endpoints]
    #[arg(long, global = true, value_name = "NAME", value_parser = values::namespace)]
    pub(crate) namespace: Option<String>,
    /// zenoh configuration file (JSON5); `ZENOH_CONFIG` names one too
    #[arg(long, global = true, value_name = "FILE")]
    pub(crate) zenoh_config: Option<PathBuf>,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    Demo(DemoOptions),
    Generate(GenerateOptions),
    Train(TrainOptions),
    Evaluate(EvaluateOptions),
    Export(ExportOptions),
    Plan(PlanOptions),
    Bench(BenchOptions),
    Bridge(BridgeOptions),
    Report(ReportOptions),
    Config(ConfigOptions),
}
