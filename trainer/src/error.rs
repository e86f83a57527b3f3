//! What can go wrong in training.

use std::path::PathBuf;

/// Errors of this crate, each with the evidence.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A sample cannot be learnt from.
    #[error("sample {sequence} of {generator}: {what}")]
    Sample {
        /// Who made it.
        generator: String,
        /// Its number there.
        sequence: u64,
        /// What was found and what was expected.
        what: String,
    },
    /// There is nothing to train on or to evaluate on.
    #[error("no solved samples among {read} in {from}")]
    NoSamples {
        /// Samples that were read.
        read: u64,
        /// Where from.
        from: String,
    },
    /// More samples than fit.
    #[error("more than {most} samples")]
    TooManySamples {
        /// Most that are kept.
        most: usize,
    },
    /// A configuration value is out of range.
    #[error("invalid training configuration: {what}")]
    Config {
        /// Field, value and what was expected.
        what: String,
    },
    /// The loss is no longer a number.
    #[error(
        "the loss is {loss} at step {step}: the rate {rate} is too high, or a sample is broken"
    )]
    Diverged {
        /// Step at which it was seen.
        step: u64,
        /// The loss.
        loss: f64,
        /// Learning rate of that step.
        rate: f64,
    },
    /// A checkpoint cannot be continued from.
    #[error("{}: not a checkpoint of this training: {what}", path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// What was found and what was expected.
        what: String,
    },
    /// A file could not be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// Path as it was given.
        path: PathBuf,
        /// The system's word.
        r#source: std::io::Error,
    },
    /// A thread that trained was lost.
    #[error("the thread that trains was lost: {what}")]
    Lost {
        /// What is known of it.
        what: String,
    },
    /// Error of the planner.
    #[error(transparent)]
    Planner(#[from] swath_planner::Error),
    /// Error of the bridge.
    #[error(transparent)]
    Bridge(#[from] swath_bridge::Error),
}
