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
            scene: scene_of(&generator, seed, 0),
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
        !self.scene.is_recorded
            && self.frame_in_scene < MAX_FRAMES
            && driven_m <= LONGEST_M
            && has_room(later, &self.generator.config().vehicle)
    }
}

/// A scene in which the vehicle is not boxed in.
fn scene_of(generator: &Generator, seed: u64, index: u64) -> Scene {
    generator.scene(seed, index).on_a_drive(generator.config())
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
            self.scene = scene_of(&self.generator, self.seed, self.scene_index);
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

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use swath_bridge::{FREE, OCCUPIED};

    use super::*;
    use crate::{GeneratorConfig, LogScenes, Scenes};

    fn drive(seed: u64) -> Drive {
        let generator = Generator::new(GeneratorConfig::default(), Scenes::Procedural);
        Drive::new(Arc::new(generator.unwrap()), seed)
    }

    #[test]
    fn odometry_goes_on_from_scene_to_scene_at_the_speed_of_each() {
        let frames: Vec<_> = drive(2).take(240).collect();
        let names: BTreeSet<&str> = frames.iter().map(|(name, _)| name.as_str()).collect();
        assert!(names.len() > 1, "{names:?}");
        for pair in frames.windows(2) {
            let (before, after) = (&pair[0].1, &pair[1].1);
            assert_eq!(after.stamp_nanos - before.stamp_nanos, PERIOD_NANOS);
            let driven_m = before
                .odom_from_vehicle
                .distance_m(&after.odom_from_vehicle);
            let expected_m = before.speed_m_per_s * PERIOD_S;
            assert!(
                (driven_m - expected_m).abs() < 0.1,
                "{driven_m} m, not {expected_m}"
            );
        }
    }

    #[test]
    fn the_vehicle_stands_free_on_every_frame_and_knows_its_way() {
        for (name, frame) in drive(3).take(120) {
            let spec = frame.occupancy.spec;
            assert_eq!(frame.occupancy.get(spec.ego()), Some(FREE), "{name}");
            assert!(frame.occupancy.cells.contains(&OCCUPIED), "{name}");
            let first = &frame.reference[0];
            assert!(
                first.distance_m(&Pose2::default()) < 1.5,
                "{name}: {first:?}"
            );
            assert!(frame.reference.len() > 20, "{name}");
        }
    }

    #[test]
    fn the_same_seed_drives_the_same_way() {
        assert!(drive(4).take(30).eq(drive(4).take(30)));
        assert!(!drive(4).take(30).eq(drive(5).take(30)));
    }

    #[test]
    fn a_drive_through_the_scenes_of_a_log_goes_from_frame_to_frame() {
        let mut logs = LogScenes::new();
        let (_, frame) = drive(6).next().unwrap();
        let kept = logs.add("log", [Ok::<_, crate::Error>(frame)]).unwrap();
        assert_eq!(kept, 1);
        let scenes = Scenes::Logs(Arc::new(logs));
        let generator = Generator::new(GeneratorConfig::default(), scenes).unwrap();
        let names: Vec<String> = Drive::new(Arc::new(generator), 1)
            .take(3)
            .map(|(name, _)| name)
            .collect();
        assert_eq!(names, ["log"; 3]);
    }
}
