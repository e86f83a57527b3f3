//! Hybrid A*: best-first search over drives along arcs, with a pose anywhere in the plane kept for each
//! square of cells and range of headings.
//!
//! From a pose the vehicle goes on straight, or on an arc of its tightest or half its tightest curvature;
//! of all drives that end in the same square and range of headings the cheapest one is followed. Every
//! now and then, the more often the nearer the goal is, the rest of the way is tried as the cheapest drive
//! in the open (Dubins). If it is free it competes with the others, 5 % being taken off its cost. The lower bound is the way around
//! obstacles to the goal and the turns that are still to come. A predicted region scales costs and bounds
//! inside, as in `tiev-fcn`.
//!
//! Source: D. Dolgov et al., Practical Search Techniques in Path Planning for Autonomous Driving (2008).
//! Deviations: forward driving only; contact is tested without gaps on the full rectangle; the lower bound
//! knows how wide the vehicle is in each direction instead of being the greater of two. The search is not
//! complete: when it has nothing left to try it says that it gave up, and that a goal is unreachable only
//! where no chain of free cells leads there.

use std::collections::{BinaryHeap, HashMap};
use std::f64::consts::TAU;
use std::hash::{BuildHasherDefault, DefaultHasher};

use swath_bridge::{Outcome, Pose2};

use crate::Error;
use crate::collision::CollisionMap;
use crate::dubins;
use crate::ground::{Ground, Nearby};
use crate::guidance::Guidance;
use crate::motion::COST_UNITS;
use crate::search::{Distances, Goal, Limits, SHORT_STOP_INTERVAL, TargetResult};
use crate::segment::{Segment, driven};
use crate::tolerance::Target;

/// Side of a square in which one pose is kept for each range of headings, cells.
const SQUARE_CELLS: f64 = 2.0;
/// Widest range of headings, radians (5°).
const HEADING_RAD: f64 = TAU / 72.0;
/// Most ranges of headings; fast vehicles turn so little on one arc that they need many.
const MAX_HEADINGS: f64 = 720.0;
/// Shortest arcs, squares: enough to leave the square that one begins in.
const SHORTEST_SQUARES: f64 = 1.5;
/// Longest arcs, metres.
const LONGEST_M: f64 = 3.0;
/// Curvatures as shares of the tightest one; the first is preferred among equals.
const BENDS: [f64; 5] = [0.0, 0.5, -0.5, 1.0, -1.0];
/// The way in the open is tried once in so many expansions for each metre that is left to the goal.
const EXPANSIONS_A_TRY_AND_METRE: f64 = 0.5;
/// A way in the open is taken when it costs at most so many times the least total that is left.
const OPEN_WAY_WORTH: f64 = 1.05;
/// Most poses that a search keeps; a pose takes about 150 bytes.
const MAX_NODES: usize = 1 << 20;
/// Stands for no node.
const NONE: u32 = u32::MAX;

/// A pose that was reached.
#[derive(Debug, Clone, Copy)]
struct Node {
    pose: Pose2,
    /// Scaled inside a region.
    cost: f64,
    parent: u32,
    way: Way,
}

/// How a pose was reached from its parent.
#[derive(Debug, Clone, Copy)]
enum Way {
    Arc(Segment),
    /// To the goal, as in the open.
    Dubins([Segment; 3]),
}

/// What one range of poses knows.
#[derive(Debug, Clone, Copy)]
struct Slot {
    node: u32,
    is_expanded: bool,
}

/// The memory of a search; reused, it needs no new allocations.
#[derive(Debug, Default)]
pub(crate) struct HybridMemory {
    nodes: Vec<Node>,
    slots: HashMap<(u32, u32), Slot, BuildHasherDefault<DefaultHasher>>,
    /// Totals in units, smallest first, and the newest node among equals.
    open: BinaryHeap<(std::cmp::Reverse<u64>, u32)>,
    distances: Distances,
    near: Nearby,
}

/// Plans to one target with `hybrid`, or with `hybrid-fcn` if a region guides it.
///
/// # Errors
/// Those of [`Guidance::check`].
pub(crate) fn hybrid(
    (map, ground): (&CollisionMap, &Ground),
    curvature_per_m: f64,
    (goal, guidance): (impl Into<Target>, Guidance<'_>),
    limits: Limits<'_>,
    memory: &mut HybridMemory,
) -> Result<TargetResult, Error> {
    guidance.check(map.spec())?;
    let goal = match ground.goal(map, goal) {
        Ok(goal) => goal,
        Err(outcome) => return Ok(TargetResult::without_path(outcome, 0)),
    };
    let stop = || limits.asked().is_some();
    if !ground.measure_to(map, &goal, &mut memory.distances, &stop) {
        let outcome = limits.asked().unwrap_or(Outcome::BudgetExhausted);
        return Ok(TargetResult::without_path(outcome, 0));
    }
    memory.nodes.clear();
    memory.slots.clear();
    memory.open.clear();
    let search = Search {
        lattice: Lattice::new(map, curvature_per_m),
        map,
        ground,
        goal,
        guidance,
        memory,
        steps: 0,
        last_try: 0,
    };
    Ok(search.run(limits))
}

/// Which poses count as the same, and the arcs between them.
#[derive(Debug)]
struct Lattice {
    square_m: f64,
    heading_rad: f64,
    arcs: [Segment; BENDS.len()],
    curvature_per_m: f64,
}

impl Lattice {
    fn new(map: &CollisionMap, curvature_per_m: f64) -> Self {
        let square_m = SQUARE_CELLS * map.spec().resolution_m;
        // The tightest arc leaves its range of headings, if it is not too long for that.
        let shortest_m = SHORTEST_SQUARES * square_m;
        let length_m = (HEADING_RAD / curvature_per_m).clamp(shortest_m, LONGEST_M.max(shortest_m));
        let turn_rad = (length_m * curvature_per_m).min(HEADING_RAD);
        Self {
            square_m,
            heading_rad: TAU / libm::ceil(TAU / turn_rad).min(MAX_HEADINGS),
            arcs: BENDS.map(|share| Segment {
                curvature_per_m: share * curvature_per_m,
                length_m,
            }),
            curvature_per_m,
        }
    }

    /// The range that a pose on the map is in.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "maps have at most 4096 squares to a side, which a wrapped number tells apart"
    )]
    fn range_of(&self, pose: &Pose2) -> (u32, u32) {
        let along = libm::floor(pose.x_m / self.square_m) as i32;
        let across = libm::floor(pose.y_m / self.square_m) as i32;
        let headings = libm::round(TAU / self.heading_rad);
        let heading = libm::round(pose.yaw_rad / self.heading_rad);
        let heading = if heading < 0.0 {
            heading + headings
        } else {
            heading
        };
        let heading = if heading < headings { heading } else { 0.0 };
        (
            (along as u32) << 16 | (across as u32 & 0xFFFF),
            heading as u32,
        )
    }
}

struct Search<'a> {
    lattice: Lattice,
    map: &'a CollisionMap,
    ground: &'a Ground,
    goal: Goal,
    guidance: Guidance<'a>,
    memory: &'a mut HybridMemory,
    steps: u64,
    /// Expansions after which the way in the open was last tried.
    last_try: u64,
}

impl Search<'_> {
    fn run(mut self, limits: Limits<'_>) -> TargetResult {
        let start = Node {
            pose: Pose2::default(),
            cost: 0.0,
            parent: NONE,
            way: Way::Arc(Segment::default()),
        };
        self.reach(start);
        while let Some((_, index)) = self.memory.open.pop() {
            let node = self.memory.nodes[index as usize];
            if matches!(node.way, Way::Dubins(_)) || self.goal.accepts_pose(&node.pose) {
                return self.trace(index);
            }
            let range = self.lattice.range_of(&node.pose);
            match self.memory.slots.get_mut(&range) {
                Some(slot) if slot.node == index && !slot.is_expanded => slot.is_expanded = true,
                _ => continue,
            }
            self.steps += 1;
            self.expand(index, &node);
            if self.memory.nodes.len() > MAX_NODES {
                break;
            }
            if let Some(outcome) = limits.reached(self.steps, SHORT_STOP_INTERVAL) {
                return TargetResult::without_path(outcome, self.steps);
            }
        }
        TargetResult::without_path(Outcome::BudgetExhausted, self.steps)
    }

    fn expand(&mut self, index: u32, from: &Node) {
        self.try_the_open(index, from);
        for arc in self.lattice.arcs {
            let pose = arc.end(&from.pose);
            let node = Node {
                cost: from.cost + arc.cost() * self.guidance.factor_at(self.map.spec(), &pose),
                pose,
                parent: index,
                way: Way::Arc(arc),
            };
            if self.is_worth(&node)
                && self
                    .ground
                    .drive(&from.pose, &arc, &mut self.memory.near)
                    .is_some()
            {
                self.reach(node);
            }
        }
    }

    /// Whether a node is better than what is known of its range.
    fn is_worth(&self, node: &Node) -> bool {
        let slot = self.memory.slots.get(&self.lattice.range_of(&node.pose));
        slot.is_none_or(|slot| {
            !slot.is_expanded && node.cost < self.memory.nodes[slot.node as usize].cost
        })
    }

    /// Keeps a node, unless there is no way from it to the goal.
    fn reach(&mut self, node: Node) {
        let Some(left) = self.cost_left(&node.pose) else {
            return;
        };
        let number = self.push(node, node.cost + left);
        let slot = Slot {
            node: number,
            is_expanded: false,
        };
        let range = self.lattice.range_of(&node.pose);
        self.memory.slots.insert(range, slot);
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "costs are not negative and the number of nodes is limited"
    )]
    fn push(&mut self, node: Node, total: f64) -> u32 {
        let number = self.memory.nodes.len() as u32;
        let total = libm::round(total * COST_UNITS) as u64;
        self.memory.nodes.push(node);
        self.memory.open.push((std::cmp::Reverse(total), number));
        number
    }

    /// A lower bound on the cost from a pose to the goal, scaled inside a region; none if no way is known
    /// around the obstacles.
    fn cost_left(&self, pose: &Pose2) -> Option<f64> {
        let spec = self.map.spec();
        let index = spec.index_of(spec.cell_at(pose.x_m, pose.y_m))?;
        let cols = spec.cols as usize;
        let length_m = self.memory.distances.metres((index / cols, index % cols))?;
        let left = length_m + self.goal.least_turn_rad(pose);
        Some(left * self.guidance.factor(index))
    }

    /// Tries the rest of the way as it would be in the open.
    fn try_the_open(&mut self, index: u32, from: &Node) {
        let distance_m = self.goal.distance_left((from.pose.x_m, from.pose.y_m));
        let since = (self.steps - self.last_try) as f64;
        if self.steps > 1 && since < distance_m * EXPANSIONS_A_TRY_AND_METRE {
            return;
        }
        self.last_try = self.steps;
        let radius_m = 1.0 / self.lattice.curvature_per_m;
        let Some(drive) = dubins::cheapest(&from.pose, &self.goal.pose(), radius_m) else {
            return;
        };
        let near = &mut self.memory.near;
        if let Some(pose) = self.ground.drive_all(&from.pose, &drive, near) {
            let node = Node {
                pose,
                cost: from.cost + self.scaled(&from.pose, &drive),
                parent: index,
                way: Way::Dubins(drive),
            };
            self.push(node, node.cost / OPEN_WAY_WORTH);
        }
    }

    /// The cost of segments as it would be in arcs of the search.
    fn scaled(&self, from: &Pose2, segments: &[Segment]) -> f64 {
        let spec = self.map.spec();
        let mut pose = *from;
        let mut cost = 0.0;
        for segment in segments {
            let pieces = libm::ceil(segment.length_m / self.lattice.arcs[0].length_m).max(1.0);
            let mut piece = 0.0;
            while piece < pieces {
                piece += 1.0;
                let at = segment.after(&pose, segment.length_m * piece / pieces);
                cost += segment.cost() / pieces * self.guidance.factor_at(spec, &at);
            }
            pose = segment.end(&pose);
        }
        cost
    }

    fn trace(&self, last: u32) -> TargetResult {
        let mut segments = Vec::new();
        let mut index = last;
        while index != NONE {
            let node = &self.memory.nodes[index as usize];
            match node.way {
                Way::Arc(arc) => segments.push(arc),
                Way::Dubins(drive) => segments.extend(drive.into_iter().rev()),
            }
            index = node.parent;
        }
        segments.reverse();
        driven(&Pose2::default(), &segments, self.steps)
    }
}
