//! What a person or a program sees: results on standard output, everything else on standard error.
//!
//! A result that cannot be written is a failure. What is only said along the way is not: no node ends
//! because its log does.

use std::io::{self, IsTerminal, Write};
use std::path::Path;
use std::process::ExitCode;

use anyhow::Context;
use serde::Serialize;
use swath_bridge::plain_words;
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::time::{FormatTime, SystemTime};

use crate::reporter;

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
            let _ = writeln!(stderr, "swath: {}", causes_once(error));
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

/// An error and its causes. Many errors say their cause themselves; it is not said again.
fn causes_once(error: &anyhow::Error) -> String {
    let mut said = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if said.is_empty() {
            said = cause;
        } else if !said.contains(&cause) {
            said += ": ";
            said += &cause;
        }
    }
    said
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
        .with_timer(Seconds)
        .with_writer(|| Log)
        // It would say on standard error that standard error takes nothing, and panic when it cannot.
        .log_internal_errors(false)
        .with_ansi(io::stderr().is_terminal())
        .with_target(false)
        .compact()
        .init();
}

/// The time of a line of the log, to the second.
struct Seconds;

impl FormatTime for Seconds {
    fn format_time(&self, line: &mut Writer<'_>) -> std::fmt::Result {
        let mut exact = String::new();
        SystemTime.format_time(&mut Writer::new(&mut exact))?;
        match exact.split_once('.') {
            Some((seconds, _)) => write!(line, "{seconds}Z"),
            None => write!(line, "{exact}"),
        }
    }
}

/// Standard error for the log. Nothing that goes wrong with it is an error, and a bar that stands there
/// is put aside meanwhile.
struct Log;

impl Write for Log {
    fn write(&mut self, text: &[u8]) -> io::Result<usize> {
        let written = String::from_utf8_lossy(text);
        // Libraries log errors with the places in their sources.
        let plain = match written.strip_suffix('\n') {
            Some(line) if line.contains(".rs:") => plain_words(line) + "\n",
            _ => written.into_owned(),
        };
        reporter::beside_bar(|| {
            // Where nobody can read it, the work goes on all the same.
            let _ = io::stderr().lock().write_all(plain.as_bytes());
        });
        Ok(text.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Says something on standard output that is not a result: the work goes on where nobody can read it.
pub(crate) fn note(text: impl std::fmt::Display) {
    let _ = writeln!(io::stdout().lock(), "{text}");
}

/// The first so many characters of a text; one dot for what is left out.
pub(crate) fn shortened(text: &str, most_chars: usize) -> String {
    if text.chars().count() <= most_chars {
        return text.to_owned();
    }
    let kept: String = text.chars().take(most_chars.saturating_sub(1)).collect();
    kept + "…"
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cause_is_said_once() {
        let cause = || io::Error::new(io::ErrorKind::NotFound, "No such file");
        let says = swath_bridge::Error::Io {
            path: "file".into(),
            source: cause(),
        };
        let once = anyhow::Error::from(says).context("not read");
        assert_eq!(causes_once(&once), "not read: file: No such file");
        let named = anyhow::Error::from(cause()).context("file");
        assert_eq!(causes_once(&named), "file: No such file");
    }

    #[test]
    fn a_text_is_shortened_by_characters() {
        assert_eq!(shortened("grün", 4), "grün");
        assert_eq!(shortened("grüner", 4), "grü…");
    }
}
