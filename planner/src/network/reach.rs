//! How well a target can be reached, as the network judges it before any search.

use super::graph::SCORES;

/// Mean and spread of the logarithm of costs, metres and radians.
const COST: (f32, f32) = (3.3, 0.6);
/// Mean and spread of the logarithm of steps.
const STEPS: (f32, f32) = (9.0, 2.0);
/// Logarithms are taken of values up to this many spreads from the mean.
const MOST_SPREADS: f32 = 6.0;

/// How well a target can be reached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reach {
    /// How likely there is a path, 0 to 1.
    pub solvable: f32,
    /// Cost of the path if there is one, metres and radians.
    pub cost: f32,
    /// Steps of the search that finds it.
    pub steps: f32,
}

impl Reach {
    /// What the network's scores say.
    pub(super) fn from_scores(scores: &[f32]) -> Option<Self> {
        let &[solvable, cost, steps] = scores else {
            return None;
        };
        let value = |score: f32, (mean, spread): (f32, f32)| {
            libm::expf(mean + spread * score.clamp(-MOST_SPREADS, MOST_SPREADS))
        };
        Some(Self {
            solvable: 1.0 / (1.0 + libm::expf(-solvable)),
            cost: value(cost, COST),
            steps: value(steps, STEPS),
        })
    }

    /// The scores of cost and steps that a network is to learn.
    pub fn wanted(cost: f32, steps: f32) -> [f32; SCORES - 1] {
        let score = |value: f32, (mean, spread): (f32, f32)| {
            let score = (libm::logf(value.max(1e-3)) - mean) / spread;
            score.clamp(-MOST_SPREADS, MOST_SPREADS)
        };
        [score(cost, COST), score(steps.max(1.0), STEPS)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wanted_is_what_is_understood() {
        for (cost, steps) in [(8.0, 30.0), (25.0, 4000.0), (90.0, 250_000.0)] {
            let [of_cost, of_steps] = Reach::wanted(cost, steps);
            let reach = Reach::from_scores(&[0.0, of_cost, of_steps]).unwrap();
            assert!((reach.cost / cost - 1.0).abs() < 1e-4);
            assert!((reach.steps / steps - 1.0).abs() < 1e-4);
            assert!((reach.solvable - 0.5).abs() < 1e-6);
        }
        assert!(
            Reach::from_scores(&[f32::INFINITY, 1e30, -1e30])
                .unwrap()
                .cost
                .is_finite()
        );
        assert_eq!(Reach::from_scores(&[]), None);
    }
}
