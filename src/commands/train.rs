//! `swath train`: on recordings, or as a node.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Context;
use indicatif::ProgressBar;
use swath_planner::network::{InputSize, Parameters};
use swath_trainer::{
    CHECKPOINT_FILE, Checkpoint, Dataset, DrawnRadii, Example, Learner, Miner, Observer, Recorded,
    Run, ScoreReport, Source, Split, StepReport, TrainConfig, Validation, network_info, split,
};

use crate::cli::{AsideOptions, NetworkOptions, Preset, Size, SplitBy, TrainOptions};
use crate::config::Config;
use crate::human::{self, decimal, percent};
use crate::output::{self, Failure};
use crate::progress::{self, Unit};
use crate::runtime::stop_flag;
use crate::{network, outputs};

mod node;

/// One sample in so many is set aside for validation when there is no recording for it.
const ASIDE_EVERY: usize = 10;

/// Rate of weights that were trained before, of that of new ones.
const RATE_OF_TRAINED: f64 = 0.2;

/// Runs the command.
pub(crate) fn run(
    options: &TrainOptions,
    session: &NetworkOptions,
    config: &Config,
) -> Result<(), Failure> {
    outputs::test_folder(&options.out)?;
    let mut train = train_config(options, config);
    let is_node = options.data.is_empty();
    let initial = initial(options, config, (&mut train, is_node))?;
    if is_node {
        node::run(options, session, config, (train, initial))
    } else {
        on_recordings(options, config, (&train, initial))
    }
}

fn train_config(options: &TrainOptions, config: &Config) -> TrainConfig {
    let mut train = match options.preset {
        Preset::Cpu => config.train.clone(),
        Preset::Paper => TrainConfig::paper(),
    };
    let label = config.generator().label;
    train.drawn = DrawnRadii {
        path_m: label.path_radius_m,
        reference_m: label.reference_radius_m,
        target_m: label.target_radius_m,
    };
    train.seed = options.aside.seed;
    train.score_every_steps = options.score_every.unwrap_or(train.score_every_steps);
    train.hard_share = options.hard.unwrap_or(train.hard_share);
    train.patience = options.patience.unwrap_or(train.patience);
    train.epochs = options.epochs.unwrap_or(train.epochs);
    if let Some(batch) = options.batch {
        train.batch = batch;
        train.micro_batch = train.micro_batch.min(batch);
    }
    train.architecture = options.architecture.unwrap_or(train.architecture);
    train.size = match options.size {
        Some(Size::Full) => InputSize::Full,
        Some(Size::Half) => InputSize::Half,
        None => train.size,
    };
    train
}

/// The weights to start from: those that were asked for, or if `by_default` those that come with
/// swath, if they are of the network that is to be trained. Those trained before learn more slowly.
fn initial(
    options: &TrainOptions,
    config: &Config,
    (train, by_default): (&mut TrainConfig, bool),
) -> anyhow::Result<Option<Parameters>> {
    let found = match &options.from {
        None if options.scratch || !by_default => None,
        path => Some(network::load_parameters(path.as_deref())?),
    };
    let wanted = network_info(train, &config.grid, &config.vehicle);
    let fitting = found.filter(|(info, _)| *info == wanted);
    if fitting.is_none()
        && let Some(path) = &options.from
    {
        anyhow::bail!(
            "{} is of another network than {} at {} size on this grid and vehicle",
            path.display(),
            wanted.architecture.name(),
            wanted.size.name()
        );
    }
    if fitting.is_some() {
        train.base_rate *= RATE_OF_TRAINED;
    }
    train.base_rate = options.learning_rate.unwrap_or(train.base_rate);
    train.validate()?;
    Ok(fitting.map(|(_, parameters)| parameters))
}

fn on_recordings(
    options: &TrainOptions,
    config: &Config,
    (train, initial): (&TrainConfig, Option<Parameters>),
) -> Result<(), Failure> {
    let (groups, validation) = samples(options)?;
    let first = groups
        .iter()
        .find_map(|(examples, _)| examples.first())
        .context("no samples are left to train on: give more --data")?;
    let info = network_info(train, &first.spec, &config.vehicle);
    let mut learner = if let Some((checkpoint, path)) = checkpoint(options)? {
        Learner::resume(checkpoint, &path, train, info)?
    } else {
        let mut learner = Learner::new(train.clone(), info)?;
        if let Some(parameters) = initial {
            learner.start_from(parameters);
        }
        learner
    };
    output::line(format_args!(
        "{} to train on, {} to validate on, from step {}",
        listed(
            groups
                .iter()
                .map(|(examples, times)| (examples.len(), format!("x {times}")))
        ),
        listed(
            validation
                .iter()
                .map(|set| (set.examples.len(), set.name.clone()))
        ),
        learner.progress().step
    ))?;
    let mut source = Recorded::mixed(groups, train.seed, train.mirror);
    let steps = source.steps_per_epoch(train.batch) * train.epochs;
    let mut watcher = Watcher {
        bar: progress::bar_of(steps, "training", Unit::Count("steps")),
        stop: stop_flag()?,
        began: Instant::now(),
        from: learner.progress().step,
        steps,
        batch: train.batch,
        waits_since: Instant::now(),
        waited: Duration::ZERO,
    };
    let run = Run {
        source: &mut source,
        validation: &validation,
        miner: miner(train, config)?,
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

/// What finds hard samples, if they are wanted.
fn miner(train: &TrainConfig, config: &Config) -> anyhow::Result<Option<Miner>> {
    if train.hard_share <= 0.0 {
        return Ok(None);
    }
    Ok(Some(Miner::new(&config.vehicle, &config.grid)?))
}

fn listed(counts: impl Iterator<Item = (usize, String)>) -> String {
    let counts: Vec<String> = counts
        .map(|(count, what)| format!("{count} samples ({what})"))
        .collect();
    if counts.is_empty() {
        "none".to_owned()
    } else {
        counts.join(" and ")
    }
}

/// Samples and how often an epoch shows them.
type Groups = Vec<(Vec<Example>, usize)>;

/// What is trained on, and what is validated on: the recording for that first.
fn samples(options: &TrainOptions) -> anyhow::Result<(Groups, Vec<Validation>)> {
    let mut groups = Vec::new();
    let mut validation = Vec::new();
    if let Some(path) = &options.validation {
        validation.push(Validation {
            name: "validation".to_owned(),
            examples: open(std::slice::from_ref(path))?.into_examples(),
        });
    }
    for (index, shown) in options.data.iter().enumerate() {
        let mut examples = open(std::slice::from_ref(&shown.path))?.into_examples();
        let aside = match options.aside.aside {
            Some(count) => count,
            None if validation.is_empty() => examples.len() / ASIDE_EVERY,
            None => 0,
        };
        if index == 0 && aside > 0 {
            let (rest, chosen) = set_aside(examples, &options.aside, aside);
            examples = rest;
            validation.push(Validation {
                name: "set aside".to_owned(),
                examples: chosen,
            });
        }
        groups.push((examples, shown.times));
    }
    Ok((groups, validation))
}

/// Sets `count` samples aside: the rest, and those.
pub(crate) fn set_aside(
    examples: Vec<Example>,
    options: &AsideOptions,
    count: usize,
) -> (Vec<Example>, Vec<Example>) {
    let by = match options.split {
        SplitBy::Random => Split::Random,
        SplitBy::Scene => Split::Scene,
    };
    split(examples, by, count, options.seed)
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
    began: Instant,
    from: u64,
    steps: u64,
    batch: usize,
    waits_since: Instant,
    waited: Duration,
}

impl Observer for Watcher {
    fn stepped(&mut self, report: &StepReport) {
        self.bar.set_position(report.step);
        self.bar
            .set_message(format!("loss {}", decimal(report.loss, 3)));
    }

    fn scored(&mut self, report: &ScoreReport) {
        let mut scores = String::new();
        for (name, validation) in &report.validation {
            let total = &validation.scores.total;
            let (miou, path, joined) = (total.miou(), total.iou_path(), total.joined_share());
            let _ = write!(
                scores,
                "; {name}: mIoU {}, path IoU {}, joined {}",
                decimal(miou, 4),
                decimal(path, 4),
                decimal(joined, 3)
            );
        }
        let elapsed = self.began.elapsed();
        let done = report.step.saturating_sub(self.from);
        let left = human::time_left(done, self.steps.saturating_sub(report.step), elapsed);
        let left = left.map_or_else(|| human::NOTHING.to_owned(), human::duration);
        let waited = percent(self.waited.as_secs_f64() / elapsed.as_secs_f64(), 1);
        let rate = human::rate_of(done.saturating_mul(self.batch as u64), elapsed);
        self.bar.suspend(|| {
            // Without anybody to read it, training goes on all the same.
            let _ = output::line(format_args!(
                "step {:>6}, epoch {:>3}, {}, {left} left, {rate} samples/s ({waited} of the time \
                 waiting for them): loss {}{scores}",
                report.step,
                report.epoch,
                human::duration(elapsed),
                decimal(report.loss, 4)
            ));
        });
    }

    fn waits(&mut self) {
        self.waits_since = Instant::now();
    }

    fn should_stop(&mut self) -> bool {
        self.waited += self.waits_since.elapsed();
        self.stop.load(Ordering::Relaxed)
    }
}

/// Names a directory in an error.
pub(crate) fn make_directory(path: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(path).with_context(|| path.display().to_string())
}
