//! A simulated drive: what a vehicle would be given to plan on as it follows the reference paths of
//! one scene after another.

use std::sync::Arc;

use swath_bridge::{Frame, Pose2, Vehicle};

use crate::Generator;
use crate::dice::{Dice, Purpose};
use crate::scene::{Scene, footprint};

/// Time between two frames, nanoseconds.
pub const PERIOD_NANOS: u64 = 100_000_000;
const PERIOD_S: f64 = 0.1;
/// Longest way through one scene, metres: farther on, scenes are empty.
const LONGEST_M: f64 = 35.0;
/// The vehicle leaves a scene when something stands this close ahead of it, metres.
const ROOM_AHEAD_M: f64 = 3.0;
/// Longest time in one scene, frames.
const MAX_FRAMES: u32 = 600;

/// Frames at 10 Hz without end. The same seed gives the same frames.
///
/// The vehicle keeps to the reference. It goes on to another scene when it has come to the end of one
/// or something stands in its way: from one frame to the next all that it sees changes then, while
/// its odometry goes on. Scenes of logs hold still, so there is one frame of each.
#[derive(Debug)]
pub struct Drive {
    generator: Arc<Generator>,
    seed: u64,
    scene_index: u64,
    scene: Scene,
    /// Frames of this scene that were given.
    frame_in_scene: u32,
    frame: u64,
    odom_from_scene: Pose2,
}

impl Drive {
    /// A drive through the scenes of a seed.
    pub fn new(generator: Arc<Generator>, seed: u64) -> Self {
        Self {
            scene: generator.scene(seed, 0),
            generator,
            seed,
            scene_index: 0,
            frame_in_scene: 0,
            frame: 0,
            odom_from_scene: Pose2::default(),
        }
    }

    fn time_s(&self) -> f64 {
        f64::from(self.frame_in_scene) * PERIOD_S
    }

    /// Whether the vehicle can go on in this scene.
    fn goes_on(&self, later: &Scene) -> bool {
        let driven_m = later.speed_m_per_s * self.time_s();
        let is_still = self.scene.speed_m_per_s <= 0.0 || !self.scene.known.is_empty();
        !is_still
            && self.frame_in_scene < MAX_FRAMES
            && driven_m <= LONGEST_M
            && has_room(later, &self.generator.config().vehicle)
    }
}

/// Whether nothing stands close ahead.
fn has_room(scene: &Scene, vehicle: &Vehicle) -> bool {
    let ahead_s = ROOM_AHEAD_M / scene.speed_m_per_s.max(0.1);
    scene.is_free(&footprint(vehicle, &Pose2::default()))
        && scene.is_free(&footprint(vehicle, &scene.ego_at(ahead_s)))
}

impl Iterator for Drive {
    /// The name of the scene and the frame.
    type Item = (String, Frame);

    fn next(&mut self) -> Option<Self::Item> {
        let mut later = self.scene.later(self.time_s());
        if self.frame_in_scene > 0 && !self.goes_on(&later) {
            self.odom_from_scene = self.odom_from_scene.then(&self.scene.ego_at(self.time_s()));
            self.scene_index += 1;
            self.frame_in_scene = 0;
            self.scene = self.generator.scene(self.seed, self.scene_index);
            later = self.scene.later(0.0);
        }
        let lot = u64::from(self.frame_in_scene);
        let mut dice = Dice::new(self.seed, Purpose::Drive, self.scene_index, lot);
        let frame = Frame {
            stamp_nanos: self.frame * PERIOD_NANOS,
            odom_from_vehicle: self.odom_from_scene.then(&self.scene.ego_at(self.time_s())),
            ..self.generator.frame_of(&later, &mut dice)
        };
        self.frame_in_scene += 1;
        self.frame += 1;
        Some((self.scene.name.clone(), frame))
    }
}
