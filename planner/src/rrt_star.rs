//! RRT*: a tree of the cheapest drives in the open (Dubins) to random poses, improved as it grows.
//!
//! A random pose pulls the nearest pose of the tree towards it by a limited length. Of all poses near the
//! new one, that becomes its parent from which it costs least, and those that it costs less to come to
//! through the new one are hung below it. From each new pose the goal is tried as in the open. A predicted region is where a share of the poses is drawn; the
//! others come from the whole map, so that every pose is drawn sooner or later, whatever the region is.
//!
//! Half of the poses are drawn without a heading: they get the one with which an arc and a straight line
//! from the nearest pose arrive. After the first path the tree grows for as many iterations again, and at
//! least for some; poses that cannot be part of a better path are not added then (informed RRT*).
//!
//! Source: S. Karaman and E. Frazzoli, Sampling-based Algorithms for Optimal Motion Planning (2011), for
//! Dubins vehicles in their paper of 2010; J. Gammell et al., Informed RRT* (2014). Deviations: nearest are
//! first those in the plane and among them those by drive; the share of a region. Every iteration is a
//! step. A search that ends without a path says that it gave up, and that a goal is unreachable only where
//! no chain of free cells leads there.

mod tree;

use std::f64::consts::{PI, TAU};

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use swath_bridge::{Outcome, Pose2};

use crate::collision::CollisionMap;
use crate::ground::{Ground, Nearby};
use crate::guidance::{Guidance, RegionSampler, unit};
use crate::search::{Goal, Limits, TargetResult};
use crate::segment::{Segment, cost_of, driven};
use crate::tolerance::Target;
use crate::{Error, dubins};

use tree::{ROOT, Tree};

/// Iterations of a search that no other limit is given for.
const DEFAULT_ITERATIONS: u64 = 4_000;
/// Most iterations whatever limit is given: a pose takes about 150 bytes, and all are looked at in each.
const MAX_ITERATIONS: u64 = 200_000;
/// How often a search asks whether it should stop, in iterations.
const STOP_INTERVAL: u64 = 16;
/// Least iterations after the first path.
const LEAST_IMPROVEMENT: u64 = 250;
/// Share of the poses that are drawn at the goal.
const GOAL_SHARE: f64 = 0.05;
/// Share of the others that are drawn from the region, if there is one.
const REGION_SHARE: f64 = 0.7;
/// Share of poses that get the heading with which they are reached.
const ARRIVAL_SHARE: f64 = 0.5;
/// Longest drive from a pose of the tree to a new one, metres.
const LONGEST_M: f64 = 8.0;
/// Least cost by which a way must be better, and by which two poses must differ, metres and radians. It is
/// far above what sums lose by rounding, so that no pose comes to hang below itself.
const LEAST_GAIN: f64 = 1e-6;
/// Neighbours are so many times ln(n): e (1 + 1 / d) for d = 3 dimensions, rounded up.
const NEIGHBOURS: f64 = 4.0;
/// Least neighbours that are looked at.
const LEAST_NEIGHBOURS: usize = 8;

/// The memory of a search; reused, it needs no new allocations.
#[derive(Debug, Default)]
pub(crate) struct RrtMemory {
    tree: Tree,
    sampler: RegionSampler,
    near: Nearby,
    /// Squared distance in the plane, and number.
    by_distance: Vec<(f64, u32)>,
    /// Cost through a neighbour, its number, and the drive from it.
    drives: Vec<(f64, u32, [Segment; 3])>,
}

/// What makes one search differ from another.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Drawing {
    /// Tightest curvature, 1/m.
    pub(crate) curvature_per_m: f64,
    pub(crate) seed: u64,
    /// Number of the random stream: searches of the same seed differ by it.
    pub(crate) stream: u64,
}

/// Plans to one target with `rrt-star`, or with `rrt-star-fcn` if a region guides it.
///
/// # Errors
/// Those of [`Guidance::check`].
pub(crate) fn rrt_star(
    (map, ground): (&CollisionMap, &Ground),
    drawing: Drawing,
    (goal, guidance): (impl Into<Target>, Guidance<'_>),
    limits: Limits<'_>,
    memory: &mut RrtMemory,
) -> Result<TargetResult, Error> {
    guidance.check(map.spec())?;
    let goal = match ground.goal(map, goal) {
        Ok(goal) => goal,
        Err(outcome) => return Ok(TargetResult::without_path(outcome, 0)),
    };
    let mut random = ChaCha8Rng::seed_from_u64(drawing.seed);
    random.set_stream(drawing.stream);
    memory.sampler.prepare(guidance);
    memory.tree.plant(Pose2::default());
    let search = Search {
        map,
        ground,
        goal,
        radius_m: 1.0 / drawing.curvature_per_m,
        random,
        memory,
    };
    let most = limits.max_expansions.unwrap_or(DEFAULT_ITERATIONS);
    let limits = Limits {
        max_expansions: Some(most.min(MAX_ITERATIONS)),
        ..limits
    };
    Ok(search.run(limits))
}

struct Search<'a> {
    map: &'a CollisionMap,
    ground: &'a Ground,
    goal: Goal,
    radius_m: f64,
    random: ChaCha8Rng,
    memory: &'a mut RrtMemory,
}

/// A point to grow towards, with a heading if one was drawn.
type Draw = ((f64, f64), Option<f64>);

impl Search<'_> {
    fn run(mut self, limits: Limits<'_>) -> TargetResult {
        let mut steps = 0;
        if self.goal.accepts_pose(&Pose2::default()) {
            return driven(&Pose2::default(), &[], 0);
        }
        let mut best = self.finish(ROOT, &Pose2::default(), f64::INFINITY);
        let mut improve_until = best.map_or(u64::MAX, |_| LEAST_IMPROVEMENT);
        let outcome = loop {
            steps += 1;
            let most_cost = best.map_or(f64::INFINITY, |node| self.memory.tree.cost(node));
            if let Some(node) = self.grow(most_cost) {
                let is_goal = self.goal.accepts_pose(&self.memory.tree.pose(node));
                if is_goal && self.memory.tree.cost(node) < most_cost {
                    if best.is_none() {
                        improve_until = steps + steps.max(LEAST_IMPROVEMENT);
                    }
                    best = Some(node);
                }
            }
            if steps >= improve_until {
                break Outcome::Solved;
            }
            if let Some(outcome) = limits.reached(steps, STOP_INTERVAL) {
                break outcome;
            }
        };
        match (best, outcome) {
            (Some(best), Outcome::Solved | Outcome::BudgetExhausted) => {
                driven(&Pose2::default(), &self.memory.tree.drive_to(best), steps)
            }
            _ => TargetResult::without_path(outcome, steps),
        }
    }

    /// Draws a pose and grows the tree towards it: the new node, or the goal if it was reached from there.
    fn grow(&mut self, most_cost: f64) -> Option<u32> {
        let (point, yaw_rad) = self.draw();
        let goal = self.goal.distance_left(point);
        if libm::hypot(point.0, point.1) + goal >= most_cost {
            return None;
        }
        let pose = self.steer(point, yaw_rad)?;
        if !self.ground.is_free(&pose) {
            return None;
        }
        self.gather((pose.x_m, pose.y_m));
        let node = self.attach(pose, most_cost)?;
        self.rewire(node, &pose);
        Some(self.finish(node, &pose, most_cost).unwrap_or(node))
    }

    /// Adds the goal below a new node, if the way in the open is free and better than the best one.
    fn finish(&mut self, node: u32, pose: &Pose2, most_cost: f64) -> Option<u32> {
        let RrtMemory { tree, near, .. } = &mut *self.memory;
        if self.goal.accepts_pose(pose) {
            return None;
        }
        let goal = self.goal.pose();
        let drive = dubins::cheapest(pose, &goal, self.radius_m)?;
        if tree.cost(node) + cost_of(&drive) >= most_cost {
            return None;
        }
        self.ground.drive_all(pose, &drive, near)?;
        Some(tree.add(goal, node, drive))
    }

    fn draw(&mut self) -> Draw {
        if unit(&mut self.random) < GOAL_SHARE {
            return self.draw_goal();
        }
        let spec = self.map.spec();
        let random = &mut self.random;
        let is_of_region = unit(random) < REGION_SHARE;
        let inside = is_of_region.then(|| self.memory.sampler.draw(spec, random));
        let point = inside.flatten().unwrap_or_else(|| {
            let (front_m, left_m) = spec.centre_of(spec.cell_of_index(0));
            let (rear_m, right_m) = spec.centre_of(spec.cell_of_index(spec.len() - 1));
            (
                rear_m + (front_m - rear_m) * unit(random),
                right_m + (left_m - right_m) * unit(random),
            )
        });
        let has_heading = unit(random) >= ARRIVAL_SHARE;
        (point, has_heading.then(|| TAU * unit(random) - PI))
    }

    /// The goal's own pose half of the time, else one within the tolerance.
    fn draw_goal(&mut self) -> Draw {
        let goal = self.goal.pose();
        let random = &mut self.random;
        let mut aside = |most: f64| most * (2.0 * unit(random) - 1.0);
        if aside(1.0) < 0.0 {
            return ((goal.x_m, goal.y_m), Some(goal.yaw_rad));
        }
        let tolerance = self.goal.tolerance();
        let most_m = tolerance.tolerance_m * std::f64::consts::FRAC_1_SQRT_2;
        let point = (goal.x_m + aside(most_m), goal.y_m + aside(most_m));
        (point, Some(goal.yaw_rad + aside(tolerance.tolerance_rad)))
    }

    /// The pose to which the nearest one of the tree goes on its way to a point.
    fn steer(&mut self, point: (f64, f64), yaw_rad: Option<f64>) -> Option<Pose2> {
        self.gather(point);
        let (tree, radius_m) = (&self.memory.tree, self.radius_m);
        let drives = self.memory.by_distance.iter().filter_map(|&(_, number)| {
            let from = tree.pose(number);
            let yaw_rad = match yaw_rad {
                Some(yaw_rad) => yaw_rad,
                None => dubins::arrival_yaw_rad(&from, point, radius_m)?,
            };
            let to = Pose2::new(point.0, point.1, yaw_rad);
            let drive = dubins::cheapest(&from, &to, radius_m)?;
            Some((cost_of(&drive), from, drive))
        });
        let (_, from, drive) = drives.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let mut pose = from;
        let mut left_m = LONGEST_M;
        for segment in drive {
            let length_m = segment.length_m.min(left_m);
            pose = segment.after(&pose, length_m);
            left_m -= length_m;
        }
        Some(pose)
    }

    /// Gathers the nodes nearest to a point in the plane.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a logarithm of a number of nodes is small and not negative"
    )]
    fn gather(&mut self, point: (f64, f64)) {
        let by_distance = &mut self.memory.by_distance;
        self.memory.tree.distances_to(point, by_distance);
        let count = by_distance.len();
        let most = (NEIGHBOURS * libm::log(count as f64)) as usize;
        let most = most.max(LEAST_NEIGHBOURS);
        if count > most {
            by_distance
                .select_nth_unstable_by(most, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            by_distance.truncate(most);
        }
    }

    /// Adds a pose below the gathered node from which it costs least, unless it is there already.
    fn attach(&mut self, pose: Pose2, most_cost: f64) -> Option<u32> {
        let RrtMemory {
            tree,
            by_distance,
            drives,
            near,
            ..
        } = &mut *self.memory;
        drives.clear();
        for &(_, number) in &*by_distance {
            if let Some(drive) = dubins::cheapest(&tree.pose(number), &pose, self.radius_m) {
                drives.push((tree.cost(number) + cost_of(&drive), number, drive));
            }
        }
        if drives
            .iter()
            .any(|(_, _, drive)| cost_of(drive) < LEAST_GAIN)
        {
            return None;
        }
        drives.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let left = self.goal.distance_left((pose.x_m, pose.y_m));
        for &(cost, number, drive) in &*drives {
            if cost + left >= most_cost {
                return None;
            }
            let parent = tree.pose(number);
            if self.ground.drive_all(&parent, &drive, near).is_some() {
                return Some(tree.add(pose, number, drive));
            }
        }
        None
    }

    /// Hangs gathered nodes below a new one where that costs less.
    fn rewire(&mut self, node: u32, pose: &Pose2) {
        let RrtMemory {
            tree,
            by_distance,
            near,
            ..
        } = &mut *self.memory;
        let cost = tree.cost(node);
        for &(squared, number) in &*by_distance {
            let known = tree.cost(number);
            if cost + libm::sqrt(squared) >= known {
                continue;
            }
            let Some(drive) = dubins::cheapest(pose, &tree.pose(number), self.radius_m) else {
                continue;
            };
            if cost + cost_of(&drive) + LEAST_GAIN < known
                && self.ground.drive_all(pose, &drive, near).is_some()
            {
                tree.hang(number, node, drive);
            }
        }
    }
}
