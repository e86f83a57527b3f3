//! Scoring a network, and two predictors without learning that it has to beat.

use std::time::{Duration, Instant};

use rayon::prelude::*;
use swath_bridge::{GridSpec, Pose2, Vehicle};
use swath_planner::Plane;
use swath_planner::dubins::shortest_path;
use swath_planner::network::Network;

use crate::score::{Counts, Scores};
use crate::{Error, Example};

/// Distance between two poses of the shortest path in the open, metres.
const DUBINS_STEP_M: f64 = 0.2;

/// Something that gives a region for an example.
#[derive(Debug, Clone, Copy)]
pub enum Predictor<'a> {
    /// A trained network.
    Network(&'a Network),
    /// The reference plane, dilated to the label's width.
    Reference {
        /// How far the plane in the sample reaches from the reference already, metres.
        already_m: f64,
    },
    /// The shortest path of the vehicle on open ground, dilated to the label's width.
    Dubins {
        /// Whose turning radius counts.
        vehicle: &'a Vehicle,
    },
}

impl Predictor<'_> {
    /// The name in tables and messages.
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Network(network) => network.info().architecture.name(),
            Self::Reference { .. } => "dilated_reference",
            Self::Dubins { .. } => "dilated_dubins",
        }
    }

    fn region(&self, example: &Example, dilation_m: f64) -> Result<Plane, Error> {
        match self {
            Self::Network(network) => {
                let goal = std::slice::from_ref(&example.goal);
                let predictions = network.predict(&example.surroundings(), goal)?;
                let first = predictions.into_iter().next();
                let region = first.map_or_else(|| empty(example), |first| first.region);
                // A wider region is what was learnt, grown by what is missing.
                let by_m = dilation_m - network.info().label_dilation_m;
                Ok(grown(region, &example.spec, by_m))
            }
            Self::Reference { already_m } => {
                let by_m = dilation_m - already_m;
                Ok(grown(example.reference.clone(), &example.spec, by_m))
            }
            Self::Dubins { vehicle } => {
                let radius_m = vehicle.min_turning_radius_m;
                let path = shortest_path(&Pose2::default(), &example.goal, radius_m, DUBINS_STEP_M);
                let mut plane = empty(example);
                plane.draw_line(&example.spec, &path, dilation_m);
                Ok(plane)
            }
        }
    }
}

/// The scores of a predictor, and how long it took.
#[derive(Debug, Clone)]
pub struct Report {
    /// The scores.
    pub scores: Scores,
    /// Elapsed time a sample, all cores working, milliseconds.
    pub ms_per_sample: f64,
    /// Width of the labels, metres.
    pub dilation_m: f64,
}

/// Most samples that are scored singly.
const MOST_SINGLE: usize = 4096;

/// The region of each sample that has a path, with its intersection over union, in the order of that.
/// Of very many samples the first 4096 are taken.
///
/// # Errors
/// The network's, if its grid is another.
pub fn ranked<'a>(
    predictor: Predictor<'_>,
    examples: &'a [Example],
    dilation_m: f64,
) -> Result<Vec<(f64, &'a Example, Plane)>, Error> {
    let solved: Vec<&Example> = examples
        .iter()
        .filter(|example| example.is_solved())
        .take(MOST_SINGLE)
        .collect();
    let regions = solved.par_iter().map(|&example| {
        let region = predictor.region(example, dilation_m)?;
        let iou = Counts::of(&region, &example.label_at(dilation_m)).iou_path();
        Ok((iou, example, region))
    });
    let mut ranked: Vec<_> = regions.collect::<Result<_, Error>>()?;
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(ranked)
}

/// Scores a predictor at the full resolution of the samples. With `redraw` the labels are drawn anew
/// at `dilation_m`, else they are as they came and `dilation_m` tells the others their width.
///
/// Samples without a path are left out.
///
/// # Errors
/// [`Error::NoSamples`] if no sample has a path; the network's, if its grid is another.
pub fn evaluate(
    predictor: Predictor<'_>,
    examples: &[Example],
    dilation_m: f64,
    redraw: bool,
) -> Result<Report, Error> {
    let solved: Vec<&Example> = examples
        .iter()
        .filter(|example| example.is_solved())
        .collect();
    if solved.is_empty() {
        return Err(Error::NoSamples {
            read: examples.len() as u64,
            from: "the samples to evaluate on".to_owned(),
        });
    }
    let mut elapsed = Duration::ZERO;
    let mut scores = Scores::default();
    // Regions are kept for one part of the samples at a time, so that memory is bounded.
    for part in solved.chunks(256) {
        let begin = Instant::now();
        let regions: Vec<Plane> = part
            .par_iter()
            .map(|example| predictor.region(example, dilation_m))
            .collect::<Result<_, _>>()?;
        elapsed += begin.elapsed();
        for (example, region) in part.iter().zip(&regions) {
            if redraw {
                scores.add(example, region, &example.label_at(dilation_m));
            } else {
                scores.add(example, region, &example.label);
            }
        }
    }
    Ok(Report {
        ms_per_sample: elapsed.as_secs_f64() * 1e3 / solved.len() as f64,
        scores,
        dilation_m,
    })
}

fn empty(example: &Example) -> Plane {
    Plane::empty(example.spec.rows, example.spec.cols)
}

/// A plane grown by `by_m`, or as it is if that is less than a cell.
fn grown(mut plane: Plane, spec: &GridSpec, by_m: f64) -> Plane {
    /// Differences of decimals fall short of them by less than this.
    const ROUNDING_M: f64 = 1e-6;
    let by_m = by_m + ROUNDING_M;
    if by_m < spec.resolution_m {
        return plane;
    }
    let set: Vec<usize> = (0..plane.len())
        .filter(|&index| plane.get_index(index))
        .collect();
    for index in set {
        let (x_m, y_m) = spec.centre_of(spec.cell_of_index(index));
        plane.draw_line(spec, &[Pose2::new(x_m, y_m, 0.0)], by_m);
    }
    plane
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::example::tests::examples;

    #[test]
    fn baselines_are_scored_at_the_width_that_is_asked_for() {
        let examples = examples(10);
        let vehicle = Vehicle::default();
        let dubins = Predictor::Dubins { vehicle: &vehicle };
        let narrow = evaluate(dubins, &examples, 1.4, true).unwrap();
        let wide = evaluate(dubins, &examples, 2.0, true).unwrap();
        assert_eq!(narrow.scores.total.samples, 10);
        assert!(wide.scores.total.union_path > narrow.scores.total.union_path);
        assert!(narrow.scores.total.miou() > 0.5);
        let reference = Predictor::Reference { already_m: 1.0 };
        let narrow = evaluate(reference, &examples, 1.4, true).unwrap();
        assert!(narrow.scores.total.miou() > 0.5);
        // The reference runs straight ahead, and no goal lies more than 2 m beside it.
        assert_eq!(narrow.scores.total.joined, 10);
    }

    #[test]
    fn a_straight_way_in_the_open_is_what_dubins_predicts() {
        let mut example = examples(1).remove(0);
        example.goal = Pose2::new(16.0, 0.0, 0.0);
        example.path = vec![Pose2::default(), example.goal];
        example.label = example.label_at(1.4);
        let vehicle = Vehicle::default();
        let dubins = Predictor::Dubins { vehicle: &vehicle };
        let report = evaluate(dubins, &[example], 1.4, false).unwrap();
        assert_eq!(report.scores.total.miou(), 1.0);
    }

    #[test]
    fn samples_are_ranked_by_how_well_they_are_predicted() {
        let examples = examples(10);
        let vehicle = Vehicle::default();
        let ranked = ranked(Predictor::Dubins { vehicle: &vehicle }, &examples, 1.4).unwrap();
        assert_eq!(ranked.len(), 10);
        assert!(ranked.windows(2).all(|pair| pair[0].0 <= pair[1].0));
        let (iou, example, region) = &ranked[9];
        assert_eq!(Counts::of(region, &example.label).iou_path(), *iou);
    }

    #[test]
    fn nothing_to_evaluate_is_an_error() {
        let vehicle = Vehicle::default();
        let dubins = Predictor::Dubins { vehicle: &vehicle };
        assert!(evaluate(dubins, &[], 1.4, false).is_err());
    }
}
