//! The training loop: one step of a network, and steps until the end of a run.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use swath_bridge::{GridSpec, Vehicle};
use swath_planner::Plane;
use swath_planner::network::{
    Dropout, Encoding, INPUT_PLANES, Network, NetworkInfo, Parameters, Training,
};

use crate::checkpoint::{Checkpoint, Progress, write_atomically};
use crate::evaluate::{Predictor, Report, evaluate};
use crate::example::mirrored;
use crate::loss::loss_and_gradient;
use crate::optimiser::Adam;
use crate::source::{Shown, Source};
use crate::{Error, Example, TrainConfig};

/// Width of labels when the configuration does not redraw them, metres.
pub const DEFAULT_LABEL_DILATION_M: f64 = 1.4;
/// Name of the checkpoint in the directory of a run.
pub const CHECKPOINT_FILE: &str = "checkpoint.safetensors";
/// Name of the newest weights in the directory of a run.
pub const WEIGHTS_FILE: &str = "weights.safetensors";
/// Name of the weights that scored best on the validation samples.
pub const BEST_FILE: &str = "best.safetensors";

/// What a network is for that is trained with `config` on grids like `spec`.
pub fn network_info(config: &TrainConfig, spec: &GridSpec, vehicle: &Vehicle) -> NetworkInfo {
    NetworkInfo {
        rows: spec.rows,
        cols: spec.cols,
        resolution_m: spec.resolution_m,
        size: config.size,
        vehicle: vehicle.digest(),
        label_dilation_m: config.label_dilation_m.unwrap_or(DEFAULT_LABEL_DILATION_M),
        ..NetworkInfo::default()
    }
}

/// A network in training.
#[derive(Debug)]
pub struct Learner {
    config: TrainConfig,
    info: NetworkInfo,
    encoding: Encoding,
    network: Training,
    parameters: Parameters,
    adam: Adam,
    progress: Progress,
    memory: Memory,
}

/// Buffers that are reused from step to step.
#[derive(Debug, Default)]
struct Memory {
    gradient: Vec<f32>,
    input: Vec<f32>,
    cells: Vec<f32>,
    cell_gradient: Vec<f32>,
    logit_gradient: Vec<f32>,
}

impl Learner {
    /// A network that has learnt nothing yet.
    ///
    /// # Errors
    /// [`Error::Config`] if the configuration or the grid is out of range.
    pub fn new(config: TrainConfig, info: NetworkInfo) -> Result<Self, Error> {
        config.validate()?;
        let encoding = info.encoding();
        let (rows, cols) = encoding.input_size();
        let network = Training::new(rows, cols).ok_or_else(|| Error::Config {
            what: format!("the network's input would be {rows} x {cols}, expected at most 4096"),
        })?;
        let parameters = Parameters::initial(config.seed);
        Ok(Self {
            adam: Adam::new(config.adam, parameters.is_kernel()),
            memory: Memory {
                gradient: vec![0.0; parameters.values().len()],
                ..Memory::default()
            },
            progress: Progress::default(),
            parameters,
            network,
            encoding,
            info,
            config,
        })
    }

    /// Goes on from a checkpoint, in the configuration that it was made with.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] if it is of another configuration.
    pub fn resume(
        checkpoint: Checkpoint,
        path: &Path,
        config: &TrainConfig,
        info: NetworkInfo,
    ) -> Result<Self, Error> {
        let wrong = |what: String| Error::Checkpoint {
            path: path.to_owned(),
            what,
        };
        if checkpoint.config != *config {
            return Err(wrong(format!(
                "it was made with {:?}, now it is {config:?}",
                checkpoint.config
            )));
        }
        let mut learner = Self::new(checkpoint.config, info)?;
        learner.parameters = checkpoint.parameters;
        learner.progress = checkpoint.progress;
        learner
            .adam
            .restore(checkpoint.adam)
            .map_err(|state| wrong(format!("{} moments", state.mean.len())))?;
        Ok(learner)
    }

    /// Starts from weights that were trained before, with a fresh optimiser.
    pub fn start_from(&mut self, parameters: Parameters) {
        self.parameters = parameters;
    }

    /// One step of the optimiser on these samples; the mean loss of a sample before it.
    ///
    /// # Errors
    /// [`Error::Diverged`] if the loss is not finite (the parameters are then as before), the
    /// planner's if a sample is of another grid.
    pub fn step(&mut self, shown: &[Shown], rate: f64) -> Result<f64, Error> {
        if shown.is_empty() {
            return Ok(0.0);
        }
        self.memory.gradient.fill(0.0);
        let mut loss = 0.0;
        for part in shown.chunks(self.config.micro_batch) {
            loss += self.accumulate(part, shown.len())?;
        }
        if !loss.is_finite() || !self.memory.gradient.iter().all(|value| value.is_finite()) {
            return Err(Error::Diverged {
                step: self.progress.step,
                loss,
                rate,
            });
        }
        self.adam
            .step(rate, self.parameters.values_mut(), &self.memory.gradient);
        self.progress.step += 1;
        self.progress.samples += shown.len() as u64;
        self.progress.loss_sum += loss;
        self.progress.loss_steps += 1;
        Ok(loss)
    }

    /// Adds the gradient of a part of a batch of `batch` samples; the part's share of the loss.
    fn accumulate(&mut self, part: &[Shown], batch: usize) -> Result<f64, Error> {
        let Self {
            encoding, memory, ..
        } = self;
        let planes = part.par_iter().map(|shown| Planes::of(shown, &self.config));
        let planes: Vec<Planes> = planes.collect();
        let (input_len, cells) = (encoding.input_len(), encoding.cells());
        memory.input.resize(part.len() * input_len, 0.0);
        memory
            .input
            .par_chunks_exact_mut(input_len)
            .zip(&planes)
            .try_for_each(|(input, planes)| encoding.encode(planes.inputs(), input))?;
        for planes in &planes {
            encoding.check(&planes.label)?;
        }
        let dropout = self.config.dropout.then_some(Dropout {
            seed: self.config.seed,
            pass: self.progress.passes,
        });
        self.progress.passes += 1;
        let logits = self
            .network
            .forward(&self.parameters, &memory.input, dropout);
        let logit_len = input_len / INPUT_PLANES;
        memory.cells.resize(part.len() * cells, 0.0);
        memory.cell_gradient.resize(part.len() * cells, 0.0);
        memory.logit_gradient.resize(part.len() * logit_len, 0.0);
        logits
            .par_chunks_exact(logit_len)
            .zip(memory.cells.par_chunks_exact_mut(cells))
            .for_each(|(logits, cells)| encoding.decode(logits, cells));
        let labels: Vec<&Plane> = planes.iter().map(|planes| &planes.label).collect();
        let loss = loss_and_gradient(
            self.config.loss,
            &labels,
            &memory.cells,
            &mut memory.cell_gradient,
            batch,
        );
        memory
            .cell_gradient
            .par_chunks_exact(cells)
            .zip(memory.logit_gradient.par_chunks_exact_mut(logit_len))
            .for_each(|(cells, logits)| encoding.decode_backward(cells, logits));
        let gradient = &mut memory.gradient;
        self.network
            .backward(&self.parameters, &memory.logit_gradient, gradient);
        self.network.update_running(&mut self.parameters);
        Ok(loss)
    }

    /// Where the training stands.
    pub const fn progress(&self) -> &Progress {
        &self.progress
    }

    /// The network as it is now, for predictions.
    pub fn network(&self) -> Network {
        Network::new(self.info.clone(), &self.parameters)
    }

    /// What the network is for.
    pub const fn info(&self) -> &NetworkInfo {
        &self.info
    }

    /// The weights file as of now.
    pub fn weights(&self) -> Vec<u8> {
        Network::save(&self.info, &self.parameters)
    }

    /// The configuration.
    pub const fn config(&self) -> &TrainConfig {
        &self.config
    }

    /// Counts up the number of published weights and returns it.
    pub const fn next_version(&mut self) -> u64 {
        self.progress.version += 1;
        self.progress.version
    }

    /// Mean loss since this was last asked, NaN if there was no step.
    pub fn take_loss(&mut self) -> f64 {
        let mean = self.progress.loss_sum / self.progress.loss_steps as f64;
        self.progress.loss_sum = 0.0;
        self.progress.loss_steps = 0;
        mean
    }

    /// Everything needed to go on later.
    pub fn checkpoint(&self) -> Checkpoint {
        Checkpoint {
            config: self.config.clone(),
            progress: self.progress.clone(),
            parameters: self.parameters.clone(),
            adam: self.adam.state().clone(),
        }
    }
}

/// The planes of one showing, mirrored and relabelled as it says.
struct Planes {
    obstacles: Plane,
    reference: Plane,
    target: Plane,
    label: Plane,
}

impl Planes {
    fn of(shown: &Shown, config: &TrainConfig) -> Self {
        let example = &*shown.example;
        let about = example.spec.ego_col;
        let turned = |plane: &Plane| {
            if shown.mirrored {
                mirrored(plane, about)
            } else {
                plane.clone()
            }
        };
        let label = config
            .label_dilation_m
            .map(|dilation_m| example.label_at(dilation_m));
        Self {
            obstacles: turned(&example.obstacles),
            reference: turned(&example.reference),
            target: turned(&example.target),
            label: turned(label.as_ref().unwrap_or(&example.label)),
        }
    }

    const fn inputs(&self) -> [&Plane; INPUT_PLANES] {
        [&self.obstacles, &self.reference, &self.target]
    }
}

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

/// The end of an epoch, for whoever watches.
#[derive(Debug, Clone)]
pub struct EpochReport {
    /// Epochs completed.
    pub epoch: u64,
    /// Steps taken.
    pub step: u64,
    /// Mean loss of the epoch.
    pub loss: f64,
    /// Scores on the validation samples, if there are any.
    pub validation: Option<Report>,
}

/// Watches a training and may end it.
pub trait Observer {
    /// After each step.
    fn stepped(&mut self, _report: &StepReport) {}

    /// After each epoch.
    fn epoch_ended(&mut self, _report: &EpochReport) {}

    /// Asked before each step; the run then ends with a checkpoint.
    fn should_stop(&mut self) -> bool {
        false
    }
}

/// Watches nothing.
#[derive(Debug, Clone, Copy)]
pub struct Unobserved;

impl Observer for Unobserved {}

/// A run from where the learner stands to the last epoch of its configuration.
#[derive(Debug)]
pub struct Run<'a> {
    /// Where samples come from.
    pub source: &'a mut dyn Source,
    /// Scored after every epoch; may be empty.
    pub validation: &'a [Example],
    /// Where checkpoint and weights are kept, if anywhere.
    pub directory: Option<PathBuf>,
}

/// How a run ended.
#[derive(Debug, Clone)]
pub struct Summary {
    /// Whether it came to its end.
    pub complete: bool,
    /// The last scores on the validation samples.
    pub validation: Option<Report>,
}

impl Run<'_> {
    /// Trains to the end or until the observer stops it. A checkpoint and the newest weights are
    /// written after every epoch and on stopping, the best weights whenever they are.
    ///
    /// # Errors
    /// [`Error::Diverged`], [`Error::Io`], [`Error::Checkpoint`] if the learner comes from a run over
    /// another number of samples.
    pub fn train(
        self,
        learner: &mut Learner,
        observer: &mut dyn Observer,
    ) -> Result<Summary, Error> {
        if let Some(directory) = &self.directory {
            std::fs::create_dir_all(directory).map_err(|source| Error::Io {
                path: directory.clone(),
                source,
            })?;
        }
        let (batch, epochs) = (learner.config.batch, learner.config.epochs);
        let an_epoch = self.source.steps_per_epoch(batch);
        let total = an_epoch * epochs;
        let schedule = learner.config.schedule(total);
        if learner.progress.step > 0 && learner.progress.total_steps != total {
            return Err(Error::Checkpoint {
                path: self.directory.unwrap_or_default().join(CHECKPOINT_FILE),
                what: format!(
                    "it is of a run of {} steps, these samples and settings make {total}",
                    learner.progress.total_steps
                ),
            });
        }
        learner.progress.total_steps = total;
        let mut validation = None;
        while learner.progress.step < total {
            let step = learner.progress.step;
            if observer.should_stop() {
                self.keep(learner)?;
                return Ok(Summary {
                    complete: false,
                    validation,
                });
            }
            let rate = schedule.rate(step);
            let shown = self.source.draw(step, batch);
            let loss = learner.step(&shown, rate)?;
            observer.stepped(&StepReport {
                step: step + 1,
                steps: Some(total),
                epoch: step / an_epoch,
                loss,
                rate,
                samples: learner.progress.samples,
            });
            if (step + 1).is_multiple_of(an_epoch) {
                validation = self.end_epoch(learner, (step + 1) / an_epoch, observer)?;
            }
        }
        Ok(Summary {
            complete: true,
            validation,
        })
    }

    fn end_epoch(
        &self,
        learner: &mut Learner,
        epoch: u64,
        observer: &mut dyn Observer,
    ) -> Result<Option<Report>, Error> {
        let validation = score(learner, self.validation)?;
        let loss = learner.take_loss();
        if let Some(report) = &validation {
            let miou = report.scores.total.miou();
            if learner.progress.best_miou.is_none_or(|best| miou > best) {
                learner.progress.best_miou = Some(miou);
                if let Some(directory) = &self.directory {
                    write_atomically(&directory.join(BEST_FILE), &learner.weights())?;
                }
            }
        }
        self.keep(learner)?;
        observer.epoch_ended(&EpochReport {
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

/// The scores of a learner's network on some samples, `None` if there are none.
///
/// # Errors
/// The network's, if the samples are of another grid.
pub fn score(learner: &Learner, examples: &[Example]) -> Result<Option<Report>, Error> {
    if !examples.iter().any(Example::is_solved) {
        return Ok(None);
    }
    let network = learner.network();
    let dilation_m = learner.info.label_dilation_m;
    let redraw = learner.config.label_dilation_m.is_some();
    evaluate(Predictor::Network(&network), examples, dilation_m, redraw).map(Some)
}

#[cfg(test)]
mod tests;
