//! A run: steps from where a learner stands to the end, with checkpoints and scores on the way.

use std::ops::Range;
use std::path::PathBuf;
use std::sync::mpsc::sync_channel;

use crate::checkpoint::write_atomically;
use crate::evaluate::Report;
use crate::mining::CANDIDATES;
use crate::source::Source;
use crate::train::score;
use crate::{Error, Example, Learner, Miner};

/// Name of the checkpoint in the directory of a run.
pub const CHECKPOINT_FILE: &str = "checkpoint.safetensors";
/// Name of the newest weights in the directory of a run.
pub const WEIGHTS_FILE: &str = "weights.safetensors";
/// Name of the weights that scored best on the validation samples.
pub const BEST_FILE: &str = "best.safetensors";

/// Steps from one checkpoint to the next.
const CHECKPOINT_EVERY_STEPS: u64 = 500;
/// Batches that are prepared ahead of the step that takes them.
const PREPARED_AHEAD: usize = 2;

/// One step, for whoever watches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepReport {
    /// Steps taken.
    pub step: u64,
    /// Steps in the whole run, if it has an end.
    pub steps: Option<u64>,
    /// Epochs completed.
    pub epoch: u64,
    /// Mean loss of a sample.
    pub loss: f64,
    /// Learning rate.
    pub rate: f64,
    /// Samples shown so far.
    pub samples: u64,
}

/// Scores on the way, for whoever watches.
#[derive(Debug, Clone)]
pub struct ScoreReport {
    /// Epochs completed.
    pub epoch: u64,
    /// Steps taken.
    pub step: u64,
    /// Mean loss since the last report.
    pub loss: f64,
    /// Scores on each set of validation samples.
    pub validation: Vec<(String, Report)>,
}

/// Watches a training and may end it.
pub trait Observer {
    /// After each step.
    fn stepped(&mut self, _report: &StepReport) {}

    /// After each epoch, and in between as the configuration says.
    fn scored(&mut self, _report: &ScoreReport) {}

    /// Before the samples of a step are waited for.
    fn waits(&mut self) {}

    /// Asked before each step, its samples at hand; the run then ends with a checkpoint.
    fn should_stop(&mut self) -> bool {
        false
    }
}

/// Watches nothing.
#[derive(Debug, Clone, Copy)]
pub struct Unobserved;

impl Observer for Unobserved {}

/// Samples to score a network on.
#[derive(Debug, Clone)]
pub struct Validation {
    /// What they are.
    pub name: String,
    /// The samples.
    pub examples: Vec<Example>,
}

/// A run from where the learner stands to the last epoch of its configuration.
#[derive(Debug)]
pub struct Run<'a> {
    /// Where samples come from.
    pub source: &'a mut dyn Source,
    /// Scored after every epoch and in between; the first decides which weights are the best.
    pub validation: &'a [Validation],
    /// Finds hard samples, if a share of each batch is to be of them.
    pub miner: Option<Miner>,
    /// Where checkpoint and weights are kept, if anywhere.
    pub directory: Option<PathBuf>,
}

/// How a run ended.
#[derive(Debug, Clone)]
pub struct Summary {
    /// Whether it came to its end.
    pub complete: bool,
    /// The last scores on the validation samples.
    pub validation: Vec<(String, Report)>,
}

impl Run<'_> {
    /// Trains to the end, until the scores have not improved for as long as the configuration says,
    /// or until the observer stops it. A checkpoint and the newest weights are written every 500
    /// steps, after every epoch and on stopping, the best weights whenever they are.
    ///
    /// # Errors
    /// [`Error::Diverged`], [`Error::Io`], [`Error::Checkpoint`] if the learner comes from a run over
    /// another number of samples.
    pub fn train(
        mut self,
        learner: &mut Learner,
        observer: &mut dyn Observer,
    ) -> Result<Summary, Error> {
        if let Some(directory) = &self.directory {
            std::fs::create_dir_all(directory).map_err(|source| Error::Io {
                path: directory.clone(),
                source,
            })?;
        }
        let batch = learner.config.batch;
        let an_epoch = self.source.steps_per_epoch(batch);
        let total = an_epoch * learner.config.epochs;
        self.check_total(learner, total)?;
        let hard_share = learner.config.hard_share;
        self.source.bring_back(&learner.progress.hard, hard_share);
        let mut validation = Vec::new();
        while learner.progress.step < total && !is_patience_over(learner) {
            let begin = learner.progress.step;
            let end = [
                an_epoch,
                learner.config.score_every_steps,
                CHECKPOINT_EVERY_STEPS,
            ]
            .into_iter()
            .filter(|&every| every > 0)
            .map(|every| (begin / every + 1) * every)
            .fold(total, u64::min);
            if !self.stretch(learner, begin..end, observer)? {
                self.keep(learner)?;
                return Ok(Summary {
                    complete: false,
                    validation,
                });
            }
            self.mine(learner)?;
            if is_due(end, an_epoch) || is_due(end, learner.config.score_every_steps) {
                validation = self.score(learner, end / an_epoch, observer)?;
            } else {
                self.keep(learner)?;
            }
        }
        Ok(Summary {
            complete: true,
            validation,
        })
    }

    /// Finds out anew which samples are hard.
    fn mine(&mut self, learner: &mut Learner) -> Result<(), Error> {
        if let Some(miner) = &self.miner {
            let candidates = self.source.candidates(learner.progress.step, CANDIDATES);
            learner.progress.hard = miner.hardest(&learner.network(), &candidates)?;
            let share = learner.config.hard_share;
            self.source.bring_back(&learner.progress.hard, share);
        }
        Ok(())
    }

    /// Takes some steps while a thread prepares what comes next. `false` if the observer stopped it.
    fn stretch(
        &mut self,
        learner: &mut Learner,
        steps: Range<u64>,
        observer: &mut dyn Observer,
    ) -> Result<bool, Error> {
        let batch = learner.config.batch;
        let an_epoch = self.source.steps_per_epoch(batch);
        let total = learner.progress.total_steps;
        let schedule = learner.config.schedule(total);
        let preparation = learner.preparation();
        let source = &mut *self.source;
        std::thread::scope(|scope| {
            let (sender, prepared) = sync_channel(PREPARED_AHEAD);
            let to_come = steps.clone();
            scope.spawn(move || {
                for step in to_come {
                    let next = preparation.batch(&source.draw(step, batch));
                    if sender.send(next).is_err() {
                        break;
                    }
                }
            });
            for step in steps {
                observer.waits();
                let Ok(batch) = prepared.recv() else { break };
                if observer.should_stop() {
                    return Ok(false);
                }
                let rate = schedule.rate(step);
                let loss = learner.step(&batch?, rate)?;
                observer.stepped(&StepReport {
                    step: step + 1,
                    steps: Some(total),
                    epoch: step / an_epoch,
                    loss,
                    rate,
                    samples: learner.progress.samples,
                });
            }
            Ok(true)
        })
    }

    fn check_total(&self, learner: &mut Learner, total: u64) -> Result<(), Error> {
        if learner.progress.step > 0 && learner.progress.total_steps != total {
            let directory = self.directory.clone().unwrap_or_default();
            return Err(Error::Checkpoint {
                path: directory.join(CHECKPOINT_FILE),
                what: format!(
                    "it is of a run of {} steps, these samples and settings make {total}",
                    learner.progress.total_steps
                ),
            });
        }
        learner.progress.total_steps = total;
        Ok(())
    }

    fn score(
        &self,
        learner: &mut Learner,
        epoch: u64,
        observer: &mut dyn Observer,
    ) -> Result<Vec<(String, Report)>, Error> {
        let mut validation = Vec::new();
        for Validation { name, examples } in self.validation {
            if let Some(report) = score(learner, examples)? {
                validation.push((name.clone(), report));
            }
        }
        let loss = learner.take_loss();
        if let Some((_, report)) = validation.first() {
            let miou = report.scores.total.miou();
            learner.progress.since_best += 1;
            if learner.progress.best_miou.is_none_or(|best| miou > best) {
                learner.progress.best_miou = Some(miou);
                learner.progress.since_best = 0;
                if let Some(directory) = &self.directory {
                    write_atomically(&directory.join(BEST_FILE), &learner.weights())?;
                }
            }
        }
        self.keep(learner)?;
        observer.scored(&ScoreReport {
            epoch,
            step: learner.progress.step,
            loss,
            validation: validation.clone(),
        });
        Ok(validation)
    }

    fn keep(&self, learner: &Learner) -> Result<(), Error> {
        let Some(directory) = &self.directory else {
            return Ok(());
        };
        write_atomically(&directory.join(WEIGHTS_FILE), &learner.weights())?;
        learner.checkpoint().save(&directory.join(CHECKPOINT_FILE))
    }
}

/// Whether something that is done every so many steps, 0 for never, is due.
const fn is_due(step: u64, every: u64) -> bool {
    every > 0 && step.is_multiple_of(every)
}

const fn is_patience_over(learner: &Learner) -> bool {
    let patience = learner.config.patience;
    patience > 0 && learner.progress.since_best >= patience
}
