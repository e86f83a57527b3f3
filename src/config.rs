//! One configuration file for all nodes, so that they agree on vehicle and grid.

pub(crate) mod keys;
mod place;
pub(crate) mod show;

use std::path::Path;

use anyhow::Context;
use serde::{Deserialize, Serialize};
use swath_bridge::ingest::IngestConfig;
use swath_bridge::{GridSpec, Vehicle};
use swath_generator::GeneratorConfig;
use swath_planner::node::{FollowConfig, FramesConfig};
use swath_planner::{ObstacleConfig, PlanConfig, TargetConfig};
use swath_trainer::TrainConfig;

/// Most bytes that a configuration file may have.
const MAX_FILE_BYTES: u64 = 1024 * 1024;

/// The configuration. Sections and keys that are left out have their defaults.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Config {
    /// Dimensions of the vehicle.
    pub(crate) vehicle: Vehicle,
    /// Size of the grid.
    pub(crate) grid: GridSpec,
    /// Which cells are obstacles.
    pub(crate) obstacles: ObstacleConfig,
    /// Where targets are placed.
    pub(crate) targets: TargetConfig,
    /// How frames are planned.
    pub(crate) plan: PlanConfig,
    /// How a planner node chooses and keeps up a path.
    pub(crate) follow: FollowConfig,
    /// How a planner node tells coordinate frames apart.
    pub(crate) frames: FramesConfig,
    /// How networks are trained; what the command line says comes first.
    pub(crate) train: TrainConfig,
    /// How logs become grids; vehicle and grid are those above.
    ingest: IngestConfig,
    /// How samples are made; vehicle and grid are those above.
    generator: GeneratorConfig,
}

impl Config {
    /// Reads a TOML file; without one, everything has its default.
    pub(crate) fn load(path: Option<&Path>) -> anyhow::Result<Self> {
        let Some(path) = path else {
            return Ok(Self::default());
        };
        let context = || path.display().to_string();
        let bytes = std::fs::metadata(path).with_context(context)?.len();
        anyhow::ensure!(
            bytes <= MAX_FILE_BYTES,
            "{}: {bytes} bytes, too long",
            context()
        );
        let text = std::fs::read_to_string(path).with_context(context)?;
        let config: Self = toml::from_str(&text).with_context(context)?;
        config.validate(&text).with_context(context)?;
        keys::check(&config).with_context(context)?;
        Ok(config)
    }

    /// Checks every section of what was read from a text.
    fn validate(&self, text: &str) -> anyhow::Result<()> {
        let sections: [(&str, anyhow::Result<()>); 10] = [
            ("vehicle", self.vehicle.validate().map_err(Into::into)),
            ("grid", self.grid.validate().map_err(Into::into)),
            ("obstacles", self.obstacles.validate().map_err(Into::into)),
            ("targets", self.targets.validate().map_err(Into::into)),
            ("plan", self.plan.validate().map_err(Into::into)),
            ("follow", self.follow.validate().map_err(Into::into)),
            ("frames", self.frames.validate().map_err(Into::into)),
            ("train", self.train.validate().map_err(Into::into)),
            ("ingest", self.ingest().validate().map_err(Into::into)),
            ("generator", self.generator().validate().map_err(Into::into)),
        ];
        for (section, checked) in sections {
            checked.map_err(|error| {
                let place = match place::line_of(text, section, &format!("{error:#}")) {
                    Some(line) => format!("line {line}, [{section}]"),
                    None => format!("[{section}]"),
                };
                error.context(place)
            })?;
        }
        self.refuse_second_sizes(text)
    }

    /// Vehicle and grid are set in one place, so that nodes agree. A second one that differs would not
    /// count.
    fn refuse_second_sizes(&self, text: &str) -> anyhow::Result<()> {
        let (grid, vehicle) = (&self.grid, &self.vehicle);
        for (section, key, is_same, instead) in [
            ("ingest", "spec", self.ingest.spec == *grid, "grid"),
            (
                "ingest",
                "vehicle",
                self.ingest.vehicle == *vehicle,
                "vehicle",
            ),
            ("generator", "grid", self.generator.grid == *grid, "grid"),
            (
                "generator",
                "vehicle",
                self.generator.vehicle == *vehicle,
                "vehicle",
            ),
        ] {
            if let Some(line) = place::line_of_key(text, section, key).filter(|_| !is_same) {
                anyhow::bail!(
                    "line {line}, [{section}]: {key} differs from [{instead}], which holds for all nodes: \
                     set it there"
                );
            }
        }
        Ok(())
    }

    /// How logs become grids.
    pub(crate) fn ingest(&self) -> IngestConfig {
        IngestConfig {
            spec: self.grid,
            vehicle: self.vehicle,
            ..self.ingest.clone()
        }
    }

    /// How samples are made.
    pub(crate) fn generator(&self) -> GeneratorConfig {
        GeneratorConfig {
            grid: self.grid,
            vehicle: self.vehicle,
            ..self.generator.clone()
        }
    }
}
