use proptest::prelude::*;
use swath_bridge::Cell;

use super::*;
use crate::config::GeneratorConfig;
use crate::dice::{MOST_DEVIATIONS, Purpose};
use crate::scene::Scene;
use crate::shape::Shape;

fn dice(seed: u64) -> Dice {
    Dice::new(seed, Purpose::Lidar, 0, 0)
}

fn quiet() -> LidarConfig {
    LidarConfig {
        noise_m: 0.0,
        dropout: 0.0,
        low_dropout: 0.0,
        ..LidarConfig::default()
    }
}

fn lidar(config: &LidarConfig) -> Lidar {
    Lidar::new(config, &GridSpec::default(), &Vehicle::default())
}

fn standing(sweeps: u32) -> Vec<Moment> {
    (0..sweeps)
        .rev()
        .map(|back| Moment {
            time_s: -0.2 * f64::from(back),
            pose: Pose2::default(),
        })
        .collect()
}

fn rectangle(x_m: f64, y_m: f64, length_m: f64, width_m: f64) -> Shape {
    Shape::Rectangle {
        centre: Pose2::new(x_m, y_m, 0.0),
        length_m,
        width_m,
    }
}

fn solid(shape: Shape, height: Height) -> Solid {
    Solid { shape, height }
}

fn world<'a>(solids: &'a [Solid], movers: &'a [Mover], trail: &'a [Moment]) -> World<'a> {
    World {
        solids,
        movers,
        blockers: &[],
        trail,
    }
}

fn occupied(map: &Occupancy) -> Vec<(f64, f64)> {
    (0..map.cells.len())
        .filter(|&index| map.cells[index] == OCCUPIED)
        .map(|index| map.spec.centre_of(map.spec.cell_of_index(index)))
        .collect()
}

/// The distance at which a ray meets a segment, by Cramer's rule on sensor + t d = from + u (to − from).
fn meeting_m(sensor: [f64; 2], direction: [f64; 2], segment: &Segment) -> Option<f64> {
    let (ex, ey) = (
        segment.to[0] - segment.from[0],
        segment.to[1] - segment.from[1],
    );
    let (wx, wy) = (segment.from[0] - sensor[0], segment.from[1] - sensor[1]);
    let determinant = direction[1] * ex - direction[0] * ey;
    let (t, u) = (
        (wy * ex - wx * ey) / determinant,
        (direction[0] * wy - direction[1] * wx) / determinant,
    );
    (t.is_finite() && t > 0.0 && (0.0..=1.0).contains(&u)).then_some(t)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn depths_agree_with_intersecting_every_piece(seed: u64, index in 0..7000u64) {
        let config = GeneratorConfig::default();
        let scene = Scene::procedural(seed, index, &config);
        let lidar = lidar(&quiet());
        let mut sweep = lidar.sweep_at(&Pose2::default(), &mut dice(seed));
        let mut segments = Vec::new();
        for solid in scene.solids.iter().filter(|solid| solid.height == Height::Tall) {
            solid.shape.outline(|segment| segments.push(segment));
        }
        for segment in &segments {
            lidar.cast(&mut sweep, segment, Height::Tall, Hit::Still);
        }
        for ray in (0..lidar.rays.len()).step_by(7) {
            let direction = lidar.direction(&sweep, ray);
            let expected = segments
                .iter()
                .filter_map(|segment| meeting_m(sweep.sensor, direction, segment))
                .filter(|range| (NEAREST_M..=lidar.config.max_range_m).contains(range))
                .fold(f64::INFINITY, f64::min);
            let got = sweep.range_m[ray];
            prop_assert!(
                got == expected || (got - expected).abs() < 1e-6, "ray {ray}: {got}, not {expected}"
            );
        }
    }

    #[test]
    fn what_is_occupied_lies_on_a_surface(seed: u64, index in 0..7000u64) {
        let config = GeneratorConfig::default();
        let scene = Scene::procedural(seed, index, &config);
        let trail = scene.trail(config.lidar.history_s, config.lidar.period_s);
        let map = lidar(&config.lidar).look(
            &world(&scene.solids, &scene.movers, &trail), &mut dice(seed),
        );
        let tolerance_m = MOST_DEVIATIONS * config.lidar.noise_m + 0.5f64.sqrt() * 0.2 + 1e-9;
        let mut shapes: Vec<Shape> = scene.solids.iter().map(|solid| solid.shape.clone()).collect();
        for moment in &trail {
            shapes.extend(scene.movers.iter().map(|mover| mover.shape_at(moment.time_s)));
        }
        let mut segments = Vec::new();
        for shape in &shapes {
            shape.outline(|segment| segments.push(segment));
        }
        for (x_m, y_m) in occupied(&map) {
            let off_m = segments
                .iter()
                .map(|segment| segment.distance_m([x_m, y_m]))
                .fold(f64::INFINITY, f64::min);
            prop_assert!(off_m <= tolerance_m, "({x_m}, {y_m}) is {off_m} m off every surface");
        }
    }

    #[test]
    fn the_vehicle_stands_on_free_cells(seed: u64, index in 0..7000u64) {
        let config = GeneratorConfig::default();
        let scene = Scene::procedural(seed, index, &config);
        let trail = scene.trail(config.lidar.history_s, config.lidar.period_s);
        let map = lidar(&config.lidar).look_around(
            &world(&scene.solids, &scene.movers, &trail), &mut dice(seed),
        );
        for (x_m, y_m) in [(0.0, 0.0), (3.6, 0.88), (3.6, -0.88), (-0.58, 0.88), (-0.58, -0.88)] {
            prop_assert_eq!(map.get(map.spec.cell_at(x_m, y_m)), Some(FREE));
        }
    }
}

#[test]
fn a_tall_thing_hides_what_is_behind_it_and_a_low_one_does_not() {
    let behind = solid(rectangle(20.0, 0.0, 2.0, 2.0), Height::Tall);
    for (height, is_hidden) in [(Height::Tall, true), (Height::Low, false)] {
        let solids = [
            solid(rectangle(10.0, 0.0, 1.0, 8.0), height),
            behind.clone(),
        ];
        let map = lidar(&quiet()).look(&world(&solids, &[], &standing(5)), &mut dice(1));
        let has = |from: f64, to: f64| occupied(&map).iter().any(|&(x, _)| x > from && x < to);
        assert!(has(9.2, 9.8), "the near face is seen");
        assert!(!has(10.2, 10.8), "the far face is not");
        assert_eq!(has(18.0, 22.0), !is_hidden, "{height:?}");
    }
}

#[test]
fn low_things_are_seen_from_near_only() {
    let config = quiet();
    let far_m = config.low_range_m + 10.0;
    for (x_m, is_seen) in [(10.0, true), (far_m, false)] {
        let solids = [solid(rectangle(x_m, 0.0, 1.0, 8.0), Height::Low)];
        let map = lidar(&config).look(&world(&solids, &[], &standing(5)), &mut dice(1));
        assert_eq!(!occupied(&map).is_empty(), is_seen);
    }
}

#[test]
fn a_quiet_lidar_draws_a_wall_without_gaps() {
    let solids = [solid(rectangle(12.0, 0.0, 0.5, 10.0), Height::Tall)];
    let map = lidar(&quiet()).look(&world(&solids, &[], &standing(3)), &mut dice(1));
    for col in 52..=98 {
        // The near face is at x = 11.75, in row 241.
        assert_eq!(map.get(Cell::new(241, col)), Some(OCCUPIED), "column {col}");
    }
}

#[test]
fn drop_outs_thin_out_what_is_seen() {
    let solids = [solid(rectangle(30.0, 0.0, 1.0, 20.0), Height::Tall)];
    let cells = |dropout: f64| {
        let config = LidarConfig { dropout, ..quiet() };
        let map = lidar(&config).look(&world(&solids, &[], &standing(1)), &mut dice(1));
        occupied(&map).len()
    };
    assert_eq!(cells(1.0), 0);
    let (half, all) = (cells(0.5), cells(0.0));
    assert!(half > all / 4 && half < all, "{half} of {all}");
}

#[test]
fn what_drove_away_is_no_longer_where_it_was() {
    let mover = Mover {
        pose: Pose2::new(30.0, 0.0, 0.0),
        speed_m_per_s: 5.0,
        turn_rad_per_s: 0.0,
        length_m: 4.0,
        width_m: 2.0,
    };
    let map = lidar(&quiet()).look(&world(&[], &[mover], &standing(10)), &mut dice(1));
    let seen = occupied(&map);
    assert!(
        seen.iter().any(|&(x, _)| (x - 28.0).abs() < 0.3),
        "its rear is seen"
    );
    assert!(
        seen.iter().all(|&(x, _)| x > 27.4),
        "its trail is cleared: {seen:?}"
    );
}

#[test]
fn ground_behind_a_wall_is_unknown_and_ground_before_it_free() {
    let solids = [solid(rectangle(12.0, 0.0, 0.5, 10.0), Height::Tall)];
    let map = lidar(&quiet()).look_around(&world(&solids, &[], &standing(3)), &mut dice(1));
    assert_eq!(map.get(map.spec.cell_at(8.0, 0.0)), Some(FREE));
    assert_eq!(map.get(map.spec.cell_at(16.0, 0.0)), Some(UNKNOWN));
    assert_eq!(map.get(map.spec.cell_at(8.0, 12.0)), Some(FREE));
}

#[test]
fn cells_of_a_known_map_hide_what_is_behind_them_and_are_not_seen_again() {
    let solids = [solid(rectangle(20.0, 0.0, 2.0, 2.0), Height::Tall)];
    let wall: Vec<[f64; 2]> = (-20..=20).map(|k| [10.0, 0.2 * f64::from(k)]).collect();
    let trail = standing(3);
    let known = World {
        blockers: &wall,
        ..world(&solids, &[], &trail)
    };
    assert!(occupied(&lidar(&quiet()).look(&known, &mut dice(1))).is_empty());
}
