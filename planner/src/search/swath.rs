//! `swath`: all targets of a frame together, each at a cost of at most ε times its optimum.
//!
//! 1. For all targets: lower bounds on the length from the vehicle to everywhere, around obstacles
//!    (`distance`), and the exact costs of what is near the vehicle (`trunk`).
//! 2. For each target: a search from its goal backward under these bounds, with few expansions
//!    (`target`). It solves what is easy and proves much of what cannot be reached. If few targets are
//!    left, the same again with more. Meanwhile the trunk goes on farther off.
//! 3. If any targets are left: the same again with the trunk's paths, which are often within the bound at
//!    once; else they are paths that a search may stop at.
//! 4. If any targets are left: the trunk looks closer, and meanwhile what is near becomes wide, with lower
//!    bounds on the costs of all that lies beyond. With both the same again, without end; and around the
//!    paths that are found so, if there is no deadline, a search for the best way there.
//!
//! Under a deadline the last searches go in rounds, each longer than the one before, so that no target
//! that takes long keeps others from their turn. What is found by then counts, with the bound that is
//! proved by then, even if that is not ε yet.
//!
//! Targets are handed to the threads in order of use. Each is searched for on its own, from what was
//! there before any of them, so results do not depend on the number of threads or on who is first; only
//! a deadline makes them depend on the machine.

use std::mem::take;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use rayon::iter::{IntoParallelRefMutIterator, ParallelIterator};
use swath_bridge::{Outcome, Pose2};

use super::distance::Distances;
use super::known::{Known, Trunks};
use super::target::{Aims, End, Search, Shared};
use super::tree::{Tree, Weights};
use super::tube::Tube;
use super::work::{Work, is_over};
use super::{Limits, TargetResult, cell_steps};
use crate::collision::CollisionMap;
use crate::motion::Successors;
use crate::timing::CpuTimer;
use crate::tolerance::GoalTolerance;
use crate::{Error, Plane};

/// Expansions of each target in a longer search, as a multiple of the first one's.
const LONGER: u64 = 8;
/// One part in so many of the last trunks' expansions is for the first searches with these.
const FIRST_SHARE: u64 = 10;
/// Expansions of each target in a round under a deadline, as a multiple of the round before.
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
    /// How nearly they have to be reached.
    pub tolerance: GoalTolerance,
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

/// What a search for targets is done with.
#[derive(Clone, Copy)]
struct Task<'a> {
    frame: &'a Frame<'a>,
    rules: &'a Rules<'a>,
    known: Known<'a>,
}

/// How many expansions each part of a frame's search is given.
#[derive(Debug, Clone, Copy)]
pub(super) struct Effort {
    /// Of the trunk near the vehicle.
    pub(super) near: u64,
    /// Of the trunk farther off while targets are searched for at first, after that, and when it looks
    /// closer.
    pub(super) meanwhile: u64,
    pub(super) far: u64,
    pub(super) closer: u64,
    /// Of the first search for a target.
    pub(super) first: u64,
    /// Of the second searches for all targets that the first ones left, if these are few.
    pub(super) few: u64,
    /// Of the searches for what is left then, before it is asked where paths are expected.
    pub(super) before_asking: u64,
    /// Of the wide trunk, meanwhile.
    pub(super) wide: u64,
}

impl Default for Effort {
    fn default() -> Self {
        Self {
            near: 3_000,
            meanwhile: 6_000,
            far: 34_000,
            closer: 80_000,
            first: 500,
            few: 20_000,
            before_asking: 2_000,
            wide: 200_000,
        }
    }
}

impl Effort {
    /// Of the second search for a target if it is one of those that are left.
    fn each_of_few(&self, work: &Work) -> u64 {
        self.few / work.left.len().max(1) as u64
    }

    /// Of the next search for one of them, however many they are.
    fn each_of_longer(&self, work: &Work) -> u64 {
        self.each_of_few(work).max(LONGER * self.first)
    }
}

/// Memory of all that targets share, reused from frame to frame.
#[derive(Debug, Default)]
pub struct FrameMemory {
    effort: Effort,
    aims: Aims,
    distances: Distances,
    trunks: Trunks,
    shared_steps: u64,
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
        if work.left.is_empty() || !self.prepare((frame, rules), &work)? {
            return Ok(work.results);
        }
        let mut trunks = take(&mut self.trunks);
        let searched = self.search((frame, rules), &mut work, &mut trunks);
        self.trunks = trunks;
        searched.map(|()| work.results)
    }

    fn search(
        &mut self,
        on: (&Frame<'_>, &Rules<'_>),
        work: &mut Work,
        trunks: &mut Trunks,
    ) -> Result<(), Error> {
        self.shared_steps = trunks.near.steps();
        self.search_near(on, work, trunks)?;
        if !is_over(on.1, work) {
            self.search_farther(on, work, trunks);
        }
        if !is_over(on.1, work) {
            self.search_on(on, work, trunks)?;
        }
        Ok(())
    }

    /// Searches for what the trunk's near states serve, while one thread makes the trunk go on.
    fn search_near(
        &mut self,
        (frame, rules): (&Frame<'_>, &Rules<'_>),
        work: &mut Work,
        Trunks { near, far, .. }: &mut Trunks,
    ) -> Result<(), Error> {
        let effort = self.effort;
        let on = (frame.map, frame.successors);
        let is_over = AtomicBool::new(false);
        let stop = || is_over.load(Ordering::Relaxed) || rules.limits.asked().is_some();
        let task = Task {
            frame,
            rules,
            known: Known::near(near),
        };
        far.follow(near, frame.map, work.unsolved())?;
        // One thread makes the trunk go on, while the others search without that.
        let left = work.left.clone();
        rayon::join(
            || {
                self.search_longer_for_few(&task, work, effort.first);
                is_over.store(work.left.is_empty(), Ordering::Relaxed);
            },
            || far.spread(on, &left, (effort.meanwhile, &stop)),
        );
        Ok(())
    }

    /// Searches for the targets that are left, with the trunk's states farther off, for which it goes on
    /// first. If time is short, other threads search with the near ones until it has.
    fn search_farther(
        &mut self,
        (frame, rules): (&Frame<'_>, &Rules<'_>),
        work: &mut Work,
        Trunks { near, far, .. }: &mut Trunks,
    ) {
        let (limits, effort) = (rules.limits, self.effort);
        let (is_spread, is_over) = (AtomicBool::new(false), AtomicBool::new(false));
        let stop_spread = || is_over.load(Ordering::Relaxed) || limits.asked().is_some();
        let stop_search = || {
            let is_spread = is_spread.load(Ordering::Relaxed);
            limits
                .asked()
                .or(is_spread.then_some(Outcome::BudgetExhausted))
        };
        let until_spread = Rules {
            limits: Limits {
                stop: Some(&stop_search),
                ..limits
            },
            ..*rules
        };
        let known = Known::near(near);
        let left = work.left.clone();
        rayon::join(
            || {
                if limits.stop.is_some() {
                    let each = effort.each_of_longer(work);
                    let rules = &until_spread;
                    let task = Task {
                        frame,
                        rules,
                        known,
                    };
                    self.search_for(&task, work, each);
                    is_over.store(work.left.is_empty(), Ordering::Relaxed);
                }
            },
            || {
                let on = (frame.map, frame.successors);
                far.spread(on, &left, (effort.far, &stop_spread));
                is_spread.store(true, Ordering::Relaxed);
            },
        );
        self.shared_steps = far.steps();
        let known = Known {
            far: Some(far),
            ..known
        };
        let task = Task {
            frame,
            rules,
            known,
        };
        let each = effort.each_of_longer(work);
        self.search_longer_for_few(&task, work, each);
    }

    /// Searches for what even that leaves, with all that can be known of ways from the vehicle: without
    /// end, or in rounds, each longer than the one before.
    fn search_on(
        &mut self,
        (frame, rules): (&Frame<'_>, &Rules<'_>),
        work: &mut Work,
        trunks: &mut Trunks,
    ) -> Result<(), Error> {
        let limits = rules.limits;
        let stop = || limits.asked().is_some();
        let (mut share, mut each) = (FIRST_SHARE, self.effort.each_of_longer(work));
        trunks.far.refine(&trunks.near, frame.map);
        trunks.wide.copy(&trunks.near, frame.map)?;
        let hard = work.left.clone();
        let mut is_asked = false;
        let mut is_due = true;
        while !is_over(rules, work) {
            if is_due {
                let most = (self.effort.closer / share, self.effort.wide / share);
                if !trunks.go_on(
                    (frame.map, frame.successors),
                    (&work.left, &self.distances),
                    (most, &stop),
                ) {
                    break;
                }
                self.shared_steps = trunks.steps();
            }
            let task = Task {
                frame,
                rules,
                known: trunks.known(),
            };
            if frame.regions.is_some() && !is_asked {
                // What the trunks decide needs no region.
                self.search_for(&task, work, self.effort.before_asking);
                self.ask_regions(&task, &work.left);
                is_asked = true;
            }
            work.put_unsolved_first();
            self.search_for(&task, work, each);
            // Under a deadline nothing that takes long keeps the others from their turn.
            each = match limits.stop {
                Some(_) => each.saturating_mul(NEXT_ROUND),
                None => u64::MAX,
            };
            is_due = share > 1 && each > self.effort.wide;
            if is_due {
                share = 1;
            }
        }
        // With a deadline, who waits for the frame has it sooner instead.
        if limits.stop.is_none() {
            let task = Task {
                frame,
                rules,
                known: trunks.known(),
            };
            self.tighten(&task, work, &hard);
        }
        Ok(())
    }

    /// Searches with so many expansions each, and if few targets are left then, once more with more: for
    /// few that costs less than what serves many.
    fn search_longer_for_few(&mut self, task: &Task<'_>, work: &mut Work, each: u64) {
        self.search_for(task, work, each);
        let longer = self.effort.each_of_few(work);
        if longer > 2 * each {
            self.search_for(task, work, longer);
        }
    }

    /// Asks where the paths to targets that are left are expected.
    fn ask_regions(&mut self, task: &Task<'_>, left: &[usize]) {
        let (frame, rules) = (task.frame, task.rules);
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
    fn search_for(&mut self, task: &Task<'_>, work: &mut Work, most: u64) {
        let rules = task.rules;
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
        self.search_all(task, work, limits);
    }

    /// Expansions that served all targets of the last frame together.
    pub const fn shared_steps(&self) -> u64 {
        self.shared_steps
    }

    /// Computes what targets share. False if it was stopped.
    fn prepare(
        &mut self,
        (frame, rules): (&Frame<'_>, &Rules<'_>),
        work: &Work,
    ) -> Result<bool, Error> {
        let (map, successors) = (frame.map, frame.successors);
        map.spec().validate()?;
        self.regions.clear();
        self.aims.prepare(map);
        let stop = || rules.limits.asked().is_some();
        let (distances, trunk) = (&mut self.distances, &mut self.trunks.near);
        let near_steps = self.effort.near;
        let (is_measured, is_grown) = rayon::join(
            || distances.measure(map, &work.goals, &stop),
            || trunk.grow(map, successors, (near_steps, &stop)),
        );
        Ok(is_grown? && is_measured)
    }

    /// Searches for the targets that are left on all threads.
    fn search_all(&mut self, task: &Task<'_>, work: &mut Work, limits: Limits<'_>) {
        let epsilon = task.rules.epsilon;
        let weights = Weights::new(epsilon, 1.0 + WEIGHT_SHARE * (epsilon - 1.0));
        let search = |shared: &Shared<'_>, tree: &mut Tree, number: usize| {
            let goal = work.goals[number].as_ref()?;
            Some(Search::new(shared, weights, tree).run((number, goal), limits))
        };
        for (number, end, cpu) in self.on_all_threads(task, &work.left, &search) {
            work.take(number, end, cpu);
        }
    }

    /// Searches around the paths to targets for ways that cost less.
    fn tighten(&mut self, task: &Task<'_>, work: &mut Work, numbers: &[usize]) {
        let map = task.frame.map;
        let limits = task.rules.limits;
        let most = limits
            .max_expansions
            .map(|most| most.saturating_sub(work.spent));
        let limits = Limits {
            max_expansions: most,
            ..limits
        };
        let search = |shared: &Shared<'_>, tree: &mut Tree, number: usize| {
            let path = &work.results[number].0.path;
            let goal = work.goals[number].as_ref().filter(|_| !path.is_empty())?;
            let tube = Tube::around(map, path);
            let search = Search::new(shared, Weights::new(1.0, 1.0), tree).within(&tube);
            Some(search.run((number, goal), limits))
        };
        for (number, end, cpu) in self.on_all_threads(task, numbers, &search) {
            work.take_better(number, end.result, cpu);
        }
    }

    /// Searches for each of some targets in memory of a thread's own, with the time that it took, until
    /// somebody says stop.
    fn on_all_threads(
        &mut self,
        task: &Task<'_>,
        numbers: &[usize],
        search: &(dyn Fn(&Shared<'_>, &mut Tree, usize) -> Option<End> + Sync),
    ) -> Vec<(usize, End, Duration)> {
        let frame = task.frame;
        let shared = Shared {
            map: frame.map,
            successors: frame.successors,
            steps_of: cell_steps(frame.map),
            aims: &self.aims,
            distances: &self.distances,
            known: task.known,
            regions: &self.regions,
        };
        let threads = rayon::current_num_threads().min(numbers.len());
        if self.trees.len() < threads {
            self.trees.resize_with(threads, Tree::default);
        }
        let next = AtomicUsize::new(0);
        let worker = |tree: &mut Tree| {
            let mut ends = Vec::new();
            while let Some(&number) = numbers.get(next.fetch_add(1, Ordering::Relaxed)) {
                if task.rules.limits.asked().is_some() || tree.prepare(frame.map.spec()).is_err() {
                    break;
                }
                let timer = CpuTimer::of_thread();
                let end = search(&shared, tree, number);
                ends.extend(end.map(|end| (number, end, timer.elapsed())));
            }
            ends
        };
        let workers = self.trees[..threads].par_iter_mut();
        let ends: Vec<_> = workers.map(worker).collect();
        ends.into_iter().flatten().collect()
    }
}
