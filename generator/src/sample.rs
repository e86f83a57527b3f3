//! One labelled sample from a seed and an index.
//!
//! Five samples that follow one another share a scene and a target, each with its own added vehicles,
//! its own sweeps and its own shift of the reference. The label is the optimal path of `tiev` on the
//! obstacles as they were seen; it knows nothing of the reference.

use std::sync::Arc;

use swath_bridge::msg::header::Header;
use swath_bridge::msg::swath::{PlanarPose, Sample};
use swath_bridge::{Cell, Frame, Outcome, Pose2};
use swath_planner::search::{Bound, Limits, SearchMemory, TargetResult, search_bounded};
use swath_planner::{CollisionMap, MotionModel, Plane, Successors};

use crate::config::GeneratorConfig;
use crate::dice::{Dice, Purpose};
use crate::lidar::{Lidar, World};
use crate::logs::LogScenes;
use crate::scene::{Moment, Scene, footprint};
use crate::{Error, augment, targets};

/// Samples that share a target.
pub const SAMPLES_PER_TARGET: u64 = 5;
/// Stamp of the sample at index 0, nanoseconds: the first second of 2026.
const EPOCH_NANOS: u64 = 1_767_225_600_000_000_000;
/// Time between the stamps of two samples, nanoseconds.
const PERIOD_NANOS: u64 = 10_000_000;
/// Frame of everything in a sample.
pub(crate) const FRAME_ID: &str = "base_link";
/// Least value of an occupied cell.
const OCCUPIED_FROM: i8 = 50;
/// Time over which the turn of a scene's vehicle is taken, seconds.
const TURN_TIME_S: f64 = 0.02;

/// Where scenes come from.
#[derive(Debug, Clone, Default)]
pub enum Scenes {
    /// Drawn from the configured distributions.
    #[default]
    Procedural,
    /// Frames of logs.
    Logs(Arc<LogScenes>),
}

/// Makes samples; shared by threads.
#[derive(Debug)]
pub struct Generator {
    config: GeneratorConfig,
    scenes: Scenes,
    lidar: Lidar,
    model: Arc<MotionModel>,
    /// Most samples are made at walking pace.
    slow: Successors,
}

impl Generator {
    /// A generator of a configuration.
    ///
    /// # Errors
    /// [`Error::Config`] and others of [`GeneratorConfig::validate`]; [`Error::NoFrames`] if the
    /// scenes are to come from logs that have none.
    pub fn new(config: GeneratorConfig, scenes: Scenes) -> Result<Self, Error> {
        config.validate()?;
        if let Scenes::Logs(logs) = &scenes {
            logs.check()?;
        }
        let model = MotionModel::new(&config.vehicle, config.grid.resolution_m)?;
        Ok(Self {
            lidar: Lidar::new(&config.lidar, &config.grid, &config.vehicle),
            slow: model.successors(config.ego.slow_m_per_s),
            model: Arc::new(model),
            config,
            scenes,
        })
    }

    /// The configuration.
    pub const fn config(&self) -> &GeneratorConfig {
        &self.config
    }

    /// The scene of an index, without added vehicles.
    pub fn scene(&self, seed: u64, scene_index: u64) -> Scene {
        match &self.scenes {
            Scenes::Procedural => Scene::procedural(seed, scene_index, &self.config),
            Scenes::Logs(logs) => logs.scene(seed, scene_index),
        }
    }

    /// The name of a scene and what the vehicle in it would be given to plan on.
    ///
    /// The reference begins at the vehicle and is not shifted. A vehicle of a procedural scene is never
    /// boxed in: a frame is a moment of a drive. The stamp is made from the index.
    pub fn frame(&self, seed: u64, scene_index: u64) -> (String, Frame) {
        let scene = self.scene(seed, scene_index).on_a_drive(&self.config);
        let mut dice = Dice::new(seed, Purpose::Lidar, scene_index, u64::MAX);
        let frame = self.frame_of(&scene, &mut dice);
        let stamped = Frame {
            stamp_nanos: stamp_nanos(scene_index),
            ..frame
        };
        (scene.name, stamped)
    }

    /// What the vehicle in a scene would be given to plan on, with stamp and odometry at 0.
    pub(crate) fn frame_of(&self, scene: &Scene, dice: &mut Dice) -> Frame {
        let trail = scene.trail(self.config.lidar.history_s, self.config.lidar.period_s);
        let mut occupancy = self.lidar.look_around(&world_of(scene, &trail), dice);
        for cell in self.known_cells(scene) {
            occupancy.set(cell, swath_bridge::OCCUPIED);
        }
        Frame {
            stamp_nanos: 0,
            occupancy,
            odom_from_vehicle: Pose2::default(),
            speed_m_per_s: scene.speed_m_per_s,
            turn_rad_per_s: scene.ego_at(TURN_TIME_S).yaw_rad / TURN_TIME_S,
            reference: augment::reference_poses(scene, true),
        }
    }

    /// The sample of an index: the same bytes on every machine.
    ///
    /// # Errors
    /// Those of the planner, which a valid configuration does not give.
    pub fn sample(
        &self,
        seed: u64,
        index: u64,
        memory: &mut SearchMemory,
    ) -> Result<Sample, Error> {
        let target_index = index / SAMPLES_PER_TARGET;
        let scene_index = target_index / self.config.targets.per_scene;
        let mut scene = self.scene(seed, scene_index);
        let mut dice = Dice::new(seed, Purpose::Target, target_index, 0);
        let goal = targets::choose(&scene, &self.config, &mut dice);
        let mut dice = Dice::new(seed, Purpose::Augment, index, 0);
        augment::add_vehicles(&mut scene, &goal, &self.config, &mut dice);
        let reference = augment::shifted_reference(&scene, &self.config, &mut dice);
        let obstacles = self.obstacles(&scene, &mut Dice::new(seed, Purpose::Lidar, index, 0));
        let label = self.label(&scene, &obstacles, &goal, memory)?;

        let (grid, sizes) = (&self.config.grid, &self.config.label);
        let draw = |poses: &[Pose2], radius_m: f64| {
            let mut plane = Plane::empty(grid.rows, grid.cols);
            plane.draw_line(grid, poses, radius_m);
            plane.into_packed()
        };
        Ok(Sample {
            header: Header::at(stamp_nanos(index), FRAME_ID),
            generator: format!("seed-{seed}"),
            sequence: index,
            seed,
            index,
            scene: scene.name.clone(),
            scene_id: scene_index,
            speed_m_per_s: single(scene.speed_m_per_s),
            goal: planar(&goal),
            outcome: label.outcome.code(),
            rows: grid.rows,
            cols: grid.cols,
            resolution_m: single(grid.resolution_m),
            ego_row: grid.ego_row,
            ego_col: grid.ego_col,
            reference: draw(&reference, sizes.reference_radius_m),
            target: draw(&[goal], sizes.target_radius_m),
            label: draw(&label.path, sizes.path_radius_m),
            obstacles: obstacles.into_packed(),
            path: label.path.iter().map(planar).collect(),
            cost: single(label.cost),
            steps: label.steps,
        })
    }

    /// The obstacles of a scene as the lidar has seen them.
    fn obstacles(&self, scene: &Scene, dice: &mut Dice) -> Plane {
        let trail = scene.trail(self.config.lidar.history_s, self.config.lidar.period_s);
        let occupancy = self.lidar.look(&world_of(scene, &trail), dice);
        let mut plane = Plane::from_occupancy(&occupancy, OCCUPIED_FROM, false);
        for cell in self.known_cells(scene) {
            plane.set(cell);
        }
        plane
    }

    /// The cells that a log's map has occupied, but for those that the vehicle stands on: the log's
    /// own vehicle may have been smaller, or its map late.
    fn known_cells<'a>(&'a self, scene: &'a Scene) -> impl Iterator<Item = Cell> + 'a {
        let grid = &self.config.grid;
        let own = footprint(&self.config.vehicle, &Pose2::default()).grown(1.5 * grid.resolution_m);
        let known = scene.known.iter().filter(move |&&point| !own.holds(point));
        known.map(|&[x_m, y_m]| grid.cell_at(x_m, y_m))
    }

    /// The optimal path to a goal among obstacles.
    fn label(
        &self,
        scene: &Scene,
        obstacles: &Plane,
        goal: &Pose2,
        memory: &mut SearchMemory,
    ) -> Result<TargetResult, Error> {
        let map = CollisionMap::new(Arc::clone(&self.model), self.config.grid, obstacles)?;
        let limits = Limits {
            max_expansions: Some(self.config.label.max_expansions),
            stop: None,
        };
        let speed_m_per_s = scene.speed_m_per_s;
        let fast;
        let successors = if (speed_m_per_s - self.config.ego.slow_m_per_s).abs() < 1e-9 {
            &self.slow
        } else {
            fast = self.model.successors(speed_m_per_s);
            &fast
        };
        // The same cost as that of `search`, sooner; among paths of equal cost it may be another one.
        let target = (goal, Bound::Informed);
        let result = search_bounded(&map, successors, target, limits, memory)?;
        let is_solved = result.outcome == Outcome::Solved;
        Ok(if is_solved {
            result
        } else {
            TargetResult::without_path(result.outcome, result.steps)
        })
    }
}

/// What a lidar in a scene looks at.
fn world_of<'a>(scene: &'a Scene, trail: &'a [Moment]) -> World<'a> {
    World {
        solids: &scene.solids,
        movers: &scene.movers,
        blockers: &scene.known,
        trail,
    }
}

/// The sample of a seed and an index. Making many, keep a [`Generator`].
///
/// # Errors
/// Those of [`Generator::new`] and [`Generator::sample`].
pub fn generate_sample(seed: u64, index: u64, config: &GeneratorConfig) -> Result<Sample, Error> {
    let generator = Generator::new(config.clone(), Scenes::Procedural)?;
    generator.sample(seed, index, &mut SearchMemory::new())
}

/// The stamp of an index, nanoseconds since the Unix epoch.
pub(crate) const fn stamp_nanos(index: u64) -> u64 {
    EPOCH_NANOS.saturating_add(index.saturating_mul(PERIOD_NANOS))
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "messages hold single precision"
)]
pub(crate) const fn single(value: f64) -> f32 {
    value as f32
}

const fn planar(pose: &Pose2) -> PlanarPose {
    PlanarPose {
        x_m: single(pose.x_m),
        y_m: single(pose.y_m),
        yaw_rad: single(pose.yaw_rad),
    }
}

#[cfg(test)]
mod tests;
