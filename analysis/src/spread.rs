//! Medians, quartiles and percentiles of a set of numbers.

/// How a set of numbers is spread. Quantiles interpolate linearly between neighbours (Hyndman and
/// Fan, type 7, which is also the default of R, numpy and polars' `linear`).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread {
    /// How many numbers.
    pub count: usize,
    /// Smallest.
    pub least: f64,
    /// A quarter lies below.
    pub lower_quartile: f64,
    /// Half lies below.
    pub median: f64,
    /// Three quarters lie below.
    pub upper_quartile: f64,
    /// Ninety-nine in a hundred lie below.
    pub p99: f64,
    /// Largest.
    pub most: f64,
}

impl Spread {
    /// The spread of the finite ones among `values`, or `None` if there are none.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let mut sorted: Vec<f64> = values.into_iter().filter(|v| v.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let (&least, &most) = (sorted.first()?, sorted.last()?);
        Some(Self {
            count: sorted.len(),
            least,
            lower_quartile: quantile(&sorted, 0.25),
            median: quantile(&sorted, 0.5),
            upper_quartile: quantile(&sorted, 0.75),
            p99: quantile(&sorted, 0.99),
            most,
        })
    }
}

/// The quantile at `share` (0 to 1) of ascending numbers, of which there must be one at least.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the position lies between 0 and the number of values"
)]
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let last = sorted.len() - 1;
    let position = share * last as f64;
    let below = (position.floor() as usize).min(last);
    let above = (below + 1).min(last);
    let weight = position - below as f64;
    sorted[below] + weight * (sorted[above] - sorted[below])
}

/// `top / bottom` where that is a number.
pub(crate) fn ratio(top: f64, bottom: f64) -> Option<f64> {
    Some(top / bottom).filter(|ratio| ratio.is_finite())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn quartiles_interpolate_between_neighbours() {
        let spread = Spread::of([4.0, 1.0, 3.0, 2.0]).unwrap();
        assert_eq!(
            (
                spread.lower_quartile,
                spread.median,
                spread.upper_quartile,
                spread.least,
                spread.most
            ),
            (1.75, 2.5, 3.25, 1.0, 4.0)
        );
        let hundred_and_one = Spread::of((0..=100).map(f64::from)).unwrap();
        assert!((hundred_and_one.p99 - 99.0).abs() < 1e-9);
    }

    #[test]
    fn one_number_is_all_of_its_own_quantiles() {
        let spread = Spread::of([7.5]).unwrap();
        assert_eq!(
            (spread.lower_quartile, spread.median, spread.p99),
            (7.5, 7.5, 7.5)
        );
    }

    #[test]
    fn what_is_not_a_number_does_not_count() {
        assert_eq!(Spread::of([f64::NAN, f64::INFINITY]), None);
        assert_eq!(Spread::of([f64::NAN, 2.0]).map(|s| s.count), Some(1));
        assert_eq!(ratio(1.0, 0.0), None);
    }

    proptest! {
        /// At least the share lies at or below a quantile, and at least the rest at or above.
        #[test]
        fn quartiles_split_the_numbers(values in prop::collection::vec(-1e6..1e6f64, 1..60)) {
            let spread = Spread::of(values.iter().copied()).unwrap();
            for (quantile, share) in [
                (spread.lower_quartile, 0.25), (spread.median, 0.5), (spread.upper_quartile, 0.75),
            ] {
                let count = values.len() as f64;
                let below = values.iter().filter(|v| **v <= quantile + 1e-6).count() as f64;
                let above = values.iter().filter(|v| **v >= quantile - 1e-6).count() as f64;
                prop_assert!(below >= (share * (count - 1.0)).floor() + 1.0);
                prop_assert!(above >= ((1.0 - share) * (count - 1.0)).floor() + 1.0);
            }
        }
    }
}
