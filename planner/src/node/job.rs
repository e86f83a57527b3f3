//! One frame's work, done on a thread of its own.

use std::sync::Arc;
use std::time::Instant;

use swath_bridge::{GridSpec, Pose2};

use super::ServedNetwork;
use super::follow::Departure;
use crate::choice::{ChoiceConfig, choose};
use crate::frame::{FrameInput, FramePlan, FramePlanner};
use crate::plan::PlanConfig;
use crate::{Error, Plane};

/// What a frame is planned with, apart from where it begins.
pub(super) struct Job {
    pub(super) planner: Arc<FramePlanner>,
    pub(super) network: Option<Arc<ServedNetwork>>,
    pub(super) spec: GridSpec,
    pub(super) obstacles: Plane,
    pub(super) reference: Vec<Pose2>,
    pub(super) goals: Vec<Pose2>,
    pub(super) plan: PlanConfig,
    pub(super) choice: ChoiceConfig,
}

impl Job {
    /// Plans from a departure and chooses a path; if there is none, and time is left, from the vehicle.
    pub(super) fn plan(
        &self,
        departure: Departure,
    ) -> (Departure, Result<(FramePlan, Option<usize>), Error>) {
        let started = Instant::now();
        let first = self.plan_from(&departure, &self.plan);
        if departure.kept.start.is_vehicle() || !matches!(first, Ok((_, None))) {
            return (departure, first);
        }
        let mut config = self.plan;
        if config.frame_deadline_ms > 0 {
            let spent_ms = u64::try_from(started.elapsed().as_millis()).unwrap_or(u64::MAX);
            config.frame_deadline_ms = config.frame_deadline_ms.saturating_sub(spent_ms + 1);
            if config.frame_deadline_ms == 0 {
                return (departure, first);
            }
        }
        let departure = departure.at_vehicle();
        let second = self.plan_from(&departure, &config);
        (departure, second)
    }

    fn plan_from(
        &self,
        departure: &Departure,
        config: &PlanConfig,
    ) -> Result<(FramePlan, Option<usize>), Error> {
        let input = FrameInput {
            spec: self.spec,
            obstacles: &self.obstacles,
            reference: &self.reference,
            goals: &self.goals,
            start: departure.kept.start,
        };
        let served = self.network.as_deref().map(|served| &served.network);
        let plan = self.planner.plan(&input, served, config)?;
        let last = departure.last_goal.as_ref();
        let chosen = choose(&plan.targets, &self.reference, last, &self.choice);
        Ok((plan, chosen))
    }
}
