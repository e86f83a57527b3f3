//! Methods against the baseline, summed over the targets of a frame that both reached.
//!
//! Sums say what planning takes altogether; they are made by the few targets that take longest. So the
//! same sums are also taken without those that took the baseline most steps.

use std::collections::{BTreeMap, BTreeSet};

use polars::prelude::DataFrame;

use crate::Error;
use crate::comparison::{COMPARED, pairs, target_pairs};
use crate::frames::{counts, names, numbers};
use crate::spread::{Spread, ratio};
use crate::tables::Tables;

/// The scene of a row over all scenes.
const ALL_SCENES: &str = "all";
/// Share of the targets, those that take the baseline most steps, that the second sums leave out.
pub(crate) const COSTLIEST_PERCENT: usize = 1;
const TABLE: &str = "pairwise";

/// Sums over targets. Times in milliseconds of processor time of the targets' own searches.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Sums {
    /// Expansions of the baseline.
    pub(crate) baseline_steps: f64,
    /// Expansions of the compared method.
    pub(crate) compared_steps: f64,
    /// Time of the baseline.
    pub(crate) baseline_ms: f64,
    /// Time of the compared method.
    pub(crate) compared_ms: f64,
}

impl Sums {
    fn of<'a>(targets: impl Iterator<Item = &'a Target>) -> Self {
        targets.fold(Self::default(), |sums, target| Self {
            baseline_steps: sums.baseline_steps + target.steps.0,
            compared_steps: sums.compared_steps + target.steps.1,
            baseline_ms: sums.baseline_ms + target.ms.0,
            compared_ms: sums.compared_ms + target.ms.1,
        })
    }

    /// Expansions of the compared method by the baseline's.
    pub(crate) fn steps_ratio(&self) -> Option<f64> {
        ratio(self.compared_steps, self.baseline_steps)
    }

    /// Time of the compared method by the baseline's.
    pub(crate) fn time_ratio(&self) -> Option<f64> {
        ratio(self.compared_ms, self.baseline_ms)
    }
}

/// A method against the baseline, over the frames of a number of targets and a kind of scene.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Pairwise {
    /// The method that is compared.
    pub(crate) compared: String,
    /// The method that is compared with.
    pub(crate) baseline: String,
    /// Number of targets of a frame.
    pub(crate) targets: u32,
    /// Kind of scene, or [`ALL_SCENES`].
    pub(crate) scene: String,
    /// Frames that both planned.
    pub(crate) frames: usize,
    /// Targets that both reached.
    pub(crate) both: usize,
    /// Targets that the baseline alone reached.
    pub(crate) baseline_only: usize,
    /// Targets that the compared method alone reached.
    pub(crate) compared_only: usize,
    /// Over the targets that both reached.
    pub(crate) all: Sums,
    /// The same without the costliest.
    pub(crate) but_costliest: Sums,
    /// Mean ratio of costs.
    pub(crate) cost_ratio_mean: Option<f64>,
    /// Greatest ratio of costs.
    pub(crate) cost_ratio_most: Option<f64>,
    /// Mean elapsed time of the network in a frame of the compared method.
    pub(crate) network_ms_mean: Option<f64>,
    /// Elapsed time of the compared method's frame, the network included, by the baseline's processor
    /// time for one target of it that it reaches (the median of these): the median over frames.
    pub(crate) frame_by_target_elapsed: Option<f64>,
    /// The same with the processor time of the frame.
    pub(crate) frame_by_target_cpu: Option<f64>,
}

/// A target of a frame that both methods planned: the baseline's measures and the compared method's.
#[derive(Debug, Clone)]
struct Target {
    frame: u64,
    is_reached: (bool, bool),
    steps: (f64, f64),
    ms: (f64, f64),
    cost: (f64, f64),
    /// Elapsed and processor time of the compared method's frame, and its network's, milliseconds.
    frame_ms: (f64, f64, f64),
}

/// Compares every method with the baseline, by number of targets and scene. Ordered by method, number
/// of targets and scene, with all scenes first.
///
/// # Errors
/// [`Error::Table`] if polars fails.
pub(crate) fn pairwise(tables: &Tables, baseline: &str) -> Result<Vec<Pairwise>, Error> {
    let methods: BTreeSet<String> = names(&tables.plans, "method", TABLE)?.into_iter().collect();
    let mut rows = Vec::new();
    for method in methods.iter().filter(|method| *method != baseline) {
        let pairs = pairs(&tables.plans, baseline, method)?;
        let by_group = grouped(&target_pairs(&pairs, &tables.targets)?)?;
        for ((targets, scene), group) in by_group {
            let row = compare(&group);
            rows.push(Pairwise {
                compared: method.clone(),
                baseline: baseline.to_owned(),
                targets,
                scene: scene.unwrap_or_else(|| ALL_SCENES.to_owned()),
                ..row
            });
        }
    }
    Ok(rows)
}

/// By number of targets, and by kind of scene with those of all first.
type Groups = BTreeMap<(u32, Option<String>), Vec<Target>>;

fn grouped(targets: &DataFrame) -> Result<Groups, Error> {
    let both = |name: &str| -> Result<Vec<(f64, f64)>, Error> {
        let baseline = numbers(targets, name, TABLE)?.into_iter();
        Ok(baseline
            .zip(numbers(targets, &format!("{name}{COMPARED}"), TABLE)?)
            .collect())
    };
    let solved = |name: &str| names(targets, name, TABLE);
    let outcomes = (solved("outcome")?, solved(&format!("outcome{COMPARED}"))?);
    let (steps, ms, cost) = (both("steps")?, both("time_ms")?, both("cost")?);
    let of_frame = |name: &str| numbers(targets, &format!("{name}{COMPARED}"), TABLE);
    let (total, cpu, network) = (
        of_frame("total_ms")?,
        of_frame("cpu_ms")?,
        of_frame("network_ms")?,
    );
    let frames = counts(targets, "plan", TABLE)?;
    let numbers_of_targets = counts(targets, "targets", TABLE)?;
    let scenes = names(targets, "scene", TABLE)?;
    let mut groups = Groups::new();
    for row in 0..targets.height() {
        let target = Target {
            frame: frames[row],
            is_reached: (outcomes.0[row] == "solved", outcomes.1[row] == "solved"),
            steps: steps[row],
            ms: ms[row],
            cost: cost[row],
            frame_ms: (total[row], cpu[row], network[row]),
        };
        let number = u32::try_from(numbers_of_targets[row]).unwrap_or(u32::MAX);
        for scene in [None, Some(scenes[row].clone())] {
            let group = groups.entry((number, scene)).or_default();
            group.push(target.clone());
        }
    }
    Ok(groups)
}

/// Compares the targets of a group; the caller knows which group it is.
fn compare(targets: &[Target]) -> Pairwise {
    let count = |reached: (bool, bool)| {
        let is_reached = targets.iter().filter(|target| target.is_reached == reached);
        is_reached.count()
    };
    let mut both: Vec<&Target> = targets
        .iter()
        .filter(|target| target.is_reached == (true, true))
        .collect();
    both.sort_by(|a, b| a.steps.0.total_cmp(&b.steps.0));
    let kept = both.len() - (both.len() * COSTLIEST_PERCENT).div_ceil(100);
    let cost_ratios: Vec<f64> = both
        .iter()
        .filter_map(|target| ratio(target.cost.1, target.cost.0))
        .collect();
    let frames = frames_of(targets);
    let networks = frames.values().map(|frame| frame[0].frame_ms.2);
    let factor = |time: fn(&Target) -> f64| {
        let of_frames = frames.values().filter_map(|frame| {
            let reached = frame.iter().filter(|target| target.is_reached.0);
            let one = Spread::of(reached.map(|target| target.ms.0))?;
            ratio(time(frame[0]), one.median)
        });
        Spread::of(of_frames).map(|spread| spread.median)
    };
    Pairwise {
        compared: String::new(),
        baseline: String::new(),
        targets: 0,
        scene: String::new(),
        frames: frames.len(),
        both: both.len(),
        baseline_only: count((true, false)),
        compared_only: count((false, true)),
        all: Sums::of(both.iter().copied()),
        but_costliest: Sums::of(both[..kept].iter().copied()),
        cost_ratio_mean: ratio(cost_ratios.iter().sum(), cost_ratios.len() as f64),
        cost_ratio_most: Spread::of(cost_ratios.iter().copied()).map(|spread| spread.most),
        network_ms_mean: ratio(networks.sum(), frames.len() as f64),
        frame_by_target_elapsed: factor(|target| target.frame_ms.0),
        frame_by_target_cpu: factor(|target| target.frame_ms.1),
    }
}

/// By frame: its targets.
fn frames_of(targets: &[Target]) -> BTreeMap<u64, Vec<&Target>> {
    let mut frames: BTreeMap<u64, Vec<&Target>> = BTreeMap::new();
    for target in targets {
        frames.entry(target.frame).or_default().push(target);
    }
    frames
}

#[cfg(test)]
mod tests {
    use super::*;

    fn target(frame: u64, is_reached: (bool, bool), steps: (f64, f64)) -> Target {
        Target {
            frame,
            is_reached,
            steps,
            ms: (steps.0 / 100.0, steps.1 / 50.0),
            cost: (10.0, 11.0),
            frame_ms: (30.0, 60.0, 4.0),
        }
    }

    #[test]
    fn sums_are_over_what_both_reached_and_told_without_the_costliest() {
        let rows = [
            target(1, (true, true), (100.0, 50.0)),
            target(1, (true, true), (300.0, 150.0)),
            target(1, (true, false), (9e9, 1.0)),
            target(2, (false, true), (1.0, 9e9)),
            target(2, (true, true), (1000.0, 1000.0)),
        ];
        let found = compare(&rows);
        assert_eq!((found.frames, found.both), (2, 3));
        assert_eq!((found.baseline_only, found.compared_only), (1, 1));
        assert_eq!(found.all.steps_ratio(), Some(1200.0 / 1400.0));
        assert_eq!(found.all.time_ratio(), Some(2.0 * 1200.0 / 1400.0));
        assert_eq!(found.but_costliest.steps_ratio(), Some(0.5));
        assert_eq!(found.network_ms_mean, Some(4.0));
        let most = found.cost_ratio_most.unwrap();
        assert!((most - 1.1).abs() < 1e-12 && found.cost_ratio_mean == Some(1.1));
    }

    #[test]
    fn a_frame_is_set_against_the_baselines_middle_target() {
        let rows = [
            target(1, (true, true), (100.0, 1.0)),
            target(1, (true, false), (300.0, 1.0)),
            target(1, (true, true), (900.0, 1.0)),
            target(1, (false, true), (9e9, 1.0)),
            target(2, (false, true), (9e9, 1.0)),
        ];
        let found = compare(&rows);
        assert_eq!(found.frame_by_target_elapsed, Some(30.0 / 3.0));
        assert_eq!(found.frame_by_target_cpu, Some(60.0 / 3.0));
    }

    #[test]
    fn nothing_reached_gives_no_ratio() {
        let found = compare(&[target(1, (false, false), (5.0, 5.0))]);
        assert_eq!(found.all.steps_ratio(), None);
        assert_eq!(found.frame_by_target_cpu, None);
    }
}
