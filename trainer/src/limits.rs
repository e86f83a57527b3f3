//! What limits a network's score: labels that could as well be others, and errors that cost something.

use std::sync::Arc;

use rayon::prelude::*;
use swath_bridge::{GridSpec, Outcome, Pose2, Vehicle};
use swath_planner::network::Network;
use swath_planner::search::{Bound, Limits as SearchLimits, SearchMemory, search_bounded};
use swath_planner::{CollisionMap, MotionModel, Plane};

use crate::example::{mirrored, mirrored_pose};
use crate::guided::Guided;
use crate::{Counts, Error, Example};

/// Upper ends of the groups of intersections over union of single regions.
pub const IOU_GROUPS: [f64; 4] = [0.5, 0.7, 0.85, f64::INFINITY];
/// Most expansions of a search.
const MAX_EXPANSIONS: u64 = 2_000_000;
/// Largest difference between the costs of two optimal paths, metres and radians.
const SAME_COST: f64 = 1e-2;
/// A path of at most this cost is as good as the optimum, of which it is a multiple.
const AS_GOOD: f64 = 1.01;

/// Samples whose regions match their labels about equally well.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct IouGroup {
    /// Samples.
    pub samples: u64,
    /// Samples to which the planner found a path with the region.
    pub solved: u64,
    /// Sum of the costs of those paths by the optimum.
    pub cost_ratios: f64,
    /// Of those, the ones whose path costs at most 1 % more than the optimum.
    pub as_good: u64,
}

/// What limits a score.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Limits {
    /// Labels against those of other paths of the same cost: what a perfect predictor would reach that
    /// does not know how ties are broken.
    pub ties: Counts,
    /// Regions by how well they match, as [`IOU_GROUPS`].
    pub groups: [IouGroup; IOU_GROUPS.len()],
}

/// Finds out what limits the score of a network on those samples that have a path.
///
/// For other paths of the same cost the scene is searched in a mirror; for the price of errors it is
/// searched by `tiev-fcn` with the predicted region.
///
/// # Errors
/// The planner's, if a sample is of another grid than the network.
pub fn limits(network: &Network, examples: &[Example], vehicle: &Vehicle) -> Result<Limits, Error> {
    let Some(first) = examples.first() else {
        return Ok(Limits::default());
    };
    let guided = Guided::new(vehicle, &first.spec, MAX_EXPANSIONS)?;
    let dilation_m = network.info().label_dilation_m;
    let solved = examples.par_iter().filter(|example| example.is_solved());
    let single = solved.map_init(SearchMemory::new, |memory, example| {
        let label = example.label_at(dilation_m);
        let other = mirror_path(&guided.model, example, memory)?.map(|path| {
            let mut plane = Plane::empty(example.spec.rows, example.spec.cols);
            plane.draw_line(&example.spec, &path, dilation_m);
            plane
        });
        let tie = other.map(|other| Counts::of(&other, &label));
        Ok((tie, price(&guided, network, (example, &label))?))
    });
    let single: Vec<_> = single.collect::<Result<_, Error>>()?;
    let mut limits = Limits::default();
    for (tie, (group, of_one)) in single {
        if let Some(tie) = tie {
            limits.ties.add(&tie);
        }
        let group = &mut limits.groups[group];
        group.samples += of_one.samples;
        group.solved += of_one.solved;
        group.cost_ratios += of_one.cost_ratios;
        group.as_good += of_one.as_good;
    }
    Ok(limits)
}

const fn is_symmetric(spec: &GridSpec) -> bool {
    spec.ego_col * 2 + 1 == spec.cols
}

/// A path that is optimal in the mirror, mirrored back. `None` if the search ended otherwise.
fn mirror_path(
    model: &Arc<MotionModel>,
    example: &Example,
    memory: &mut SearchMemory,
) -> Result<Option<Vec<Pose2>>, Error> {
    if !is_symmetric(&example.spec) {
        return Ok(None);
    }
    let obstacles = mirrored(&example.obstacles, example.spec.ego_col);
    let map = CollisionMap::new(Arc::clone(model), example.spec, &obstacles)?;
    let successors = model.successors(example.speed_m_per_s);
    let search_limits = SearchLimits {
        max_expansions: Some(MAX_EXPANSIONS),
        stop: None,
    };
    let target = (&mirrored_pose(&example.goal), Bound::Informed);
    let found = search_bounded(&map, &successors, target, search_limits, memory)?;
    let is_same = (found.cost - f64::from(example.cost)).abs() <= SAME_COST;
    Ok(is_same.then(|| found.path.iter().map(mirrored_pose).collect()))
}

/// The group of a sample's region, and what planning with it costs.
fn price(
    guided: &Guided,
    network: &Network,
    (example, label): (&Example, &Plane),
) -> Result<(usize, IouGroup), Error> {
    let planned = guided.plan(network, example)?;
    let iou = planned
        .as_ref()
        .map_or(0.0, |(region, _)| Counts::of(region, label).iou_path());
    let found = planned.filter(|(_, result)| result.outcome == Outcome::Solved);
    let ratio = found.map(|(_, result)| result.cost / f64::from(example.cost).max(SAME_COST));
    let of_one = IouGroup {
        samples: 1,
        solved: u64::from(ratio.is_some()),
        cost_ratios: ratio.unwrap_or(0.0),
        as_good: u64::from(ratio.is_some_and(|ratio| ratio <= AS_GOOD)),
    };
    let group = IOU_GROUPS.iter().position(|&end| iou < end);
    Ok((group.unwrap_or(IOU_GROUPS.len() - 1), of_one))
}
