//! Pictures of a demo's drive, drawn from its recording.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::Context;
use swath_bridge::msg::nav::{OccupancyGrid, Path as PathMessage};
use swath_bridge::msg::swath::{PlanReport, TargetPlan};
use swath_bridge::picture::{BLUE, GREEN, ORANGE, Picture, RED};
use swath_bridge::poses::poses_of_path;
use swath_bridge::recording::Reader;
use swath_bridge::{Occupancy, Outcome, Pose2, keys};
use swath_planner::report::{path_points, pose_of_planar};

use super::feed::VEHICLE;
use crate::config::Config;

/// Frames that are drawn beside those that stopped.
const FRAMES: usize = 6;
/// Frames without a path to follow that are drawn.
const STOPS: usize = 2;
const PIXELS_A_CELL: u32 = 3;
const GOAL_RADIUS_M: f64 = 0.3;
const CHOSEN_PX: f64 = 4.0;
const LINE_PX: f64 = 1.0;

/// Draws frames of the drive, spread over all of it, into a folder: a picture each.
pub(super) fn draw(recording: &Path, folder: &Path, config: &Config) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let wanted = wanted(recording)?;
    let mut reports: BTreeMap<u64, PlanReport> = BTreeMap::new();
    let mut scenes: BTreeMap<u64, Scene> = BTreeMap::new();
    let mut reference = Vec::new();
    let (grids, plans) = (
        topic(keys::grid(VEHICLE).key()),
        topic(keys::plan(VEHICLE).key()),
    );
    let references = topic(keys::reference(VEHICLE).key());
    for message in read(recording)? {
        let message = message?;
        if *message.topic == *references {
            reference = poses_of_path(&message.decode::<PathMessage>()?);
        } else if *message.topic == *grids {
            let grid: OccupancyGrid = message.decode()?;
            let stamp = grid.header.stamp.nanos();
            if wanted.contains(&stamp) {
                let occupancy = Occupancy::from_message(&grid, &config.grid)?;
                let reference = reference.clone();
                scenes.insert(
                    stamp,
                    Scene {
                        occupancy,
                        reference,
                    },
                );
            }
        } else if *message.topic == *plans {
            let report: PlanReport = message.decode()?;
            let stamp = report.header.stamp.nanos();
            if wanted.contains(&stamp) {
                reports.insert(stamp, report);
            }
        }
    }
    for (stamp, report) in &reports {
        if let Some(scene) = scenes.get(stamp) {
            let file = folder.join(format!("frame-{:05}.png", report.frame));
            picture(scene, report, config).write_png(&file)?;
        }
    }
    Ok(())
}

/// What was seen in a frame, in the vehicle's frame.
struct Scene {
    occupancy: Occupancy,
    reference: Vec<Pose2>,
}

fn topic(key: &str) -> String {
    keys::topic_of_key(key)
}

/// The vehicle's messages in a recording.
fn read(
    recording: &Path,
) -> anyhow::Result<
    impl Iterator<Item = Result<swath_bridge::recording::RawMessage, swath_bridge::Error>>,
> {
    let of_vehicle = [
        topic(keys::grid(VEHICLE).key()),
        topic(keys::reference(VEHICLE).key()),
        topic(keys::plan(VEHICLE).key()),
    ];
    let is_of_vehicle = move |topic: &str| of_vehicle.iter().any(|one| one == topic);
    Ok(Reader::open(recording)?.with_topics(is_of_vehicle))
}

/// Stamps of the frames to draw: some spread evenly over the drive, and some that stopped.
fn wanted(recording: &Path) -> anyhow::Result<BTreeSet<u64>> {
    let plans = topic(keys::plan(VEHICLE).key());
    let (mut driven, mut stopped) = (Vec::new(), Vec::new());
    for message in read(recording)? {
        let message = message?;
        if *message.topic != *plans {
            continue;
        }
        let report: PlanReport = message.decode()?;
        let stamp = report.header.stamp.nanos();
        if report.chosen < 0 {
            stopped.push(stamp);
        } else {
            driven.push(stamp);
        }
    }
    let chosen = spread(&driven, FRAMES).chain(spread(&stopped, STOPS));
    Ok(chosen.collect())
}

/// At most `count` of some stamps, spread evenly.
fn spread(stamps: &[u64], count: usize) -> impl Iterator<Item = u64> {
    let count = count.min(stamps.len());
    (0..count).map(move |index| stamps[(2 * index + 1) * stamps.len() / (2 * count)])
}

/// Map, reference (green), paths (orange, the chosen one red), goals and vehicle.
fn picture(scene: &Scene, report: &PlanReport, config: &Config) -> Picture {
    let mut picture = Picture::of(&scene.occupancy, PIXELS_A_CELL);
    picture.line(&scene.reference, GREEN, LINE_PX);
    let chosen = usize::try_from(report.chosen).ok();
    let poses = |target: &TargetPlan| -> Vec<Pose2> {
        path_points(target).iter().map(|point| point.pose).collect()
    };
    for target in &report.targets {
        picture.line(&poses(target), ORANGE, LINE_PX);
        let is_solved = target.status == Outcome::Solved.code();
        let colour = if is_solved { RED } else { ORANGE };
        picture.disc(&pose_of_planar(&target.goal), GOAL_RADIUS_M, colour);
    }
    if let Some(target) = chosen.and_then(|number| report.targets.get(number)) {
        picture.line(&poses(target), RED, CHOSEN_PX);
    }
    picture.vehicle(&Pose2::default(), &config.vehicle, BLUE);
    picture.scale_bar();
    picture
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_spread_over_the_drive() {
        let stamps: Vec<u64> = (0..100).collect();
        let chosen: Vec<u64> = spread(&stamps, 4).collect();
        assert_eq!(chosen, [12, 37, 62, 87]);
        assert_eq!(spread(&[7], 4).collect::<Vec<_>>(), [7]);
        assert_eq!(spread(&[], 4).count(), 0);
    }
}
