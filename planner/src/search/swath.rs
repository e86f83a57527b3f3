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
//! Under a deadline the last searches go in rounds, each longer than the one before, so that no target
//! that takes long keeps others from their turn. What is found by then counts, with the bound that is
//! proved by then, even if that is not ε yet.
//!
//! Targets are handed to the threads in order of use. Each is searched for on its own, from what was
//! there before any of them, so results do not depend on the number of threads or on who is first; only
//! a deadline makes them depend on the machine.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use rayon::iter::{IntoParallelRefMutIterator, ParallelIterator};
use swath_bridge::Pose2;

use super::distance::Distances;
use super::goal::Goal;
use super::target::{Aims, Search, Shared};
use super::tree::{Tree, Weights};
use super::trunk::Trunk;
use super::work::{Work, is_over};
use super::{Limits, TargetResult, cell_steps};
use crate::collision::CollisionMap;
use crate::motion::Successors;
use crate::timing::CpuTimer;
use crate::{Error, Plane};

/// Expansions of each target in the first round under a deadline, as a multiple of the first search's.
const FIRST_ROUND: u64 = 8;
/// The same in each further round, as a multiple of the round before.
const NEXT_ROUND: u64 = 4;
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
    /// Memory of a second one.
    far_trunk: Trunk,
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
        let mut work = Work::new(frame, rules.epsilon);
        if work.left.is_empty() || !self.prepare(frame, rules)? {
            return Ok(work.results);
        }
        let task = (frame, rules);
        self.search_for(task, &mut work, self.effort.first);
        // Where few targets are left, searching longer for them costs less than what would serve many.
        let each = self.effort.few / work.left.len().max(1) as u64;
        if each > 2 * self.effort.first {
            self.search_for(task, &mut work, each);
        }
        if !is_over(rules, &work) {
            self.search_farther(task, &mut work, each);
        }
        Ok(work.results)
    }

    /// Searches for the targets that are left, with the trunk's states farther off: without end, or in
    /// rounds of at least so many expansions each.
    fn search_farther(
        &mut self,
        (frame, rules): (&Frame<'_>, &Rules<'_>),
        work: &mut Work,
        each: u64,
    ) {
        let stop = || rules.limits.asked().is_some();
        let far = self.effort.far;
        let unsolved: Vec<Goal> = work.unsolved().cloned().collect();
        let mut each = each.max(FIRST_ROUND * self.effort.first);
        if rules.limits.stop.is_some() {
            // One thread makes the trunk go on, so the others search without that meanwhile.
            let mut trunk = std::mem::take(&mut self.far_trunk);
            trunk.copy(&self.trunk);
            rayon::join(
                || trunk.spread(frame.map, frame.successors, &unsolved, (far, &stop)),
                || self.search_for((frame, rules), work, each),
            );
            self.far_trunk = std::mem::replace(&mut self.trunk, trunk);
        } else {
            let (map, successors) = (frame.map, frame.successors);
            self.trunk.spread(map, successors, &unsolved, (far, &stop));
        }
        if frame.regions.is_some() {
            // What the trunk decides needs no region.
            self.search_for((frame, rules), work, self.effort.before_asking);
            self.ask_regions((frame, rules), &work.left);
        }
        // Under a deadline nothing that takes long keeps the others from their turn.
        if rules.limits.stop.is_none() {
            each = u64::MAX;
        }
        while !is_over(rules, work) {
            work.put_unsolved_first();
            self.search_for((frame, rules), work, each);
            each = each.saturating_mul(NEXT_ROUND);
        }
    }

    /// Asks where the paths to targets that are left are expected.
    fn ask_regions(&mut self, (frame, rules): (&Frame<'_>, &Rules<'_>), left: &[usize]) {
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

    /// Searches for the targets that are left with at most so many expansions each, as far as the rules'
    /// limit leaves any after what each was searched for already.
    fn search_for(&mut self, (frame, rules): (&Frame<'_>, &Rules<'_>), work: &mut Work, most: u64) {
        let allowed = rules.limits.max_expansions.unwrap_or(u64::MAX);
        let most = most.min(allowed.saturating_sub(work.spent));
        if most == 0 {
            return;
        }
        work.spent = work.spent.saturating_add(most);
        let limits = Limits {
            max_expansions: Some(most),
            ..rules.limits
        };
        self.search_all(frame, work, (rules.epsilon, limits));
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

    /// Searches for the targets that are left on all threads.
    fn search_all(
        &mut self,
        frame: &Frame<'_>,
        work: &mut Work,
        (epsilon, limits): (f64, Limits<'_>),
    ) {
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
        let threads = rayon::current_num_threads().min(work.left.len());
        if self.trees.len() < threads {
            self.trees.resize_with(threads, Tree::default);
        }
        let next = AtomicUsize::new(0);
        let (goals, numbers) = (&work.goals, &work.left);
        let search = |tree: &mut Tree| {
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
        let ends: Vec<_> = workers.map(search).collect();
        for (number, end, cpu) in ends.into_iter().flatten() {
            work.take(number, end, cpu);
        }
    }
}
