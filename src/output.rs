//! What a person or a program sees: results on standard output, everything else on standard error.

use std::io::{self, IsTerminal, Write};
use std::path::Path;
use std::process::ExitCode;

use anyhow::Context;
use serde::Serialize;
use tracing_subscriber::EnvFilter;

/// Exit code when the run went wrong.
const FAILURE: u8 = 1;
/// Exit code when data were lost.
const DATA_LOST: u8 = 3;
/// Exit code when no target was solved.
const UNSOLVED: u8 = 4;

/// Why a command did not succeed.
#[derive(Debug)]
pub(crate) enum Failure {
    /// It went wrong.
    Error(anyhow::Error),
    /// It went through, but not all data did.
    DataLost(String),
    /// It went through, but nothing was solved.
    Unsolved(String),
}

impl<E: Into<anyhow::Error>> From<E> for Failure {
    fn from(error: E) -> Self {
        Self::Error(error.into())
    }
}

/// Says why on standard error.
pub(crate) fn report_failure(failure: &Failure) -> ExitCode {
    let mut stderr = io::stderr().lock();
    // Where standard error is gone, the exit code still tells.
    match failure {
        Failure::Error(error) if is_broken_pipe(error) => ExitCode::SUCCESS,
        Failure::Error(error) => {
            let _ = writeln!(stderr, "swath: {error:#}");
            ExitCode::from(FAILURE)
        }
        Failure::DataLost(what) => {
            let _ = writeln!(stderr, "swath: data lost: {what}");
            ExitCode::from(DATA_LOST)
        }
        Failure::Unsolved(what) => {
            let _ = writeln!(stderr, "swath: nothing was solved: {what}");
            ExitCode::from(UNSOLVED)
        }
    }
}

/// Whether the reader of our output went away, as `head` does.
fn is_broken_pipe(error: &anyhow::Error) -> bool {
    let causes = || {
        error
            .chain()
            .filter_map(|cause| cause.downcast_ref::<io::Error>())
    };
    causes().any(|cause| cause.kind() == io::ErrorKind::BrokenPipe)
}

/// Logs go to standard error; `RUST_LOG` decides where it is set.
pub(crate) fn start_logging(verbose: u8, quiet: bool) {
    let level = match (quiet, verbose) {
        (true, _) => "error",
        (false, 0) => "error,swath=info",
        (false, 1) => "warn,swath=debug",
        (false, _) => "info,swath=trace",
    };
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_unset| EnvFilter::new(level));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(io::stderr)
        .with_ansi(io::stderr().is_terminal())
        .with_target(false)
        .compact()
        .init();
}

/// Prints a line on standard output.
pub(crate) fn line(text: impl std::fmt::Display) -> anyhow::Result<()> {
    writeln!(io::stdout().lock(), "{text}").context("standard output")
}

/// Prints a value as one line of JSON.
pub(crate) fn json(value: &impl Serialize) -> anyhow::Result<()> {
    line(serde_json::to_string(value)?)
}

/// Writes a value as JSON to a file, or to standard output for `-`.
pub(crate) fn json_to(path: &Path, value: &impl Serialize) -> anyhow::Result<()> {
    if path == Path::new("-") {
        return json(value);
    }
    let text = serde_json::to_string(value)?;
    std::fs::write(path, text + "\n").with_context(|| path.display().to_string())
}
