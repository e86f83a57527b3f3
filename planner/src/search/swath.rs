//! `swath`: all targets of a frame together, each at a cost of at most ε times its optimum.
//!
//! 1. For all targets: lower bounds on the length from the vehicle to everywhere, around obstacles
//!    (`distance`), and the exact costs of what is near the vehicle (`trunk`).
//! 2. For each target: a search from its goal backward under these bounds, with few expansions
//!    (`target`). It solves what is easy and proves most of what cannot be reached.
//! 3. If few targets are left: the same again with more expansions, which costs less than the next step.
//! 4. If any targets are left: the trunk goes on farther off, and they are searched for again. The
//!    trunk's paths are often within the bound at once; else they are paths that a search may stop at.
//!
//! Targets are handed to the threads in order of use. Each is searched for on its own, from what was
//! there before any of them, so results do not depend on the number of threads or on who is first; only
//! a deadline makes them depend on the machine.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use rayon::iter::{IntoParallelRefMutIterator, ParallelIterator};
use swath_bridge::{Outcome, Pose2};

use super::distance::Distances;
use super::goal::Goal;
use super::target::{Aims, End, Search, Shared};
use super::tree::{Tree, Weights};
use super::trunk::Trunk;
use super::{Limits, TargetResult, cell_steps};
use crate::collision::CollisionMap;
use crate::motion::Successors;
use crate::timing::CpuTimer;
use crate::{Error, Plane};

/// How much of what ε allows beyond 1 a new state's key makes use of.
const WEIGHT_SHARE: f64 = 0.5;

/// A frame's targets.
#[derive(Clone, Copy)]
pub struct Frame<'a> {
    /// Where motions are free.
    pub map: &'a CollisionMap,
    /// What may follow what.
    pub successors: &'a Successors,
    /// Targets, vehicle frame.
    pub goals: &'a [Pose2],
    /// Numbers of the targets, most useful first. Those that are missing are not searched for.
    pub order: &'a [usize],
    /// Where paths are expected, if anything can tell.
    pub regions: Option<Regions<'a>>,
}

/// Asked at most once a frame, for the targets that all short searches left undecided: the region in
/// which the path to each is expected. Nothing at all, or `None` for a target, says that none is known;
/// so does a plane that is not of the map's size.
pub type Regions<'a> = &'a (dyn Fn(&[usize]) -> Vec<Option<Plane>> + Sync);

impl std::fmt::Debug for Frame<'_> {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("Frame")
            .field("goals", &self.goals)
            .field("order", &self.order)
            .field("regions", &self.regions.map(|_| "callback"))
            .finish_non_exhaustive()
    }
}

/// How a frame's targets are searched for.
#[derive(Debug, Clone, Copy)]
pub struct Rules<'a> {
    /// Greatest cost of a path, as a multiple of the optimum; from 1 to 64.
    pub epsilon: f64,
    /// Most expansions for a target, and when to stop the whole frame.
    pub limits: Limits<'a>,
}

/// How many expansions each part of a frame's search is given.
#[derive(Debug, Clone, Copy)]
pub(super) struct Effort {
    /// Of the trunk near the vehicle.
    pub(super) near: u64,
    /// Of the trunk farther off.
    pub(super) far: u64,
    /// Of the first search for a target.
    pub(super) first: u64,
    /// Of the second searches for all targets that the first ones left, if these are few.
    pub(super) few: u64,
    /// Of the searches for what is left then, before it is asked where paths are expected.
    pub(super) before_asking: u64,
}

impl Default for Effort {
    fn default() -> Self {
        Self {
            near: 3_000,
            far: 30_000,
            first: 500,
            few: 20_000,
            before_asking: 2_000,
        }
    }
}

/// Memory of all that targets share, reused from frame to frame.
#[derive(Debug, Default)]
pub struct FrameMemory {
    effort: Effort,
    aims: Aims,
    distances: Distances,
    trunk: Trunk,
    /// By target, as far as they were asked for.
    regions: Vec<Option<Plane>>,
    /// One for each thread.
    trees: Vec<Tree>,
}

impl FrameMemory {
    /// Memory that grows with its first frames.
    pub fn new() -> Self {
        Self::default()
    }

    /// Memory of a search that is given other efforts.
    #[cfg(test)]
    pub(super) fn with_effort(effort: Effort) -> Self {
        Self {
            effort,
            ..Self::default()
        }
    }

    /// Plans to all targets of a frame on rayon's threads; results, each with the processor time of its
    /// own search, are in the order of the goals.
    ///
    /// # Errors
    /// [`Error::Epsilon`] unless ε is from 1 to 64, [`Error::Order`] if a number in the order is no
    /// goal's.
    pub fn plan(
        &mut self,
        frame: &Frame<'_>,
        rules: &Rules<'_>,
    ) -> Result<Vec<(TargetResult, Duration)>, Error> {
        super::check_epsilon(rules.epsilon)?;
        if let Some(&number) = frame
            .order
            .iter()
            .find(|&&number| number >= frame.goals.len())
        {
            return Err(Error::Order {
                number,
                goals: frame.goals.len(),
            });
        }
        let mut results = vec![
            (
                TargetResult::without_path(Outcome::BudgetExhausted, 0),
                Duration::ZERO
            );
            frame.goals.len()
        ];
        let mut goals: Vec<Option<Goal>> = Vec::new();
        for (pose, result) in frame.goals.iter().zip(&mut results) {
            let goal = Goal::new(frame.map, pose).map_err(|outcome| {
                result.0 = TargetResult::without_path(outcome, 0);
            });
            goals.push(goal.ok());
        }
        let has_goal = |&&number: &&usize| goals[number].is_some();
        let left: Vec<usize> = frame.order.iter().filter(has_goal).copied().collect();
        if left.is_empty() || !self.prepare(frame, rules)? {
            return Ok(results);
        }
        let mut spent = 0;
        let left = self.search_for(
            frame,
            rules,
            (&goals, left),
            ((&mut spent, self.effort.first), &mut results),
        );
        // Where few targets are left, searching longer for them costs less than what would serve many.
        let each = self.effort.few / left.len().max(1) as u64;
        let left = if each > 2 * self.effort.first {
            self.search_for(
                frame,
                rules,
                (&goals, left),
                ((&mut spent, each), &mut results),
            )
        } else {
            left
        };
        let is_limit = rules
            .limits
            .max_expansions
            .is_some_and(|most| most <= spent);
        if left.is_empty() || is_limit || rules.limits.asked().is_some() {
            return Ok(results);
        }
        self.search_on(frame, rules, (&goals, left), (&mut spent, &mut results));
        Ok(results)
    }

    /// Searches for the targets that short searches have left, with the trunk's help and perhaps with
    /// regions.
    fn search_on(
        &mut self,
        frame: &Frame<'_>,
        rules: &Rules<'_>,
        (goals, mut left): (&[Option<Goal>], Vec<usize>),
        (spent, results): (&mut u64, &mut [(TargetResult, Duration)]),
    ) {
        let unsolved: Vec<&Goal> = left.iter().filter_map(|&at| goals[at].as_ref()).collect();
        let stop = || rules.limits.asked().is_some();
        let far = (self.effort.far, &stop as _);
        self.trunk
            .spread(frame.map, frame.successors, &unsolved, far);
        if frame.regions.is_some() {
            // What the trunk decides needs no region.
            let most = self.effort.before_asking;
            left = self.search_for(frame, rules, (goals, left), ((spent, most), results));
            self.ask_regions(frame, (rules, &left));
        }
        self.search_for(frame, rules, (goals, left), ((spent, u64::MAX), results));
    }

    /// Asks where the paths to targets that are left are expected.
    fn ask_regions(&mut self, frame: &Frame<'_>, (rules, left): (&Rules<'_>, &[usize])) {
        let Some(ask) = frame.regions else { return };
        if left.is_empty() || rules.limits.asked().is_some() {
            return;
        }
        self.regions.resize(frame.goals.len(), None);
        for (&number, region) in left.iter().zip(ask(left)) {
            self.regions[number] =
                region.filter(|region| region.check_size("region", frame.map.spec()).is_ok());
        }
    }

    /// Searches for targets with at most so many expansions each, as far as the rules' limit leaves any
    /// after what each was searched for already; returns those which are not decided.
    fn search_for(
        &mut self,
        frame: &Frame<'_>,
        rules: &Rules<'_>,
        (goals, numbers): (&[Option<Goal>], Vec<usize>),
        ((spent, most), results): ((&mut u64, u64), &mut [(TargetResult, Duration)]),
    ) -> Vec<usize> {
        let left = rules
            .limits
            .max_expansions
            .map_or(u64::MAX, |most| most.saturating_sub(*spent));
        if left == 0 {
            return numbers;
        }
        let most = most.min(left);
        *spent = spent.saturating_add(most);
        let limits = Limits {
            max_expansions: Some(most),
            ..rules.limits
        };
        self.search_all(frame, (goals, &numbers), (rules.epsilon, limits), results)
    }

    /// Expansions that served all targets of the last frame together.
    pub const fn shared_steps(&self) -> u64 {
        self.trunk.steps()
    }

    /// Computes what targets share. False if it was stopped.
    fn prepare(&mut self, frame: &Frame<'_>, rules: &Rules<'_>) -> Result<bool, Error> {
        let (map, successors) = (frame.map, frame.successors);
        map.spec().validate()?;
        self.regions.clear();
        self.aims.prepare(map);
        let stop = || rules.limits.asked().is_some();
        let (distances, trunk) = (&mut self.distances, &mut self.trunk);
        let near_steps = self.effort.near;
        let (is_measured, is_grown) = rayon::join(
            || distances.measure(map, &stop),
            || trunk.grow(map, successors, (near_steps, &stop)),
        );
        Ok(is_grown? && is_measured)
    }

    /// Searches for targets on all threads; returns those which are not decided, in the same order.
    fn search_all(
        &mut self,
        frame: &Frame<'_>,
        (goals, numbers): (&[Option<Goal>], &[usize]),
        (epsilon, limits): (f64, Limits<'_>),
        results: &mut [(TargetResult, Duration)],
    ) -> Vec<usize> {
        let shared = Shared {
            map: frame.map,
            successors: frame.successors,
            steps_of: cell_steps(frame.map),
            aims: &self.aims,
            distances: &self.distances,
            trunk: &self.trunk,
            regions: &self.regions,
        };
        let weights = Weights::new(epsilon, 1.0 + WEIGHT_SHARE * (epsilon - 1.0));
        let threads = rayon::current_num_threads().min(numbers.len());
        if self.trees.len() < threads {
            self.trees.resize_with(threads, Tree::default);
        }
        let next = AtomicUsize::new(0);
        let work = |tree: &mut Tree| {
            let mut ends = Vec::new();
            while let Some(&number) = numbers.get(next.fetch_add(1, Ordering::Relaxed)) {
                let Some(goal) = &goals[number] else { continue };
                if limits.asked().is_some() || tree.prepare(frame.map.spec()).is_err() {
                    break;
                }
                let timer = CpuTimer::of_thread();
                let end = Search::new(&shared, weights, tree).run((number, goal), limits);
                ends.push((number, end, timer.elapsed()));
            }
            ends
        };
        let workers = self.trees[..threads].par_iter_mut();
        let mut is_decided = vec![false; goals.len()];
        for (number, end, cpu) in workers.map(work).collect::<Vec<_>>().into_iter().flatten() {
            let (result, all_cpu) = &mut results[number];
            let before = result.steps;
            *result = match end {
                End::Result(result) => {
                    is_decided[number] = true;
                    result
                }
                End::Limit(outcome, steps) => TargetResult::without_path(outcome, steps),
            };
            result.steps += before;
            *all_cpu += cpu;
        }
        let undecided = |number: &&usize| !is_decided[**number];
        numbers.iter().filter(undecided).copied().collect()
    }
}
