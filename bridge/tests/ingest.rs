//! Logs to frames and grids: logs built here, and the real ones where they are at hand.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::{Path, PathBuf};

use swath_bridge::ingest::{
    GridsOut, IngestConfig, MAX_PICTURES, Mount, SensorKind, frames, write_grids,
};
use swath_bridge::msg::geometry::{
    Point, Pose, PoseWithCovariance, Quaternion, Transform, TransformStamped, Twist,
    TwistWithCovariance, Vector3,
};
use swath_bridge::msg::header::Header;
use swath_bridge::msg::nav::{OccupancyGrid, Odometry};
use swath_bridge::msg::sensor::{LaserScan, PointCloud2, PointField};
use swath_bridge::msg::tf2::TFMessage;
use swath_bridge::recording::{Existing, Reader, Stamps, Writer};
use swath_bridge::{Error, FREE, Frame, GridSpec, OCCUPIED, Occupancy};

const START_NANOS: u64 = 1_700_000_000_000_000_000;
const STEP_NANOS: u64 = 100_000_000;

/// A synthetic log: a vehicle drives along x at 5 m/s towards a wall at x = 30 m.
#[derive(Debug, Clone, Copy)]
struct Log {
    steps: u32,
    has_odometry: bool,
    has_mounting: bool,
    /// Whether headers have stamps; else they are 0 and only the times of recording tell.
    has_stamps: bool,
    /// Odometry jumps 100 m aside behind this step.
    jump_at: u32,
}

const PLAIN: Log = Log {
    steps: 20,
    has_odometry: true,
    has_mounting: true,
    has_stamps: true,
    jump_at: u32::MAX,
};

impl Log {
    fn write(&self, path: &Path, kind: SensorKind) {
        let mut writer = Writer::create_with(path, Existing::Replace).unwrap();
        let stamps = |nanos: u64| (nanos, nanos);
        if self.has_mounting {
            let (log, publish) = stamps(START_NANOS);
            writer
                .write_as("/tf_static", &mounting(), log, publish)
                .unwrap();
        }
        for step in 0..self.steps {
            let nanos = START_NANOS + u64::from(step) * STEP_NANOS;
            let header_nanos = if self.has_stamps { nanos } else { 0 };
            let x_m = 0.5 * f64::from(step);
            if self.has_odometry {
                let aside_m = if step > self.jump_at { 100.0 } else { 0.0 };
                let odometry = odometry(header_nanos, x_m, aside_m);
                writer.write_as("/odom", &odometry, nanos, nanos).unwrap();
            }
            match kind {
                SensorKind::Points => {
                    let cloud = cloud(header_nanos, 30.0 - x_m);
                    writer.write_as("/points", &cloud, nanos, nanos).unwrap();
                }
                SensorKind::Scan => {
                    let scan = scan(header_nanos, 30.0 - x_m);
                    writer.write_as("/scan", &scan, nanos, nanos).unwrap();
                }
            }
        }
        writer.finish().unwrap();
    }
}

/// The lidar hangs upside down 1.5 m above and 1 m ahead of the vehicle's frame, on a mast.
fn mounting() -> TFMessage {
    let link = |parent: &str, child: &str, (x, z): (f64, f64), roll: f64| TransformStamped {
        header: Header::at(START_NANOS, parent),
        child_frame_id: child.to_owned(),
        transform: Transform {
            translation: Vector3 { x, y: 0.0, z },
            rotation: Quaternion {
                x: (roll / 2.0).sin(),
                y: 0.0,
                z: 0.0,
                w: (roll / 2.0).cos(),
            },
        },
    };
    TFMessage {
        transforms: vec![
            link("rear_axle", "mast", (1.0, 0.5), 0.0),
            link("mast", "lidar", (0.0, 1.0), std::f64::consts::PI),
        ],
    }
}

fn odometry(nanos: u64, x: f64, y: f64) -> Odometry {
    let zero = Vector3 {
        x: 0.0,
        y: 0.0,
        z: 0.0,
    };
    Odometry {
        header: Header::at(nanos, "odom"),
        child_frame_id: "rear_axle".to_owned(),
        pose: PoseWithCovariance {
            pose: Pose {
                position: Point { x, y, z: 0.0 },
                orientation: Quaternion {
                    x: 0.0,
                    y: 0.0,
                    z: 0.0,
                    w: 1.0,
                },
            },
            covariance: [0.0; 36],
        },
        twist: TwistWithCovariance {
            twist: Twist {
                linear: zero.clone(),
                angular: zero,
            },
            covariance: [0.0; 36],
        },
    }
}

/// Ground all around and a wall ahead, as the lidar that hangs upside down sees them.
fn cloud(nanos: u64, wall_m: f64) -> PointCloud2 {
    let mut data = Vec::new();
    let mut width = 0;
    let mut push = |x: f64, y: f64, z: f64| {
        for metres in [x - 1.0, -y, 1.5 - z] {
            #[expect(clippy::cast_possible_truncation, reason = "coordinates of a point")]
            data.extend((metres as f32).to_le_bytes());
        }
        data.extend([7, 0, 0, 0]);
        width += 1;
    };
    for ring in 3..25 {
        for direction in 0..360 {
            let (sin, cos) = f64::from(direction).to_radians().sin_cos();
            let (x, y) = (1.0 + f64::from(ring) * cos, f64::from(ring) * sin);
            if x < wall_m {
                push(x, y, 0.0);
            }
        }
    }
    for side in -40..=40 {
        for up in 0..15 {
            push(wall_m, f64::from(side) * 0.1, f64::from(up) * 0.1);
        }
    }
    PointCloud2 {
        header: Header::at(nanos, "lidar"),
        height: 1,
        width,
        fields: ["x", "y", "z", "ring"]
            .iter()
            .zip(0..)
            .map(|(name, index)| PointField {
                name: (*name).to_owned(),
                offset: 4 * index,
                datatype: if index == 3 {
                    PointField::UINT16
                } else {
                    PointField::FLOAT32
                },
                count: 1,
            })
            .collect(),
        is_bigendian: false,
        point_step: 16,
        row_step: 16 * width,
        data,
        is_dense: false,
    }
}

/// A wall ahead, over all of a scan of 181 beams. The scanner is 1 m ahead of the vehicle's frame.
fn scan(nanos: u64, wall_m: f64) -> LaserScan {
    #[expect(clippy::cast_possible_truncation, reason = "ranges of a scan")]
    let ranges = (0..181)
        .map(|beam| {
            let range_m = (wall_m - 1.0) / (f64::from(beam - 90).to_radians()).cos();
            if range_m < 80.0 {
                range_m as f32
            } else {
                f32::INFINITY
            }
        })
        .collect();
    LaserScan {
        header: Header::at(nanos, "lidar"),
        angle_min: -std::f32::consts::FRAC_PI_2,
        angle_max: std::f32::consts::FRAC_PI_2,
        angle_increment: 1f32.to_radians(),
        time_increment: 0.0,
        scan_time: 0.1,
        range_min: 0.1,
        range_max: 80.0,
        ranges,
        intensities: Vec::new(),
    }
}

fn all_frames(path: &Path, config: &IngestConfig) -> Vec<Frame> {
    frames(path, config).unwrap().map(Result::unwrap).collect()
}

fn at(frame: &Frame, x_m: f64, y_m: f64) -> i8 {
    let spec = &frame.occupancy.spec;
    frame.occupancy.get(spec.cell_at(x_m, y_m)).unwrap()
}

/// Whether a wall is seen ahead at this distance, straight ahead and to both sides.
fn has_wall(frame: &Frame, wall_m: f64) -> bool {
    let offsets_m = [-0.4, -0.2, 0.0, 0.2, 0.4];
    [-3.0, 0.0, 3.0].iter().all(|y_m| {
        let is_wall = |x_off_m: &f64| {
            offsets_m
                .iter()
                .any(|off_m| at(frame, wall_m + x_off_m, y_m + off_m) == OCCUPIED)
        };
        offsets_m[1..4].iter().any(is_wall) && at(frame, wall_m - 2.0, *y_m) == FREE
    })
}

#[test]
fn both_kinds_of_lidar_give_a_frame_a_sweep_with_the_wall_in_its_place() {
    let directory = tempfile::tempdir().unwrap();
    for kind in [SensorKind::Points, SensorKind::Scan] {
        for has_stamps in [true, false] {
            let path = directory.path().join("log.mcap");
            Log {
                has_stamps,
                ..PLAIN
            }
            .write(&path, kind);
            let frames = all_frames(&path, &IngestConfig::default());
            assert_eq!(frames.len(), 20);
            for (step, frame) in (0u32..).zip(&frames) {
                let x_m = 0.5 * f64::from(step);
                assert!(
                    has_wall(frame, 30.0 - x_m),
                    "{kind:?}, stamps {has_stamps}, step {step}"
                );
                assert_eq!(
                    frame.stamp_nanos,
                    START_NANOS + u64::from(step) * STEP_NANOS
                );
                assert!((frame.odom_from_vehicle.x_m - x_m).abs() < 1e-9);
                assert!((frame.speed_m_per_s - 5.0).abs() < 1e-6);
            }
            let first = &frames[0].reference;
            assert_eq!(first.len(), 10);
            assert!(first.iter().all(|pose| pose.y_m.abs() < 1e-9));
            assert!(frames[19].reference.is_empty());
        }
    }
}

#[test]
fn without_a_transform_a_log_is_refused_unless_a_mounting_is_given() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("log.mcap");
    Log {
        has_mounting: false,
        ..PLAIN
    }
    .write(&path, SensorKind::Scan);
    let error = frames(&path, &IngestConfig::default())
        .unwrap_err()
        .to_string();
    for part in ["log.mcap", "\"lidar\"", "\"rear_axle\"", "--mount /scan="] {
        assert!(error.contains(part), "{error}");
    }
    let mounted = |text: &str| IngestConfig {
        mount: vec![text.parse().unwrap()],
        ..IngestConfig::default()
    };
    for mount in ["1,0,1.5,3.14159265,0,0", "scan=1,0,1.5,3.14159265,0,0"] {
        let frames = all_frames(&path, &mounted(mount));
        assert_eq!(frames.len(), 20);
        assert!(has_wall(&frames[0], 30.0));
    }
    // The scanner is said to be 1 m behind of where it is.
    assert!(has_wall(
        &all_frames(&path, &mounted("0,0,1.5,3.14159265,0,0"))[0],
        29.0
    ));
    let error = frames(&path, &mounted("/rear=0,0,0,0,0,0"))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("/rear") && error.contains("/scan"),
        "{error}"
    );
    let far = IngestConfig {
        mount: vec![Mount {
            x_m: 1e6,
            ..Mount::default()
        }],
        ..IngestConfig::default()
    };
    assert!(
        frames(&path, &far)
            .unwrap_err()
            .to_string()
            .contains("100 m")
    );
}

#[test]
fn a_log_that_lacks_something_says_what_it_has() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("log.mcap");
    Log {
        has_odometry: false,
        ..PLAIN
    }
    .write(&path, SensorKind::Scan);
    let error = frames(&path, &IngestConfig::default())
        .unwrap_err()
        .to_string();
    for part in [
        "log.mcap",
        "no nav_msgs/msg/Odometry",
        "/scan (sensor_msgs/msg/LaserScan, 20 messages)",
    ] {
        assert!(error.contains(part), "{error}");
    }
    PLAIN.write(&path, SensorKind::Scan);
    let points = IngestConfig {
        points_topics: vec!["/velodyne".into()],
        ..IngestConfig::default()
    };
    let error = frames(&path, &points).unwrap_err().to_string();
    assert!(error.contains("PointCloud2 on \"/velodyne\""), "{error}");
    let named = IngestConfig {
        scan_topics: vec!["scan".into()],
        odom_topic: Some("/odom".into()),
        ..IngestConfig::default()
    };
    assert_eq!(all_frames(&path, &named).len(), 20);
}

#[test]
fn the_map_begins_anew_where_the_odometry_jumps() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("log.mcap");
    Log {
        jump_at: 9,
        ..PLAIN
    }
    .write(&path, SensorKind::Scan);
    let mut frames = frames(&path, &IngestConfig::default()).unwrap();
    let all: Vec<Frame> = frames.by_ref().map(Result::unwrap).collect();
    assert_eq!(all.len(), 20);
    assert!(
        all[9].reference.is_empty(),
        "the reference ends at the jump"
    );
    assert!(has_wall(&all[10], 25.0) && has_wall(&all[9], 25.5));
    assert!(frames.report().warnings[0].contains("jumps"));
}

#[test]
fn bad_messages_are_counted_and_passed_over() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("log.mcap");
    let mut writer = Writer::create(&path).unwrap();
    writer
        .write_as("/tf_static", &mounting(), START_NANOS, START_NANOS)
        .unwrap();
    for step in 0..10u32 {
        let nanos = START_NANOS + u64::from(step) * STEP_NANOS;
        writer
            .write_as(
                "/odom",
                &odometry(nanos, 0.5 * f64::from(step), 0.0),
                nanos,
                nanos,
            )
            .unwrap();
        if step % 2 == 0 {
            writer
                .write_as("/points", &cloud(nanos, 30.0), nanos, nanos)
                .unwrap();
        } else {
            let mut bad = cloud(nanos, 30.0);
            bad.data.truncate(100);
            writer.write_as("/points", &bad, nanos, nanos).unwrap();
        }
    }
    let stamps = Stamps {
        log_nanos: START_NANOS,
        publish_nanos: START_NANOS,
    };
    writer
        .write_raw(
            "/points",
            "sensor_msgs/msg/PointCloud2",
            &[0, 1, 0, 0, 9],
            stamps,
        )
        .unwrap();
    writer.finish().unwrap();
    let mut frames = frames(&path, &IngestConfig::default()).unwrap();
    assert_eq!(frames.by_ref().map(Result::unwrap).count(), 5);
    assert_eq!(frames.report().bad_messages, 6);
    assert!(
        frames
            .report()
            .warnings
            .iter()
            .any(|warning| warning.contains("need"))
    );
}

#[test]
fn a_log_with_no_usable_sweep_is_an_error() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("log.mcap");
    let mut writer = Writer::create(&path).unwrap();
    writer
        .write_as(
            "/odom",
            &odometry(START_NANOS, 0.0, 0.0),
            START_NANOS,
            START_NANOS,
        )
        .unwrap();
    let late_nanos = START_NANOS + 60_000_000_000;
    writer
        .write_as("/scan", &scan(late_nanos, 9.0), late_nanos, late_nanos)
        .unwrap();
    writer.finish().unwrap();
    let error = frames(&path, &IngestConfig::default()).unwrap_err();
    assert!(
        error
            .to_string()
            .contains("no pose at the time of any of the 1 messages"),
        "{error}"
    );
}

#[test]
fn truncated_and_foreign_files_give_an_error_that_names_them() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("log.mcap");
    PLAIN.write(&path, SensorKind::Scan);
    let bytes = std::fs::read(&path).unwrap();
    for len in [0, 7, 100, bytes.len() / 2, bytes.len() - 3] {
        std::fs::write(&path, &bytes[..len]).unwrap();
        let error = frames(&path, &IngestConfig::default()).unwrap_err();
        assert!(matches!(error, Error::BadRecording { .. }), "{error}");
        assert!(error.to_string().contains("log.mcap"), "{error}");
    }
}

#[test]
fn grids_are_written_as_the_messages_of_a_vehicle_and_as_pictures() {
    let directory = tempfile::tempdir().unwrap();
    let (log, out) = (
        directory.path().join("log.mcap"),
        directory.path().join("grids.mcap"),
    );
    let pictures = directory.path().join("pictures");
    PLAIN.write(&log, SensorKind::Points);
    let config = IngestConfig {
        vehicle_id: "kart".into(),
        min_interval_s: 0.35,
        ..IngestConfig::default()
    };
    let mut calls = 0;
    let to = GridsOut {
        recording: &out,
        existing: Existing::Refuse,
        pictures: Some(&pictures),
    };
    let report = write_grids(&log, &to, &config, &mut |_| calls += 1).unwrap();
    assert_eq!((report.sweeps, report.frames, calls), (20, 5, 5));
    assert_eq!(std::fs::read_dir(&pictures).unwrap().count(), 5);
    let direct = all_frames(&log, &config);
    let mut topics = std::collections::BTreeMap::new();
    let mut grids = Vec::new();
    for message in Reader::open(&out).unwrap() {
        let message = message.unwrap();
        *topics.entry(message.topic.to_string()).or_insert(0) += 1;
        if &*message.topic == "/swath/vehicle/kart/grid" {
            let grid: OccupancyGrid = message.decode().unwrap();
            grids.push(Occupancy::from_message(&grid, &GridSpec::default()).unwrap());
        }
    }
    assert_eq!(topics.len(), 3);
    assert!(topics.values().all(|count| *count == 5), "{topics:?}");
    assert!(direct.iter().map(|frame| &frame.occupancy).eq(&grids));
}

fn real_log(name: &str) -> Option<PathBuf> {
    let workspace = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let data = std::env::var_os("SWATH_DATA")
        .map_or_else(|| workspace.join("../shared/data"), PathBuf::from);
    let path = data.join("logs").join(name);
    if !path.is_file() {
        #[expect(clippy::print_stderr, reason = "a skipped test says so")]
        {
            eprintln!(
                "SKIPPED: there is no {}, set SWATH_DATA to where it is",
                path.display()
            );
        }
        return None;
    }
    Some(path)
}

/// Parts of the frames' cells, by what is known of them: occupied and free.
fn shares(frames: &[Frame]) -> (f64, f64) {
    let cells = frames.iter().flat_map(|frame| &frame.occupancy.cells);
    let (mut occupied, mut free, mut all) = (0u32, 0u32, 0u32);
    for value in cells {
        occupied += u32::from(*value == OCCUPIED);
        free += u32::from(*value == FREE);
        all += 1;
    }
    (
        f64::from(occupied) / f64::from(all),
        f64::from(free) / f64::from(all),
    )
}

/// The part of the cells along the driven path, as wide as a narrow robot, that are occupied in the
/// frame: the vehicle drove there, so none should be but what moved away in time.
fn blocked_share(frames: &[Frame]) -> f64 {
    let (mut blocked, mut all) = (0u32, 0u32);
    for frame in frames {
        for pose in frame.reference.iter().take(10) {
            for side_m in [-0.2, 0.0, 0.2] {
                let value = at(
                    frame,
                    pose.x_m - side_m * pose.yaw_rad.sin(),
                    pose.y_m + side_m * pose.yaw_rad.cos(),
                );
                blocked += u32::from(value == OCCUPIED);
                all += 1;
            }
        }
    }
    f64::from(blocked) / f64::from(all.max(1))
}

#[test]
fn a_real_drive_with_a_3d_lidar_is_driven_through_free_space() {
    let Some(path) = real_log("kitti_seqA.mcap") else {
        return;
    };
    let frames = all_frames(&path, &IngestConfig::default());
    assert_eq!(frames.len(), 39);
    let (occupied, free) = shares(&frames);
    assert!(
        (0.01..0.12).contains(&occupied) && free > 0.3,
        "{occupied} occupied, {free} free"
    );
    let blocked = blocked_share(&frames);
    assert!(blocked < 0.01, "{blocked} of the driven path is occupied");
}

#[test]
fn real_drives_with_planar_lidars_are_driven_through_free_space() {
    for (name, sweeps) in [
        ("radish_freiburg_campus.mcap", 2008),
        ("radish_csail.mcap", 406),
        ("radish_fhw.mcap", 488),
        ("radish_freiburg_101.mcap", 292),
        ("radish_intel.mcap", 910),
        ("radish_seattle.mcap", 241),
    ] {
        let Some(path) = real_log(name) else { continue };
        let config = IngestConfig {
            min_interval_s: 1.0,
            ..IngestConfig::default()
        };
        let mut log = frames(&path, &config).unwrap();
        let all: Vec<Frame> = log.by_ref().map(Result::unwrap).collect();
        assert_eq!(log.report().sweeps, sweeps, "{name}");
        assert!(
            log.report().warnings.is_empty(),
            "{name}: {:?}",
            log.report().warnings
        );
        assert!(all.len() as u64 <= sweeps && log.sweeps() / MAX_PICTURES <= 20);
        let (occupied, free) = shares(&all);
        assert!(
            (0.002..0.1).contains(&occupied) && free > 0.02,
            "{name}: {occupied}, {free}"
        );
        let blocked = blocked_share(&all);
        assert!(
            blocked < 0.02,
            "{name}: {blocked} of the driven path is occupied"
        );
    }
}
