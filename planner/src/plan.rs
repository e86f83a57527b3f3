//! All targets of one frame on all cores: one search each (the paper's Algorithm 2), or all together.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use rayon::iter::{IndexedParallelIterator, IntoParallelRefIterator, ParallelIterator};
use serde::{Deserialize, Serialize};
use swath_bridge::{Outcome, Pose2};

use crate::collision::CollisionMap;
use crate::motion::Successors;
use crate::search::{
    Frame, FrameMemory, Limits, Regions, Rules, SearchMemory, TargetResult, WeightedMemory,
    WeightedRegion, search, search_weighted,
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
}

impl Method {
    /// Every method.
    pub const ALL: [Self; 4] = [Self::Tiev, Self::TievFcn, Self::Weighted, Self::Swath];

    /// The name used on the command line, in JSON and in tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tiev => "tiev",
            Self::TievFcn => "tiev-fcn",
            Self::Weighted => "weighted",
            Self::Swath => "swath",
        }
    }

    /// The method of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|method| method.name() == name)
    }

    /// Whether it needs regions.
    pub const fn needs_regions(self) -> bool {
        matches!(self, Self::TievFcn)
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
    /// How to search. With regions `tiev` is `tiev-fcn`; methods without a network leave regions aside.
    pub method: Method,
    /// The vehicle's speed, m/s; it limits the angle between actions.
    pub speed_m_per_s: f64,
    /// Factor on cost and heuristic inside a region, in (0, 1].
    pub region_weight: f64,
    /// Cells by which a predicted region is made narrower on each side before `tiev-fcn` uses it. What
    /// the network learns is as wide as a vehicle needs; the search only looks where its reference
    /// point goes. 0 is the paper's rule.
    pub region_shrink_cells: u32,
    /// Whether `swath` may ask a network for the regions of targets that it finds hard.
    pub asks_network: bool,
    /// Greatest cost of a path as a multiple of the optimum, for `weighted` and `swath`; 1 to 64.
    pub epsilon: f64,
    /// Most time for one target's search, milliseconds elapsed; 0 for no limit. Not for `swath`.
    pub time_limit_ms: u64,
    /// Most expansions for one target's search; 0 for no limit.
    pub max_expansions: u64,
    /// Most time for all targets of a frame, milliseconds elapsed; 0 for no limit. For `swath`.
    pub frame_deadline_ms: u64,
    /// Which targets come first before that deadline.
    pub order: TargetOrder,
}

impl PlanConfig {
    /// Whether a network is of use to the method.
    pub const fn uses_network(&self) -> bool {
        self.method.needs_regions() || (self.asks_network && matches!(self.method, Method::Swath))
    }
}

impl Default for PlanConfig {
    fn default() -> Self {
        Self {
            method: Method::Tiev,
            speed_m_per_s: 1.4,
            region_weight: 0.15,
            region_shrink_cells: 3,
            asks_network: false,
            epsilon: 1.2,
            time_limit_ms: 0,
            max_expansions: 0,
            frame_deadline_ms: 0,
            order: TargetOrder::Nearest,
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
        let successors = map.model().successors(config.speed_m_per_s);
        let inputs = (map, &successors);
        match config.method {
            Method::Tiev | Method::TievFcn => each_target(goals, config, |index, goal, limits| {
                let cells =
                    regions.map(|regions| regions[index].shrunk(config.region_shrink_cells));
                let region = cells.as_ref().map(|cells| WeightedRegion {
                    cells,
                    weight: config.region_weight,
                });
                self.memories
                    .with(|memory| search(map, &successors, (goal, region), limits, memory))
            }),
            Method::Weighted => each_target(goals, config, |_, goal, limits| {
                self.weighted.with(|memory| {
                    search_weighted(map, &successors, (goal, config.epsilon), limits, memory)
                })
            }),
            Method::Swath => self.plan_together(inputs, goals, None, config),
        }
    }

    /// As [`Self::plan`], but regions are asked for while `swath` plans, and only if it does not get on
    /// without; other methods do without.
    ///
    /// # Errors
    /// As [`Self::plan`].
    pub fn plan_asking(
        &self,
        map: &CollisionMap,
        goals: &[Pose2],
        ask: Regions<'_>,
        config: &PlanConfig,
    ) -> Result<Vec<TargetPlan>, Error> {
        if config.method != Method::Swath {
            return self.plan(map, goals, None, config);
        }
        let successors = map.model().successors(config.speed_m_per_s);
        self.plan_together((map, &successors), goals, Some(ask), config)
    }

    /// Plans with `swath`.
    fn plan_together(
        &self,
        (map, successors): (&CollisionMap, &Successors),
        goals: &[Pose2],
        regions: Option<Regions<'_>>,
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
            regions,
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

    fn goals() -> Vec<Pose2> {
        (0..6)
            .map(|k| Pose2::new(20.0 + f64::from(k), f64::from(k) - 3.0, 0.0))
            .collect()
    }

    #[test]
    fn results_do_not_depend_on_the_number_of_threads() {
        for method in [Method::Tiev, Method::Weighted, Method::Swath] {
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
                plans
                    .into_iter()
                    .map(|plan| plan.result)
                    .collect::<Vec<_>>()
            };
            let alone = plan_on(1);
            assert!(alone.iter().all(|result| result.outcome == Outcome::Solved));
            assert_eq!(alone, plan_on(3));
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
        for method in [Method::Tiev, Method::Weighted, Method::Swath] {
            let planner = Planner::new();
            let config = PlanConfig {
                method,
                ..PlanConfig::default()
            };
            let plan = || {
                let plans = planner.plan(&map(), &goals(), None, &config).unwrap();
                plans
                    .into_iter()
                    .map(|plan| plan.result)
                    .collect::<Vec<_>>()
            };
            assert_eq!(plan(), plan());
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
