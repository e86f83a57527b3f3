//! The planner with a network's region, on single samples.

use std::sync::Arc;

use swath_bridge::{GridSpec, Vehicle};
use swath_planner::network::Network;
use swath_planner::search::TargetResult;
use swath_planner::{CollisionMap, Method, MotionModel, PlanConfig, Plane, Planner};

use crate::{Error, Example};

/// Plans with `tiev-fcn`.
#[derive(Debug)]
pub(crate) struct Guided {
    pub(crate) model: Arc<MotionModel>,
    planner: Planner,
    max_expansions: u64,
}

impl Guided {
    /// A planner for a vehicle on grids like `spec`, with so many expansions a search.
    pub(crate) fn new(
        vehicle: &Vehicle,
        spec: &GridSpec,
        max_expansions: u64,
    ) -> Result<Self, Error> {
        Ok(Self {
            model: Arc::new(MotionModel::new(vehicle, spec.resolution_m)?),
            planner: Planner::new(),
            max_expansions,
        })
    }

    /// The region that a network predicts for a sample, and what the search with it comes to.
    pub(crate) fn plan(
        &self,
        network: &Network,
        example: &Example,
    ) -> Result<Option<(Plane, TargetResult)>, Error> {
        let goals = [example.goal];
        let predictions = network.predict(&example.surroundings(), &goals)?;
        let regions = predictions.into_iter().map(|prediction| prediction.region);
        let regions: Vec<_> = regions.collect();
        let map = CollisionMap::new(Arc::clone(&self.model), example.spec, &example.obstacles)?;
        let config = PlanConfig {
            method: Method::TievFcn,
            speed_m_per_s: example.speed_m_per_s,
            max_expansions: self.max_expansions,
            ..PlanConfig::default()
        };
        let plans = self.planner.plan(&map, &goals, Some(&regions), &config)?;
        let results = plans.into_iter().map(|plan| plan.result);
        Ok(regions.into_iter().zip(results).next())
    }
}
