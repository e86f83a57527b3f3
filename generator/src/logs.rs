//! Scenes from drive logs: the grids and reference paths of their frames.

use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use swath_bridge::{Frame, Pose2};

use crate::Error;
use crate::config::Span;
use crate::course::Course;
use crate::dice::{Dice, Purpose};
use crate::scene::Scene;

/// Most frames that are kept of all logs together.
const MAX_FRAMES: usize = 4000;
/// Shortest reference that targets can be placed along, metres.
const SHORTEST_REFERENCE_M: f64 = 12.0;
/// Distance driven between two frames of a log that are kept, metres.
const SPACING_M: f64 = 2.0;
/// Least value of an occupied cell.
const OCCUPIED_FROM: i8 = 50;

/// Frames of logs as scenes.
#[derive(Debug, Default)]
pub struct LogScenes {
    scenes: Vec<Scene>,
}

impl LogScenes {
    /// No frames yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Number of frames that are kept.
    pub const fn len(&self) -> usize {
        self.scenes.len()
    }

    /// Whether there are no frames.
    pub const fn is_empty(&self) -> bool {
        self.scenes.is_empty()
    }

    /// Adds the frames of one log under its name: those that lie apart and have a reference that is
    /// long enough. Gives how many were kept.
    ///
    /// # Errors
    /// The first error of the frames.
    pub fn add<E: Into<Error>>(
        &mut self,
        name: &str,
        frames: impl IntoIterator<Item = Result<Frame, E>>,
    ) -> Result<usize, Error> {
        let before = self.scenes.len();
        let mut last: Option<Pose2> = None;
        for frame in frames {
            let frame = frame.map_err(Into::into)?;
            if self.scenes.len() >= MAX_FRAMES {
                break;
            }
            let pose = frame.odom_from_vehicle;
            let is_apart = last.is_none_or(|last| {
                let turned = swath_bridge::geometry::wrap_angle_rad(pose.yaw_rad - last.yaw_rad);
                pose.distance_m(&last) >= SPACING_M || turned.abs() > 0.25 * FRAC_PI_2
            });
            if !is_apart {
                continue;
            }
            if let Some(scene) = scene_of(name, &frame) {
                self.scenes.push(scene);
                last = Some(pose);
            }
        }
        Ok(self.scenes.len() - before)
    }

    /// Checks that there are frames.
    pub(crate) const fn check(&self) -> Result<(), Error> {
        if self.scenes.is_empty() {
            return Err(Error::NoFrames {
                shortest_m: SHORTEST_REFERENCE_M,
            });
        }
        Ok(())
    }

    /// The scene of an index: frames as the seed draws them.
    pub(crate) fn scene(&self, seed: u64, index: u64) -> Scene {
        let pick = Dice::new(seed, Purpose::Scene, index, 1).below(self.scenes.len());
        self.scenes.get(pick).cloned().unwrap_or_else(empty)
    }
}

/// Open ground, for when there are no frames at all.
fn empty() -> Scene {
    Scene {
        name: "empty".to_owned(),
        is_recorded: true,
        known: Arc::from([]),
        solids: Vec::new(),
        movers: Vec::new(),
        reference: Course::through(&[[0.0, 0.0], [60.0, 0.0]]),
        lanes_m: vec![0.0],
        band_m: Span(-7.0, 7.0),
        ego_from_reference: Pose2::default(),
        speed_m_per_s: 0.0,
    }
}

/// A log's frame as a scene, if its reference is long enough.
fn scene_of(name: &str, frame: &Frame) -> Option<Scene> {
    let spec = &frame.occupancy.spec;
    let reference: Vec<Pose2> = frame
        .reference
        .iter()
        .filter(|pose| pose.is_finite())
        .copied()
        .collect();
    let course = Course::through_poses(&reference);
    let (begin_m, end_m) = course.span_m();
    if end_m - begin_m < SHORTEST_REFERENCE_M {
        return None;
    }
    let known: Vec<[f64; 2]> = (0..frame.occupancy.cells.len())
        .filter(|&index| frame.occupancy.cells[index] >= OCCUPIED_FROM)
        .map(|index| spec.centre_of(spec.cell_of_index(index)))
        .map(|(x_m, y_m)| [x_m, y_m])
        .collect();
    Some(Scene {
        name: name.to_owned(),
        known: known.into(),
        ego_from_reference: course.at(0.0).inverse(),
        reference: course,
        lanes_m: vec![0.0, 3.2, -3.2],
        // A pace at which the search can turn: the log's own path need not be followed here.
        speed_m_per_s: 1.4,
        ..empty()
    })
}

#[cfg(test)]
mod tests {
    use swath_bridge::{Cell, GridSpec, OCCUPIED, Occupancy, cdr};
    use swath_planner::Plane;
    use swath_planner::search::SearchMemory;

    use super::*;
    use crate::{Generator, GeneratorConfig, Scenes};

    /// A frame on a straight road between two walls, a distance along.
    fn frame(along_m: f64) -> Frame {
        let spec = GridSpec::default();
        let mut occupancy = Occupancy::filled(spec, swath_bridge::FREE);
        for row in 0..401 {
            for col in [40, 110] {
                occupancy.set(Cell::new(row, col), OCCUPIED);
            }
        }
        Frame {
            stamp_nanos: 0,
            occupancy,
            odom_from_vehicle: Pose2::new(along_m, 0.0, 0.0),
            speed_m_per_s: 3.0,
            turn_rad_per_s: 0.0,
            reference: (0..60)
                .map(|x| Pose2::new(f64::from(x), 0.0, 0.0))
                .collect(),
        }
    }

    fn frames(count: u32, step_m: f64) -> Vec<Result<Frame, Error>> {
        (0..count)
            .map(|index| Ok(frame(f64::from(index) * step_m)))
            .collect()
    }

    #[test]
    fn frames_that_lie_apart_and_have_a_way_ahead_become_scenes() {
        let mut logs = LogScenes::new();
        assert_eq!(logs.add("a", frames(10, 0.5)).unwrap(), 3);
        assert_eq!(logs.add("b", frames(10, 5.0)).unwrap(), 10);
        let short = Frame {
            reference: vec![Pose2::default(); 3],
            ..frame(0.0)
        };
        assert_eq!(logs.add("c", [Ok::<_, Error>(short)]).unwrap(), 0);
        assert_eq!(logs.len(), 13);
    }

    #[test]
    fn logs_without_frames_are_refused() {
        let scenes = Scenes::Logs(Arc::new(LogScenes::new()));
        let error = Generator::new(GeneratorConfig::default(), scenes).unwrap_err();
        assert!(matches!(error, Error::NoFrames { .. }), "{error}");
    }

    #[test]
    fn samples_of_a_log_keep_its_walls_and_show_added_vehicles_from_one_side() {
        let mut logs = LogScenes::new();
        logs.add("campus", frames(10, 5.0)).unwrap();
        let generator =
            Generator::new(GeneratorConfig::default(), Scenes::Logs(Arc::new(logs))).unwrap();
        let mut memory = SearchMemory::new();
        let mut added = 0;
        for index in 0..40 {
            let sample = generator.sample(1, index, &mut memory).unwrap();
            assert_eq!(sample.scene, "campus");
            let plane = Plane::from_packed(401, 151, sample.obstacles.clone()).unwrap();
            for row in 0..401 {
                assert!(plane.get(Cell::new(row, 40)) && plane.get(Cell::new(row, 110)));
            }
            added += plane.count() - 802;
            let again = generator.sample(1, index, &mut memory).unwrap();
            assert_eq!(cdr::to_vec(&sample).unwrap(), cdr::to_vec(&again).unwrap());
        }
        assert!(added > 200, "{added} cells of added vehicles");
    }
}
