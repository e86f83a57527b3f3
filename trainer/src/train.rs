//! A network in training: one step of it, and its scores.

use std::path::Path;

use rayon::prelude::*;
use swath_bridge::{GridSpec, Vehicle};
use swath_planner::Plane;
use swath_planner::network::{Dropout, Encoding, Network, NetworkInfo, Parameters, Training};

use crate::batch::{Batch, Part, Preparation};
use crate::checkpoint::{Checkpoint, Progress};
use crate::evaluate::{Predictor, Report, evaluate};
use crate::loss::loss_and_gradient;
use crate::optimiser::Adam;
use crate::reach;
use crate::{Error, Example, TrainConfig};

/// What a network is for that is trained with `config` on grids like `spec`.
pub fn network_info(config: &TrainConfig, spec: &GridSpec, vehicle: &Vehicle) -> NetworkInfo {
    NetworkInfo {
        architecture: config.architecture,
        spec: *spec,
        size: config.size,
        vehicle: vehicle.digest(),
        min_turning_radius_m: vehicle.min_turning_radius_m,
        speed_limits: vehicle.speed_limits(),
        half_width_m: vehicle.half_width_m,
        label_dilation_m: config.label_dilation_m.unwrap_or(config.drawn.path_m),
        reference_dilation_m: config.drawn.reference_m,
        target_dilation_m: config.drawn.target_m,
    }
}

/// A network in training.
#[derive(Debug)]
pub struct Learner {
    pub(crate) config: TrainConfig,
    info: NetworkInfo,
    encoding: Encoding,
    network: Training,
    parameters: Parameters,
    adam: Adam,
    pub(crate) progress: Progress,
    memory: Memory,
}

/// Buffers that are reused from step to step.
#[derive(Debug, Default)]
struct Memory {
    gradient: Vec<f32>,
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
        let network = Training::new(config.architecture, (rows, cols));
        let network = network.ok_or_else(|| Error::Config {
            what: format!("the network's input would be {rows} x {cols}, expected at most 4096"),
        })?;
        let parameters = Parameters::initial(config.architecture, config.seed);
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

    /// How batches for this network are made.
    pub const fn preparation(&self) -> Preparation {
        Preparation::new(&self.config, &self.encoding)
    }

    /// One step of the optimiser on a batch; the mean loss of a sample before it.
    ///
    /// # Errors
    /// [`Error::Diverged`] if the loss is not finite; the parameters are then as before.
    pub fn step(&mut self, batch: &Batch, rate: f64) -> Result<f64, Error> {
        if batch.samples == 0 {
            return Ok(0.0);
        }
        self.memory.gradient.fill(0.0);
        let parts = batch.parts.iter();
        let loss = parts.map(|part| self.accumulate(part, batch.samples)).sum();
        if !f64::is_finite(loss) || !self.memory.gradient.iter().all(|value| value.is_finite()) {
            return Err(Error::Diverged {
                step: self.progress.step,
                loss,
                rate,
            });
        }
        self.adam
            .step(rate, self.parameters.values_mut(), &self.memory.gradient);
        self.progress.step += 1;
        self.progress.samples += batch.samples as u64;
        self.progress.loss_sum += loss;
        self.progress.loss_steps += 1;
        Ok(loss)
    }

    /// Adds the gradient of a part of a batch of `samples`; the part's share of the loss.
    fn accumulate(&mut self, part: &Part, samples: usize) -> f64 {
        let Self {
            encoding, memory, ..
        } = self;
        let (images, cells) = (part.labels.len(), encoding.cells());
        let dropout = self.config.dropout.then_some(Dropout {
            seed: self.config.seed,
            pass: self.progress.passes,
        });
        self.progress.passes += 1;
        let logits = self.network.forward(&self.parameters, &part.input, dropout);
        let logit_len = encoding.output_len();
        memory.cells.resize(images * cells, 0.0);
        memory.cell_gradient.resize(images * cells, 0.0);
        memory.logit_gradient.resize(images * logit_len, 0.0);
        logits
            .par_chunks_exact(logit_len)
            .zip(memory.cells.par_chunks_exact_mut(cells))
            .for_each(|(logits, cells)| encoding.decode(logits, cells));
        let labels: Vec<&Plane> = part.labels.iter().collect();
        let of_cells = loss_and_gradient(
            self.config.loss,
            &labels,
            &memory.cells,
            &mut memory.cell_gradient,
            samples,
        );
        memory
            .cell_gradient
            .par_chunks_exact(cells)
            .zip(memory.logit_gradient.par_chunks_exact_mut(logit_len))
            .for_each(|(cells, logits)| encoding.decode_backward(cells, logits));
        let (of_reach, score_gradient) = reach::loss_and_gradient(
            self.config.loss.reach_weight,
            &part.reached,
            &self.network.scores(),
            samples,
        );
        let gradients = (memory.logit_gradient.as_slice(), score_gradient.as_slice());
        self.network
            .backward(&self.parameters, gradients, &mut memory.gradient);
        self.network.update_running(&mut self.parameters);
        of_cells + of_reach
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
