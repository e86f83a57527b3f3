//! The command line.

use std::convert::Infallible;
use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, Parser, Subcommand, ValueEnum};
use swath_planner::network::Architecture;
use swath_planner::{Method, PlanConfig};

use crate::config::Config;

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

Exit codes: 0 success, 1 failure, 2 wrong usage, 3 data were lost."
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
    /// Listen here instead of on loopback, for example tcp/0.0.0.0:7447
    #[arg(long, global = true, value_name = "ENDPOINT")]
    pub(crate) listen: Vec<String>,
    /// Connect there, for example tcp/10.0.0.2:7447
    #[arg(long, global = true, value_name = "ENDPOINT")]
    pub(crate) connect: Vec<String>,
    /// Prefix of all keys, to keep systems apart
    #[arg(long, global = true, value_name = "NAME")]
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
}

/// Run everything at once: two generators, a trainer, a planner on live grids, a recorder.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  swath demo
  swath demo --seconds 60 --log drive.mcap --out runs/demo")]
pub(crate) struct DemoOptions {
    /// How long to run, seconds
    #[arg(long, default_value_t = 120, value_parser = clap::value_parser!(u64).range(5..=86400))]
    pub(crate) seconds: u64,
    /// Drive log (rosbag2-profile MCAP) for scenes and live grids; may be given again
    #[arg(long, value_name = "FILE")]
    pub(crate) log: Vec<PathBuf>,
    /// Directory for recording, weights and report
    #[arg(long, default_value = "runs/demo", value_name = "DIR")]
    pub(crate) out: PathBuf,
}

/// Make labelled samples: into a file, or as a node that publishes them.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  swath generate --count 3000 --seed 1 --out samples.mcap
  swath generate --log drive.mcap --count 500 --out drive-samples.mcap
  swath generate --id lab-1                  a node: publishes until stopped")]
pub(crate) struct GenerateOptions {
    /// Number of samples [default: 1000 into a file, endless as a node]
    #[arg(long)]
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
    #[arg(long, default_value = "generator-0", value_name = "NAME")]
    pub(crate) id: String,
    /// Threads of a node, 0 for as many as there are cores
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub(crate) workers: usize,
    /// Print a JSON summary
    #[arg(long)]
    pub(crate) json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Preset {
    /// Small batches at half size, for a processor
    Cpu,
    /// The paper's: enet at full size, batch 100, 300 epochs, rate 5e-4
    Paper,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Size {
    Full,
    Half,
}

/// A recording and how often an epoch shows it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Shown {
    pub(crate) path: PathBuf,
    pub(crate) times: usize,
}

impl FromStr for Shown {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Self, Infallible> {
        let split = text.rsplit_once(':');
        let times = split.and_then(|(path, times)| Some((path, times.parse::<u8>().ok()?)));
        let (path, times) = times.unwrap_or((text, 1));
        Ok(Self {
            path: path.into(),
            times: usize::from(times),
        })
    }
}

/// Samples that are set aside from the first recording.
#[derive(Debug, Args)]
pub(crate) struct AsideOptions {
    /// Set so many samples of the first recording aside, and test on them; the same ones for the
    /// same seed [default in training without --validation: a tenth]
    #[arg(long, value_name = "N")]
    pub(crate) aside: Option<usize>,
    /// Set aside any samples, as the paper did, or whole scenes
    #[arg(long, value_enum, default_value_t = SplitBy::Scene)]
    pub(crate) split: SplitBy,
    /// Seed of initial weights, of shuffles and of what is set aside
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum SplitBy {
    Random,
    Scene,
}

fn architecture(name: &str) -> Result<Architecture, String> {
    Architecture::from_name(name).ok_or_else(|| {
        let known = Architecture::ALL.map(Architecture::name).join(" or ");
        format!("expected {known}")
    })
}

/// Train a network: on recordings, or as a node on the live stream of samples.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  swath train --data samples.mcap --validation held-out.mcap --size half --out runs/first
  swath train --data samples.mcap --out runs/first --resume
  swath train --preset paper --data samples.mcap --aside 2000 --split random --out runs/paper
  swath train --out runs/live                a node: trains on what generators publish")]
pub(crate) struct TrainOptions {
    /// Recording of samples, shown once or TIMES times an epoch; may be given again; without it this
    /// is a node
    #[arg(long, value_name = "FILE[:TIMES]")]
    pub(crate) data: Vec<Shown>,
    /// Recording of samples to validate on
    #[arg(long, value_name = "FILE")]
    pub(crate) validation: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) aside: AsideOptions,
    /// Steps from one scoring to the next, beside those after each epoch; 0 for none
    #[arg(long, value_name = "STEPS")]
    pub(crate) score_every: Option<u64>,
    /// End after so many scorings without a better one; 0 for never
    #[arg(long, value_name = "SCORINGS")]
    pub(crate) patience: Option<u64>,
    /// Share of each batch drawn from the samples on which the planner, with the network so far,
    /// searches longest; 0 for none [default: 0]
    #[arg(long, value_name = "SHARE")]
    pub(crate) hard: Option<f64>,
    /// Passes over the data
    #[arg(long)]
    pub(crate) epochs: Option<u64>,
    /// Samples a step
    #[arg(long)]
    pub(crate) batch: Option<usize>,
    /// Network: the paper's, or one that shares the work on a map between targets
    #[arg(long, value_parser = architecture, value_name = "enet|enet-shared")]
    pub(crate) architecture: Option<Architecture>,
    /// Resolution at which the network sees the grid
    #[arg(long, value_enum)]
    pub(crate) size: Option<Size>,
    /// Start from these weights; a node starts from those that come with swath if they fit
    #[arg(long, value_name = "FILE", conflicts_with = "scratch")]
    pub(crate) from: Option<PathBuf>,
    /// Start from nothing
    #[arg(long)]
    pub(crate) scratch: bool,
    /// A set of training settings, which other options change
    #[arg(long, value_enum, default_value_t = Preset::Cpu)]
    pub(crate) preset: Preset,
    /// Base learning rate [default: that of the preset, a fifth of it from trained weights]
    #[arg(long, value_name = "RATE")]
    pub(crate) learning_rate: Option<f64>,
    /// Go on from the newest checkpoint in the output directory
    #[arg(long)]
    pub(crate) resume: bool,
    /// Directory for weights and checkpoints
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Steps of a node from one publication of weights to the next
    #[arg(long, default_value_t = 25, value_name = "STEPS")]
    pub(crate) publish_every: u64,
    /// Most samples of the stream that a node keeps to learn from, about 30 kB each
    #[arg(long, default_value_t = 20_000, value_name = "SAMPLES")]
    pub(crate) keep: usize,
    /// Name of the run, as subscribers see it
    #[arg(long, default_value = "main", value_name = "NAME")]
    pub(crate) run: String,
}

/// Compare predicted regions with labels, and with two baselines that learn nothing.
#[derive(Debug, Args)]
#[command(after_help = "Example:
  swath evaluate --data held-out.mcap --weights runs/first/weights.safetensors --json")]
pub(crate) struct EvaluateOptions {
    /// Recording of samples; may be given again
    #[arg(long, required = true, value_name = "FILE")]
    pub(crate) data: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) aside: AsideOptions,
    /// Weights to evaluate [default: those that come with swath]
    #[arg(long, value_name = "FILE")]
    pub(crate) weights: Option<PathBuf>,
    /// Distance from the optimal path to the edge of its label, metres [default: as trained]
    #[arg(long, value_name = "METRES")]
    pub(crate) dilation_m: Option<f64>,
    /// Also say what limits the score: how far labels of the same cost differ, and what errors cost
    /// the planner. Searches every sample twice again
    #[arg(long)]
    pub(crate) limits: bool,
    /// Picture of samples from the worst predicted to the best
    #[arg(long, value_name = "FILE")]
    pub(crate) picture: Option<PathBuf>,
    /// Recording to write the counts to, for `swath report`
    #[arg(long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    pub(crate) json: bool,
}

/// Write a network in the format of other runtimes.
#[derive(Debug, Args)]
#[command(after_help = "Example:
  swath export --weights runs/first/best.safetensors --onnx network.onnx")]
pub(crate) struct ExportOptions {
    /// Weights to export [default: those that come with swath]
    #[arg(long, value_name = "FILE")]
    pub(crate) weights: Option<PathBuf>,
    /// ONNX file to write
    #[arg(long, value_name = "FILE")]
    pub(crate) onnx: PathBuf,
}

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

fn parse_method(name: &str) -> Result<Method, String> {
    Method::from_name(name).ok_or_else(|| {
        let names: Vec<&str> = Method::ALL.iter().map(|method| method.name()).collect();
        format!("expected one of {}", names.join(", "))
    })
}

/// Measure methods side by side, as the paper's tables do.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  swath bench --scenes 50 --weights W.safetensors --out bench.mcap
  swath report bench.mcap --out report
  swath bench --scenes 200 --targets 50 --methods swath --deadline-ms 100,5000 --check \\
      --out frames.mcap")]
pub(crate) struct BenchOptions {
    /// Number of generated scenes, or of frames a log
    #[arg(long, default_value_t = 50)]
    pub(crate) scenes: u64,
    /// Seed of the scenes
    #[arg(long, default_value_t = 1000)]
    pub(crate) seed: u64,
    /// Drive log to take frames from instead; may be given again
    #[arg(long, value_name = "FILE")]
    pub(crate) log: Vec<PathBuf>,
    /// Numbers of targets
    #[arg(long, value_delimiter = ',', default_value = "1,3,7,10,15,20,30,40,50")]
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
