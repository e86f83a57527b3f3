//! What training minimises: cross entropy of each cell, and optionally the Dice loss of the region.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use swath_planner::Plane;

/// Added to both sides of the Dice quotient, in cells.
const DICE_SMOOTHING: f64 = 1.0;

/// Smaller derivatives of a cell count as 0. Where a network is sure, they are as small as single
/// precision goes, and products with such numbers take a processor a hundred times as long.
const LEAST_DERIVATIVE: f32 = 1e-7;

/// The parts of the loss.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LossConfig {
    /// Factor of the Dice loss beside the mean cross entropy, 0 for none.
    pub dice_weight: f32,
    /// Factor of the cross entropy of cells in the label.
    pub path_weight: f32,
    /// Factor of the loss of whether and how a target can be reached.
    pub reach_weight: f32,
}

impl Default for LossConfig {
    fn default() -> Self {
        Self {
            dice_weight: 0.5,
            path_weight: 1.0,
            reach_weight: 0.1,
        }
    }
}

/// Cross entropy with logits of one cell and its derivative: softplus(x) − x·y and σ(x) − y.
///
/// Neither overflows nor loses the small side: only exp(−|x|) is taken.
fn cross_entropy(logit: f32, label: bool) -> (f32, f32) {
    let small = (-logit.abs()).exp();
    let probability = sigmoid_of(logit, small);
    let softplus = logit.max(0.0) + small.ln_1p();
    if label {
        (softplus - logit, probability - 1.0)
    } else {
        (softplus, probability)
    }
}

/// σ(x), given exp(−|x|).
fn sigmoid_of(logit: f32, small: f32) -> f32 {
    if logit >= 0.0 {
        1.0 / (1.0 + small)
    } else {
        small / (1.0 + small)
    }
}

/// The sum over images of their losses divided by `images_in_batch`; `gradient` becomes its
/// derivative. Images with an empty label are of targets without a path, and cost nothing.
///
/// Infinite and undefined logits give a loss that is not finite, never a panic.
///
/// # Shapes
/// `logits` and `gradient`: images × cells of a label.
pub fn loss_and_gradient(
    config: LossConfig,
    labels: &[&Plane],
    logits: &[f32],
    gradient: &mut [f32],
    images_in_batch: usize,
) -> f64 {
    let Some(cells) = labels
        .first()
        .map(|label| label.len())
        .filter(|&cells| cells > 0)
    else {
        return 0.0;
    };
    let share = 1.0 / images_in_batch as f64;
    let images = logits
        .par_chunks_exact(cells)
        .zip(gradient.par_chunks_exact_mut(cells));
    let losses: Vec<f64> = images
        .zip(labels)
        .map(|((logits, gradient), label)| image_loss(config, label, logits, gradient, share))
        .collect();
    losses.iter().sum()
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "gradients are of single precision"
)]
fn image_loss(
    config: LossConfig,
    label: &Plane,
    logits: &[f32],
    gradient: &mut [f32],
    share: f64,
) -> f64 {
    if label.packed().iter().all(|&bits| bits == 0) {
        gradient.fill(0.0);
        return 0.0;
    }
    let cell_share = (share / logits.len() as f64) as f32;
    let mut entropy = 0.0;
    let (mut common, mut both) = (0.0, 0.0);
    for (index, (&logit, gradient)) in logits.iter().zip(gradient.iter_mut()).enumerate() {
        let inside = label.get_index(index);
        let (value, derivative) = cross_entropy(logit, inside);
        let weight = if inside { config.path_weight } else { 1.0 };
        entropy += f64::from(weight * value);
        *gradient = weight * derivative * cell_share;
        let probability = f64::from(derivative + f32::from(u8::from(inside)));
        common += if inside { probability } else { 0.0 };
        both += probability + f64::from(u8::from(inside));
    }
    let mut loss = entropy * f64::from(cell_share);
    if config.dice_weight > 0.0 {
        let weight = f64::from(config.dice_weight) * share;
        let (top, bottom) = (2.0 * common + DICE_SMOOTHING, both + DICE_SMOOTHING);
        loss += weight * (1.0 - top / bottom);
        let outside_slope = (weight * top / (bottom * bottom)) as f32;
        let inside_slope = outside_slope - (weight * 2.0 / bottom) as f32;
        for (index, (&logit, gradient)) in logits.iter().zip(gradient.iter_mut()).enumerate() {
            let small = (-logit.abs()).exp();
            let slope = if label.get_index(index) {
                inside_slope
            } else {
                outside_slope
            };
            *gradient += slope * small / ((1.0 + small) * (1.0 + small));
        }
    }
    let least = LEAST_DERIVATIVE * cell_share;
    for gradient in gradient {
        if gradient.abs() < least {
            *gradient = 0.0;
        }
    }
    loss
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn label(cells: u32, step: usize) -> Plane {
        let mut plane = Plane::empty(1, cells);
        (0..cells as usize)
            .step_by(step)
            .for_each(|index| plane.set_index(index));
        plane
    }

    #[test]
    fn extreme_logits_cost_what_they_should() {
        for logit in [-1e30, -1e4, -88.0, 0.0, 88.0, 1e4, 1e30_f32] {
            for inside in [false, true] {
                let (value, derivative) = cross_entropy(logit, inside);
                let against = if inside { -logit } else { logit };
                let expected = if logit == 0.0 {
                    std::f32::consts::LN_2
                } else {
                    against.max(0.0)
                };
                assert!(
                    (value - expected).abs() <= 1e-6 * (1.0 + expected),
                    "{logit} {inside}"
                );
                assert!(derivative.abs() <= 1.0 && derivative.is_finite());
            }
        }
        let (value, derivative) = cross_entropy(-20.0, false);
        assert!((f64::from(value) / (-20.0_f64).exp() - 1.0).abs() < 1e-5);
        assert!((f64::from(derivative) / (-20.0_f64).exp() - 1.0).abs() < 1e-5);
    }

    #[test]
    fn a_perfect_region_costs_nothing_and_its_opposite_a_lot() {
        let label = label(40, 3);
        let logit = |inside: bool| if inside { 30.0 } else { -30.0 };
        let right: Vec<f32> = (0..40).map(|cell| logit(label.get_index(cell))).collect();
        let wrong: Vec<f32> = right.iter().map(|logit| -logit).collect();
        let mut gradient = vec![0.0; 40];
        let config = LossConfig::default();
        let mut cost =
            |logits: &[f32]| loss_and_gradient(config, &[&label], logits, &mut gradient, 1);
        assert!(cost(&right) < 1e-9);
        assert!(cost(&wrong) > 30.0);
    }

    proptest! {
        #[test]
        fn the_gradient_is_that_of_finite_differences(
            logits in proptest::collection::vec(-6.0f32..6.0, 24),
            dice_weight in 0.0f32..2.0, path_weight in 0.5f32..3.0, step in 2usize..6,
        ) {
            let config = LossConfig { dice_weight, path_weight, ..LossConfig::default() };
            let (first, second) = (label(12, step), label(12, step + 1));
            let labels = [&first, &second];
            let mut gradient = vec![0.0; 24];
            loss_and_gradient(config, &labels, &logits, &mut gradient, 3);
            let mut unused = vec![0.0; 24];
            for index in 0..24 {
                let mut at = |offset: f32| {
                    let mut moved = logits.clone();
                    moved[index] += offset;
                    loss_and_gradient(config, &labels, &moved, &mut unused, 3)
                };
                let slope = (at(0.01) - at(-0.01)) / 0.02;
                prop_assert!((slope - f64::from(gradient[index])).abs() < 2e-5);
            }
        }
    }
}
