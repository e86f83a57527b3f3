//! The mapper on worlds of boxes on a plane, seen by lidars of several kinds through exact rays.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;

use super::*;
use crate::GridSpec;

/// A box that stands along the axes of the world: least and greatest x, y and z, metres.
type Block = [(f64, f64); 3];

#[derive(Debug, Clone, Default)]
struct World {
    blocks: Vec<Block>,
    /// Rise of the ground along x and y, metres a metre.
    slope: (f64, f64),
}

#[derive(Debug, Clone)]
struct Lidar {
    /// Elevation of each line, radians.
    lines_rad: Vec<f64>,
    /// Directions of a turn.
    directions: u32,
    vehicle_from_sensor: Isometry3<f64>,
}

impl Lidar {
    fn new(
        lines: u32,
        (lowest_deg, highest_deg): (f64, f64),
        directions: u32,
        height_m: f64,
    ) -> Self {
        let step_deg = (highest_deg - lowest_deg) / f64::from(lines - 1);
        let lines_rad = (0..lines)
            .map(|line| (lowest_deg + f64::from(line) * step_deg).to_radians())
            .collect();
        let vehicle_from_sensor = Isometry3::translation(0.5, 0.0, height_m);
        Self {
            lines_rad,
            directions,
            vehicle_from_sensor,
        }
    }

    fn sweep(&self, world: &World, odom_from_vehicle: &Pose2) -> Vec<Point> {
        let pose = Isometry3::from_parts(
            Translation3::new(
                odom_from_vehicle.x_m,
                odom_from_vehicle.y_m,
                world.ground_m(odom_from_vehicle.x_m, odom_from_vehicle.y_m),
            ),
            world.attitude()
                * UnitQuaternion::from_euler_angles(0.0, 0.0, odom_from_vehicle.yaw_rad),
        );
        let world_from_sensor = pose * self.vehicle_from_sensor;
        let origin = world_from_sensor * Point3::origin();
        let mut points = Vec::new();
        for line_rad in &self.lines_rad {
            for step in 0..self.directions {
                let azimuth_rad =
                    std::f64::consts::TAU * f64::from(step) / f64::from(self.directions);
                let ray = Vector3::new(
                    line_rad.cos() * azimuth_rad.cos(),
                    line_rad.cos() * azimuth_rad.sin(),
                    line_rad.sin(),
                );
                if let Some(range_m) = world.range_m(&origin, &(world_from_sensor * ray)) {
                    // Two centimetres of noise from the point's number, the same in every run.
                    let number = u32::try_from(points.len()).unwrap();
                    let noise_m =
                        f64::from(number.wrapping_mul(2_654_435_761) >> 20) / 4096.0 - 0.5;
                    let sensed =
                        self.vehicle_from_sensor * Point3::from(ray * (range_m + 0.04 * noise_m));
                    #[expect(clippy::cast_possible_truncation, reason = "coordinates of a point")]
                    points.push([sensed.x as f32, sensed.y as f32, sensed.z as f32]);
                }
            }
        }
        points
    }

    fn place(&self) -> Point {
        let at = self.vehicle_from_sensor.translation.vector;
        #[expect(clippy::cast_possible_truncation, reason = "a place on the vehicle")]
        [at.x as f32, at.y as f32, at.z as f32]
    }
}

impl World {
    fn ground_m(&self, x_m: f64, y_m: f64) -> f64 {
        self.slope.0 * x_m + self.slope.1 * y_m
    }

    /// The attitude of a vehicle on this ground that heads along x.
    fn attitude(&self) -> UnitQuaternion<f64> {
        let up = Vector3::new(-self.slope.0, -self.slope.1, 1.0);
        UnitQuaternion::rotation_between(&Vector3::z(), &up).unwrap()
    }

    /// Distance to the first thing on a ray, metres, up to 100.
    fn range_m(&self, origin: &Point3<f64>, ray: &Vector3<f64>) -> Option<f64> {
        let falling = ray.z - self.slope.0 * ray.x - self.slope.1 * ray.y;
        let above_m = origin.z - self.ground_m(origin.x, origin.y);
        let to_ground = if falling < 0.0 {
            above_m / -falling
        } else {
            f64::INFINITY
        };
        let nearest = self
            .blocks
            .iter()
            .filter_map(|block| entry_m(block, origin, ray));
        let range_m = nearest.fold(to_ground, f64::min);
        (range_m < 100.0).then_some(range_m)
    }

    /// Distance of a place from the nearest block that stands below a height, metres.
    fn distance_m(&self, x_m: f64, y_m: f64, below_m: f64) -> f64 {
        let away = |value: f64, (low, high): (f64, f64)| (low - value).max(value - high).max(0.0);
        self.blocks
            .iter()
            .filter(|block| block[2].0 < below_m)
            .map(|block| away(x_m, block[0]).hypot(away(y_m, block[1])))
            .fold(f64::INFINITY, f64::min)
    }
}

/// Where a ray enters a box from outside, metres.
fn entry_m(block: &Block, origin: &Point3<f64>, ray: &Vector3<f64>) -> Option<f64> {
    let (mut enters, mut leaves) = (0.0f64, f64::INFINITY);
    for axis in 0..3 {
        let low = (block[axis].0 - origin[axis]) / ray[axis];
        let high = (block[axis].1 - origin[axis]) / ray[axis];
        enters = enters.max(low.min(high));
        leaves = leaves.min(low.max(high));
    }
    (enters <= leaves && enters > 0.0).then_some(enters)
}

fn car(x_m: f64, y_m: f64) -> Block {
    [(x_m, x_m + 4.4), (y_m, y_m + 1.8), (0.2, 1.5)]
}

/// A street along x with walls, parked cars, a pole and a branch that hangs over it.
fn street() -> World {
    let wall = |y_m: f64| [(-60.0, 120.0), (y_m, y_m + 0.5), (0.0, 8.0)];
    let mut blocks = vec![wall(9.0), wall(-9.5)];
    blocks.extend([
        car(8.0, 3.5),
        car(15.0, 3.5),
        car(24.0, 3.5),
        car(12.0, -5.5),
        car(30.0, -5.5),
    ]);
    blocks.push([(20.0, 20.3), (-6.5, -6.2), (0.0, 6.0)]);
    blocks.push([(16.0, 22.0), (-3.0, 3.0), (2.6, 3.0)]);
    World {
        blocks,
        slope: (0.0, 0.0),
    }
}

fn lidars() -> Vec<(&'static str, Lidar)> {
    let pitched = {
        let mut lidar = Lidar::new(32, (-30.67, 10.67), 1084, 1.84);
        let tilt = UnitQuaternion::from_euler_angles(0.03, 0.06, -1.2);
        lidar.vehicle_from_sensor = Isometry3::from_parts(Translation3::new(0.9, 0.0, 1.84), tilt);
        lidar
    };
    vec![
        (
            "64 lines on a car",
            Lidar::new(64, (-24.8, 2.0), 2000, 1.73),
        ),
        (
            "16 lines on a car",
            Lidar::new(16, (-15.0, 15.0), 1800, 1.9),
        ),
        (
            "16 lines on a robot",
            Lidar::new(16, (-15.0, 15.0), 900, 0.6),
        ),
        ("32 lines, tilted and turned", pitched),
    ]
}

/// Drives along x at 5 m/s for a while, ten sweeps a second; the world may change by time in seconds.
fn drive(
    mapper: &mut Mapper,
    lidar: &Lidar,
    sweeps: u32,
    world_at: impl Fn(f64) -> World,
) -> Pose2 {
    let mut pose = Pose2::default();
    for sweep in 0..sweeps {
        let time_s = f64::from(sweep) / 10.0;
        pose = Pose2::new(5.0 * time_s, 0.0, 0.0);
        let points = lidar.sweep(&world_at(time_s), &pose);
        mapper
            .add_points(
                &points,
                lidar.place(),
                &pose,
                u64::from(sweep) * 100_000_000,
            )
            .unwrap();
    }
    pose
}

fn mapper() -> Mapper {
    Mapper::new(&IngestConfig::default()).unwrap()
}

/// Occupied places in the world, metres.
fn occupied(occupancy: &Occupancy, pose: &Pose2) -> Vec<(f64, f64)> {
    let spec = &occupancy.spec;
    (0..spec.len())
        .filter(|index| occupancy.cells[*index] == OCCUPIED)
        .map(|index| {
            let (x_m, y_m) = spec.centre_of(spec.cell_of_index(index));
            let place = pose.then(&Pose2::new(x_m, y_m, 0.0));
            (place.x_m, place.y_m)
        })
        .collect()
}

fn value_at(occupancy: &Occupancy, pose: &Pose2, (x_m, y_m): (f64, f64)) -> i8 {
    let place = pose.inverse().then(&Pose2::new(x_m, y_m, 0.0));
    occupancy
        .get(occupancy.spec.cell_at(place.x_m, place.y_m))
        .unwrap()
}

/// Asserts that nothing is occupied but blocks.
fn assert_no_clutter(name: &str, world: &World, occupancy: &Occupancy, pose: &Pose2) {
    for (x_m, y_m) in occupied(occupancy, pose) {
        let away_m = world.distance_m(x_m, y_m, 2.2);
        assert!(
            away_m < 0.35,
            "{name}: ({x_m:.1}, {y_m:.1}) is {away_m:.2} m from anything"
        );
    }
}

#[test]
fn cars_walls_and_poles_are_where_they_are_for_every_lidar() {
    let world = street();
    for (name, lidar) in lidars() {
        let mut mapper = mapper();
        let pose = drive(&mut mapper, &lidar, 10, |_| world.clone());
        let occupancy = mapper.occupancy();
        assert_no_clutter(name, &world, &occupancy, &pose);
        let found = occupied(&occupancy, &pose);
        let near = |block: &Block| {
            let only = World {
                blocks: vec![*block],
                slope: (0.0, 0.0),
            };
            found
                .iter()
                .filter(|(x_m, y_m)| only.distance_m(*x_m, *y_m, 9.0) < 0.3)
                .count()
        };
        for block in &world.blocks[2..7] {
            assert!(
                near(block) >= 6,
                "{name}: {} cells of the car {block:?}",
                near(block)
            );
        }
        assert!(near(&world.blocks[7]) >= 1, "{name}: no pole");
        assert!(
            near(&world.blocks[0]) >= 100 && near(&world.blocks[1]) >= 100,
            "{name}: no walls"
        );
        for x_m in 5..25 {
            assert_eq!(
                value_at(&occupancy, &pose, (f64::from(x_m), 0.0)),
                FREE,
                "{name}: {x_m}"
            );
        }
    }
}

#[test]
fn hills_and_banks_are_ground() {
    for slope in [(0.1, 0.0), (-0.1, 0.0), (0.04, 0.06), (0.0, -0.08)] {
        for (name, lidar) in lidars() {
            let world = World {
                blocks: Vec::new(),
                slope,
            };
            let mut mapper = mapper();
            let pose = drive(&mut mapper, &lidar, 5, |_| world.clone());
            let found = occupied(&mapper.occupancy(), &pose);
            assert!(
                found.is_empty(),
                "{name} on {slope:?}: {} cells",
                found.len()
            );
        }
    }
}

#[test]
fn the_foot_of_a_hill_ahead_is_ground() {
    // A wedge cannot be made of blocks, so the hill is many low steps: 8 % from 12 m on.
    let steps = (0..900).map(|step| {
        let from_m = 12.0 + f64::from(step) * 0.1;
        [
            (from_m, from_m + 0.1),
            (-40.0, 40.0),
            (-1.0, f64::from(step) * 0.008),
        ]
    });
    let world = World {
        blocks: steps.collect(),
        slope: (0.0, 0.0),
    };
    for (name, lidar) in &lidars()[..1] {
        let mut mapper = mapper();
        mapper
            .add_points(
                &lidar.sweep(&world, &Pose2::default()),
                lidar.place(),
                &Pose2::default(),
                0,
            )
            .unwrap();
        let found = occupied(&mapper.occupancy(), &Pose2::default());
        assert!(
            found.is_empty(),
            "{name}: {} cells, the first at {:?}",
            found.len(),
            found[0]
        );
    }
}

#[test]
fn what_drives_ahead_leaves_no_trail() {
    let ahead = |time_s: f64| World {
        blocks: vec![car(10.0 + 9.0 * time_s, -0.9)],
        slope: (0.0, 0.0),
    };
    for (name, lidar) in lidars() {
        let mut mapper = mapper();
        let pose = drive(&mut mapper, &lidar, 15, ahead);
        let now = ahead(1.4);
        let found = occupied(&mapper.occupancy(), &pose);
        assert!(found.len() >= 4, "{name}: the car is lost");
        for (x_m, y_m) in found {
            let away_m = now.distance_m(x_m, y_m, 9.0);
            assert!(
                away_m < 1.5,
                "{name}: a trail at ({x_m:.1}, {y_m:.1}), {away_m:.1} m behind"
            );
        }
    }
}

#[test]
fn the_vehicles_own_returns_are_left_out() {
    let lidar = &lidars()[0].1;
    let mut points = lidar.sweep(&World::default(), &Pose2::default());
    points.extend((0..200).map(|step| {
        [
            3.0 - 0.01 * f32::from(i16::try_from(step).unwrap()),
            0.9,
            0.9,
        ]
    }));
    points.extend([[-0.7, 0.9, 1.2]; 50]);
    let mut mapper = mapper();
    mapper
        .add_points(&points, lidar.place(), &Pose2::default(), 0)
        .unwrap();
    let occupancy = mapper.occupancy();
    assert_eq!(occupied(&occupancy, &Pose2::default()), []);
    assert_eq!(value_at(&occupancy, &Pose2::default(), (1.0, 0.5)), FREE);
}

#[test]
fn single_returns_in_the_air_and_below_the_ground_are_noise() {
    let lidar = &lidars()[0].1;
    let mut points = lidar.sweep(&World::default(), &Pose2::default());
    points.extend([
        [10.0, 2.0, 1.0],
        [14.0, -3.0, 0.7],
        [9.0, 5.0, -2.5],
        [20.0, 0.0, -0.9],
    ]);
    let mut mapper = mapper();
    mapper
        .add_points(&points, lidar.place(), &Pose2::default(), 0)
        .unwrap();
    assert_eq!(occupied(&mapper.occupancy(), &Pose2::default()), []);
}

#[test]
fn kerbs_are_obstacles_only_where_that_is_wanted() {
    let kerbs = World {
        blocks: vec![
            [(-60.0, 60.0), (3.5, 8.0), (-1.0, 0.14)],
            [(-60.0, 60.0), (-8.0, -3.5), (-1.0, 0.14)],
        ],
        slope: (0.0, 0.0),
    };
    let lidar = &lidars()[0].1;
    for (min_height_m, wanted) in [(0.25, 0), (0.1, 20)] {
        let config = IngestConfig {
            min_height_m,
            ..IngestConfig::default()
        };
        let mut mapper = Mapper::new(&config).unwrap();
        let pose = drive(&mut mapper, lidar, 5, |_| kerbs.clone());
        let found = occupied(&mapper.occupancy(), &pose);
        assert!(
            found.len() >= wanted && (wanted > 0 || found.is_empty()),
            "{} cells",
            found.len()
        );
        for (_, y_m) in found {
            assert!(y_m.abs() > 3.3, "the road at {y_m}");
        }
    }
}

#[test]
fn a_lidar_without_a_known_mounting_still_finds_the_ground() {
    let world = street();
    let real = &lidars()[0].1;
    let mut claimed = real.clone();
    claimed.vehicle_from_sensor = Isometry3::identity();
    let points: Vec<Point> = real
        .sweep(&world, &Pose2::default())
        .iter()
        .map(|[x, y, z]| {
            [
                x - real.place()[0],
                y - real.place()[1],
                z - real.place()[2],
            ]
        })
        .collect();
    let mut mapper = mapper();
    mapper
        .add_points(&points, claimed.place(), &Pose2::default(), 0)
        .unwrap();
    let pose = Pose2::new(0.5, 0.0, 0.0);
    assert_no_clutter("unmounted", &world, &mapper.occupancy(), &pose);
}

#[test]
fn a_cloud_that_is_in_the_vehicles_frame_already_keeps_its_ground() {
    // A ditch beside the road lies below the frame, as the ground below a sensor would.
    let mut world = street();
    world.blocks.truncate(7);
    let lidar = &lidars()[0].1;
    let mut points = lidar.sweep(&world, &Pose2::default());
    points.extend((0u8..100).map(|step| [4.0 + 0.05 * f32::from(step), -2.0, -0.2]));
    let mut mapper = mapper();
    mapper
        .add_points(&points, [0.0; 3], &Pose2::default(), 0)
        .unwrap();
    let occupancy = mapper.occupancy();
    assert_no_clutter("in the frame", &world, &occupancy, &Pose2::default());
    let found = occupied(&occupancy, &Pose2::default());
    assert!(
        found
            .iter()
            .any(|(x_m, y_m)| *x_m < 13.0 && (*y_m - 3.5).abs() < 0.3),
        "no car"
    );
}

#[test]
fn what_is_behind_a_wall_is_unknown() {
    let world = World {
        blocks: vec![[(10.0, 10.5), (-20.0, 20.0), (0.0, 6.0)]],
        slope: (0.0, 0.0),
    };
    let lidar = &lidars()[0].1;
    let mut mapper = mapper();
    mapper
        .add_points(
            &lidar.sweep(&world, &Pose2::default()),
            lidar.place(),
            &Pose2::default(),
            0,
        )
        .unwrap();
    let occupancy = mapper.occupancy();
    assert_eq!(
        value_at(&occupancy, &Pose2::default(), (15.0, 0.0)),
        UNKNOWN
    );
    assert_eq!(value_at(&occupancy, &Pose2::default(), (8.0, 0.0)), FREE);
    assert_eq!(
        value_at(&occupancy, &Pose2::default(), (10.0, 0.0)),
        OCCUPIED
    );
}

#[test]
fn old_sweeps_and_those_before_a_clear_do_not_count() {
    let lidar = &lidars()[1].1;
    let wall = World {
        blocks: vec![[(8.0, 8.5), (-5.0, 5.0), (0.0, 3.0)]],
        slope: (0.0, 0.0),
    };
    let points = lidar.sweep(&wall, &Pose2::default());
    let mut mapper = mapper();
    mapper
        .add_points(&points, lidar.place(), &Pose2::default(), 0)
        .unwrap();
    assert!(!occupied(&mapper.occupancy(), &Pose2::default()).is_empty());
    mapper
        .add_points(&[], lidar.place(), &Pose2::default(), 2_900_000_000)
        .unwrap();
    assert!(!occupied(&mapper.occupancy(), &Pose2::default()).is_empty());
    mapper
        .add_points(&[], lidar.place(), &Pose2::default(), 3_100_000_000)
        .unwrap();
    assert!(occupied(&mapper.occupancy(), &Pose2::default()).is_empty());
    mapper
        .add_points(&points, lidar.place(), &Pose2::default(), 3_200_000_000)
        .unwrap();
    mapper.clear();
    assert!(
        mapper
            .occupancy()
            .cells
            .iter()
            .all(|value| *value == UNKNOWN)
    );
}

/// The beams of a planar lidar in a room, each with an exact range.
fn scan_ends(
    world: &World,
    pose: &Pose2,
    (from_rad, step_rad, beams): (f64, f64, u32),
) -> Vec<BeamEnd> {
    (0..beams)
        .map(|beam| {
            let angle_rad = from_rad + f64::from(beam) * step_rad;
            let heading = pose.yaw_rad + angle_rad;
            let ray = Vector3::new(heading.cos(), heading.sin(), 0.0);
            let range_m = world.range_m(&Point3::new(pose.x_m, pose.y_m, 0.3), &ray);
            let length_m = range_m.unwrap_or(15.0);
            #[expect(clippy::cast_possible_truncation, reason = "coordinates of a point")]
            BeamEnd {
                x_m: (length_m * angle_rad.cos()) as f32,
                y_m: (length_m * angle_rad.sin()) as f32,
                is_hit: range_m.is_some(),
            }
        })
        .collect()
}

#[test]
fn scanners_of_any_angular_range_map_a_room_and_forget_who_walked_through() {
    let room = vec![
        [(-6.0, 14.0), (5.0, 5.3), (0.0, 3.0)],
        [(-6.0, 14.0), (-5.3, -5.0), (0.0, 3.0)],
        [(14.0, 14.3), (-5.0, 5.0), (0.0, 3.0)],
    ];
    for (fan, step_deg) in [
        ((-90.0f64, 1.0f64, 180), 1.0f32),
        ((-135.0, 0.25, 1081), 0.25),
        ((-120.0, 0.36, 667), 0.36),
        ((0.0, 1.0, 360), 1.0),
    ] {
        let fan_rad = (fan.0.to_radians(), fan.1.to_radians(), fan.2);
        let mut mapper = mapper();
        let mut pose = Pose2::default();
        for scan in 0..40u32 {
            let time_s = f64::from(scan) / 10.0;
            pose = Pose2::new(0.5 * time_s, 0.0, 0.0);
            let mut blocks = room.clone();
            let y_m = 4.0 - 2.0 * time_s;
            blocks.push([(7.0, 7.4), (y_m, y_m + 0.5), (0.0, 1.8)]);
            let world = World {
                blocks,
                slope: (0.0, 0.0),
            };
            let ends = scan_ends(&world, &pose, fan_rad);
            mapper
                .add_scan(
                    (&ends, step_deg.to_radians()),
                    (0.0, 0.0),
                    &pose,
                    u64::from(scan) * 100_000_000,
                )
                .unwrap();
        }
        let world = World {
            blocks: room.clone(),
            slope: (0.0, 0.0),
        };
        let occupancy = mapper.occupancy();
        let (mut of_room, mut of_walker) = (0, 0);
        for (x_m, y_m) in occupied(&occupancy, &pose) {
            if world.distance_m(x_m, y_m, 9.0) < 0.3 {
                of_room += 1;
            } else {
                assert!(
                    (y_m + 3.8).abs() < 1.2 && (x_m - 7.2).abs() < 0.5,
                    "{fan:?}: ({x_m}, {y_m})"
                );
                of_walker += 1;
            }
        }
        assert!(
            of_room > 80 && of_walker < 20,
            "{fan:?}: {of_room} and {of_walker} cells"
        );
        assert_eq!(value_at(&occupancy, &pose, (10.0, 0.0)), FREE);
        assert_eq!(value_at(&occupancy, &pose, (16.0, 0.0)), UNKNOWN);
    }
}

#[test]
fn a_pose_that_cannot_be_worked_with_is_an_error() {
    let mut mapper = mapper();
    for pose in [Pose2::new(f64::NAN, 0.0, 0.0), Pose2::new(0.0, 1e300, 0.0)] {
        assert!(mapper.add_points(&[], [0.0; 3], &pose, 0).is_err());
        assert!(mapper.add_scan((&[], 0.01), (0.0, 0.0), &pose, 0).is_err());
    }
}

#[test]
fn the_same_sweeps_give_the_same_grid() {
    let lidar = &lidars()[1].1;
    let run = || {
        let mut mapper = mapper();
        drive(&mut mapper, lidar, 4, |_| street());
        mapper.occupancy()
    };
    assert_eq!(run(), run());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn no_points_sizes_or_stamps_panic(
        points in proptest::collection::vec((any::<f32>(), any::<f32>(), any::<f32>()), 0..60),
        near in proptest::collection::vec((-60.0..60.0f32, -60.0..60.0f32, -3.0..9.0f32), 0..60),
        sensor in (-5.0..5.0f32, -5.0..5.0f32, -2.0..5.0f32),
        (x_m, y_m, yaw_rad) in (-1e7..1e7f64, -1e7..1e7f64, -4.0..4.0f64),
        stamps in proptest::collection::vec(any::<u64>(), 1..4),
        (rows, cols, resolution_m) in (1u32..300, 1u32..300, 0.01..10.0f64),
    ) {
        let spec = GridSpec { rows, cols, resolution_m, ego_row: rows / 2, ego_col: cols / 2 };
        let mut mapper = Mapper::new(&IngestConfig { spec, ..IngestConfig::default() }).unwrap();
        let points: Vec<Point> = points.iter().chain(&near).map(|(x, y, z)| [*x, *y, *z]).collect();
        let ends: Vec<BeamEnd> =
            points.iter().map(|[x_m, y_m, z]| BeamEnd { x_m: *x_m, y_m: *y_m, is_hit: *z > 0.0 }).collect();
        for stamp_nanos in stamps {
            let pose = Pose2::new(x_m, y_m, yaw_rad);
            mapper.add_points(&points, [sensor.0, sensor.1, sensor.2], &pose, stamp_nanos).unwrap();
            prop_assert_eq!(mapper.occupancy().cells.len(), spec.len());
            mapper.add_scan((&ends, sensor.2), (sensor.0, sensor.1), &pose, stamp_nanos).unwrap();
            prop_assert_eq!(mapper.occupancy().cells.len(), spec.len());
        }
    }
}
