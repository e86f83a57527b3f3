//! `swath generate`: samples into a file, or a node that publishes them.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use serde::Serialize;
use swath_bridge::Outcome;
use swath_bridge::ingest::IngestConfig;
use swath_bridge::recording::{Existing, Writer, check_out};
use swath_generator::{Generator, LogScenes, Run, Scenes, Written, write_dataset};

use crate::cli::{GenerateOptions, NetworkOptions};
use crate::config::Config;
use crate::output::{self, Failure};
use crate::progress;

mod node;

/// Samples of a file when nobody says how many.
const DEFAULT_COUNT: u64 = 1000;

/// Runs the command.
pub(crate) fn run(
    options: &GenerateOptions,
    network: &NetworkOptions,
    config: &Config,
) -> Result<(), Failure> {
    if let Some(out) = &options.out {
        check_out(out, Existing::of_force(options.force))?;
    }
    let scenes = scenes_of(&options.log, &options.ingest.apply(config.ingest()))?;
    let generator = Arc::new(Generator::new(config.generator(), scenes)?);
    match &options.out {
        Some(out) => into_file(options, &generator, out),
        None => node::run(options, network, &generator),
    }
}

/// Scenes of logs, or procedural ones without any.
pub(crate) fn scenes_of(logs: &[PathBuf], config: &IngestConfig) -> anyhow::Result<Scenes> {
    if logs.is_empty() {
        return Ok(Scenes::Procedural);
    }
    let mut scenes = LogScenes::new();
    for log in logs {
        let frames = swath_bridge::ingest::frames(log, config)?;
        let kept = scenes.add(&name_of(log), frames)?;
        tracing::info!("{}: {kept} frames", log.display());
    }
    Ok(Scenes::Logs(Arc::new(scenes)))
}

/// The name of a log: that of its file or folder, without the endings of recordings.
fn name_of(log: &Path) -> String {
    let name = log.file_name().unwrap_or_default().to_string_lossy();
    let name = name.strip_suffix(".zstd").unwrap_or(&name);
    name.strip_suffix(".mcap").unwrap_or(name).to_owned()
}

fn into_file(
    options: &GenerateOptions,
    generator: &Arc<Generator>,
    out: &Path,
) -> Result<(), Failure> {
    let count = options.count.unwrap_or(DEFAULT_COUNT);
    let run = Run {
        seed: options.seed,
        first: 0,
        count: Some(count),
    };
    let bar = progress::bar(count, "samples");
    let started = Instant::now();
    let existing = Existing::of_force(options.force);
    let writer = Writer::create_with(out, existing)?;
    let written = write_dataset(generator, run, writer, &mut |done, _| {
        bar.set_position(done);
    })?;
    bar.finish_and_clear();
    let summary = Summary::new(&written, started.elapsed().as_secs_f64());
    if options.json {
        output::json(&summary)?;
    } else {
        output::line(format_args!(
            "{} samples ({} solved) in {:.1} s, {:.0} a second, written to {}",
            summary.samples,
            summary.solved,
            summary.seconds,
            summary.samples_per_s,
            out.display(),
        ))?;
    }
    Ok(())
}

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Summary {
    samples: u64,
    solved: u64,
    outcomes: Vec<(Outcome, u64)>,
    seconds: f64,
    samples_per_s: f64,
}

impl Summary {
    fn new(written: &Written, seconds: f64) -> Self {
        Self {
            samples: written.samples,
            solved: written.with(Outcome::Solved),
            outcomes: Outcome::ALL
                .map(|outcome| (outcome, written.with(outcome)))
                .to_vec(),
            seconds,
            samples_per_s: written.samples as f64 / seconds.max(1e-9),
        }
    }
}
