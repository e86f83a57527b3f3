//! How the pipeline did: what was made, lost, applied and late.

mod plans;
mod samples;
mod training;

use crate::Error;
use crate::tables::Tables;

pub(crate) use plans::{LATE_MS, OutcomeCount, PlannerHealth, RejectionCount, StopCount};
pub(crate) use samples::{GeneratorHealth, SampleHealth};
pub(crate) use training::{TrainerHealth, WeightsHealth};

/// How the pipeline did.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Health {
    /// Samples of all generators.
    pub(crate) samples: SampleHealth,
    /// One entry a training run that told its status.
    pub(crate) trainers: Vec<TrainerHealth>,
    /// One entry a training run whose weights were published or applied.
    pub(crate) weights: Vec<WeightsHealth>,
    /// One entry a vehicle.
    pub(crate) planners: Vec<PlannerHealth>,
    /// Reasons of empty paths.
    pub(crate) stops: Vec<StopCount>,
    /// Messages that planners could not use.
    pub(crate) rejections: Vec<RejectionCount>,
    /// Targets by method and outcome.
    pub(crate) outcomes: Vec<OutcomeCount>,
    /// Paths by method and how far they can be driven.
    pub(crate) drivabilities: Vec<OutcomeCount>,
}

impl Health {
    /// # Errors
    /// [`Error::Table`] if polars fails.
    pub(crate) fn of(tables: &Tables) -> Result<Self, Error> {
        Ok(Self {
            samples: SampleHealth::of(&tables.samples)?,
            trainers: training::trainers(&tables.status)?,
            weights: training::weights(tables)?,
            planners: plans::planners(tables)?,
            stops: plans::stops(tables)?,
            rejections: plans::rejections(tables)?,
            outcomes: plans::outcomes(tables)?,
            drivabilities: plans::drivabilities(tables)?,
        })
    }
}
