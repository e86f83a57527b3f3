//! A sample as training keeps it: planes that have been checked, and what evaluation groups by.

use swath_bridge::msg::swath::Sample;
use swath_bridge::{GridSpec, Outcome, Pose2};
use swath_planner::Plane;
use swath_planner::network::Surroundings;
use swath_planner::report::pose_of_planar;

use crate::Error;

/// Most characters of a scene's name.
const MAX_SCENE_CHARS: usize = 64;
/// Highest cost of a path, metres and radians.
const MAX_COST: f32 = 1e6;
/// Highest speed, m/s.
const MAX_SPEED_M_PER_S: f64 = 100.0;
/// Most poses of a path.
const MAX_PATH_POSES: usize = 10_000;

/// One solved or unsolved target with what the network sees of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Example {
    /// Size and place of the planes.
    pub spec: GridSpec,
    /// Obstacles as seen.
    pub obstacles: Plane,
    /// Dilated reference.
    pub reference: Plane,
    /// Disc around the goal.
    pub target: Plane,
    /// Dilated path; empty unless solved.
    pub label: Plane,
    /// Where the path is to end, in the vehicle frame.
    pub goal: Pose2,
    /// Speed of the vehicle, m/s.
    pub speed_m_per_s: f64,
    /// What became of the search.
    pub outcome: Outcome,
    /// Cost of the path, metres and radians; NaN without one.
    pub cost: f32,
    /// Steps of the search.
    pub steps: f32,
    /// The path itself.
    pub path: Vec<Pose2>,
    /// Kind of scene.
    pub scene: String,
    /// Samples with the same id share a scene.
    pub scene_id: u64,
}

impl Example {
    /// Checks a sample and takes it over.
    ///
    /// # Errors
    /// [`Error::Sample`] says what is wrong with it.
    pub fn from_sample(sample: Sample) -> Result<Self, Error> {
        let (generator, sequence) = (sample.generator.clone(), sample.sequence);
        Self::checked(sample).map_err(|what| Error::Sample {
            generator: generator.chars().take(MAX_SCENE_CHARS).collect(),
            sequence,
            what,
        })
    }

    fn checked(sample: Sample) -> Result<Self, String> {
        let spec = GridSpec {
            rows: sample.rows,
            cols: sample.cols,
            // The message holds single precision; the cell sides in use are short decimals.
            resolution_m: (f64::from(sample.resolution_m) * 1e6).round() / 1e6,
            ego_row: sample.ego_row,
            ego_col: sample.ego_col,
        };
        spec.validate().map_err(|error| error.to_string())?;
        let outcome = Outcome::from_code(sample.outcome)
            .ok_or_else(|| format!("outcome {}, expected 0 to 6", sample.outcome))?;
        let plane = |name: &str, bits: Vec<u8>| {
            Plane::from_packed(spec.rows, spec.cols, bits)
                .map_err(|error| format!("{name}: {error}"))
        };
        let goal = pose_of_planar(&sample.goal);
        if sample.path.len() > MAX_PATH_POSES {
            let count = sample.path.len();
            return Err(format!("{count} poses, expected at most {MAX_PATH_POSES}"));
        }
        let path: Vec<Pose2> = sample.path.iter().map(pose_of_planar).collect();
        if !goal.is_finite() || !path.iter().all(Pose2::is_finite) {
            return Err("goal or path is not finite".to_owned());
        }
        let speed_m_per_s = f64::from(sample.speed_m_per_s);
        if !(0.0..=MAX_SPEED_M_PER_S).contains(&speed_m_per_s) {
            return Err(format!(
                "speed {speed_m_per_s}, expected 0 to {MAX_SPEED_M_PER_S} m/s"
            ));
        }
        let label = plane("label", sample.label)?;
        let solved = outcome == Outcome::Solved;
        if solved && !(0.0..=MAX_COST).contains(&sample.cost) {
            return Err(format!("cost {}, expected 0 to {MAX_COST}", sample.cost));
        }
        if solved != (label.count() > 0) {
            let (name, cells) = (outcome.name(), label.count());
            return Err(format!("outcome {name}, but {cells} cells in the label"));
        }
        Ok(Self {
            spec,
            obstacles: plane("obstacles", sample.obstacles)?,
            reference: plane("reference", sample.reference)?,
            target: plane("target", sample.target)?,
            label,
            goal,
            speed_m_per_s,
            outcome,
            cost: sample.cost,
            steps: sample.steps as f32,
            path,
            scene: sample.scene.chars().take(MAX_SCENE_CHARS).collect(),
            scene_id: sample.scene_id,
        })
    }

    /// What the network sees of it beside the goal.
    pub const fn surroundings(&self) -> Surroundings<'_> {
        Surroundings {
            obstacles: &self.obstacles,
            reference: &self.reference,
            speed_m_per_s: self.speed_m_per_s,
        }
    }

    /// Whether there is a path to learn.
    pub fn is_solved(&self) -> bool {
        self.outcome == Outcome::Solved
    }

    /// The label drawn anew from the path, with its edge at `dilation_m` from it.
    pub fn label_at(&self, dilation_m: f64) -> Plane {
        let mut plane = Plane::empty(self.spec.rows, self.spec.cols);
        plane.draw_line(&self.spec, &self.path, dilation_m);
        plane
    }

    /// Straight distance from the vehicle to the goal, metres.
    pub fn distance_m(&self) -> f64 {
        self.goal.distance_m(&Pose2::default())
    }

    /// The same scene seen in a mirror: left and right swapped.
    #[must_use]
    pub fn mirrored(&self) -> Self {
        let plane = |plane: &Plane| mirrored(plane, self.spec.ego_col);
        Self {
            spec: self.spec,
            obstacles: plane(&self.obstacles),
            reference: plane(&self.reference),
            target: plane(&self.target),
            label: plane(&self.label),
            goal: mirrored_pose(&self.goal),
            speed_m_per_s: self.speed_m_per_s,
            outcome: self.outcome,
            cost: self.cost,
            steps: self.steps,
            path: self.path.iter().map(mirrored_pose).collect(),
            scene: self.scene.clone(),
            scene_id: self.scene_id,
        }
    }
}

/// A pose on the other side of the vehicle.
pub(crate) const fn mirrored_pose(pose: &Pose2) -> Pose2 {
    Pose2::new(pose.x_m, -pose.y_m, -pose.yaw_rad)
}

/// A plane mirrored about a column; what falls off the grid is lost.
pub(crate) fn mirrored(plane: &Plane, about_col: u32) -> Plane {
    let mut mirror = Plane::empty(plane.rows(), plane.cols());
    let cols = plane.cols() as usize;
    plane.each_set(|index| {
        let (row, col) = (index / cols, index % cols);
        if let Some(col) = (2 * about_col as usize)
            .checked_sub(col)
            .filter(|&col| col < cols)
        {
            mirror.set_index(row * cols + col);
        }
    });
    mirror
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use swath_bridge::msg::header::Header;
    use swath_planner::report::planar_pose;

    /// A grid on which a network trains in seconds.
    pub(crate) fn small_spec() -> GridSpec {
        GridSpec {
            rows: 64,
            cols: 41,
            resolution_m: 0.4,
            ego_row: 56,
            ego_col: 20,
        }
    }

    /// The same ground in cells of half the side.
    pub(crate) fn finer_spec() -> GridSpec {
        GridSpec {
            rows: 128,
            cols: 81,
            resolution_m: 0.2,
            ego_row: 112,
            ego_col: 40,
        }
    }

    /// A sample whose path bends around a block of obstacles.
    pub(crate) fn sample(index: u64) -> Sample {
        sample_on(small_spec(), index)
    }

    fn sample_on(spec: GridSpec, index: u64) -> Sample {
        let side = if index.is_multiple_of(2) { 1.0 } else { -1.0 };
        let goal = Pose2::new(
            12.0 + (index % 5) as f64 * 2.0,
            side * (index % 3) as f64,
            0.0,
        );
        let bend = Pose2::new(goal.x_m / 2.0, goal.y_m / 2.0 + side * 2.5, 0.0);
        let path = [Pose2::default(), bend, goal];
        let plane = |poses: &[Pose2], radius_m: f64| {
            let mut plane = Plane::empty(spec.rows, spec.cols);
            plane.draw_line(&spec, poses, radius_m);
            plane.into_packed()
        };
        let block = Pose2::new(goal.x_m / 2.0, goal.y_m / 2.0 - side, 0.0);
        Sample {
            header: Header::at(index, "base_link"),
            generator: "test".to_owned(),
            sequence: index,
            seed: 1,
            index,
            scene: if side > 0.0 { "straight" } else { "curve" }.to_owned(),
            scene_id: index / 2,
            speed_m_per_s: 1.4,
            goal: planar_pose(&goal),
            outcome: Outcome::Solved.code(),
            rows: spec.rows,
            cols: spec.cols,
            resolution_m: single(spec.resolution_m),
            ego_row: spec.ego_row,
            ego_col: spec.ego_col,
            obstacles: plane(&[block], 1.2),
            reference: plane(&[Pose2::default(), Pose2::new(22.0, 0.0, 0.0)], 1.0),
            target: plane(&[goal], 1.0),
            label: plane(&path, 1.4),
            path: path.iter().map(planar_pose).collect(),
            cost: 20.0,
            steps: 100,
        }
    }

    #[expect(
        clippy::cast_possible_truncation,
        reason = "messages are of single precision"
    )]
    fn single(value: f64) -> f32 {
        value as f32
    }

    pub(crate) fn examples(count: u64) -> Vec<Example> {
        examples_on(small_spec(), count)
    }

    pub(crate) fn examples_on(spec: GridSpec, count: u64) -> Vec<Example> {
        (0..count)
            .map(|index| Example::from_sample(sample_on(spec, index)).unwrap())
            .collect()
    }

    #[test]
    fn a_good_sample_is_taken_and_its_label_can_be_redrawn() {
        let example = Example::from_sample(sample(3)).unwrap();
        assert_eq!(example.spec, small_spec());
        assert_eq!(example.label_at(1.4).count(), example.label.count());
        assert!(example.label_at(2.0).count() > example.label.count());
    }

    #[test]
    fn a_mirrored_mirror_is_the_original() {
        let example = Example::from_sample(sample(4)).unwrap();
        assert_ne!(example.mirrored().label, example.label);
        assert_eq!(example.mirrored().mirrored(), example);
    }

    #[test]
    fn samples_that_contradict_themselves_are_refused() {
        type Change = fn(&mut Sample);
        let changes: [(Change, &str); 7] = [
            (|sample| sample.rows = 0, "grid"),
            (|sample| sample.cols = u32::MAX, "grid"),
            (|sample| sample.obstacles.truncate(5), "obstacles"),
            (|sample| sample.outcome = 77, "outcome"),
            (|sample| sample.outcome = 1, "label"),
            (|sample| sample.goal.x_m = f32::NAN, "finite"),
            (|sample| sample.resolution_m = f32::INFINITY, "resolution"),
        ];
        for (change, evidence) in changes {
            let mut bad = sample(0);
            change(&mut bad);
            let error = Example::from_sample(bad).unwrap_err().to_string();
            assert!(error.contains(evidence), "{error}");
        }
    }
}
