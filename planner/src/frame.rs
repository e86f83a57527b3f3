//! One frame from obstacles to plans: regions from the network, then a search to each target.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use swath_bridge::{GridSpec, Occupancy, Pose2};

use crate::collision::CollisionMap;
use crate::network::{Network, Prediction, Reach, Surroundings};
use crate::plan::{Method, PlanConfig, Planner, TargetPlan};
use crate::timing::CpuTimer;
use crate::{Error, MotionModel, Plane};

/// Which cells of an occupancy grid are obstacles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ObstacleConfig {
    /// Least occupancy of an obstacle, percent.
    pub threshold_percent: i8,
    /// Whether cells that nothing is known of are obstacles.
    pub unknown_is_obstacle: bool,
}

impl Default for ObstacleConfig {
    fn default() -> Self {
        Self {
            threshold_percent: 50,
            unknown_is_obstacle: false,
        }
    }
}

impl ObstacleConfig {
    /// The obstacles of an occupancy grid.
    pub fn obstacles(&self, occupancy: &Occupancy) -> Plane {
        Plane::from_occupancy(occupancy, self.threshold_percent, self.unknown_is_obstacle)
    }
}

/// What a frame is planned on.
#[derive(Debug, Clone, Copy)]
pub struct FrameInput<'a> {
    /// Size and place of the grid.
    pub spec: GridSpec,
    /// Occupied cells.
    pub obstacles: &'a Plane,
    /// The rough path, vehicle frame; may be empty.
    pub reference: &'a [Pose2],
    /// Targets, vehicle frame.
    pub goals: &'a [Pose2],
}

/// Whether a network was asked for regions, and why.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Consulted {
    /// There is none, or the method does without.
    #[default]
    Without,
    /// For all targets, before any search.
    ForAll,
    /// All targets were decided by short searches.
    NotNeeded,
    /// What was left of the deadline did not allow for it.
    NoTime,
    /// For so many targets that short searches had left.
    ForHard(usize),
}

/// A planned frame.
#[derive(Debug, Clone, PartialEq)]
pub struct FramePlan {
    /// One for each goal, in their order.
    pub targets: Vec<TargetPlan>,
    /// The regions that were predicted, one for each goal; none without a network.
    pub regions: Vec<Plane>,
    /// How well each goal can be reached, as far as the network says.
    pub reach: Vec<Option<Reach>>,
    /// Whether the network was asked.
    pub consulted: Consulted,
    /// Elapsed time of the prediction.
    pub network: Duration,
    /// Elapsed time of the searches.
    pub search: Duration,
    /// Processor time of both.
    pub cpu: Duration,
    /// Elapsed time of both.
    pub total: Duration,
}

/// Plans frames of one vehicle.
#[derive(Debug)]
pub struct FramePlanner {
    model: Arc<MotionModel>,
    planner: Planner,
    /// Longest prediction so far: what one is expected to take.
    longest_prediction: Mutex<Duration>,
}

impl FramePlanner {
    /// A planner of a vehicle's motions.
    pub fn new(model: Arc<MotionModel>) -> Self {
        Self {
            model,
            planner: Planner::new(),
            longest_prediction: Mutex::default(),
        }
    }

    /// Plans to every goal: with `tiev-fcn` in the regions of a network, or with `tiev` without one.
    /// `swath` asks a network while it searches, if the configuration allows it.
    ///
    /// # Errors
    /// Those of [`CollisionMap::new`], [`Network::predict`] and [`Planner::plan`]: sizes that do not
    /// fit together.
    pub fn plan(
        &self,
        input: &FrameInput<'_>,
        network: Option<&Network>,
        config: &PlanConfig,
    ) -> Result<FramePlan, Error> {
        let cpu = CpuTimer::of_process();
        let started = Instant::now();
        if let Some(network) = network.filter(|_| config.method == Method::Swath) {
            return self.plan_asking(input, network, config, (cpu, started));
        }
        let predictions = network
            .map(|network| predict(input, network, config.speed_m_per_s))
            .transpose()?;
        let network_time = started.elapsed();
        let (regions, reach) = predictions.map_or_else(Default::default, |predictions| {
            let parts = predictions.into_iter();
            let parts = parts.map(|prediction| (prediction.region, prediction.reach));
            parts.unzip::<_, _, Vec<_>, Vec<_>>()
        });
        let map = CollisionMap::new(Arc::clone(&self.model), input.spec, input.obstacles)?;
        let targets = self.planner.plan(
            &map,
            input.goals,
            network.map(|_| regions.as_slice()),
            config,
        )?;
        let total = started.elapsed();
        Ok(FramePlan {
            targets,
            regions,
            reach,
            consulted: network.map_or(Consulted::Without, |_| Consulted::ForAll),
            network: if network.is_some() {
                network_time
            } else {
                Duration::ZERO
            },
            search: total.saturating_sub(network_time),
            cpu: cpu.elapsed(),
            total,
        })
    }
}

/// What came of asking a network while a frame was searched.
#[derive(Default)]
struct Asked {
    consulted: Option<Consulted>,
    regions: Vec<Plane>,
    reach: Vec<Option<Reach>>,
    elapsed: Duration,
    error: Option<Error>,
}

impl FramePlanner {
    /// Plans with `swath`, which asks the network for the targets that it finds hard.
    fn plan_asking(
        &self,
        input: &FrameInput<'_>,
        network: &Network,
        config: &PlanConfig,
        (cpu, started): (CpuTimer, Instant),
    ) -> Result<FramePlan, Error> {
        let map = CollisionMap::new(Arc::clone(&self.model), input.spec, input.obstacles)?;
        let asked = Mutex::new(Asked::default());
        let ask = |left: &[usize]| {
            let mut asked = asked.lock().unwrap_or_else(PoisonError::into_inner);
            self.ask(input, network, (config, left, started), &mut asked)
        };
        let targets = if config.asks_network {
            self.planner.plan_asking(&map, input.goals, &ask, config)?
        } else {
            self.planner.plan(&map, input.goals, None, config)?
        };
        let asked = asked.into_inner().unwrap_or_else(PoisonError::into_inner);
        if let Some(error) = asked.error {
            return Err(error);
        }
        let otherwise = if config.asks_network {
            Consulted::NotNeeded
        } else {
            Consulted::Without
        };
        let total = started.elapsed();
        Ok(FramePlan {
            targets,
            regions: asked.regions,
            reach: asked.reach,
            consulted: asked.consulted.unwrap_or(otherwise),
            network: asked.elapsed,
            search: total.saturating_sub(asked.elapsed),
            cpu: cpu.elapsed(),
            total,
        })
    }

    /// The regions of the targets that are left, if there is time for them.
    fn ask(
        &self,
        input: &FrameInput<'_>,
        network: &Network,
        (config, left, started): (&PlanConfig, &[usize], Instant),
        asked: &mut Asked,
    ) -> Vec<Option<Plane>> {
        let begun = Instant::now();
        let mut longest = self
            .longest_prediction
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        let deadline = Duration::from_millis(config.frame_deadline_ms);
        // As long again is left for the searches that are to gain from it.
        if !deadline.is_zero() && started.elapsed() + 2 * *longest > deadline {
            asked.consulted = Some(Consulted::NoTime);
            return Vec::new();
        }
        let goals: Vec<Pose2> = left.iter().map(|&number| input.goals[number]).collect();
        let of_left = FrameInput {
            goals: &goals,
            ..*input
        };
        match predict(&of_left, network, config.speed_m_per_s) {
            Ok(predictions) => {
                asked.regions =
                    vec![Plane::empty(input.spec.rows, input.spec.cols); input.goals.len()];
                asked.reach = vec![None; input.goals.len()];
                for (&number, prediction) in left.iter().zip(&predictions) {
                    asked.regions[number].clone_from(&prediction.region);
                    asked.reach[number] = prediction.reach;
                }
                asked.consulted = Some(Consulted::ForHard(left.len()));
                asked.elapsed = begun.elapsed();
                *longest = asked.elapsed.max(*longest);
                let regions = predictions.into_iter();
                regions.map(|prediction| Some(prediction.region)).collect()
            }
            Err(error) => {
                asked.error = Some(error);
                Vec::new()
            }
        }
    }
}

/// The region to each goal (the paper's Algorithm 2, lines 2 to 9).
fn predict(
    input: &FrameInput<'_>,
    network: &Network,
    speed_m_per_s: f64,
) -> Result<Vec<Prediction>, Error> {
    let info = network.info();
    if info.spec != input.spec {
        return Err(Error::GridMismatch {
            got: input.spec,
            wanted: info.spec,
        });
    }
    let mut reference = Plane::empty(input.spec.rows, input.spec.cols);
    reference.draw_line(&input.spec, input.reference, info.reference_dilation_m);
    let surroundings = Surroundings {
        obstacles: input.obstacles,
        reference: &reference,
        speed_m_per_s,
    };
    network.predict(&surroundings, input.goals)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::{Architecture, NetworkInfo, Parameters};
    use swath_bridge::{Cell, Outcome, Vehicle};

    /// A wall with a goal behind it that short searches leave: beside the gap, across its direction.
    fn plan(goals: &[Pose2], config: &PlanConfig) -> FramePlan {
        let spec = GridSpec::default();
        let mut obstacles = Plane::empty(spec.rows, spec.cols);
        for row in 200..330 {
            for col in [60, 90] {
                obstacles.set(Cell::new(row, col));
            }
        }
        let parameters = Parameters::initial(Architecture::default(), 3);
        let network = Network::new(NetworkInfo::default(), &parameters);
        let model = MotionModel::new(&Vehicle::default(), spec.resolution_m).unwrap();
        let input = FrameInput {
            spec,
            obstacles: &obstacles,
            reference: &[],
            goals,
        };
        FramePlanner::new(Arc::new(model))
            .plan(&input, Some(&network), config)
            .unwrap()
    }

    #[test]
    fn a_network_is_asked_for_hard_targets_alone_and_only_if_it_may_be() {
        let config = PlanConfig {
            method: Method::Swath,
            asks_network: true,
            ..PlanConfig::default()
        };
        let easy = Pose2::new(12.0, 0.0, 0.0);
        // Outside the walls and against the direction in which one comes out of them.
        let hard = Pose2::new(6.0, 8.0, 3.1);
        let found = plan(&[easy], &config);
        assert_eq!(found.consulted, Consulted::NotNeeded);
        assert!(found.regions.is_empty() && found.network.is_zero());
        let found = plan(&[easy, hard], &config);
        assert_eq!(found.consulted, Consulted::ForHard(1));
        assert_eq!((found.regions.len(), found.regions[0].count()), (2, 0));
        assert!(found.reach[0].is_none() && !found.network.is_zero());
        let without = PlanConfig {
            asks_network: false,
            ..config
        };
        let other = plan(&[easy, hard], &without);
        assert_eq!(other.consulted, Consulted::Without);
        for (found, other) in found.targets.iter().zip(&other.targets) {
            assert_eq!(found.result.outcome, Outcome::Solved);
            assert_eq!(other.result.outcome, Outcome::Solved);
            assert!(found.result.cost <= 1.2 * other.result.cost);
        }
    }
}
