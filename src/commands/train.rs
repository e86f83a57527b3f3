//! `swath train`: on recordings, or as a node.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context;
use indicatif::ProgressBar;
use swath_planner::network::InputSize;
use swath_trainer::{
    CHECKPOINT_FILE, Checkpoint, Dataset, EpochReport, Learner, Observer, Recorded, Run, Source,
    Split, StepReport, TrainConfig, network_info, split,
};

use crate::cli::{NetworkOptions, Size, TrainOptions};
use crate::config::Config;
use crate::output::{self, Failure};
use crate::progress;
use crate::runtime::stop_flag;

mod node;

/// One sample in so many is set aside for validation when there is no recording for it.
const ASIDE_EVERY: usize = 10;

/// Runs the command.
pub(crate) fn run(
    options: &TrainOptions,
    network: &NetworkOptions,
    config: &Config,
) -> Result<(), Failure> {
    let train = train_config(options, config)?;
    if options.data.is_empty() {
        node::run(options, network, config, train)
    } else {
        on_recordings(options, config, &train)
    }
}

fn train_config(options: &TrainOptions, config: &Config) -> anyhow::Result<TrainConfig> {
    let mut train = config.train.clone();
    train.seed = options.seed;
    train.epochs = options.epochs.unwrap_or(train.epochs);
    if let Some(batch) = options.batch {
        train.batch = batch;
        train.micro_batch = train.micro_batch.min(batch);
    }
    train.base_rate = options.learning_rate.unwrap_or(train.base_rate);
    train.size = match options.size {
        Some(Size::Full) => InputSize::Full,
        Some(Size::Half) => InputSize::Half,
        None => train.size,
    };
    train.validate()?;
    Ok(train)
}

fn on_recordings(
    options: &TrainOptions,
    config: &Config,
    train: &TrainConfig,
) -> Result<(), Failure> {
    let data = open(&options.data)?;
    let (examples, validation) = if let Some(path) = &options.validation {
        (data.solved, open(std::slice::from_ref(path))?.solved)
    } else {
        let aside = data.solved.len() / ASIDE_EVERY;
        split(data.solved, Split::Scene, aside, train.seed)
    };
    let first = examples
        .first()
        .context("no samples are left to train on: give more --data")?;
    let info = network_info(train, &first.spec, &config.vehicle);
    let mut learner = match checkpoint(options)? {
        Some((checkpoint, path)) => Learner::resume(checkpoint, &path, train, info)?,
        None => Learner::new(train.clone(), info)?,
    };
    output::line(format_args!(
        "{} samples to train on, {} to validate on, from step {}",
        examples.len(),
        validation.len(),
        learner.progress().step
    ))?;
    let mut source = Recorded::new(examples, train.seed, train.mirror);
    let steps = source.steps_per_epoch(train.batch) * train.epochs;
    let mut watcher = Watcher {
        bar: progress::bar(steps, "training"),
        stop: stop_flag()?,
    };
    let run = Run {
        source: &mut source,
        validation: &validation,
        directory: Some(options.out.clone()),
    };
    let summary = run.train(&mut learner, &mut watcher)?;
    watcher.bar.finish_and_clear();
    let out = options.out.display();
    if summary.complete {
        output::line(format_args!("done; weights are in {out}"))?;
    } else {
        output::line(format_args!("stopped; go on with --resume --out {out}"))?;
    }
    Ok(())
}

/// Reads samples and says what could not be used.
pub(crate) fn open(paths: &[PathBuf]) -> anyhow::Result<Dataset> {
    let data = Dataset::open(paths)?;
    if let Some(fault) = &data.first_fault {
        tracing::warn!(
            "{} samples were left out; the first: {fault}",
            data.rejected
        );
    }
    Ok(data)
}

/// The checkpoint to go on from, if that was asked for. A run that is there is never overwritten.
fn checkpoint(options: &TrainOptions) -> anyhow::Result<Option<(Checkpoint, PathBuf)>> {
    let path = options.out.join(CHECKPOINT_FILE);
    let exists = path.exists();
    anyhow::ensure!(
        options.resume || !exists,
        "{} is there: give --resume to go on with it, or another --out",
        path.display()
    );
    anyhow::ensure!(
        exists || !options.resume,
        "{}: no checkpoint to resume",
        path.display()
    );
    if !exists {
        return Ok(None);
    }
    Ok(Some((Checkpoint::load(&path)?, path)))
}

/// Shows how training goes and passes on the wish to stop.
struct Watcher {
    bar: ProgressBar,
    stop: Arc<AtomicBool>,
}

impl Observer for Watcher {
    fn stepped(&mut self, report: &StepReport) {
        self.bar.set_position(report.step);
        self.bar.set_message(format!("loss {:.3}", report.loss));
    }

    fn epoch_ended(&mut self, report: &EpochReport) {
        let scores = report
            .validation
            .as_ref()
            .map_or_else(String::new, |validation| {
                let total = &validation.scores.total;
                format!(
                    ", mIoU {:.4}, path IoU {:.4}",
                    total.miou(),
                    total.iou_path()
                )
            });
        self.bar.suspend(|| {
            // Without anybody to read it, training goes on all the same.
            let _ = output::line(format_args!(
                "epoch {:>3}: loss {:.4}{scores}",
                report.epoch, report.loss
            ));
        });
    }

    fn should_stop(&mut self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// Names a directory in an error.
pub(crate) fn make_directory(path: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(path).with_context(|| path.display().to_string())
}
