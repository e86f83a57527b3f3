//! Scenes from real drive logs.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::PathBuf;
use std::sync::Arc;

use swath_bridge::Outcome;
use swath_bridge::ingest::{IngestConfig, frames};
use swath_generator::{Generator, GeneratorConfig, LogScenes, Scenes};
use swath_planner::search::SearchMemory;

/// A log of the shared data, or `None` where there is none.
fn log(name: &str) -> Option<PathBuf> {
    let shared = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data");
    let data = std::env::var_os("SWATH_DATA").map_or_else(|| PathBuf::from(shared), PathBuf::from);
    let path = data.join("logs").join(name);
    path.exists().then_some(path)
}

#[expect(clippy::print_stderr, reason = "a skipped test says so")]
fn skipped(name: &str) {
    eprintln!("SKIPPED: there is no {name}; set SWATH_DATA to the directory that holds logs/");
}

fn samples_of(name: &str, fewest_scenes: usize) {
    let Some(path) = log(name) else {
        skipped(name);
        return;
    };
    let mut scenes = LogScenes::new();
    let kept = scenes
        .add(name, frames(&path, &IngestConfig::default()).unwrap())
        .unwrap();
    assert!(kept >= fewest_scenes, "{kept} scenes");
    let generator =
        Generator::new(GeneratorConfig::default(), Scenes::Logs(Arc::new(scenes))).unwrap();
    let mut memory = SearchMemory::new();
    let mut solved = 0;
    for index in (0..200).step_by(5) {
        let sample = generator.sample(1, index, &mut memory).unwrap();
        assert_eq!(sample.scene, name);
        assert!(sample.obstacles.iter().any(|byte| *byte != 0));
        assert_ne!(sample.outcome, Outcome::StartOccupied.code());
        solved += u32::from(sample.outcome == Outcome::Solved.code());
    }
    assert!(solved >= 16, "{solved} of 40 solved");
}

#[test]
fn a_car_with_a_3d_lidar_gives_scenes_to_learn_from() {
    samples_of("kitti_seqA.mcap", 10);
}

#[test]
fn a_robot_with_a_planar_scanner_gives_scenes_to_learn_from() {
    samples_of("radish_freiburg_campus.mcap", 100);
}
