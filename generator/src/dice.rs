//! Chance, seeded: every random number of the generator comes from here.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use crate::config::Span;

/// What a stream of random numbers is used for; streams of different purposes are independent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Purpose {
    Scene = 1,
    Target = 2,
    Augment = 3,
    Lidar = 4,
    Drive = 5,
}

/// A stream of random numbers that is the same on every machine.
#[derive(Debug, Clone)]
pub(crate) struct Dice(ChaCha8Rng);

impl Dice {
    /// The stream of a purpose. The four numbers are the cipher's key, so that no two streams meet.
    pub(crate) fn new(seed: u64, purpose: Purpose, index: u64, variant: u64) -> Self {
        let mut key = [0; 32];
        for (part, value) in key
            .chunks_exact_mut(8)
            .zip([seed, purpose as u64, index, variant])
        {
            part.copy_from_slice(&value.to_le_bytes());
        }
        Self(ChaCha8Rng::from_seed(key))
    }

    /// 64 random bits.
    pub(crate) fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// Uniform in [0, 1).
    pub(crate) fn unit(&mut self) -> f64 {
        const SCALE: f64 = 1.0 / (1u64 << 53) as f64;
        (self.bits() >> 11) as f64 * SCALE
    }

    /// Uniform in a span.
    pub(crate) fn within(&mut self, span: Span) -> f64 {
        span.0 + (span.1 - span.0) * self.unit()
    }

    /// Uniform in a span, of either sign.
    pub(crate) fn either(&mut self, span: Span) -> f64 {
        let size = self.within(span);
        if self.chance(0.5) { size } else { -size }
    }

    /// True with the given probability.
    pub(crate) fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// Uniform in 0..`count`; 0 if that is empty.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the product's upper half is below count"
    )]
    pub(crate) fn below(&mut self, count: usize) -> usize {
        ((u128::from(self.bits()) * count as u128) >> 64) as usize
    }

    /// A whole number in a span, both ends included.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "float to integer casts saturate"
    )]
    pub(crate) fn count(&mut self, span: Span) -> usize {
        let low = span.0.max(0.0) as usize;
        let high = (span.1.max(0.0) as usize).max(low);
        low + self.below(high - low + 1)
    }

    /// A bell-shaped number of mean 0 and standard deviation 1, never beyond 3.5.
    pub(crate) fn bell(&mut self) -> f64 {
        bell_of(self.bits())
    }
}

/// Above the largest value of [`Dice::bell`]: four uniform parts, each √3 standard deviations of a half.
#[cfg(test)]
pub(crate) const MOST_DEVIATIONS: f64 = 3.5;

/// The sum of four uniform numbers of 12 bits each, scaled to standard deviation 1. It costs no
/// logarithm and has no tails, so that noise has a bound that tests can hold on to.
pub(crate) fn bell_of(bits: u64) -> f64 {
    const MEAN: f64 = 4.0 * 2047.5;
    const DEVIATION: f64 = 2_364.831_566_3;
    let sum = (0..4)
        .map(|part| (bits >> (12 * part)) & 0xfff)
        .sum::<u64>();
    (sum as f64 - MEAN) / DEVIATION
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bell_shaped_numbers_have_mean_0_deviation_1_and_a_bound() {
        let mut dice = Dice::new(1, Purpose::Lidar, 2, 3);
        let values: Vec<f64> = (0..100_000).map(|_| dice.bell()).collect();
        let mean = values.iter().sum::<f64>() / 1e5;
        let variance = values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / 1e5;
        assert!(mean.abs() < 0.02, "{mean}");
        assert!((variance - 1.0).abs() < 0.02, "{variance}");
        assert!(values.iter().all(|v| v.abs() <= MOST_DEVIATIONS));
    }

    #[test]
    fn streams_differ_in_each_of_their_four_numbers() {
        let first = |seed, purpose, index, variant| Dice::new(seed, purpose, index, variant).bits();
        let base = first(1, Purpose::Scene, 2, 3);
        assert_eq!(base, first(1, Purpose::Scene, 2, 3));
        assert_ne!(base, first(2, Purpose::Scene, 2, 3));
        assert_ne!(base, first(1, Purpose::Target, 2, 3));
        assert_ne!(base, first(1, Purpose::Scene, 3, 3));
        assert_ne!(base, first(1, Purpose::Scene, 2, 4));
    }

    #[test]
    fn whole_numbers_reach_both_ends_of_their_span() {
        let mut dice = Dice::new(1, Purpose::Scene, 0, 0);
        let counts: Vec<usize> = (0..200).map(|_| dice.count(Span(2.0, 4.0))).collect();
        assert!((2..=4).all(|value| counts.contains(&value)));
        assert!(counts.iter().all(|value| (2..=4).contains(value)));
        assert_eq!(dice.below(0), 0);
    }
}
