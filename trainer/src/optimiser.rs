//! Adam over one flat vector of parameters.

use serde::{Deserialize, Serialize};

/// Smaller numbers become 0: products with the smallest that single precision has take a processor a
/// hundred times as long.
const LEAST: f32 = 1e-25;

/// How weight decay enters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Decay {
    /// Added to the gradient, as `PyTorch`'s `Adam` and so the paper's.
    L2,
    /// Taken off the parameters beside the step, as `AdamW`.
    Decoupled,
}

/// The constants of Adam.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AdamConfig {
    /// Memory of the mean gradient, below 1.
    pub beta1: f64,
    /// Memory of the mean square gradient, below 1.
    pub beta2: f64,
    /// Added to the root of the mean square.
    pub epsilon: f64,
    /// Factor of the parameters in the decay.
    pub weight_decay: f64,
    /// How it enters.
    pub decay: Decay,
}

impl AdamConfig {
    /// The paper's weight decay, and the customary rest.
    pub const PAPER: Self = Self {
        beta1: 0.9,
        beta2: 0.999,
        epsilon: 1e-8,
        weight_decay: 2e-4,
        decay: Decay::L2,
    };
}

impl Default for AdamConfig {
    /// Decay beside the step. Added to the gradient, it takes the full rate off every parameter whose
    /// own gradient is small: a third of the channels died within a few thousand steps.
    fn default() -> Self {
        Self {
            weight_decay: 1e-2,
            decay: Decay::Decoupled,
            ..Self::PAPER
        }
    }
}

/// Adam (D. Kingma and J. Ba, 2015) with its state.
///
/// Unlike `PyTorch`'s default, weight decay is confined to the parameters that `decays` marks.
#[derive(Debug, Clone, PartialEq)]
pub struct Adam {
    config: AdamConfig,
    decays: Vec<bool>,
    state: AdamState,
}

/// What Adam remembers.
#[derive(Debug, Clone, PartialEq)]
pub struct AdamState {
    /// Steps taken.
    pub steps: u64,
    /// Running mean of the gradient.
    pub mean: Vec<f32>,
    /// Running mean of its square.
    pub square: Vec<f32>,
}

impl Adam {
    /// An optimiser that has taken no step; it has as many parameters as `decays`.
    pub fn new(config: AdamConfig, decays: Vec<bool>) -> Self {
        let state = AdamState {
            steps: 0,
            mean: vec![0.0; decays.len()],
            square: vec![0.0; decays.len()],
        };
        Self {
            config,
            decays,
            state,
        }
    }

    /// What it remembers.
    pub const fn state(&self) -> &AdamState {
        &self.state
    }

    /// Continues from a state, or gives it back if it is for another number of parameters.
    ///
    /// # Errors
    /// The state that does not fit.
    pub fn restore(&mut self, state: AdamState) -> Result<(), AdamState> {
        if [state.mean.len(), state.square.len()] != [self.decays.len(); 2] {
            return Err(state);
        }
        self.state = state;
        Ok(())
    }

    /// One step down the gradient.
    ///
    /// # Shapes
    /// Both as long as the parameters.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "parameters are of single precision"
    )]
    pub fn step(&mut self, rate: f64, values: &mut [f32], gradient: &[f32]) {
        let Adam {
            config,
            decays,
            state,
        } = self;
        state.steps += 1;
        let power = i32::try_from(state.steps).unwrap_or(i32::MAX);
        let mean_bias = 1.0 - config.beta1.powi(power);
        let square_bias = 1.0 - config.beta2.powi(power);
        let step = (rate / mean_bias) as f32;
        let root_scale = (1.0 / square_bias.sqrt()) as f32;
        let (beta1, beta2) = (config.beta1 as f32, config.beta2 as f32);
        let epsilon = config.epsilon as f32;
        let (l2, shrink) = match config.decay {
            Decay::L2 => (config.weight_decay as f32, 0.0),
            Decay::Decoupled => (0.0, (rate * config.weight_decay) as f32),
        };
        let moments = state.mean.iter_mut().zip(&mut state.square);
        let parameters = values.iter_mut().zip(gradient).zip(&*decays);
        for (((value, &gradient), &decays), (mean, square)) in parameters.zip(moments) {
            let (l2, shrink) = if decays { (l2, shrink) } else { (0.0, 0.0) };
            let gradient = gradient + l2 * *value;
            *mean += (1.0 - beta1) * (gradient - *mean);
            *square += (1.0 - beta2) * (gradient * gradient - *square);
            *value -= shrink * *value + step * *mean / (square.sqrt() * root_scale + epsilon);
            for number in [value, mean, square] {
                if number.abs() < LEAST {
                    *number = 0.0;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_step_is_the_rate_against_the_sign_of_the_gradient() {
        let config = AdamConfig {
            weight_decay: 0.0,
            ..AdamConfig::default()
        };
        let mut adam = Adam::new(config, vec![true; 3]);
        let mut values = [1.0, 1.0, 1.0];
        adam.step(0.1, &mut values, &[5.0, -0.01, 0.0]);
        for (value, expected) in values.iter().zip([0.9, 1.1, 1.0]) {
            assert!((value - expected).abs() < 1e-5);
        }
    }

    #[test]
    fn a_cubic_is_descended_as_by_the_formulas_in_double_precision() {
        for decay in [Decay::L2, Decay::Decoupled] {
            let config = AdamConfig {
                weight_decay: 0.1,
                decay,
                ..AdamConfig::default()
            };
            let mut adam = Adam::new(config, vec![true, true]);
            let mut values = [0.5_f32, -1.0];
            let mut expected = [0.5_f64, -1.0];
            let (mut mean, mut square) = ([0.0; 2], [0.0; 2]);
            for step in 1..=20 {
                let gradient = values.map(|value| 3.0 * value * value);
                adam.step(0.01, &mut values, &gradient);
                for index in 0..2 {
                    let mut slope = 3.0 * expected[index] * expected[index];
                    match decay {
                        Decay::L2 => slope += 0.1 * expected[index],
                        Decay::Decoupled => expected[index] *= 1.0 - 0.01 * 0.1,
                    }
                    mean[index] = 0.9 * mean[index] + 0.1 * slope;
                    square[index] = 0.999 * square[index] + 0.001 * slope * slope;
                    let m: f64 = mean[index] / (1.0 - 0.9_f64.powi(step));
                    let v: f64 = square[index] / (1.0 - 0.999_f64.powi(step));
                    expected[index] -= 0.01 * m / (v.sqrt() + 1e-8);
                }
            }
            for (value, expected) in values.iter().zip(expected) {
                assert!((f64::from(*value) - expected).abs() < 1e-5);
            }
        }
    }
}
