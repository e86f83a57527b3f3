//! `swath` asking a network while it searches: only for targets that it finds hard, and only in time.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use swath_bridge::Pose2;

use super::{Found, FramePlanner, Seen, predict};
use crate::network::{Network, Reach};
use crate::plan::PlanConfig;
use crate::{Error, Plane};

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

impl Consulted {
    /// The name in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Without => "without",
            Self::ForAll => "all",
            Self::NotNeeded => "not-needed",
            Self::NoTime => "no-time",
            Self::ForHard(_) => "hard",
        }
    }
}

/// What came of asking.
#[derive(Default)]
struct Asked {
    consulted: Option<Consulted>,
    regions: Vec<Plane>,
    reach: Vec<Option<Reach>>,
    elapsed: Duration,
    error: Option<Error>,
}

impl FramePlanner {
    /// Searches with `swath`, which asks the network for the targets that it finds hard, if the
    /// configuration allows it.
    pub(super) fn search_asking(
        &self,
        seen: &Seen<'_>,
        network: &Network,
        config: &PlanConfig,
    ) -> Result<Found, Error> {
        if !config.asks_network {
            return Ok(Found::without(self.search(seen, None, config)?));
        }
        let asked = Mutex::new(Asked::default());
        let ask = |left: &[usize]| {
            let mut asked = asked.lock().unwrap_or_else(PoisonError::into_inner);
            self.ask(seen, network, (config, left), &mut asked)
        };
        let goals = (seen.map, &*seen.view.goals);
        let targets = self
            .planner
            .plan_asking(seen.deadline, goals, &ask, config)?;
        let asked = asked.into_inner().unwrap_or_else(PoisonError::into_inner);
        if let Some(error) = asked.error {
            return Err(error);
        }
        Ok(Found {
            targets,
            regions: asked.regions,
            reach: asked.reach,
            consulted: asked.consulted.unwrap_or(Consulted::NotNeeded),
            network: asked.elapsed,
        })
    }

    /// The regions of the targets that are left, if there is time for them.
    fn ask(
        &self,
        seen: &Seen<'_>,
        network: &Network,
        (config, left): (&PlanConfig, &[usize]),
        asked: &mut Asked,
    ) -> Vec<Option<Plane>> {
        let begun = Instant::now();
        let longest = &self.longest_prediction;
        let mut longest = longest.lock().unwrap_or_else(PoisonError::into_inner);
        // As long again is left for the searches that are to gain from it.
        let is_late = |deadline: Instant| begun + 2 * *longest > deadline;
        if seen.deadline.is_some_and(is_late) {
            asked.consulted = Some(Consulted::NoTime);
            return Vec::new();
        }
        let goals: Vec<Pose2> = left.iter().map(|&number| seen.view.goals[number]).collect();
        match predict(seen, &goals, network, config.speed_m_per_s) {
            Ok(predictions) => {
                let spec = seen.map.spec();
                let all = seen.view.goals.len();
                asked.regions = vec![Plane::empty(spec.rows, spec.cols); all];
                asked.reach = vec![None; all];
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
