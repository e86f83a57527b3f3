//! The knobs of a training run.

use serde::{Deserialize, Serialize};
use swath_planner::network::{Architecture, InputSize};

use crate::Error;
use crate::loss::LossConfig;
use crate::optimiser::AdamConfig;
use crate::schedule::Schedule;

/// Width of labels when nothing is said of it, metres.
pub const DEFAULT_LABEL_DILATION_M: f64 = 1.4;

/// Most samples in a batch.
pub const MAX_BATCH: usize = 4096;
/// Most passes over the data.
pub const MAX_EPOCHS: u64 = 1_000_000;

/// How a network is trained.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainConfig {
    /// Seed of the initial parameters, of shuffles, mirroring and dropout.
    pub seed: u64,
    /// Which network.
    pub architecture: Architecture,
    /// Resolution at which the network sees the grid.
    pub size: InputSize,
    /// Passes over the data.
    pub epochs: u64,
    /// Samples a step.
    pub batch: usize,
    /// Samples that go through the network at once; a batch is the sum of such parts. Memory grows
    /// with it, and normalisation uses the statistics of a part.
    pub micro_batch: usize,
    /// Rate once warmed up, see [`Schedule`].
    pub base_rate: f64,
    /// Share of all steps that warm up, 0 to 1; at most [`Self::max_warm_up_steps`].
    pub warm_up_share: f64,
    /// Most steps that warm up.
    pub max_warm_up_steps: u64,
    /// Weight decay and moments.
    pub adam: AdamConfig,
    /// What is minimised.
    pub loss: LossConfig,
    /// Whether channels are dropped as the architecture says.
    pub dropout: bool,
    /// Whether every other showing of a sample is mirrored left to right.
    pub mirror: bool,
    /// Share of a batch that is drawn from the samples that the planner finds hardest.
    pub hard_share: f64,
    /// Steps from one scoring to the next, apart from those after each epoch; 0 for none.
    pub score_every_steps: u64,
    /// Ends a run after so many scorings without a better one; 0 for never.
    pub patience: u64,
    /// Redraws labels with this distance from path to edge, metres; `None` takes them as they are.
    pub label_dilation_m: Option<f64>,
    /// How wide samples draw what the network sees and learns: the generator's settings, not this
    /// section's.
    #[serde(skip)]
    pub drawn: DrawnRadii,
}

/// How wide paths, references and targets are drawn in samples, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrawnRadii {
    /// From the path to the edge of its label.
    pub path_m: f64,
    /// From the reference to the edge of its plane.
    pub reference_m: f64,
    /// From the target to the edge of its disc.
    pub target_m: f64,
}

impl Default for DrawnRadii {
    /// The generator's defaults.
    fn default() -> Self {
        Self {
            path_m: DEFAULT_LABEL_DILATION_M,
            reference_m: 1.0,
            target_m: 1.0,
        }
    }
}

impl Default for TrainConfig {
    /// Fits a CPU: small batches at half size and a rate above the paper's.
    fn default() -> Self {
        Self {
            seed: 1,
            architecture: Architecture::default(),
            size: InputSize::Half,
            epochs: 20,
            batch: 16,
            micro_batch: 16,
            base_rate: 2.5e-3,
            warm_up_share: 0.05,
            max_warm_up_steps: 500,
            adam: AdamConfig::default(),
            loss: LossConfig::default(),
            dropout: true,
            mirror: true,
            hard_share: 0.0,
            score_every_steps: 0,
            patience: 0,
            label_dilation_m: None,
            drawn: DrawnRadii::default(),
        }
    }
}

impl TrainConfig {
    /// The paper's set-up: batch 100, rate 5e-4, weight decay 2e-4, 300 epochs, full size, cross
    /// entropy only.
    pub fn paper() -> Self {
        Self {
            architecture: Architecture::Enet,
            size: InputSize::Full,
            epochs: 300,
            batch: 100,
            micro_batch: 20,
            base_rate: 5e-4,
            adam: AdamConfig::PAPER,
            loss: LossConfig {
                dice_weight: 0.0,
                reach_weight: 0.0,
                ..LossConfig::default()
            },
            mirror: false,
            ..Self::default()
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Config`] names the field that is out of range.
    pub fn validate(&self) -> Result<(), Error> {
        let wrong = |what: String| Err(Error::Config { what });
        if self.batch == 0 || self.batch > MAX_BATCH {
            return wrong(format!(
                "batch is {}, expected 1 to {MAX_BATCH}",
                self.batch
            ));
        }
        if self.micro_batch == 0 || self.micro_batch > self.batch {
            let most = self.batch;
            return wrong(format!(
                "micro_batch is {}, expected 1 to {most}",
                self.micro_batch
            ));
        }
        if self.epochs == 0 || self.epochs > MAX_EPOCHS {
            return wrong(format!(
                "epochs is {}, expected 1 to {MAX_EPOCHS}",
                self.epochs
            ));
        }
        let dilation = self.label_dilation_m.unwrap_or(1.0);
        for (name, value, least, most) in [
            ("base_rate", self.base_rate, 1e-9, 1.0),
            ("warm_up_share", self.warm_up_share, 0.0, 1.0),
            ("adam.weight_decay", self.adam.weight_decay, 0.0, 1.0),
            ("adam.beta1", self.adam.beta1, 0.0, 0.999_999),
            ("adam.beta2", self.adam.beta2, 0.0, 0.999_999),
            ("adam.epsilon", self.adam.epsilon, 1e-12, 1.0),
            (
                "loss.dice_weight",
                f64::from(self.loss.dice_weight),
                0.0,
                100.0,
            ),
            (
                "loss.path_weight",
                f64::from(self.loss.path_weight),
                f64::from(0.01_f32),
                100.0,
            ),
            (
                "loss.reach_weight",
                f64::from(self.loss.reach_weight),
                0.0,
                100.0,
            ),
            ("hard_share", self.hard_share, 0.0, 1.0),
            ("label_dilation_m", dilation, 0.1, 10.0),
        ] {
            if !(least..=most).contains(&value) {
                return wrong(format!("{name} is {value}, expected {least} to {most}"));
            }
        }
        Ok(())
    }

    /// The schedule of a run of `steps` steps.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a share of a count of steps is a smaller count of steps"
    )]
    pub fn schedule(&self, steps: u64) -> Schedule {
        let warm_up = (self.warm_up_share * steps as f64).ceil() as u64;
        let warm_up = warm_up.min(self.max_warm_up_steps).min(steps);
        Schedule::cosine(self.base_rate, warm_up, steps - warm_up)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_presets_are_valid_and_nonsense_is_named() {
        TrainConfig::default().validate().unwrap();
        TrainConfig::paper().validate().unwrap();
        let config = TrainConfig {
            base_rate: f64::NAN,
            ..TrainConfig::default()
        };
        let error = config.validate().unwrap_err().to_string();
        assert!(error.contains("base_rate"), "{error}");
        let config = TrainConfig {
            micro_batch: 17,
            ..TrainConfig::default()
        };
        assert!(config.validate().is_err());
    }
}
