//! A planned frame as a picture.

use std::path::Path;

use swath_bridge::picture::{BLUE, GREEN, ORANGE, Picture, RED};
use swath_bridge::{Occupancy, Outcome};
use swath_planner::{FrameInput, FramePlan};

use crate::config::Config;

/// Pixels along a side of a cell.
const PIXELS_A_CELL: u32 = 4;
/// How much of the ground a region hides.
const REGION_OPACITY: f64 = 0.35;
const GOAL_RADIUS_M: f64 = 0.3;
const LINE_PX: f64 = 2.0;

/// Draws map, regions, reference, paths, goals and vehicle. Goals without a path are circled in
/// orange, the others in red.
pub(super) fn draw(
    path: &Path,
    occupancy: &Occupancy,
    input: &FrameInput<'_>,
    plan: &FramePlan,
    config: &Config,
) -> anyhow::Result<()> {
    let mut picture = Picture::of(occupancy, PIXELS_A_CELL);
    if !plan.regions.is_empty() {
        picture.overlay(ORANGE, REGION_OPACITY, |cell| {
            plan.regions.iter().any(|region| region.get(cell))
        });
    }
    picture.line(input.reference, GREEN, LINE_PX);
    for target in &plan.targets {
        let is_solved = target.result.outcome == Outcome::Solved;
        picture.line(&target.poses(), RED, LINE_PX);
        picture.disc(
            &target.goal,
            GOAL_RADIUS_M,
            if is_solved { RED } else { ORANGE },
        );
    }
    picture.vehicle(&swath_bridge::Pose2::default(), &config.vehicle, BLUE);
    picture.scale_bar();
    picture.write_png(path)?;
    Ok(())
}
