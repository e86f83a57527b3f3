//! The options of `swath train`, `evaluate` and `export`.

use std::path::PathBuf;
use std::str::FromStr;

use clap::{Args, ValueEnum};
use swath_planner::network::Architecture;
use swath_trainer::{MAX_BATCH, MAX_EPOCHS, MAX_EXAMPLES};

use super::values;

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

/// Most times that an epoch shows a recording.
const MAX_TIMES: usize = 255;
/// Least and greatest base rate of learning.
const RATES: (f64, f64) = (1e-9, 1.0);
/// Least and greatest distance from a path to the edge of its label, metres.
const DILATIONS_M: (f64, f64) = (0.1, 10.0);

/// A recording and how often an epoch shows it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Shown {
    pub(crate) path: PathBuf,
    pub(crate) times: usize,
}

impl FromStr for Shown {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let is_number = |text: &str| {
            let digits = text.strip_prefix('-').unwrap_or(text);
            !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit())
        };
        let split = text.rsplit_once(':').filter(|(_, times)| is_number(times));
        let (path, times) = match split {
            Some((path, times)) => (path, values::whole(1, MAX_TIMES)(times)?),
            None => (text, 1),
        };
        if path.is_empty() {
            return Err("expected the name of a file".to_owned());
        }
        Ok(Self {
            path: path.into(),
            times,
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
    /// searches longest, at most 1; 0 for none [default: 0]
    #[arg(
        long,
        value_name = "SHARE",
        value_parser = values::number(0.0, 1.0),
        allow_negative_numbers = true
    )]
    pub(crate) hard: Option<f64>,
    /// Passes over the data
    #[arg(
        long,
        value_name = "N",
        value_parser = values::whole(1, MAX_EPOCHS),
        allow_negative_numbers = true
    )]
    pub(crate) epochs: Option<u64>,
    /// Samples a step, at most 4096
    #[arg(
        long,
        value_name = "N",
        value_parser = values::whole(1, MAX_BATCH),
        allow_negative_numbers = true
    )]
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
    #[arg(
        long,
        value_name = "RATE",
        value_parser = values::number(RATES.0, RATES.1),
        allow_negative_numbers = true
    )]
    pub(crate) learning_rate: Option<f64>,
    /// Go on from the newest checkpoint in the output directory
    #[arg(long)]
    pub(crate) resume: bool,
    /// Directory for weights and checkpoints
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Steps of a node from one publication of weights to the next
    #[arg(
        long,
        default_value_t = 25,
        value_name = "STEPS",
        value_parser = values::at_least(1),
        allow_negative_numbers = true
    )]
    pub(crate) publish_every: u64,
    /// Most samples of the stream that a node keeps to learn from, about 30 kB each
    #[arg(
        long,
        default_value_t = 20_000,
        value_name = "SAMPLES",
        value_parser = values::whole(1, MAX_EXAMPLES),
        allow_negative_numbers = true
    )]
    pub(crate) keep: usize,
    /// Name of the run, as subscribers see it
    #[arg(long, default_value = "main", value_name = "NAME", value_parser = values::name)]
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
    #[arg(
        long,
        value_name = "METRES",
        value_parser = values::number(DILATIONS_M.0, DILATIONS_M.1),
        allow_negative_numbers = true
    )]
    pub(crate) dilation_m: Option<f64>,
    /// Also say what limits the score: how far labels of the same cost differ, and what errors cost
    /// the planner. Searches every sample twice again
    #[arg(long)]
    pub(crate) limits: bool,
    /// Picture (PNG) of samples from the worst predicted to the best
    #[arg(long, value_name = "FILE", value_parser = values::png_file)]
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
