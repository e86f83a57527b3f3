//! Where the vehicle stands on a map, and in which frame goals and results are.

use std::path::{Path, PathBuf};

use anyhow::{bail, ensure};
use swath_bridge::map::{Map, Top};
use swath_bridge::{GridSpec, Occupancy, Outcome, Pose2};
use swath_planner::network::Network;
use swath_planner::{FramePlan, Start, grid_around};

use crate::config::Config;

/// A map with the vehicle on it. Without a start that was asked for, all frames are the vehicle's.
#[derive(Debug)]
pub(super) struct Place {
    path: PathBuf,
    pub(super) occupancy: Occupancy,
    /// In the frame of the cells.
    pub(super) start: Start,
    /// The frame of the cells in the map's.
    map_from_grid: Pose2,
    pub(super) top: Top,
    /// Whether the cells are the map's own and the vehicle stands anywhere on them.
    pub(super) is_around: bool,
}

impl Place {
    /// Reads a map; the vehicle stands at a start in the map's frame, or at that frame's origin.
    pub(super) fn read(
        path: &Path,
        start: Option<&Pose2>,
        config: &Config,
    ) -> anyhow::Result<Self> {
        let map = Map::read(path, &config.grid)?;
        if start.is_none() && map.is_unturned() {
            return Ok(Self {
                path: path.to_owned(),
                occupancy: map.at_origin()?,
                start: Start::default(),
                map_from_grid: Pose2::default(),
                top: Top::X,
                is_around: false,
            });
        }
        let around = map.around(start.unwrap_or(&Pose2::default()))?;
        Ok(Self {
            path: path.to_owned(),
            occupancy: around.occupancy,
            start: Start {
                pose: around.pose,
                curvature_per_m: None,
            },
            map_from_grid: around.map_from_grid,
            top: around.top,
            is_around: true,
        })
    }

    /// Poses of the map's frame in that of the cells.
    pub(super) fn in_grid(&self, poses: &[Pose2]) -> Vec<Pose2> {
        if !self.is_around {
            return poses.to_vec();
        }
        let grid_from_map = self.map_from_grid.inverse();
        poses.iter().map(|pose| grid_from_map.then(pose)).collect()
    }

    /// A pose of the cells' frame in the map's.
    pub(super) fn in_map(&self, pose: &Pose2) -> Pose2 {
        if self.is_around {
            self.map_from_grid.then(pose)
        } else {
            *pose
        }
    }

    /// The grid to search on, in the frame of the start: that of the network, or one that holds the map.
    pub(super) fn grid_around(
        &self,
        goals: &[Pose2],
        network: Option<&Network>,
    ) -> anyhow::Result<GridSpec> {
        let spec = self.occupancy.spec;
        if !self.is_around {
            return Ok(spec);
        }
        if let Some(network) = network {
            let wanted = network.info().spec;
            ensure!(
                (wanted.resolution_m - spec.resolution_m).abs() < 1e-9,
                "{}: cells of {} m, but the network is for cells of {} m; another method, or --weights \
                 of a network for such cells, is needed",
                self.path.display(),
                spec.resolution_m,
                wanted.resolution_m
            );
            tracing::info!(
                "plans on the network's {} x {} cells around the start; goals beyond them are out of \
                 bounds",
                wanted.rows,
                wanted.cols
            );
            return Ok(wanted);
        }
        let Some(around) = grid_around(&spec, &self.start.pose, goals) else {
            bail!(
                "{}: turned by the start's heading, start and goals are more than 4096 cells apart; \
                 nearer goals, or a start that heads along the map, are needed",
                self.path.display()
            );
        };
        if around.len() < spec.len() {
            tracing::warn!(
                "the map is larger than 4096 cells along the start's heading: planned on {} x {} cells \
                 of it around start and goals",
                around.rows,
                around.cols
            );
        }
        Ok(around)
    }

    /// Why no target of a plan was solved.
    pub(super) fn why_unsolved(&self, plan: &FramePlan) -> String {
        let start = self.in_map(&self.start.pose);
        let count = plan.targets.len();
        let with = |outcome: Outcome| {
            let targets = plan.targets.iter();
            targets
                .filter(|target| target.result.outcome == outcome)
                .count()
        };
        if with(Outcome::StartOccupied) == count {
            return format!(
                "{}: the vehicle stands in an obstacle at ({:.2}, {:.2}), heading {:.2} rad",
                self.path.display(),
                start.x_m,
                start.y_m,
                start.yaw_rad
            );
        }
        let counts: Vec<String> = Outcome::ALL
            .into_iter()
            .filter(|outcome| with(*outcome) > 0)
            .map(|outcome| format!("{} {}", with(outcome), outcome.name()))
            .collect();
        format!(
            "{}: of {count} targets {}",
            self.path.display(),
            counts.join(", ")
        )
    }
}
