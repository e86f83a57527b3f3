//! A planned frame as a picture.

use std::path::Path;

use swath_bridge::scene::{Scene, SceneGoal};
use swath_bridge::{Cell, Drivability, GridSpec, Outcome, Pose2};
use swath_planner::{FrameInput, FramePlan, Method, TargetPlan};

use super::place::Place;
use crate::config::Config;

/// What a picture is of.
pub(super) struct Shown<'a> {
    pub(super) place: &'a Place,
    /// Goals as they were given.
    pub(super) named: &'a [Pose2],
    /// The grid that regions are on, in the frame of the start.
    pub(super) around: &'a GridSpec,
    pub(super) method: Method,
}

impl Shown<'_> {
    /// Draws map, regions, reference, paths, goals and vehicle.
    pub(super) fn draw(
        &self,
        path: &Path,
        input: &FrameInput<'_>,
        plan: &FramePlan,
        config: &Config,
    ) -> anyhow::Result<()> {
        let is_solved = |target: &&TargetPlan| target.result.outcome == Outcome::Solved;
        let solved = plan.targets.iter().filter(is_solved).count();
        let title = format!(
            "{}: {solved} of {} solved",
            self.method.name(),
            plan.targets.len()
        );
        let goals = plan.targets.iter().zip(input.goals).zip(self.named);
        let goals: Vec<SceneGoal> = (0..)
            .zip(goals)
            .map(|(number, ((target, pose), named))| SceneGoal {
                number,
                pose: *pose,
                named: *named,
                path: target.poses(),
                note: note_of(target),
                is_chosen: false,
            })
            .collect();
        let start = &self.place.start.pose;
        let start_from_grid = start.inverse();
        let spec = &self.place.occupancy.spec;
        let region = |cell: Cell| {
            let (x_m, y_m) = spec.centre_of(cell);
            let seen = start_from_grid.then(&Pose2::new(x_m, y_m, 0.0));
            let cell = self.around.cell_at(seen.x_m, seen.y_m);
            plan.regions.iter().any(|region| region.get(cell))
        };
        let scene = Scene {
            title: &title,
            occupancy: &self.place.occupancy,
            top: self.place.top,
            region: (!plan.regions.is_empty()).then_some(&region),
            region_name: "predicted region",
            near_reference: None,
            reference: input.reference,
            goals: &goals,
            start: *start,
            start_named: self.place.in_map(start),
            vehicle: &config.vehicle,
        };
        scene.drawing().write(path)?;
        Ok(())
    }
}

/// How long a path is and how it can be driven, or why there is none.
fn note_of(target: &TargetPlan) -> String {
    if target.result.outcome != Outcome::Solved {
        return reason_of(target.result.outcome).to_owned();
    }
    let length_m = target.result.length_m;
    match target.drivable.as_ref().map(|path| path.drivability) {
        Some(Drivability::AtSpeed) => format!("{length_m:.1} m"),
        Some(other) => format!("{length_m:.1} m, {}", other.name().replace('_', " ")),
        None => format!("{length_m:.1} m, chords"),
    }
}

/// An outcome in a word or two.
pub(crate) const fn reason_of(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Solved => "solved",
        Outcome::Unreachable => "unreachable",
        Outcome::BudgetExhausted => "no time",
        Outcome::StartOccupied => "start occupied",
        Outcome::GoalOccupied => "occupied",
        Outcome::OutOfBounds => "out of bounds",
        Outcome::Cancelled => "cancelled",
    }
}
