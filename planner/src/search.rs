//! Best-first search over (row, column, direction): `tiev` and `tiev-fcn`; `weighted` and `swath`, whose
//! costs are within a factor of the optimum, are in modules of their own.
//!
//! A state is a cell's centre and one of the 256 directions, that of the last action; the vehicle
//! starts on the ego cell heading straight ahead. An action may follow if its direction is within the
//! angle limit, the turn on the spot and the straight drive touch no occupied cell, and the new centre
//! is on the map. Cost is length in metres plus turn in radians. This graph is what optimality,
//! bounds and reachability refer to.
//!
//! Source: the paper's section IV, Algorithm 1. Deviations: the consistent form of the algorithm is
//! used (it compares the unscaled cost and stores the scaled one); the heuristic is the Euclidean
//! distance less the goal tolerance, so that it never overestimates; improved states are expanded
//! again, so that an inconsistent heuristic costs steps and not optimality.
//!
//! What makes it fast: the motions of a cell that are blocked are read as words (see `collision`), so
//! that nothing blocked is ever looked at; all costs of an expansion are loaded before the first one
//! is compared; states that are near in direction lie together; the open list sorts only what is due.
//! Measured and not kept: finer buckets of the open list, cells aligned to cache lines, and proofs of
//! unreachability from the connected free ground, which found none that going backwards does not.

mod backward;
mod bound;
mod distance;
mod goal;
mod known;
mod memory;
mod open;
mod path;
mod sieve;
mod swath;
mod target;
mod tree;
mod trunk;
mod tube;
mod weighted;
mod work;

use swath_bridge::{Outcome, Pose2};

use crate::Error;
use crate::action::{ACTIONS, AHEAD, DIRECTIONS};
use crate::collision::{CollisionMap, WORD};
use crate::guidance::Guidance;
use crate::motion::{COST_UNITS, Fan, Successors};
use crate::tolerance::Target;

pub use bound::Bound;
pub(crate) use distance::{Distances, Passable};
pub(crate) use goal::Goal;
pub(crate) use path::POSE_SPACING_M;

pub use memory::SearchMemory;
pub use swath::{Frame, FrameMemory, Regions, Rules};
pub use weighted::{WeightedMemory, search_weighted};

use backward::Finding;
use bound::{Aim, TurnBound};
use memory::{About, Parent, Place, State};

/// An informed search that has come so far tries to prove that the goal cannot be reached.
const PROOF_AFTER_STEPS: u64 = 8_000;
/// States that such a proof may look at: little time beside what the search has taken by then.
const MAX_PROOF_STATES: usize = 20_000;
/// How often a search asks whether it should stop, in expansions.
const STOP_INTERVAL: u64 = 256;
/// The same where deadlines are kept closely.
pub(crate) const SHORT_STOP_INTERVAL: u64 = 64;

/// What a search may spend.
#[derive(Clone, Copy, Default)]
pub struct Limits<'a> {
    /// Most expansions, or `None` for no limit.
    pub max_expansions: Option<u64>,
    /// Asked every few hundred expansions: the reason to stop, if there is one.
    pub stop: Option<&'a (dyn Fn() -> Option<Outcome> + Sync)>,
}

impl Limits<'_> {
    /// The reason to stop after so many expansions, if there is one; the caller's is asked for once in
    /// so many only.
    pub(crate) fn reached(&self, steps: u64, stop_interval: u64) -> Option<Outcome> {
        if self.max_expansions.is_some_and(|most| steps >= most) {
            return Some(Outcome::BudgetExhausted);
        }
        if steps % stop_interval == 1 {
            self.asked()
        } else {
            None
        }
    }

    /// The caller's reason to stop.
    pub(crate) fn asked(&self) -> Option<Outcome> {
        self.stop.and_then(|ask| ask())
    }
}

impl std::fmt::Debug for Limits<'_> {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("Limits")
            .field("max_expansions", &self.max_expansions)
            .field("stop", &self.stop.map(|_| "callback"))
            .finish()
    }
}

/// The result of a search to one target.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetResult {
    /// What became of it.
    pub outcome: Outcome,
    /// Metres plus radians along the path, never scaled; NaN unless solved.
    pub cost: f64,
    /// The cost is proved to be at most so many times the optimum; NaN where nothing is proved.
    pub bound: f64,
    /// Length of the path, metres; NaN unless solved.
    pub length_m: f64,
    /// Expansions.
    pub steps: u64,
    /// The path, at most 0.2 m and one turn between poses, in the vehicle frame; empty unless solved.
    pub path: Vec<Pose2>,
}

impl TargetResult {
    /// A result without a path.
    pub const fn without_path(outcome: Outcome, steps: u64) -> Self {
        Self {
            outcome,
            cost: f64::NAN,
            bound: f64::NAN,
            length_m: f64::NAN,
            steps,
            path: Vec::new(),
        }
    }
}

/// Plans to one target with `tiev`, or with `tiev-fcn` if a region guides it.
///
/// # Errors
/// [`Error::Shape`] if the region or the memory is not of the map's size,
/// [`Error::RegionWeight`] if its weight is not in (0, 1].
pub fn search(
    map: &CollisionMap,
    successors: &Successors,
    target: (impl Into<Target>, Guidance<'_>),
    limits: Limits<'_>,
    memory: &mut SearchMemory,
) -> Result<TargetResult, Error> {
    let (goal, guidance) = target;
    guidance.check(map.spec())?;
    match Goal::new(map, goal) {
        Ok(goal) => {
            memory.prepare(map.spec(), None)?;
            let steps_of = cell_steps(map);
            let search = Search::new(map, successors, &steps_of, (goal, guidance), memory);
            Ok(search.run(limits))
        }
        Err(outcome) => Ok(TargetResult::without_path(outcome, 0)),
    }
}

/// Plans to one target with `tiev` and a lower bound of choice: the optimum is the same with any.
///
/// With [`Bound::Informed`] a search that takes long also looks for a proof that the goal cannot be
/// reached, so that it may say so where [`search`] would come to its limit.
///
/// # Errors
/// None with a map that was made.
pub fn search_bounded(
    map: &CollisionMap,
    successors: &Successors,
    target: (impl Into<Target>, Bound),
    limits: Limits<'_>,
    memory: &mut SearchMemory,
) -> Result<TargetResult, Error> {
    match Goal::new(map, target.0) {
        Ok(goal) => {
            let turns = match target.1 {
                Bound::Euclidean => None,
                Bound::Informed => Some(Box::new(TurnBound::new(map, &goal))),
            };
            memory.prepare(map.spec(), turns)?;
            let steps_of = cell_steps(map);
            let search = Search::new(map, successors, &steps_of, (goal, Guidance::NONE), memory);
            let bound = target.1;
            Ok(Search { bound, ..search }.run(limits))
        }
        Err(outcome) => Ok(TargetResult::without_path(outcome, 0)),
    }
}

fn check_epsilon(epsilon: f64) -> Result<(), Error> {
    if (1.0..=tree::MAX_EPSILON).contains(&epsilon) {
        Ok(())
    } else {
        Err(Error::Epsilon { epsilon })
    }
}

/// Where an action leads from any cell.
#[derive(Debug, Clone, Copy, Default)]
struct CellStep {
    /// To be added to the cell's number.
    offset: i32,
    direction: u8,
}

#[expect(
    clippy::cast_possible_wrap,
    reason = "GridSpec::validate keeps sides at or below 4096"
)]
fn cell_steps(map: &CollisionMap) -> [CellStep; ACTIONS] {
    let mut steps = [CellStep::default(); ACTIONS];
    for (step, action) in steps.iter_mut().zip(map.model().table().actions()) {
        *step = CellStep {
            offset: action.d_row * map.spec().cols as i32 + action.d_col,
            direction: action.direction,
        };
    }
    steps
}

/// The vehicle's state before it moves.
fn start_of(map: &CollisionMap) -> State {
    let ego = map.spec().index_of(map.spec().ego());
    State::new(ego.unwrap_or(0), AHEAD)
}

/// Calls `follow` with the fans of a state's heading and the bits of their actions that are free there.
#[inline]
fn each_free_fan(
    map: &CollisionMap,
    successors: &Successors,
    state: State,
    mut follow: impl FnMut(&Fan, u64),
) {
    let cols = map.spec().cols as usize;
    let (cell, heading) = (
        (state.cell() / cols, state.cell() % cols),
        state.direction(),
    );
    let reach = successors.reach(heading, |group| map.blocked_turns(group, cell));
    for fan in successors.fans(heading) {
        let mut free = fan.allowed & !map.blocked_chords(fan.group, cell);
        if let Some(reach) = reach {
            free &= reach.of_group(fan.group);
        }
        follow(fan, free);
    }
}

/// Calls `each` with where a fan's actions whose bits are set lead, their costs and their numbers.
#[inline]
#[expect(clippy::cast_possible_truncation, reason = "there are 368 actions")]
fn each_step(
    steps_of: &[CellStep; ACTIONS],
    from: State,
    (fan, mut free): (&Fan, u64),
    mut each: impl FnMut(State, u32, u16),
) {
    while free != 0 {
        let bit = free.trailing_zeros() as usize;
        free &= free - 1;
        let action = fan.group * WORD + bit;
        let step = steps_of[action];
        // Actions that leave the map are blocked, so this is on it.
        let cell = from.cell().wrapping_add_signed(step.offset as isize);
        each(
            State::new(cell, step.direction),
            fan.costs[bit],
            action as u16,
        );
    }
}

struct Search<'a> {
    map: &'a CollisionMap,
    successors: &'a Successors,
    goal: Goal,
    guidance: Guidance<'a>,
    bound: Bound,
    steps_of: &'a [CellStep; ACTIONS],
    memory: &'a mut SearchMemory,
    /// What `follow` has looked up, kept here so that it need not be cleared.
    ways: [Way; WORD],
    steps: u64,
}

impl<'a> Search<'a> {
    fn new(
        map: &'a CollisionMap,
        successors: &'a Successors,
        steps_of: &'a [CellStep; ACTIONS],
        (goal, guidance): (Goal, Guidance<'a>),
        memory: &'a mut SearchMemory,
    ) -> Self {
        Self {
            map,
            successors,
            goal,
            guidance,
            bound: Bound::Euclidean,
            steps_of,
            memory,
            ways: [Way::default(); WORD],
            steps: 0,
        }
    }

    fn run(mut self, limits: Limits<'_>) -> TargetResult {
        let start = start_of(self.map);
        let place = self.place(start);
        self.memory.reach(start, place, 0, Parent::START);

        while let Some((state, cost)) = self.memory.pop() {
            if self.goal.accepts(state) {
                return TargetResult {
                    // A region's weight scales the path's cost, and overestimates the rest as much.
                    bound: self.guidance.weight().map_or(1.0, |weight| weight.powi(-2)),
                    ..path::trace(self.map, self.memory, state, self.steps)
                };
            }
            self.steps += 1;
            self.expand(state, cost);
            if self.steps == PROOF_AFTER_STEPS && self.is_proved_unreachable() {
                break;
            }
            if let Some(outcome) = limits.reached(self.steps, STOP_INTERVAL) {
                return TargetResult::without_path(outcome, self.steps);
            }
        }
        TargetResult::without_path(Outcome::Unreachable, self.steps)
    }

    fn is_proved_unreachable(&mut self) -> bool {
        let (map, successors, goal) = (self.map, self.successors, &self.goal);
        let backward = &mut self.memory.backward;
        self.bound == Bound::Informed
            && backward.search(map, successors, goal, MAX_PROOF_STATES) == Finding::Unreachable
    }

    fn expand(&mut self, state: State, cost: u32) {
        let (map, successors) = (self.map, self.successors);
        each_free_fan(map, successors, state, |fan, free| {
            self.follow(state, cost, (fan, free));
        });
    }

    /// Follows the actions of a fan whose bits are set.
    ///
    /// First all places are looked up and then all costs compared, so that the loads, most of which
    /// miss the caches, do not wait for one another's comparison.
    #[inline]
    fn follow(&mut self, from: State, cost: u32, free: (&Fan, u64)) {
        let mut count = 0;
        let steps_of = self.steps_of;
        each_step(steps_of, from, free, |to, step, action| {
            let place = self.place(to);
            let way = &mut self.ways[count];
            way.to = to;
            way.place = place;
            way.known_cost = self.memory.cost(place);
            way.step = step;
            way.action = action;
            count += 1;
        });
        for way in &self.ways[..count] {
            let step = match self.guidance.weight() {
                Some(weight) if self.memory.is_inside(way.to.cell()) => {
                    scaled_units(way.step, weight)
                }
                _ => way.step,
            };
            let cost = cost.saturating_add(step);
            if cost < way.known_cost {
                let parent = Parent::new(way.action, from.direction());
                self.memory.reach(way.to, way.place, cost, parent);
            }
        }
    }

    #[inline]
    fn place(&mut self, state: State) -> Place {
        let (map, goal, guidance, bound) = (self.map, &self.goal, self.guidance, self.bound);
        self.memory
            .place(state, |cell| about_cell(map, goal, (guidance, bound), cell))
    }
}

/// An action that may be followed, and where it leads.
#[derive(Debug, Clone, Copy, Default)]
struct Way {
    to: State,
    place: Place,
    /// Cost of the best way there so far, in units.
    known_cost: u32,
    /// Turn and length, in units.
    step: u32,
    action: u16,
}

/// What a search has to know of a cell when it first comes there.
#[cold]
fn about_cell(
    map: &CollisionMap,
    goal: &Goal,
    (guidance, bound): (Guidance<'_>, Bound),
    cell: usize,
) -> About {
    let centre = map.spec().centre_of(map.spec().cell_of_index(cell));
    About {
        estimate: floor_units(goal.distance_left(centre) * guidance.factor(cell)),
        is_inside: guidance.holds(cell),
        aim: if bound == Bound::Informed {
            TurnBound::aim(goal, centre)
        } else {
            Aim::default()
        },
    }
}

/// A step's cost times a weight in (0, 1], rounded half up.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the product is at least 0 and at most the step"
)]
fn scaled_units(step: u32, weight: f64) -> u32 {
    let scaled = f64::from(step) * weight;
    let whole = scaled as u32;
    whole + u32::from(scaled - f64::from(whole) >= 0.5)
}

/// A lower bound in units.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "bounds are not negative, and a cast saturates"
)]
fn floor_units(bound: f64) -> u32 {
    libm::floor(bound * COST_UNITS) as u32
}

// A direction is a u8 everywhere, so that it wraps around by itself.
const _: () = assert!(DIRECTIONS == 1 << u8::BITS);

#[cfg(test)]
mod tests;
