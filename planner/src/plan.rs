//! All targets of one frame on all cores: one search each (the paper's Algorithm 2), or all together.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use rayon::iter::{IndexedParallelIterator, IntoParallelRefIterator, ParallelIterator};
use serde::{Deserialize, Serialize};
use swath_bridge::{Outcome, Pose2};

use crate::collision::CollisionMap;
use crate::ground::Ground;
use crate::guidance::Guidance;
use crate::hybrid::{HybridMemory, hybrid};
use crate::motion::Successors;
use crate::rrt_star::{Drawing, RrtMemory, rrt_star};
use crate::search::{
    Frame, FrameMemory, Limits, Rules, SearchMemory, TargetResult, WeightedMemory, search,
    search_weighted,
};
use crate::timing::CpuTimer;
use crate::{Error, Plane};

/// Most search memories that are kept for later plans.
const MAX_POOLED_MEMORIES: usize = 64;

/// How to search.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// The paper's A*, optimal on its graph.
    Tiev,
    /// The same inside a predicted region (the paper's Algorithm 1).
    TievFcn,
    /// Weighted A*, within a factor of the optimum; no network.
    Weighted,
    /// All targets together, within the same factor; no network.
    Swath,
    /// Hybrid A* with arcs.
    Hybrid,
    /// The same inside a predicted region.
    HybridFcn,
    /// RRT* with Dubins drives.
    RrtStar,
    /// The same with poses drawn from a predicted region.
    RrtStarFcn,
}

impl Method {
    /// Every method.
    pub const ALL: [Self; 8] = [
        Self::Tiev,
        Self::TievFcn,
        Self::Weighted,
        Self::Swath,
        Self::Hybrid,
        Self::HybridFcn,
        Self::RrtStar,
        Self::RrtStarFcn,
    ];

    /// The methods that are compared unless others are named.
    pub const COMPARED: [Self; 4] = [Self::Tiev, Self::TievFcn, Self::Weighted, Self::Swath];

    /// The name used on the command line, in JSON and in tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tiev => "tiev",
            Self::TievFcn => "tiev-fcn",
            Self::Weighted => "weighted",
            Self::Swath => "swath",
            Self::Hybrid => "hybrid",
            Self::HybridFcn => "hybrid-fcn",
            Self::RrtStar => "rrt-star",
            Self::RrtStarFcn => "rrt-star-fcn",
        }
    }

    /// The method of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|method| method.name() == name)
    }

    /// Whether it needs regions.
    pub const fn needs_regions(self) -> bool {
        matches!(self, Self::TievFcn | Self::HybridFcn | Self::RrtStarFcn)
    }

    /// The same planner without a region; itself if it needs none.
    #[must_use]
    pub const fn without_regions(self) -> Self {
        match self {
            Self::TievFcn => Self::Tiev,
            Self::HybridFcn => Self::Hybrid,
            Self::RrtStarFcn => Self::RrtStar,
            other => other,
        }
    }
}

/// Which targets come first when time is short.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TargetOrder {
    /// The nearest to the vehicle.
    Nearest,
    /// The first ones given.
    Given,
}

/// How a frame is planned.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PlanConfig {
    /// How to search. With regions `tiev` is `tiev-fcn`, and so are `hybrid` and `rrt-star`; methods
    /// without a network leave regions aside.
    pub method: Method,
    /// The vehicle's speed, m/s; it limits the angle between actions.
    pub speed_m_per_s: f64,
    /// Factor on cost and heuristic inside a region, in (0, 1].
    pub region_weight: f64,
    /// Greatest cost of a path as a multiple of the optimum, for `weighted` and `swath`; 1 to 64.
    pub epsilon: f64,
    /// Most time for one target's search, milliseconds elapsed; 0 for no limit. Not for `swath`.
    pub time_limit_ms: u64,
    /// Most expansions for one target's search, or iterations of `rrt-star`; 0 for no limit (and 4000 of
    /// these).
    pub max_expansions: u64,
    /// Most time for all targets of a frame, milliseconds elapsed; 0 for no limit. For `swath`.
    pub frame_deadline_ms: u64,
    /// Which targets come first before that deadline.
    pub order: TargetOrder,
    /// Seed of what is drawn at random, for `rrt-star`.
    pub seed: u64,
}

impl Default for PlanConfig {
    fn default() -> Self {
        Self {
            method: Method::Tiev,
            speed_m_per_s: 1.4,
            region_weight: 0.15,
            epsilon: 1.2,
            time_limit_ms: 0,
            max_expansions: 0,
            frame_deadline_ms: 0,
            order: TargetOrder::Nearest,
            seed: 0,
        }
    }
}

/// One target's result and the processor time of its search.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetPlan {
    /// Where to.
    pub goal: Pose2,
    /// What became of it.
    pub result: TargetResult,
    /// Processor time of its own search; what targets share is not in it.
    pub cpu: Duration,
}

/// Plans frame after frame, reusing its memory.
#[derive(Debug, Default)]
pub struct Planner {
    memories: Pool<SearchMemory>,
    weighted: Pool<WeightedMemory>,
    frames: Pool<FrameMemory>,
    hybrid: Pool<HybridMemory>,
    rrt_star: Pool<RrtMemory>,
}

impl Planner {
    /// A planner whose memory grows with its first plans.
    pub fn new() -> Self {
        Self::default()
    }

    /// Plans to every goal by the method of the configuration, in parallel on rayon's pool; results are
    /// in the order of the goals and do not depend on the number of threads. `tiev` with regions, one a
    /// goal, is `tiev-fcn`.
    ///
    /// # Errors
    /// [`Error::RegionCount`] unless there are as many regions as goals, and those of [`search`],
    /// [`search_weighted`] and [`FrameMemory::plan`].
    pub fn plan(
        &self,
        map: &CollisionMap,
        goals: &[Pose2],
        regions: Option<&[Plane]>,
        config: &PlanConfig,
    ) -> Result<Vec<TargetPlan>, Error> {
        if let Some(regions) = regions.filter(|regions| regions.len() != goals.len()) {
            return Err(Error::RegionCount {
                regions: regions.len(),
                goals: goals.len(),
            });
        }
        let guidance = |index: usize| {
            regions.map_or(Guidance::NONE, |regions| {
                Guidance::inside(&regions[index], config.region_weight)
            })
        };
        let successors = || map.model().successors(config.speed_m_per_s);
        match config.method {
            Method::Tiev | Method::TievFcn => {
                let successors = successors();
                each_target(goals, config, |index, goal, limits| {
                    let goal = (goal, guidance(index));
                    self.memories
                        .with(|memory| search(map, &successors, goal, limits, memory))
                })
            }
            Method::Weighted => {
                let successors = successors();
                each_target(goals, config, |_, goal, limits| {
                    let goal = (goal, config.epsilon);
                    self.weighted
                        .with(|memory| search_weighted(map, &successors, goal, limits, memory))
                })
            }
            Method::Swath => self.plan_together((map, &successors()), goals, config),
            Method::Hybrid | Method::HybridFcn => self.plan_hybrid(map, goals, guidance, config),
            Method::RrtStar | Method::RrtStarFcn => {
                self.plan_rrt_star(map, goals, guidance, config)
            }
        }
    }

    /// Plans with `hybrid` or `hybrid-fcn`.
    fn plan_hybrid<'a>(
        &self,
        map: &CollisionMap,
        goals: &[Pose2],
        guidance: impl Fn(usize) -> Guidance<'a> + Sync,
        config: &PlanConfig,
    ) -> Result<Vec<TargetPlan>, Error> {
        let ground = Ground::surveyed(map);
        let curvature_per_m = map.model().curvature_limit_per_m(config.speed_m_per_s);
        each_target(goals, config, |index, goal, limits| {
            let goal = (goal, guidance(index));
            self.hybrid
                .with(|memory| hybrid((map, &ground), curvature_per_m, goal, limits, memory))
        })
    }

    /// Plans with `rrt-star` or `rrt-star-fcn`.
    fn plan_rrt_star<'a>(
        &self,
        map: &CollisionMap,
        goals: &[Pose2],
        guidance: impl Fn(usize) -> Guidance<'a> + Sync,
        config: &PlanConfig,
    ) -> Result<Vec<TargetPlan>, Error> {
        let ground = Ground::new(map);
        let curvature_per_m = map.model().curvature_limit_per_m(config.speed_m_per_s);
        each_target(goals, config, |index, goal, limits| {
            let goal = (goal, guidance(index));
            let drawing = Drawing {
                curvature_per_m,
                seed: config.seed,
                stream: index as u64,
            };
            self.rrt_star
                .with(|memory| rrt_star((map, &ground), drawing, goal, limits, memory))
        })
    }

    /// Plans with `swath`.
    fn plan_together(
        &self,
        (map, successors): (&CollisionMap, &Successors),
        goals: &[Pose2],
        config: &PlanConfig,
    ) -> Result<Vec<TargetPlan>, Error> {
        let deadline = deadline_in(config.frame_deadline_ms);
        let stop = stop_at(deadline);
        let rules = Rules {
            epsilon: config.epsilon,
            limits: limits_of(config, deadline.is_some().then_some(&stop as _)),
        };
        let order = order_of(goals, config.order);
        let frame = Frame {
            map,
            successors,
            goals,
            order: &order,
        };
        let results = self.frames.with(|memory| memory.plan(&frame, &rules))?;
        let plans = goals.iter().zip(results);
        let plan_of = |(goal, (result, cpu)): (&Pose2, _)| TargetPlan {
            goal: *goal,
            result,
            cpu,
        };
        Ok(plans.map(plan_of).collect())
    }
}

/// Searches for each target by itself.
fn each_target(
    goals: &[Pose2],
    config: &PlanConfig,
    search: impl Fn(usize, &Pose2, Limits<'_>) -> Result<TargetResult, Error> + Sync,
) -> Result<Vec<TargetPlan>, Error> {
    goals
        .par_iter()
        .enumerate()
        // One target a job: their searches differ in length by orders of magnitude.
        .with_max_len(1)
        .map(|(index, goal)| {
            let timer = CpuTimer::of_thread();
            let deadline = deadline_in(config.time_limit_ms);
            let stop = stop_at(deadline);
            let limits = limits_of(config, deadline.is_some().then_some(&stop as _));
            Ok(TargetPlan {
                goal: *goal,
                result: search(index, goal, limits)?,
                cpu: timer.elapsed(),
            })
        })
        .collect()
}

fn limits_of<'a>(
    config: &PlanConfig,
    stop: Option<&'a (dyn Fn() -> Option<Outcome> + Sync)>,
) -> Limits<'a> {
    Limits {
        max_expansions: Some(config.max_expansions).filter(|&most| most > 0),
        stop,
    }
}

/// Numbers of the targets, those first that are to come first.
fn order_of(goals: &[Pose2], order: TargetOrder) -> Vec<usize> {
    let mut numbers: Vec<usize> = (0..goals.len()).collect();
    if order == TargetOrder::Nearest {
        let distance_m = |&number: &usize| goals[number].distance_m(&Pose2::default());
        numbers.sort_by(|a, b| distance_m(a).total_cmp(&distance_m(b)));
    }
    numbers
}

/// Memories of searches that are not running.
#[derive(Debug)]
struct Pool<T>(Mutex<Vec<T>>);

impl<T> Default for Pool<T> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<T: Default> Pool<T> {
    /// Lends a memory to a search.
    fn with<R>(&self, search: impl FnOnce(&mut T) -> R) -> R {
        // A poisoned lock is fine: a memory is prepared anew before each search.
        let lock = || self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let mut memory = lock().pop().unwrap_or_default();
        let result = search(&mut memory);
        let mut memories = lock();
        if memories.len() < MAX_POOLED_MEMORIES {
            memories.push(memory);
        }
        result
    }
}

/// Asks for a stop from a deadline on.
fn stop_at(deadline: Option<Instant>) -> impl Fn() -> Option<Outcome> + Sync {
    move || {
        deadline
            .is_some_and(|deadline| Instant::now() >= deadline)
            .then_some(Outcome::BudgetExhausted)
    }
}

fn deadline_in(time_limit_ms: u64) -> Option<Instant> {
    if time_limit_ms == 0 {
        return None;
    }
    Instant::now().checked_add(Duration::from_millis(time_limit_ms))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use swath_bridge::{Cell, GridSpec, Vehicle};

    use super::*;
    use crate::MotionModel;

    fn map() -> CollisionMap {
        let spec = GridSpec::default();
        let mut obstacles = Plane::empty(spec.rows, spec.cols);
        for col in 60..95 {
            obstacles.set(Cell::new(240, col));
        }
        let model = Arc::new(MotionModel::new(&Vehicle::default(), 0.2).unwrap());
        CollisionMap::new(model, spec, &obstacles).unwrap()
    }

    const PLAIN: [Method; 5] = [
        Method::Tiev,
        Method::Weighted,
        Method::Swath,
        Method::Hybrid,
        Method::RrtStar,
    ];

    /// What a search decided, without numbers that are not equal to themselves.
    fn decided(result: TargetResult) -> (Outcome, u64, Vec<Pose2>) {
        (result.outcome, result.steps, result.path)
    }

    fn goals() -> Vec<Pose2> {
        (0..6)
            .map(|k| Pose2::new(20.0 + f64::from(k), f64::from(k) - 3.0, 0.0))
            .collect()
    }

    #[test]
    fn results_do_not_depend_on_the_number_of_threads() {
        for method in PLAIN {
            let config = PlanConfig {
                method,
                ..PlanConfig::default()
            };
            let plan_on = |threads| {
                let pool = rayon::ThreadPoolBuilder::new()
                    .num_threads(threads)
                    .build()
                    .unwrap();
                let plans = pool.install(|| {
                    let planner = Planner::new();
                    planner.plan(&map(), &goals(), None, &config).unwrap()
                });
                let results = plans.into_iter().map(|plan| plan.result);
                results.map(decided).collect::<Vec<_>>()
            };
            let alone = plan_on(1);
            assert!(
                alone
                    .iter()
                    .all(|(outcome, ..)| *outcome == Outcome::Solved)
            );
            assert!(alone == plan_on(3), "{method:?}");
        }
    }

    #[test]
    fn configurations_from_before_a_field_was_added_still_load() {
        let config: PlanConfig = serde_json::from_str(r#"{"speed_m_per_s": 3.0}"#).unwrap();
        assert_eq!(config.method, Method::Tiev);
        assert_eq!((config.epsilon, config.frame_deadline_ms), (1.2, 0));
    }

    #[test]
    fn memory_of_an_earlier_plan_leaves_no_trace() {
        for method in PLAIN {
            let planner = Planner::new();
            let config = PlanConfig {
                method,
                ..PlanConfig::default()
            };
            let plan = || {
                let plans = planner.plan(&map(), &goals(), None, &config).unwrap();
                let results = plans.into_iter().map(|plan| plan.result);
                results.map(decided).collect::<Vec<_>>()
            };
            assert!(plan() == plan(), "{method:?}");
        }
    }

    #[test]
    fn an_expansion_limit_is_kept_and_reported() {
        let config = PlanConfig {
            max_expansions: 40,
            ..PlanConfig::default()
        };
        for plan in Planner::new()
            .plan(&map(), &goals(), None, &config)
            .unwrap()
        {
            assert_eq!(plan.result.outcome, Outcome::BudgetExhausted);
            assert_eq!(plan.result.steps, 40);
        }
        for method in [Method::Hybrid, Method::RrtStar] {
            let config = PlanConfig {
                method,
                max_expansions: 3,
                ..PlanConfig::default()
            };
            for plan in Planner::new()
                .plan(&map(), &goals(), None, &config)
                .unwrap()
            {
                let is_decided = plan.result.outcome == Outcome::Solved;
                assert!(is_decided || plan.result.outcome == Outcome::BudgetExhausted);
                assert!(plan.result.steps <= 3);
            }
        }
    }

    #[test]
    fn methods_keep_their_names_and_their_twins() {
        for method in Method::ALL {
            assert_eq!(Method::from_name(method.name()), Some(method));
            assert!(!method.without_regions().needs_regions());
            let is_same = method.without_regions() == method;
            assert_eq!(is_same, !method.needs_regions());
        }
    }

    #[test]
    fn regions_must_be_one_a_goal() {
        let spec = GridSpec::default();
        let regions = vec![Plane::empty(spec.rows, spec.cols); 2];
        let plans = Planner::new().plan(&map(), &goals(), Some(&regions), &PlanConfig::default());
        assert!(matches!(
            plans,
            Err(Error::RegionCount {
                regions: 2,
                goals: 6
            })
        ));
    }
}
