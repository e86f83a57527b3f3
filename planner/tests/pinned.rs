//! Results stay the same to the bit, whatever is done to make the search faster.

mod scenes;

use std::sync::Arc;

use swath_bridge::{GridSpec, Outcome, Pose2, Vehicle};
use swath_planner::search::{Limits, SearchMemory, TargetResult, search};
use swath_planner::{CollisionMap, Guidance, MotionModel, Plane};

/// Folds bytes into a digest (64-bit FNV-1a).
fn fold(digest: u64, bytes: &[u8]) -> u64 {
    bytes.iter().fold(digest, |digest, &byte| {
        (digest ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

fn fold_result(digest: u64, result: &TargetResult) -> u64 {
    let mut digest = fold(digest, &[result.outcome.code()]);
    digest = fold(digest, &result.steps.to_le_bytes());
    for value in [result.cost, result.length_m] {
        digest = fold(digest, &value.to_bits().to_le_bytes());
    }
    for pose in &result.path {
        for value in [pose.x_m, pose.y_m, pose.yaw_rad] {
            digest = fold(digest, &value.to_bits().to_le_bytes());
        }
    }
    digest
}

/// Plans to every fourth target of a scene with both methods, at two speeds.
fn digest_of(scene: &scenes::Scene) -> (u64, u64, usize) {
    let spec = GridSpec::default();
    let model = MotionModel::new(&Vehicle::default(), spec.resolution_m);
    let model = Arc::new(model.expect("the default vehicle fits the default cells"));
    let map = CollisionMap::new(model, spec, &scene.obstacles);
    let map = map.expect("scenes are made for the default grid");
    let mut memory = SearchMemory::new();
    let limits = Limits {
        max_expansions: Some(30_000),
        stop: None,
    };
    let (mut digest, mut steps, mut solved) = (0xcbf2_9ce4_8422_2325, 0, 0);
    for speed_m_per_s in [1.4, 4.0] {
        let successors = map.model().successors(speed_m_per_s);
        let mut run = |goal: &Pose2, guidance: Guidance<'_>| {
            search(&map, &successors, (goal, guidance), limits, &mut memory)
                .expect("the region is of the map's size")
        };
        for goal in scene.goals.iter().step_by(4) {
            let plain = run(goal, Guidance::NONE);
            digest = fold_result(digest, &plain);
            let mut cells = Plane::empty(spec.rows, spec.cols);
            let line = if plain.path.is_empty() {
                vec![Pose2::default(), *goal]
            } else {
                plain.path
            };
            cells.draw_line(&spec, &line, 1.4);
            let guided = run(goal, Guidance::inside(&cells, 0.15));
            digest = fold_result(digest, &guided);
            steps += plain.steps + guided.steps;
            solved += usize::from(plain.outcome == Outcome::Solved);
        }
    }
    (digest, steps, solved)
}

#[test]
fn outcomes_costs_steps_and_paths_are_what_they_were() {
    let found: Vec<_> = scenes::all()
        .iter()
        .map(|scene| (scene.name, digest_of(scene)))
        .collect();
    assert_eq!(
        found,
        [
            ("open road", (13_627_060_155_153_101_434, 643_814, 14)),
            ("lot", (12_194_440_899_598_051_455, 326_760, 8)),
            ("slalom", (1_424_732_733_879_086_008, 1_259_067, 4)),
        ]
    );
}
