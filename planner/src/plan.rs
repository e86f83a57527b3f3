//! All targets of one frame on all cores: one search each (the paper's Algorithm 2), or all together.

use std::time::{Duration, Instant};

use rayon::iter::{IndexedParallelIterator, IntoParallelRefIterator, ParallelIterator};
use serde::{Deserialize, Serialize};
use swath_bridge::{Outcome, Pose2};

use crate::collision::CollisionMap;
use crate::ground::Ground;
use crate::guidance::Guidance;
use crate::hybrid::{HybridMemory, hybrid};
use crate::method::Method;
use crate::motion::Successors;
use crate::pool::Pool;
use crate::rrt_star::{Drawing, RrtMemory, rrt_star};
use crate::search::{
    Frame, FrameMemory, Limits, Regions, Rules, SearchMemory, TargetResult, WeightedMemory, search,
    search_weighted,
};
use crate::smooth::{Drivability, DrivablePath, SmoothConfig};
use crate::timing::CpuTimer;
use crate::tolerance::{GoalTolerance, Target};
use crate::{Error, Plane};

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
    /// Cells by which a predicted region is made narrower on each side before `tiev-fcn` uses it. What
    /// the network learns is as wide as a vehicle needs; the search only looks where its reference
    /// point goes. 0 is the paper's rule.
    pub region_shrink_cells: u32,
    /// Whether `swath` may ask a network for the regions of targets that it finds hard.
    pub asks_network: bool,
    /// Greatest cost of a path as a multiple of the optimum, for `weighted` and `swath`; 1 to 64.
    pub epsilon: f64,
    /// How near to a goal a path has to end.
    pub goal: GoalTolerance,
    /// Most time for one target's search, milliseconds elapsed; 0 for no limit. Not for `swath`.
    pub time_limit_ms: u64,
    /// Most expansions for one target's search, or iterations of `rrt-star`; 0 for no limit (and 4000 of
    /// these).
    pub max_expansions: u64,
    /// Most time for a frame, all that is done for it, milliseconds elapsed; 0 for no limit.
    pub frame_deadline_ms: u64,
    /// Which targets come first before that deadline.
    pub order: TargetOrder,
    /// Whether paths are made drivable.
    pub smooth: bool,
    /// How they are.
    pub smoothing: SmoothConfig,
    /// Seed of what is drawn at random, for `rrt-star`.
    pub seed: u64,
}

/// Greatest speed, m/s, and most time, milliseconds, that can be asked for.
const MOST_SPEED_M_PER_S: f64 = 100.0;
const MOST_TIME_MS: f64 = 3_600_000.0;

impl PlanConfig {
    /// Whether every setting is in its range.
    ///
    /// # Errors
    /// [`Error::PlanConfig`] names the first that is not; those of [`SmoothConfig::validate`].
    pub fn validate(&self) -> Result<(), Error> {
        for (field, value, least, most) in [
            ("speed_m_per_s", self.speed_m_per_s, 0.0, MOST_SPEED_M_PER_S),
            ("region_weight", self.region_weight, 1e-3, 1.0),
            ("epsilon", self.epsilon, 1.0, 64.0),
            (
                "time_limit_ms",
                self.time_limit_ms as f64,
                0.0,
                MOST_TIME_MS,
            ),
            (
                "frame_deadline_ms",
                self.frame_deadline_ms as f64,
                0.0,
                MOST_TIME_MS,
            ),
        ] {
            if !(value >= least && value <= most) {
                return Err(Error::PlanConfig {
                    field,
                    value,
                    least,
                    most,
                });
            }
        }
        self.goal.validate()?;
        self.smoothing.validate()
    }

    /// A pose to reach as nearly as the configuration says.
    const fn target(&self, pose: &Pose2) -> Target {
        Target {
            pose: *pose,
            tolerance: self.goal,
        }
    }

    /// Whether a network is of use to the method.
    pub const fn uses_network(&self) -> bool {
        self.method.needs_regions() || (self.asks_network && matches!(self.method, Method::Swath))
    }
}

impl Default for PlanConfig {
    fn default() -> Self {
        Self {
            method: Method::Swath,
            speed_m_per_s: 1.4,
            region_weight: 0.15,
            region_shrink_cells: 3,
            asks_network: false,
            epsilon: 1.2,
            goal: GoalTolerance::default(),
            time_limit_ms: 0,
            max_expansions: 0,
            frame_deadline_ms: 0,
            order: TargetOrder::Nearest,
            smooth: true,
            smoothing: SmoothConfig::default(),
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
    /// The path made drivable, as far as it could be; `None` unless solved and asked for in time.
    pub drivable: Option<DrivablePath>,
}

impl TargetPlan {
    /// The path as it is to be driven, or else as the search found it; empty unless solved.
    pub fn poses(&self) -> Vec<Pose2> {
        match &self.drivable {
            Some(path) => path.points.iter().map(|point| point.pose).collect(),
            None => self.result.path.clone(),
        }
    }

    /// The curvature at each of these, 1/m; empty where the path is chords.
    pub fn curvatures_per_m(&self) -> Vec<f64> {
        let curve = self.drivable.as_ref();
        let curve = curve.filter(|path| path.drivability != Drivability::TurnsOnTheSpot);
        curve.map_or_else(Vec::new, |path| {
            let curvatures = path.points.iter().map(|point| point.curvature_per_m);
            curvatures.collect()
        })
    }
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
    /// goal, is `tiev-fcn`. Paths are not made drivable.
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
        let deadline = deadline_in(config.frame_deadline_ms);
        self.plan_until(deadline, (map, goals), regions, config)
    }

    /// [`Self::plan`] under a deadline that began before, in place of the configuration's.
    pub(crate) fn plan_until(
        &self,
        deadline: Option<Instant>,
        (map, goals): (&CollisionMap, &[Pose2]),
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
        config.goal.validate()?;
        let target = |pose: &Pose2| config.target(pose);
        let successors = || map.model().successors(config.speed_m_per_s);
        let frame = (goals, deadline);
        match config.method {
            Method::Tiev | Method::TievFcn => {
                let successors = successors();
                each_target(frame, config, |index, goal, limits| {
                    let narrower =
                        regions.map(|regions| regions[index].shrunk(config.region_shrink_cells));
                    let guidance = narrower.as_ref().map_or(Guidance::NONE, |cells| {
                        Guidance::inside(cells, config.region_weight)
                    });
                    let goal = (target(goal), guidance);
                    self.memories
                        .with(|memory| search(map, &successors, goal, limits, memory))
                })
            }
            Method::Weighted => {
                let successors = successors();
                each_target(frame, config, |_, goal, limits| {
                    let goal = (target(goal), config.epsilon);
                    self.weighted
                        .with(|memory| search_weighted(map, &successors, goal, limits, memory))
                })
            }
            Method::Swath => self.plan_together((map, &successors()), frame, None, config),
            Method::Hybrid | Method::HybridFcn => self.plan_hybrid(map, frame, guidance, config),
            Method::RrtStar | Method::RrtStarFcn => {
                self.plan_rrt_star(map, frame, guidance, config)
            }
        }
    }

    /// Plans with `swath`, whatever the configuration's method is; regions are asked for meanwhile, and
    /// only if it does not get on without.
    pub(crate) fn plan_asking(
        &self,
        deadline: Option<Instant>,
        (map, goals): (&CollisionMap, &[Pose2]),
        ask: Regions<'_>,
        config: &PlanConfig,
    ) -> Result<Vec<TargetPlan>, Error> {
        let successors = map.model().successors(config.speed_m_per_s);
        self.plan_together((map, &successors), (goals, deadline), Some(ask), config)
    }

    /// Plans with `hybrid` or `hybrid-fcn`.
    fn plan_hybrid<'a>(
        &self,
        map: &CollisionMap,
        frame: (&[Pose2], Option<Instant>),
        guidance: impl Fn(usize) -> Guidance<'a> + Sync,
        config: &PlanConfig,
    ) -> Result<Vec<TargetPlan>, Error> {
        let ground = Ground::surveyed(map);
        let curvature_per_m = map
            .model()
            .vehicle()
            .curvature_limit_per_m(config.speed_m_per_s);
        each_target(frame, config, |index, goal, limits| {
            let goal = (config.target(goal), guidance(index));
            self.hybrid
                .with(|memory| hybrid((map, &ground), curvature_per_m, goal, limits, memory))
        })
    }

    /// Plans with `rrt-star` or `rrt-star-fcn`.
    fn plan_rrt_star<'a>(
        &self,
        map: &CollisionMap,
        frame: (&[Pose2], Option<Instant>),
        guidance: impl Fn(usize) -> Guidance<'a> + Sync,
        config: &PlanConfig,
    ) -> Result<Vec<TargetPlan>, Error> {
        let ground = Ground::new(map);
        let curvature_per_m = map
            .model()
            .vehicle()
            .curvature_limit_per_m(config.speed_m_per_s);
        each_target(frame, config, |index, goal, limits| {
            let goal = (config.target(goal), guidance(index));
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
        (goals, deadline): (&[Pose2], Option<Instant>),
        regions: Option<Regions<'_>>,
        config: &PlanConfig,
    ) -> Result<Vec<TargetPlan>, Error> {
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
            tolerance: config.goal,
            order: &order,
            regions,
        };
        let results = self.frames.with(|memory| memory.plan(&frame, &rules))?;
        let plans = goals.iter().zip(results);
        let plan_of = |(goal, (result, cpu)): (&Pose2, _)| TargetPlan {
            goal: *goal,
            result,
            cpu,
            drivable: None,
        };
        Ok(plans.map(plan_of).collect())
    }
}

/// Searches for each target by itself; those that a deadline leaves no time for are not searched for.
fn each_target(
    (goals, frame_deadline): (&[Pose2], Option<Instant>),
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
            let deadlines = [deadline_in(config.time_limit_ms), frame_deadline];
            let deadline = deadlines.into_iter().flatten().min();
            let stop = stop_at(deadline);
            let limits = limits_of(config, deadline.is_some().then_some(&stop as _));
            let result = match stop() {
                Some(outcome) => TargetResult::without_path(outcome, 0),
                None => search(index, goal, limits)?,
            };
            Ok(TargetPlan {
                goal: *goal,
                result,
                cpu: timer.elapsed(),
                drivable: None,
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
pub(crate) fn order_of(goals: &[Pose2], order: TargetOrder) -> Vec<usize> {
    let mut numbers: Vec<usize> = (0..goals.len()).collect();
    if order == TargetOrder::Nearest {
        let distance_m = |&number: &usize| goals[number].distance_m(&Pose2::default());
        numbers.sort_by(|a, b| distance_m(a).total_cmp(&distance_m(b)));
    }
    numbers
}

/// Asks for a stop from a deadline on.
fn stop_at(deadline: Option<Instant>) -> impl Fn() -> Option<Outcome> + Sync {
    move || {
        deadline
            .is_some_and(|deadline| Instant::now() >= deadline)
            .then_some(Outcome::BudgetExhausted)
    }
}

pub(crate) fn deadline_in(time_limit_ms: u64) -> Option<Instant> {
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
        assert_eq!(config.method, Method::Swath);
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
            method: Method::Tiev,
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
    fn regions_must_be_one_a_goal() {
        let spec = GridSpec::default();
        let regions = vec![Plane::empty(spec.rows, spec.cols); 2];
        let config = PlanConfig {
            method: Method::TievFcn,
            ..PlanConfig::default()
        };
        let plans = Planner::new().plan(&map(), &goals(), Some(&regions), &config);
        assert!(matches!(
            plans,
            Err(Error::RegionCount {
                regions: 2,
                goals: 6
            })
        ));
    }
}
