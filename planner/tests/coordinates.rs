//! Coordinate frames between real sessions: grids, targets and references in the vehicle's frame, in the
//! odometry's and beyond, all of one world of boxes whose truth is known here.

use std::f64::consts::FRAC_PI_2;

use surroundings::{Moment, Surroundings, config, soon, transform};
use swath_bridge::msg::geometry::{Point, Pose, Quaternion};
use swath_bridge::msg::header::Header;
use swath_bridge::msg::nav::{MapMetaData, OccupancyGrid, Path};
use swath_bridge::msg::tf2::TFMessage;
use swath_bridge::poses::{pose_of_ros, poses_of_path, ros_pose};
use swath_bridge::{Pose2, Vehicle, keys};
use swath_planner::Method;
use swath_planner::network::{Network, NetworkInfo, Parameters};
use swath_planner::node::{FramesConfig, NodeConfig, ServedNetwork};
use swath_planner::report::pose_of_planar;

mod surroundings;

/// Boxes of the world, in `odom`: ranges of x and y, metres.
const BOXES: [[f64; 4]; 4] = [
    // Across the straight way to the target, with room on both sides.
    [26.0, 28.0, 2.0, 6.0],
    [33.0, 34.0, 14.0, 20.0],
    [10.0, 14.0, 2.0, 5.0],
    [20.0, 30.0, -9.0, -5.0],
];
/// A street along the vehicle's way in the vehicle's frame: its sides, which leave little choice.
const STREET: [[f64; 4]; 3] = [
    [-6.0, 40.0, 1.8, 3.0],
    [-6.0, 40.0, -3.0, -1.8],
    [42.0, 44.0, -6.0, 6.0],
];
/// Where the vehicle stands in `odom`, turned by 40°.
const ODOM_FROM_VEHICLE: Pose2 = Pose2::new(12.0, -7.0, 0.698_131_700_8);
/// Where `odom` is in `map`.
const MAP_FROM_ODOM: Pose2 = Pose2::new(140.0, -65.0, -1.1);
/// The target in the vehicle's frame.
const TARGET: Pose2 = Pose2::new(30.0, 0.0, 0.0);
/// Side of the grids' cells, metres.
const CELL_M: f64 = 0.2;
const CELLS: u32 = 500;

/// Whether a point of the world is in a box.
type IsIn<'a> = &'a dyn Fn(&Pose2) -> bool;

fn is_in(boxes: &[[f64; 4]], point: &Pose2) -> bool {
    let holds = |&[x0, x1, y0, y1]: &[f64; 4]| {
        (x0..=x1).contains(&point.x_m) && (y0..=y1).contains(&point.y_m)
    };
    boxes.iter().any(holds)
}

fn is_in_boxes(in_odom: &Pose2) -> bool {
    is_in(&BOXES, in_odom)
}

fn is_in_street(in_odom: &Pose2) -> bool {
    is_in(&STREET, &ODOM_FROM_VEHICLE.inverse().then(in_odom))
}

/// A square grid of the world in a frame, of which `corner` is the pose of its first corner: a cell is
/// occupied if one of many points in it is in a box.
fn grid_of(world: IsIn<'_>, frame: &str, odom_from_frame: &Pose2, corner: &Pose2) -> OccupancyGrid {
    let mut data = Vec::new();
    let odom_from_corner = odom_from_frame.then(corner);
    let points = [0.02, 0.25, 0.5, 0.75, 0.98];
    for row in 0..CELLS {
        for col in 0..CELLS {
            let occupied = points.iter().any(|x| {
                points.iter().any(|y| {
                    let x_m = (f64::from(col) + x) * CELL_M;
                    let y_m = (f64::from(row) + y) * CELL_M;
                    world(&odom_from_corner.then(&Pose2::new(x_m, y_m, 0.0)))
                })
            });
            data.push(if occupied { 100 } else { 0 });
        }
    }
    let header = Header::at(0, frame);
    OccupancyGrid {
        info: MapMetaData {
            map_load_time: header.stamp.clone(),
            resolution: 0.2,
            width: CELLS,
            height: CELLS,
            origin: ros_pose(corner),
        },
        header,
        data,
    }
}

/// A grid of the world in a frame whose axes it is along, around the vehicle.
fn grid_around(world: IsIn<'_>, frame: &str, odom_from_frame: &Pose2) -> OccupancyGrid {
    let middle = odom_from_frame.inverse().then(&ODOM_FROM_VEHICLE);
    let half_m = f64::from(CELLS) * CELL_M / 2.0;
    // Where cells of no frame lie on cells of another.
    let corner = Pose2::new(middle.x_m - half_m + 0.07, middle.y_m - half_m - 0.03, 0.0);
    grid_of(world, frame, odom_from_frame, &corner)
}

/// Every point of the vehicle's rectangle that is in a box, at every pose of a path in `odom`.
fn collisions(world: IsIn<'_>, path: &[Pose2]) -> Vec<Pose2> {
    let vehicle = Vehicle::default();
    let length_m = vehicle.front_m + vehicle.rear_m;
    let mut found = Vec::new();
    for pose in path {
        for along in 0..=20 {
            for across in 0..=10 {
                let x_m = f64::from(along) / 20.0 * length_m - vehicle.rear_m;
                let y_m = (f64::from(across) / 5.0 - 1.0) * vehicle.half_width_m;
                let point = pose.then(&Pose2::new(x_m, y_m, 0.0));
                if world(&point) {
                    found.push(point);
                }
            }
        }
    }
    found
}

fn assert_in_frame(path: &Path, frame: &str) {
    assert_eq!(path.header.frame_id, frame);
    for pose in &path.poses {
        assert_eq!(pose.header, path.header);
    }
}

fn in_frame(poses: &[Pose2], frame_from: &Pose2) -> Vec<Pose2> {
    poses.iter().map(|pose| frame_from.then(pose)).collect()
}

/// The greatest distance of a point of one path from the other.
fn apart_m(one: &[Pose2], other: &[Pose2]) -> f64 {
    let nearest = |pose: &Pose2| {
        let distances = other.iter().map(|candidate| candidate.distance_m(pose));
        distances.fold(f64::INFINITY, f64::min)
    };
    one.iter().map(nearest).fold(0.0, f64::max)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_path_on_a_grid_in_odom_is_in_odom_and_free_of_the_worlds_obstacles() {
    let mut node = Surroundings::start(config(), None).await;
    let target = ODOM_FROM_VEHICLE.then(&TARGET);
    let moment = Moment {
        grid: Some(grid_around(&is_in_boxes, "odom", &Pose2::default())),
        odometry: Some(ODOM_FROM_VEHICLE),
        targets: Some(("odom", vec![target])),
        ..Moment::default()
    };
    let (report, path) = node.plan(&moment, |report| report.chosen == 0).await;
    assert_in_frame(&path, "odom");
    let poses = poses_of_path(&path);
    assert!(
        poses[0].distance_m(&ODOM_FROM_VEHICLE) < 1e-6,
        "{:?}",
        poses[0]
    );
    assert!((poses[0].yaw_rad - ODOM_FROM_VEHICLE.yaw_rad).abs() < 1e-6);
    assert!(poses[poses.len() - 1].distance_m(&target) < 0.6);
    assert_eq!(collisions(&is_in_boxes, &poses), []);
    // The straight way is not free, or the test could not fail.
    let straight: Vec<Pose2> = (0..150)
        .map(|k| ODOM_FROM_VEHICLE.then(&Pose2::new(0.2 * f64::from(k), 0.0, 0.0)))
        .collect();
    assert!(!collisions(&is_in_boxes, &straight).is_empty());
    // The report is in the same frame.
    assert_eq!(report.header, path.header);
    assert!(pose_of_planar(&report.targets[0].goal).distance_m(&target) < 1e-5);
    assert!(pose_of_planar(&report.start).distance_m(&ODOM_FROM_VEHICLE) < 1e-5);
    for (reported, pose) in report.targets[0].path.iter().zip(&poses) {
        assert!(pose_of_planar(reported).distance_m(pose) < 1e-5);
    }
    assert_eq!((report.reason.as_str(), report.detail.as_str()), ("", ""));
    node.end().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn one_world_gives_one_path_in_whatever_frames_it_is_given() {
    let mut node = Surroundings::start(config(), None).await;
    let from_odom = |frame: &str| match frame {
        "odom" => Pose2::default(),
        "map" => MAP_FROM_ODOM.inverse(),
        _ => ODOM_FROM_VEHICLE,
    };
    let mut in_odom: Vec<Vec<Pose2>> = Vec::new();
    // Grid, targets and reference: in one frame, and each in another.
    for (grid, targets, reference) in [
        ("base_link", "base_link", "base_link"),
        ("odom", "odom", "odom"),
        ("map", "map", "map"),
        ("odom", "base_link", "map"),
        ("/map", "odom", "base_link"),
        ("", "map", "/odom"),
    ] {
        let plain = |frame: &'static str| frame.trim_start_matches('/');
        let odom_from = |frame: &'static str| from_odom(plain(frame));
        let placed = |frame: &'static str, pose: &Pose2| {
            odom_from(frame)
                .inverse()
                .then(&ODOM_FROM_VEHICLE.then(pose))
        };
        let road = (0..40).map(|k| placed(reference, &Pose2::new(f64::from(k), 0.0, 0.0)));
        let moment = Moment {
            grid: Some(grid_around(&is_in_street, grid, &odom_from(grid))),
            odometry: Some(ODOM_FROM_VEHICLE),
            transforms: vec![("map", "odom", MAP_FROM_ODOM)],
            targets: Some((targets, vec![placed(targets, &TARGET)])),
            reference: Some((reference, road.collect())),
        };
        let (_, path) = node
            .plan(&moment, |report| {
                let goal = report
                    .targets
                    .first()
                    .map(|target| pose_of_planar(&target.goal));
                report.chosen == 0
                    && goal.is_some_and(|goal| goal.distance_m(&placed(grid, &TARGET)) < 1e-4)
            })
            .await;
        assert_in_frame(&path, grid);
        let poses = in_frame(&poses_of_path(&path), &odom_from(grid));
        assert_eq!(collisions(&is_in_street, &poses), [], "{grid:?}");
        in_odom.push(poses);
    }
    for other in &in_odom[1..] {
        let apart_m = apart_m(&in_odom[0], other).max(apart_m(other, &in_odom[0]));
        assert!(apart_m < 2.0 * CELL_M, "{apart_m} m");
    }
    node.end().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_grid_whose_origin_is_turned_is_seen_as_it_lies() {
    let mut node = Surroundings::start(config(), None).await;
    let corner = Pose2::new(12.0 + 60.0, -7.0 - 40.0, FRAC_PI_2 + 0.3);
    let target = ODOM_FROM_VEHICLE.then(&TARGET);
    let moment = Moment {
        grid: Some(grid_of(&is_in_boxes, "odom", &Pose2::default(), &corner)),
        odometry: Some(ODOM_FROM_VEHICLE),
        targets: Some(("odom", vec![target])),
        ..Moment::default()
    };
    let (_, path) = node.plan(&moment, |report| report.chosen == 0).await;
    let poses = poses_of_path(&path);
    assert!(poses[poses.len() - 1].distance_m(&target) < 0.6);
    assert_eq!(collisions(&is_in_boxes, &poses), []);
    // One that is tilted is refused.
    let mut tilted = moment.clone();
    tilted.grid.as_mut().unwrap().info.origin.orientation.x = 0.9;
    let refused = |report: &swath_bridge::msg::swath::PlanReport| report.reason == "bad input";
    // The path lasts until it expires; then the reason is that no grid can be used.
    let mut grid = tilted.grid.clone().unwrap();
    let report = soon(async {
        loop {
            node.stamp += 100_000_000;
            grid.header.stamp = Header::at(node.stamp, "").stamp;
            node.grids.put(&grid).await.unwrap();
            let report = node.next_report(|_| true).await;
            if refused(&report) {
                return report;
            }
        }
    })
    .await;
    assert!(report.detail.contains("tilted by"), "{}", report.detail);
    node.end().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_frame_that_nothing_joins_with_the_vehicle_stops_it_and_is_named() {
    let mut node = Surroundings::start(config(), None).await;
    let free = |_: &Pose2| false;
    let good = Moment {
        grid: Some(grid_around(&free, "odom", &Pose2::default())),
        odometry: Some(ODOM_FROM_VEHICLE),
        targets: Some(("odom", vec![ODOM_FROM_VEHICLE.then(&TARGET)])),
        ..Moment::default()
    };
    let with_grid = |frame: &str| {
        let mut moment = good.clone();
        frame.clone_into(&mut moment.grid.as_mut().unwrap().header.frame_id);
        moment
    };
    let with_targets = Moment {
        targets: Some(("venus", vec![TARGET])),
        ..good.clone()
    };
    let with_reference = Moment {
        reference: Some(("pluto", vec![Pose2::default(), TARGET])),
        ..good.clone()
    };
    for (moment, topic, frame) in [
        (with_grid("mars"), "grid", "mars"),
        (with_targets, "targets", "venus"),
        (with_reference, "reference", "pluto"),
    ] {
        // A path first, so that something is withdrawn.
        node.plan(&good, |report| report.chosen == 0).await;
        let said = format!("{topic}: no transform from {frame:?} to \"base_link\"");
        let (report, path) = node
            .plan(&moment, |report| report.detail.starts_with(&said))
            .await;
        assert_eq!(report.reason, "no transform");
        assert!(path.poses.is_empty());
        assert_eq!(
            (report.frame, report.chosen, report.targets.len()),
            (0, -1, 0)
        );
        assert!(report.method.is_empty() && report.latency_ms.is_nan());
        let counted = report
            .rejected
            .iter()
            .any(|one| (one.topic.as_str(), one.cause.as_str()) == (topic, "no transform"));
        assert!(counted, "{:?}", report.rejected);
    }
    node.end().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_grid_in_odom_without_odometry_says_so() {
    let mut node = Surroundings::start(config(), None).await;
    let free = |_: &Pose2| false;
    let without = Moment {
        grid: Some(grid_around(&free, "odom", &Pose2::default())),
        targets: Some(("odom", vec![ODOM_FROM_VEHICLE.then(&TARGET)])),
        ..Moment::default()
    };
    let (report, path) = node.plan(&without, |report| report.frame == 0).await;
    assert_eq!(report.reason, "no odometry");
    assert!(
        report.detail.contains("no odometry has come"),
        "{}",
        report.detail
    );
    assert!(path.poses.is_empty());
    let with = Moment {
        odometry: Some(ODOM_FROM_VEHICLE),
        ..without.clone()
    };
    node.plan(&with, |report| report.chosen == 0).await;
    // Odometry stops: after half a second what it said no longer holds.
    let (report, _) = node
        .plan(&without, |report| report.reason == "no odometry")
        .await;
    assert!(
        report.detail.contains("older than the grid"),
        "{}",
        report.detail
    );
    // Transforms alone do as well.
    let by_tf = Moment {
        transforms: vec![("odom", "base_link", ODOM_FROM_VEHICLE)],
        ..without.clone()
    };
    node.plan(&by_tf, |report| report.chosen == 0).await;
    node.end().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_given_in_odom_stays_there_while_the_vehicle_moves() {
    let mut node = Surroundings::start(config(), None).await;
    let free = |_: &Pose2| false;
    // In the vehicle's frame, so that all is seen through the moving vehicle.
    let mut grid = grid_around(&free, "base_link", &ODOM_FROM_VEHICLE);
    grid.header.frame_id = "base_link".to_owned();
    let road: Vec<Pose2> = (0..160)
        .map(|k| Pose2::new(f64::from(k), 0.0, 0.0))
        .collect();
    // It is given once; the node keeps it.
    let mut given = Moment {
        grid: Some(grid.clone()),
        odometry: Some(Pose2::default()),
        reference: Some(("odom", road)),
        ..Moment::default()
    };
    node.plan(&given, |report| report.chosen >= 0).await;
    given.reference = None;
    for pose in [
        Pose2::new(6.0, 0.5, 0.1),
        Pose2::new(14.0, 2.0, 0.3),
        Pose2::new(22.0, -1.0, -0.4),
    ] {
        let moment = Moment {
            odometry: Some(pose),
            ..given.clone()
        };
        // Targets are sampled along the reference in steps of 1.75 m to its sides.
        let is_on_road = |report: &swath_bridge::msg::swath::PlanReport| {
            let goals = report
                .targets
                .iter()
                .map(|target| pose_of_planar(&target.goal));
            let mut in_odom = goals.map(|goal| pose.then(&goal));
            report.targets.len() == 3
                && in_odom.all(|goal| {
                    let rows = goal.y_m / 1.75;
                    (rows - rows.round()).abs() < 1e-4 && goal.yaw_rad.abs() < 1e-4
                })
        };
        node.plan(&moment, is_on_road).await;
    }
    // The same with targets, which come before the reference.
    let goals = vec![Pose2::new(50.0, 1.0, 0.0), Pose2::new(55.0, -2.0, 0.2)];
    given.targets = Some(("odom", goals.clone()));
    node.plan(&given, |report| report.targets.len() == 2).await;
    given.targets = None;
    let pose = Pose2::new(30.0, 3.0, -0.2);
    let moment = Moment {
        odometry: Some(pose),
        ..given.clone()
    };
    let stays = |report: &swath_bridge::msg::swath::PlanReport| {
        let pairs = report.targets.iter().zip(&goals);
        let mut found =
            pairs.map(|(target, goal)| pose.then(&pose_of_planar(&target.goal)).distance_m(goal));
        found.all(|apart_m| apart_m < 1e-4)
    };
    node.plan(&moment, stays).await;
    node.end().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn transforms_that_are_late_doubled_looped_damaged_or_far_too_many_do_no_harm() {
    let mut node = Surroundings::start(config(), None).await;
    let free = |_: &Pose2| false;
    let good = Moment {
        grid: Some(grid_around(&free, "map", &MAP_FROM_ODOM.inverse())),
        odometry: Some(ODOM_FROM_VEHICLE),
        transforms: vec![("map", "odom", MAP_FROM_ODOM)],
        targets: Some(("odom", vec![ODOM_FROM_VEHICLE.then(&TARGET)])),
        ..Moment::default()
    };
    let target = MAP_FROM_ODOM.then(&ODOM_FROM_VEHICLE.then(&TARGET));
    let is_right = |report: &swath_bridge::msg::swath::PlanReport| {
        let goal = report
            .targets
            .first()
            .map(|target| pose_of_planar(&target.goal));
        report.chosen == 0 && goal.is_some_and(|goal| goal.distance_m(&target) < 1e-3)
    };
    node.plan(&good, is_right).await;
    let elsewhere = Pose2::new(-3.0, 900.0, 2.0);
    let stamp = node.stamp;
    let nan = Pose2::new(f64::NAN, 0.0, 0.0);
    let flood = |from: u32| {
        let names = (from..from + 10_000).map(|k| format!("junk{k}"));
        names
            .map(|name| transform(stamp, "map", &name, &elsewhere))
            .collect::<Vec<_>>()
    };
    for transforms in [
        // Late: from before what is known.
        vec![transform(stamp - 900_000_000, "map", "odom", &elsewhere)],
        // Doubled: another value at a time that is known.
        vec![transform(stamp, "map", "odom", &elsewhere)],
        // Loops: one of their own, and one that the odometry's frame hangs in.
        vec![
            transform(stamp, "a", "b", &elsewhere),
            transform(stamp, "b", "a", &elsewhere),
            transform(stamp, "c", "c", &elsewhere),
            transform(stamp, "base_link", "map", &elsewhere),
        ],
        // Damaged.
        vec![
            transform(stamp + 1, "map", "odom", &nan),
            transform(stamp + 1, "", "odom", &elsewhere),
            transform(stamp + 1, "map", "", &elsewhere),
        ],
        flood(0),
        flood(10_000),
    ] {
        node.tf.put(&TFMessage { transforms }).await.unwrap();
        node.plan(&good, is_right).await;
    }
    // A grid in a frame of the loop is refused.
    let mut looped = good.clone();
    looped.grid.as_mut().unwrap().header.frame_id = "b".to_owned();
    looped.transforms = vec![("a", "b", elsewhere), ("b", "a", elsewhere)];
    let (report, _) = node
        .plan(&looped, |report| report.detail.contains("form a loop"))
        .await;
    assert_eq!(report.reason, "no transform");
    let mut causes: Vec<&str> = report
        .rejected
        .iter()
        .filter(|one| one.topic == "tf")
        .map(|one| one.cause.as_str())
        .collect();
    causes.sort_unstable();
    assert_eq!(
        causes,
        [
            "a frame is its own parent",
            "a transform has a frame without a name",
            "a transform is not finite or has no rotation",
        ]
    );
    node.end().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_transform_that_tilts_is_refused() {
    let mut node = Surroundings::start(config(), None).await;
    let free = |_: &Pose2| false;
    let mut moment = Moment {
        grid: Some(grid_around(&free, "wall", &Pose2::default())),
        odometry: Some(ODOM_FROM_VEHICLE),
        targets: Some(("odom", vec![ODOM_FROM_VEHICLE.then(&TARGET)])),
        ..Moment::default()
    };
    let mut tilted = transform(0, "odom", "wall", &Pose2::default());
    let half = std::f64::consts::FRAC_PI_4;
    tilted.transform.rotation = Quaternion {
        x: half.sin(),
        y: 0.0,
        z: 0.0,
        w: half.cos(),
    };
    let transforms = vec![tilted];
    node.tf.put(&TFMessage { transforms }).await.unwrap();
    let (report, path) = node
        .plan(&moment, |report| report.detail.contains("tilts"))
        .await;
    assert_eq!(report.reason, "no transform");
    assert!(report.detail.contains("90 degrees") && path.poses.is_empty());
    moment.grid.as_mut().unwrap().header.frame_id = "odom".to_owned();
    node.plan(&moment, |report| report.chosen == 0).await;
    node.end().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn the_vehicles_frame_can_be_named() {
    let named = NodeConfig {
        frames: FramesConfig {
            vehicle: "/chassis".to_owned(),
            ..FramesConfig::default()
        },
        ..config()
    };
    let mut node = Surroundings::start(named, None).await;
    let free = |_: &Pose2| false;
    // The chassis is 1 m behind what the odometry is of.
    let base_from_chassis = Pose2::new(-1.0, 0.0, 0.0);
    let moment = Moment {
        grid: Some(grid_around(&free, "odom", &Pose2::default())),
        odometry: Some(ODOM_FROM_VEHICLE),
        transforms: vec![("base_link", "chassis", base_from_chassis)],
        targets: Some(("chassis", vec![TARGET])),
        ..Moment::default()
    };
    let chassis = ODOM_FROM_VEHICLE.then(&base_from_chassis);
    let (report, path) = node.plan(&moment, |report| report.chosen == 0).await;
    let goal = pose_of_planar(&report.targets[0].goal);
    assert!(goal.distance_m(&chassis.then(&TARGET)) < 1e-5);
    let first = pose_of_ros(&path.poses[0].pose);
    assert!(first.distance_m(&chassis) < 1e-6, "{first:?}");
    node.end().await;
}

#[tokio::test(flavor = "multi_thread")]
async fn regions_lie_where_they_were_predicted_in_the_grids_frame() {
    let info = NetworkInfo::default();
    let parameters = Parameters::initial(info.architecture, 1);
    let network = ServedNetwork {
        network: Network::load(&Network::save(&info, &parameters)).unwrap(),
        run: String::new(),
        version: 0,
        stamp_nanos: 0,
    };
    let mut in_regions = config();
    in_regions.plan.method = Method::TievFcn;
    let mut node = Surroundings::start(in_regions, Some(network)).await;
    let topic = keys::region(surroundings::VEHICLE);
    let mut regions = node.session.subscriber(&topic, 16).await.unwrap();
    let moment = Moment {
        grid: Some(grid_around(
            &|_: &Pose2| false,
            "map",
            &MAP_FROM_ODOM.inverse(),
        )),
        odometry: Some(ODOM_FROM_VEHICLE),
        transforms: vec![("map", "odom", MAP_FROM_ODOM)],
        targets: Some(("base_link", vec![TARGET])),
        ..Moment::default()
    };
    let region = soon(async {
        loop {
            node.plan(&moment, |report| report.method == "tiev-fcn")
                .await;
            if let Some(region) = regions.try_recv() {
                return region.message;
            }
        }
    })
    .await;
    assert_eq!(region.header.frame_id, "map");
    // The corner of the vehicle's grid: 20.1 m behind the vehicle and 15.1 m to its right.
    let corner = MAP_FROM_ODOM.then(&ODOM_FROM_VEHICLE.then(&Pose2::new(-20.1, -15.1, 0.0)));
    let origin = pose_of_ros(&region.info.origin);
    assert!(origin.distance_m(&corner) < 1e-6 && (origin.yaw_rad - corner.yaw_rad).abs() < 1e-6);
    node.end().await;
}

/// Poses of a message that are no poses.
fn bad_pose() -> Pose {
    Pose {
        position: Point {
            x: f64::NAN,
            y: 0.0,
            z: 0.0,
        },
        ..ros_pose(&Pose2::default())
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn bad_messages_are_counted_by_topic_and_cause() {
    let mut node = Surroundings::start(config(), None).await;
    let free = |_: &Pose2| false;
    let grid = grid_around(&free, "base_link", &ODOM_FROM_VEHICLE);
    let raw = node
        .session
        .raw_publisher("swath/vehicle/v0/odom", keys::Qos::Lossy)
        .await
        .unwrap();
    soon(raw.wait_for_subscribers()).await.unwrap();
    raw.put(vec![0, 1, 0, 0, 7]).await.unwrap();
    for (speed_m_per_s, x_m) in [(500.0, 0.0), (1.0, f64::NAN), (1.0, f64::NAN)] {
        let mut odometry = surroundings::odometry_of(node.stamp, &Pose2::new(x_m, 0.0, 0.0));
        odometry.twist.twist.linear.x = speed_m_per_s;
        node.odometry.put(&odometry).await.unwrap();
    }
    let poses = vec![bad_pose(), ros_pose(&TARGET)];
    let header = Header::at(1, "base_link");
    let targets = swath_bridge::msg::geometry::PoseArray { header, poses };
    node.targets.put(&targets).await.unwrap();
    let moment = Moment {
        grid: Some(grid.clone()),
        ..Moment::default()
    };
    let expected = [
        ("odom", "it does not decode", 1),
        ("odom", "no car moves so", 1),
        ("odom", "the pose or the motion is not finite", 2),
        ("targets", "it has poses that are not finite", 1),
    ];
    let counts = |report: &swath_bridge::msg::swath::PlanReport| {
        let counts = report.rejected.iter();
        let mut counts: Vec<(String, String, u64)> = counts
            .map(|one| (one.topic.clone(), one.cause.clone(), one.messages))
            .collect();
        counts.sort();
        counts
    };
    let expected: Vec<_> = expected
        .map(|(topic, cause, messages)| (topic.to_owned(), cause.to_owned(), messages))
        .into();
    let (report, _) = node
        .plan(&moment, |report| {
            report.chosen == 0 && counts(report) == expected
        })
        .await;
    assert_eq!(report.targets.len(), 1);
    let summary = node.end().await;
    assert_eq!(summary.rejected, 5);
    assert_eq!(summary.rejections, report.rejected);
}
