//! Learning, and scoring, how well targets can be reached.

use rayon::prelude::*;
use swath_bridge::Outcome;
use swath_planner::network::{Network, Reach};

use crate::{Error, Example};

/// Farthest obstacle that the clearance of a goal tells of, metres.
const MOST_CLEARANCE_M: f64 = 20.0;
/// From this difference on, an error in cost or steps counts linearly, in spreads.
const LINEAR_FROM: f32 = 1.0;

/// What became of a target, as far as a network can learn from it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reached {
    /// Whether a path was found.
    pub solvable: bool,
    /// Scores of cost and steps, see [`Reach::wanted`]; of no meaning without a path.
    pub wanted: [f32; 2],
}

impl Reached {
    /// `None` for targets that say nothing of how to get there, such as those on an obstacle.
    pub fn of(example: &Example) -> Option<Self> {
        match example.outcome {
            Outcome::Solved => Some(Self {
                solvable: true,
                wanted: Reach::wanted(example.cost, example.steps),
            }),
            Outcome::Unreachable | Outcome::BudgetExhausted => Some(Self {
                solvable: false,
                wanted: [0.0; 2],
            }),
            _ => None,
        }
    }
}

/// The sum over images of `weight` times their losses divided by `images_in_batch`, and its gradient:
/// cross entropy of there being a path, and where there is one, the Huber losses of its cost and of
/// the steps to it.
///
/// # Shapes
/// `scores`: images × 3.
pub(crate) fn loss_and_gradient(
    weight: f32,
    reached: &[Option<Reached>],
    scores: &[f32],
    images_in_batch: usize,
) -> (f64, Vec<f32>) {
    let share = weight / images_in_batch as f32;
    let mut gradient = vec![0.0; scores.len()];
    let mut loss = 0.0;
    let images = scores.chunks_exact(3).zip(gradient.chunks_exact_mut(3));
    for ((scores, gradient), reached) in images.zip(reached) {
        let Some(reached) = reached else {
            continue;
        };
        let wanted = f32::from(u8::from(reached.solvable));
        let small = (-scores[0].abs()).exp();
        let probability = if scores[0] >= 0.0 {
            1.0 / (1.0 + small)
        } else {
            small / (1.0 + small)
        };
        let entropy = scores[0].max(0.0) - scores[0] * wanted + small.ln_1p();
        loss += f64::from(share * entropy);
        gradient[0] = share * (probability - wanted);
        if reached.solvable {
            for (index, wanted) in (1..).zip(reached.wanted) {
                let off = scores[index] - wanted;
                let (value, slope) = if off.abs() < LINEAR_FROM {
                    (0.5 * off * off, off)
                } else {
                    let linear = LINEAR_FROM * (off.abs() - 0.5 * LINEAR_FROM);
                    (linear, LINEAR_FROM.copysign(off))
                };
                loss += f64::from(share * value);
                gradient[index] = share * slope;
            }
        }
    }
    (loss, gradient)
}

/// How well a network ranks targets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ranking {
    /// Targets with a path, and without.
    pub targets: (usize, usize),
    /// Area under the ROC curve of there being a path.
    pub auc: f64,
    /// The same of the distance from the goal to the nearest obstacle.
    pub auc_clearance: f64,
    /// Rank correlation with the true cost, of targets with a path.
    pub rank_cost: f64,
    /// Rank correlation with the steps of the search, of targets with a path.
    pub rank_steps: f64,
}

/// Ranks the targets of some samples, those on obstacles left out. `None` if the network does not, or
/// there is nothing to tell apart.
///
/// # Errors
/// The network's, if its grid is another.
pub fn ranking(network: &Network, examples: &[Example]) -> Result<Option<Ranking>, Error> {
    let known: Vec<(&Example, Reached)> = examples
        .iter()
        .filter_map(|example| Some((example, Reached::of(example)?)))
        .collect();
    let judged = known.par_iter().map(|(example, _)| {
        let goal = std::slice::from_ref(&example.goal);
        let predictions = network.predict(&example.surroundings(), goal)?;
        Ok(predictions.first().and_then(|prediction| prediction.reach))
    });
    let judged: Vec<Option<Reach>> = judged.collect::<Result<_, Error>>()?;
    let Some(judged) = judged.into_iter().collect::<Option<Vec<Reach>>>() else {
        return Ok(None);
    };
    let solvable: Vec<bool> = known.iter().map(|(_, reached)| reached.solvable).collect();
    let with = solvable.iter().filter(|&&solvable| solvable).count();
    if with == 0 || with == solvable.len() {
        return Ok(None);
    }
    let by = |value: &dyn Fn(usize) -> f64| auc(&solvable, value);
    let clearances: Vec<f64> = known
        .par_iter()
        .map(|(example, _)| clearance_m(example))
        .collect();
    let of_solved = |value: &dyn Fn(usize) -> f64| -> Vec<f64> {
        (0..known.len())
            .filter(|&index| solvable[index])
            .map(value)
            .collect()
    };
    let cost = of_solved(&|index| f64::from(judged[index].cost));
    let true_cost = of_solved(&|index| f64::from(known[index].0.cost));
    let steps = of_solved(&|index| f64::from(judged[index].steps));
    let true_steps = of_solved(&|index| f64::from(known[index].0.steps));
    Ok(Some(Ranking {
        targets: (with, solvable.len() - with),
        auc: by(&|index| f64::from(judged[index].solvable)),
        auc_clearance: by(&|index| clearances[index]),
        rank_cost: correlation(&ranks(&cost), &ranks(&true_cost)),
        rank_steps: correlation(&ranks(&steps), &ranks(&true_steps)),
    }))
}

/// Distance from the goal to the nearest obstacle.
fn clearance_m(example: &Example) -> f64 {
    let mut least = MOST_CLEARANCE_M;
    example.obstacles.each_set(|index| {
        let (x_m, y_m) = example.spec.centre_of(example.spec.cell_of_index(index));
        least = least.min(libm::hypot(x_m - example.goal.x_m, y_m - example.goal.y_m));
    });
    least
}

/// How often something that is so has a larger value than something that is not; ties count half.
fn auc(is_so: &[bool], value: &dyn Fn(usize) -> f64) -> f64 {
    let values: Vec<f64> = (0..is_so.len()).map(value).collect();
    let ranks = ranks(&values);
    let positive = is_so.iter().filter(|&&is_so| is_so).count() as f64;
    let negative = is_so.len() as f64 - positive;
    let pairs = ranks.iter().zip(is_so).filter(|(_, is_so)| **is_so);
    let sum: f64 = pairs.map(|(rank, _)| rank).sum();
    (sum - 0.5 * positive * (positive + 1.0)) / (positive * negative)
}

/// Ranks from 1; equal values share the mean of theirs.
fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let mut ranks = vec![0.0; values.len()];
    let mut first = 0;
    while first < order.len() {
        let value = values[order[first]];
        let mut last = first;
        while last + 1 < order.len() && values[order[last + 1]] == value {
            last += 1;
        }
        for &index in &order[first..=last] {
            ranks[index] = f64::midpoint(first as f64, last as f64) + 1.0;
        }
        first = last + 1;
    }
    ranks
}

/// The correlation of two lists of the same length.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let (mean_a, mean_b) = (mean(a), mean(b));
    let (mut both, mut square_a, mut square_b) = (0.0, 0.0, 0.0);
    for (a, b) in a.iter().zip(b) {
        both += (a - mean_a) * (b - mean_b);
        square_a += (a - mean_a).powi(2);
        square_b += (b - mean_b).powi(2);
    }
    both / (square_a * square_b).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn areas_and_correlations_are_those_of_small_examples() {
        let is_so = [true, false, true, false];
        let by = |values: [f64; 4]| auc(&is_so, &move |index| values[index]);
        assert_eq!(by([3.0, 1.0, 4.0, 2.0]), 1.0);
        assert_eq!(by([1.0, 3.0, 2.0, 4.0]), 0.0);
        assert_eq!(by([1.0; 4]), 0.5);
        assert_eq!(ranks(&[5.0, 1.0, 5.0, 9.0]), [2.5, 1.0, 2.5, 4.0]);
        assert!((correlation(&[1.0, 2.0, 3.0], &[2.0, 4.0, 6.0]) - 1.0).abs() < 1e-12);
    }

    proptest! {
        #[test]
        fn the_gradient_is_that_of_finite_differences(
            scores in proptest::collection::vec(-4.0f32..4.0, 9), wanted in -3.0f32..3.0,
        ) {
            let solved = Reached { solvable: true, wanted: [wanted, -wanted] };
            let not = Reached { solvable: false, wanted: [0.0; 2] };
            let reached = [Some(solved), None, Some(not)];
            let (_, gradient) = loss_and_gradient(0.5, &reached, &scores, 3);
            prop_assert_eq!(&gradient[3..6], &[0.0; 3]);
            for index in 0..9 {
                let at = |offset: f32| {
                    let mut moved = scores.clone();
                    moved[index] += offset;
                    loss_and_gradient(0.5, &reached, &moved, 3).0
                };
                let slope = (at(1e-2) - at(-1e-2)) / 2e-2;
                prop_assert!((slope - f64::from(gradient[index])).abs() < 2e-3);
            }
        }
    }
}
