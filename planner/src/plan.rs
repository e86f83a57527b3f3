//! All targets of one frame, one search each, on all cores (the paper's Algorithm 2).

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use rayon::iter::{IndexedParallelIterator, IntoParallelRefIterator, ParallelIterator};
use serde::{Deserialize, Serialize};
use swath_bridge::{Outcome, Pose2};

use crate::collision::CollisionMap;
use crate::search::{Limits, SearchMemory, TargetResult, WeightedRegion, search};
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
}

impl Method {
    /// Every method.
    pub const ALL: [Self; 2] = [Self::Tiev, Self::TievFcn];

    /// The name used on the command line, in JSON and in tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tiev => "tiev",
            Self::TievFcn => "tiev-fcn",
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

/// How a frame is planned.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PlanConfig {
    /// The vehicle's speed, m/s; it limits the angle between actions.
    pub speed_m_per_s: f64,
    /// Factor on cost and heuristic inside a region, in (0, 1].
    pub region_weight: f64,
    /// Most time for one target's search, milliseconds elapsed; 0 for no limit.
    pub time_limit_ms: u64,
    /// Most expansions for one target's search; 0 for no limit.
    pub max_expansions: u64,
}

impl Default for PlanConfig {
    fn default() -> Self {
        Self {
            speed_m_per_s: 1.4,
            region_weight: 0.15,
            time_limit_ms: 0,
            max_expansions: 0,
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
    /// Processor time of the search.
    pub cpu: Duration,
}

/// Plans frame after frame, reusing its memory.
#[derive(Debug, Default)]
pub struct Planner {
    memories: Mutex<Vec<SearchMemory>>,
}

impl Planner {
    /// A planner whose memory grows with its first plans.
    pub fn new() -> Self {
        Self::default()
    }

    /// Plans to every goal, in parallel on rayon's pool; results are in the order of the goals and do
    /// not depend on the number of threads. With regions, one a goal, this is `tiev-fcn`, else `tiev`.
    ///
    /// # Errors
    /// [`Error::RegionCount`] unless there are as many regions as goals, and those of [`search`].
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
        goals
            .par_iter()
            .enumerate()
            // One target a job: their searches differ in length by orders of magnitude.
            .with_max_len(1)
            .map(|(index, goal)| {
                let region = regions.map(|regions| WeightedRegion {
                    cells: &regions[index],
                    weight: config.region_weight,
                });
                let timer = CpuTimer::of_thread();
                let deadline = deadline_in(config.time_limit_ms);
                let stop = || {
                    deadline
                        .is_some_and(|deadline| Instant::now() >= deadline)
                        .then_some(Outcome::BudgetExhausted)
                };
                let limits = Limits {
                    max_expansions: Some(config.max_expansions).filter(|&most| most > 0),
                    stop: deadline.is_some().then_some(&stop as _),
                };
                let mut memory = self.take_memory();
                let result = search(map, &successors, (goal, region), limits, &mut memory);
                self.give_back(memory);
                Ok(TargetPlan {
                    goal: *goal,
                    result: result?,
                    cpu: timer.elapsed(),
                })
            })
            .collect()
    }

    fn take_memory(&self) -> SearchMemory {
        // A poisoned lock is fine: a memory is prepared anew before each search.
        self.memories
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .pop()
            .unwrap_or_default()
    }

    fn give_back(&self, memory: SearchMemory) {
        let mut memories = self.memories.lock().unwrap_or_else(PoisonError::into_inner);
        if memories.len() < MAX_POOLED_MEMORIES {
            memories.push(memory);
        }
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
        let plan_on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            let plans = pool.install(|| {
                Planner::new()
                    .plan(&map(), &goals(), None, &PlanConfig::default())
                    .unwrap()
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

    #[test]
    fn memory_of_an_earlier_plan_leaves_no_trace() {
        let planner = Planner::new();
        let plan = || {
            let plans = planner
                .plan(&map(), &goals(), None, &PlanConfig::default())
                .unwrap();
            plans
                .into_iter()
                .map(|plan| plan.result)
                .collect::<Vec<_>>()
        };
        assert_eq!(plan(), plan());
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
