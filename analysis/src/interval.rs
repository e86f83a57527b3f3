//! How far a mean over few samples may lie from that over many.

use serde::Serialize;

/// Fewest samples whose mIoU is compared with the paper's. The interval over fewer reaches more than
/// six percentage points to a side, which is more than networks of this kind differ by.
pub const MIN_COMPARED_SAMPLES: u64 = 200;

/// The 97.5 % quantile of the standard normal distribution, for intervals of 95 %.
const QUANTILE: f64 = 1.959_963_984_540_054;

/// A range of shares of 1 that holds the true one with a probability of 95 %.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Interval {
    /// Lower end, 0 to 1.
    pub low: f64,
    /// Upper end, 0 to 1.
    pub high: f64,
}

impl Interval {
    /// The Wilson score interval of the mean of `samples` independent values between 0 and 1; `None`
    /// without samples, or if the mean is not between 0 and 1.
    ///
    /// No values between 0 and 1 with a mean of m vary more than m (1 − m), as those do that are
    /// either 0 or 1 (Bhatia and Davis). So the interval is wider than it would have to be, which
    /// makes up for samples of one scene that are not independent.
    pub fn of_mean(mean: f64, samples: u64) -> Option<Self> {
        if samples == 0 || !(0.0..=1.0).contains(&mean) {
            return None;
        }
        let count = samples as f64;
        let square = QUANTILE * QUANTILE;
        let scale = 1.0 + square / count;
        let centre = (mean + square / (2.0 * count)) / scale;
        let variance = mean * (1.0 - mean) / count + square / (4.0 * count * count);
        let reach = QUANTILE * variance.sqrt() / scale;
        Some(Self {
            low: (centre - reach).max(0.0),
            high: (centre + reach).min(1.0),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Newcombe (1998), table I, gives these for 81 of 263, 15 of 148, 0 of 20 and 1 of 29.
    #[test]
    fn intervals_are_those_of_the_literature() {
        for (hits, count, low, high) in [
            (81.0, 263u32, 0.2553, 0.3662),
            (15.0, 148, 0.0624, 0.1605),
            (0.0, 20, 0.0, 0.1611),
            (1.0, 29, 0.0061, 0.1718),
        ] {
            let interval = Interval::of_mean(hits / f64::from(count), count.into()).unwrap();
            assert!((interval.low - low).abs() < 5e-5, "{interval:?}");
            assert!((interval.high - high).abs() < 5e-5, "{interval:?}");
        }
    }

    #[test]
    fn without_samples_there_is_none() {
        assert_eq!(Interval::of_mean(0.5, 0), None);
        assert_eq!(Interval::of_mean(f64::NAN, 10), None);
        assert_eq!(Interval::of_mean(1.1, 10), None);
    }

    #[test]
    fn what_is_compared_is_known_to_seven_points() {
        for percent in 1..100 {
            let mean = f64::from(percent) / 100.0;
            let interval = Interval::of_mean(mean, MIN_COMPARED_SAMPLES).unwrap();
            assert!(interval.high - interval.low < 0.14);
        }
    }

    proptest! {
        #[test]
        fn the_mean_is_inside_and_more_samples_tell_more(mean in 0.0..=1.0f64, samples in 1u64..10_000) {
            let few = Interval::of_mean(mean, samples).unwrap();
            let many = Interval::of_mean(mean, 4 * samples).unwrap();
            prop_assert!(few.low <= mean + 1e-12 && mean <= few.high + 1e-12);
            prop_assert!(many.high - many.low < few.high - few.low);
        }
    }
}
