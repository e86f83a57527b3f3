//! Best-first search over (row, column, direction): `tiev` and `tiev-fcn`.
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

mod goal;
mod memory;
mod path;

use swath_bridge::{Outcome, Pose2};

use crate::action::{AHEAD, DIRECTIONS};
use crate::collision::CollisionMap;
use crate::motion::{COST_UNITS, Side, Successor, Successors, cost_units};
use crate::{Error, Plane};

pub use goal::{GOAL_TOLERANCE_M, GOAL_TOLERANCE_RAD};
pub use memory::SearchMemory;

use goal::Goal;
use memory::{Node, State};

/// How often a search asks whether it should stop, in expansions.
const STOP_INTERVAL: u64 = 256;

/// What a search may spend.
#[derive(Clone, Copy, Default)]
pub struct Limits<'a> {
    /// Most expansions, or `None` for no limit.
    pub max_expansions: Option<u64>,
    /// Asked every few hundred expansions: the reason to stop, if there is one.
    pub stop: Option<&'a (dyn Fn() -> Option<Outcome> + Sync)>,
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
            length_m: f64::NAN,
            steps,
            path: Vec::new(),
        }
    }
}

/// A region in which a search's costs and heuristic are scaled.
#[derive(Debug, Clone, Copy)]
pub struct WeightedRegion<'a> {
    /// The cells.
    pub cells: &'a Plane,
    /// Factor inside, in (0, 1]; the paper's is 0.15.
    pub weight: f64,
}

/// Plans to one target with `tiev`, or with `tiev-fcn` if there is a region.
///
/// # Errors
/// [`Error::Shape`] if the region or the memory is not of the map's size,
/// [`Error::RegionWeight`] if its weight is not in (0, 1].
pub fn search(
    map: &CollisionMap,
    successors: &Successors,
    target: (&Pose2, Option<WeightedRegion<'_>>),
    limits: Limits<'_>,
    memory: &mut SearchMemory,
) -> Result<TargetResult, Error> {
    let (goal, region) = target;
    check_region(map, region)?;
    memory.prepare(map.spec())?;
    Ok(match Goal::new(map, goal) {
        Ok(goal) => Search {
            map,
            successors,
            goal,
            region,
            memory,
            steps: 0,
        }
        .run(limits),
        Err(outcome) => TargetResult::without_path(outcome, 0),
    })
}

fn check_region(map: &CollisionMap, region: Option<WeightedRegion<'_>>) -> Result<(), Error> {
    let Some(region) = region else { return Ok(()) };
    let wanted = (map.spec().rows, map.spec().cols);
    let got = (region.cells.rows(), region.cells.cols());
    if got != wanted {
        return Err(Error::Shape {
            what: "region",
            got,
            wanted,
        });
    }
    if !(region.weight > 0.0 && region.weight <= 1.0) {
        return Err(Error::RegionWeight {
            weight: region.weight,
        });
    }
    Ok(())
}

struct Search<'a> {
    map: &'a CollisionMap,
    successors: &'a Successors,
    goal: Goal,
    region: Option<WeightedRegion<'a>>,
    memory: &'a mut SearchMemory,
    steps: u64,
}

impl Search<'_> {
    fn run(mut self, limits: Limits<'_>) -> TargetResult {
        let ego = self.map.spec().ego();
        let start = State::new(self.cell_index(ego.row, ego.col), AHEAD);
        self.claim(start.cell());
        *self.memory.node_mut(start) = Node::start();
        self.push(start, 0);

        while let Some(state) = self.memory.pop() {
            if self.goal.accepts(state) {
                return path::trace(self.map, self.memory, state, self.steps);
            }
            self.steps += 1;
            self.expand(state);
            if let Some(outcome) = self.stopped(limits) {
                return TargetResult::without_path(outcome, self.steps);
            }
        }
        TargetResult::without_path(Outcome::Unreachable, self.steps)
    }

    fn stopped(&self, limits: Limits<'_>) -> Option<Outcome> {
        if limits.max_expansions.is_some_and(|most| self.steps >= most) {
            return Some(Outcome::BudgetExhausted);
        }
        if self.steps % STOP_INTERVAL == 1 {
            limits.stop.and_then(|ask| ask())
        } else {
            None
        }
    }

    fn expand(&mut self, state: State) {
        let cols = self.map.spec().cols as usize;
        let (row, col) = (state.cell() / cols, state.cell() % cols);
        let cost = self.memory.node(state).cost;
        let successors = self.successors;
        // The turn to a direction passes all directions between, so the first one that is blocked
        // ends a side.
        let mut side = Side::Left;
        let (mut turned, mut is_blocked) = (0, false);
        for successor in successors.of(state.direction()) {
            if successor.side != side {
                side = successor.side;
                (turned, is_blocked) = (0, false);
            }
            while turned < successor.steps && !is_blocked {
                is_blocked = self
                    .map
                    .turn(side.passed(state.direction(), turned))
                    .get(row, col);
                turned += 1;
            }
            if !is_blocked {
                self.follow(state, (row, col), cost, successor);
            }
        }
    }

    fn follow(&mut self, from: State, (row, col): (usize, usize), cost: u32, step: &Successor) {
        let spec = self.map.spec();
        let Some(to_row) = row.checked_add_signed(step.d_row as isize) else {
            return;
        };
        let Some(to_col) = col.checked_add_signed(step.d_col as isize) else {
            return;
        };
        if to_row >= spec.rows as usize || to_col >= spec.cols as usize {
            return;
        }
        if self.map.chord(step.action).get(row, col) {
            return;
        }
        let cell = to_row * spec.cols as usize + to_col;
        let inside = self.claim(cell);
        let step_cost = match self.region {
            Some(region) if inside => cost_units(f64::from(step.cost) * region.weight / COST_UNITS),
            _ => step.cost,
        };
        let to = State::new(cell, step.direction);
        let new_cost = cost.saturating_add(step_cost);
        let node = self.memory.node_mut(to);
        if new_cost < node.cost {
            *node = Node::reached(new_cost, step.action, from.direction());
            self.push(to, new_cost);
        }
    }

    /// Makes a cell's states usable and says whether the cell is inside the region.
    fn claim(&mut self, cell: usize) -> bool {
        let inside = self
            .region
            .is_some_and(|region| region.cells.get_index(cell));
        if !self.memory.is_claimed(cell) {
            let centre = self
                .map
                .spec()
                .centre_of(self.map.spec().cell_of_index(cell));
            let mut estimate = self.goal.distance_left(centre);
            if let Some(region) = self.region.filter(|_| inside) {
                estimate *= region.weight;
            }
            self.memory.claim(cell, floor_units(estimate));
        }
        inside
    }

    fn push(&mut self, state: State, cost: u32) {
        self.memory.push(state, cost);
    }

    fn cell_index(&self, row: i32, col: i32) -> usize {
        self.map
            .spec()
            .index_of(swath_bridge::Cell::new(row, col))
            .unwrap_or(0)
    }
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
