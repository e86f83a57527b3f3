use std::collections::BTreeSet;
use std::f64::consts::TAU;

use proptest::prelude::*;
use swath_bridge::Pose2;

use super::*;
use crate::shape::Height;

fn scene(seed: u64, index: u64) -> Scene {
    Scene::procedural(seed, index, &GeneratorConfig::default())
}

#[test]
fn kinds_have_equal_shares_in_any_run_of_scenes() {
    for first in [0, 3, 1_000_000_007, u64::MAX - 700] {
        let mut shares = [0; SceneKind::ALL.len()];
        for index in first..first + 700 {
            let kind = SceneKind::of_index(&GeneratorConfig::default().kinds, index);
            shares[SceneKind::ALL.iter().position(|k| *k == kind).unwrap()] += 1;
        }
        assert_eq!(shares, [100; 7]);
    }
}

#[test]
fn intersections_are_crossed_to_the_left_to_the_right_and_straight_on() {
    let config = GeneratorConfig::default();
    let mut ways = BTreeSet::new();
    for round in 0..60 {
        let scene = Scene::procedural(5, 3 + 7 * round, &config);
        assert_eq!(scene.name, "turn");
        let (begin, end) = (scene.reference.at(0.0), scene.reference.at(80.0));
        let turned = swath_bridge::geometry::wrap_angle_rad(end.yaw_rad - begin.yaw_rad);
        ways.insert(match turned {
            left if left > 0.1 => "left",
            right if right < -0.1 => "right",
            _ => "through",
        });
    }
    assert_eq!(ways.len(), 3, "{ways:?}");
}

#[test]
fn bends_reach_their_curvature_and_turn_by_their_angle() {
    let config = GeneratorConfig::default();
    for round in 0..40 {
        let scene = Scene::procedural(6, 1 + 7 * round, &config);
        let sharpest = (-24..100)
            .map(|along| scene.reference.curvature_per_m(f64::from(along)).abs())
            .fold(0.0, f64::max);
        assert!(
            sharpest > 0.008 && sharpest < 0.1,
            "round {round}: {sharpest}"
        );
    }
}

#[test]
fn s_shaped_roads_bend_to_both_sides() {
    let config = GeneratorConfig::default();
    for round in 0..40 {
        let scene = Scene::procedural(7, 2 + 7 * round, &config);
        let bends: Vec<f64> = (-20..95)
            .map(|along| scene.reference.curvature_per_m(f64::from(along)))
            .collect();
        assert!(bends.iter().any(|bend| *bend > 0.01), "round {round}");
        assert!(bends.iter().any(|bend| *bend < -0.01), "round {round}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn the_vehicle_and_its_way_here_are_free(seed: u64, index in 0..1_000_000u64) {
        let config = GeneratorConfig::default();
        let scene = scene(seed, index);
        let start = footprint(&config.vehicle, &Pose2::default()).grown(0.3);
        prop_assert!(scene.is_free(&start));
        for moment in scene.trail(config.lidar.history_s, 0.5) {
            let stood = footprint(&config.vehicle, &moment.pose);
            let hits = |shape: &Shape| shape.touches(&stood);
            prop_assert!(!scene.solids.iter().any(|solid| hits(&solid.shape)));
            let mover_hits = scene.movers.iter().any(|m| hits(&m.shape_at(moment.time_s)));
            prop_assert!(!mover_hits);
        }
    }

    #[test]
    fn the_reference_begins_beside_the_vehicle_and_on_the_grid(
        seed: u64, index in 0..1_000_000u64,
    ) {
        let grid = GeneratorConfig::default().grid;
        let scene = scene(seed, index);
        let beside = scene.reference.at(0.0);
        prop_assert!(beside.distance_m(&Pose2::default()) < 1.1, "{beside:?}");
        prop_assert!(beside.yaw_rad.abs() < 0.2, "{beside:?}");
        prop_assert!(scene.ego_at(0.0).distance_m(&Pose2::default()) < 1e-9);
        for along in 0..8 {
            let pose = scene.reference.at(f64::from(along));
            prop_assert!(grid.index_of(grid.cell_at(pose.x_m, pose.y_m)).is_some());
        }
        prop_assert!(scene.lanes_m.contains(&0.0));
        prop_assert!(scene.speed_m_per_s > 0.0 && scene.speed_m_per_s <= 10.0);
    }

    #[test]
    fn scenes_are_finite_and_the_same_twice(seed: u64, index in 0..1_000_000u64) {
        let scene = scene(seed, index);
        let mut is_finite = true;
        for solid in &scene.solids {
            solid.shape.outline(|s| {
                is_finite &= s.from.iter().chain(&s.to).all(|value| value.is_finite());
            });
        }
        prop_assert!(is_finite);
        prop_assert!(scene.reference.poses().iter().all(Pose2::is_finite));
        prop_assert_eq!(scene, self::scene(seed, index));
    }

    #[test]
    fn later_nothing_has_moved_but_what_moves(seed: u64, index in 0..7000u64, time in 0.1..8.0f64) {
        let scene = scene(seed, index);
        let later = scene.later(time);
        let now_from_then = scene.ego_at(time);
        for (before, after) in scene.solids.iter().zip(&later.solids) {
            let point = now_from_then.then(&Pose2::new(4.0, 1.0, 0.0));
            let expected = before.shape.distance_m([point.x_m, point.y_m]);
            // A disc's polygon does not turn with the frame.
            prop_assert!((after.shape.distance_m([4.0, 1.0]) - expected).abs() < 0.1);
        }
        for (before, after) in scene.movers.iter().zip(&later.movers) {
            let expected = before.pose_at(time + 1.5);
            prop_assert!(now_from_then.then(&after.pose_at(1.5)).distance_m(&expected) < 1e-6);
        }
        prop_assert!(later.ego_at(0.0).distance_m(&Pose2::default()) < 1e-9);
        let ahead = scene.reference.at(scene.speed_m_per_s * time + 5.0);
        prop_assert!(now_from_then.then(&later.reference.at(5.0)).distance_m(&ahead) < 1e-6);
    }
}

#[test]
fn a_vehicle_on_a_drive_is_never_boxed_in() {
    let config = GeneratorConfig::default();
    let is_clear = |scene: &Scene| {
        way::goes_on(scene, &config.vehicle)
            || way::ahead(scene, &config).all(|ground| scene.is_free(&ground))
    };
    // In the first two the vehicle stands half a metre from a wall before it.
    let boxed_in = [34, 77].map(|index| (900_010, index));
    assert!(
        boxed_in
            .iter()
            .all(|&(seed, index)| !is_clear(&scene(seed, index)))
    );
    for (seed, index) in boxed_in.into_iter().chain((0..140).map(|index| (7, index))) {
        let scene = scene(seed, index);
        let is_changed = !way::goes_on(&scene, &config.vehicle);
        let driving = scene.clone().on_a_drive(&config);
        assert!(is_clear(&driving), "{seed} {index}");
        assert!(is_changed || driving == scene, "{seed} {index}");
    }
}

#[test]
fn a_vehicle_before_a_wall_does_not_go_on() {
    let vehicle = Vehicle::default();
    let mut scene = scene(1, 0);
    scene.movers.clear();
    for (gap_m, goes_on) in [(0.5, false), (30.0, true)] {
        scene.solids = vec![Solid {
            shape: Shape::Line {
                points: vec![
                    [vehicle.front_m + gap_m, -50.0],
                    [vehicle.front_m + gap_m, 50.0],
                ],
                thickness_m: 0.1,
            },
            height: Height::Tall,
        }];
        assert_eq!(way::goes_on(&scene, &vehicle), goes_on, "{gap_m} m");
    }
}

#[test]
fn a_mover_on_a_circle_comes_back_after_a_turn() {
    let mover = Mover {
        pose: Pose2::new(1.0, 2.0, 0.5),
        speed_m_per_s: 2.0,
        turn_rad_per_s: 0.5,
        length_m: 4.0,
        width_m: 2.0,
    };
    assert!(mover.pose_at(TAU / 0.5).distance_m(&mover.pose) < 1e-9);
    // Half a circle is its diameter, 2 v / ω, to the left.
    let half = mover.pose.then(&Pose2::new(0.0, 8.0, 0.0));
    assert!(mover.pose_at(TAU).distance_m(&half) < 1e-9);
}
