//! A small world that logs are made of: two boxes of a metre, a vehicle with scanners, odometry at 10 Hz.

#![allow(dead_code, reason = "each test uses a part of it")]

use std::path::Path;

use swath_bridge::ingest::{IngestConfig, IngestReport, frames};
use swath_bridge::msg::geometry::{
    PoseWithCovariance, Quaternion, Transform, TransformStamped, Twist, TwistWithCovariance,
    Vector3,
};
use swath_bridge::msg::header::Header;
use swath_bridge::msg::nav::Odometry;
use swath_bridge::msg::sensor::LaserScan;
use swath_bridge::msg::tf2::TFMessage;
use swath_bridge::poses::ros_pose;
use swath_bridge::recording::{Stamps, Writer};
use swath_bridge::{Frame, OCCUPIED, Pose2};

pub(crate) const SECOND: u64 = 1_000_000_000;
pub(crate) const STEP: u64 = SECOND / 10;
pub(crate) const NOW: u64 = 1_700_000_000 * SECOND;
/// Centres of the boxes, metres.
pub(crate) const BOXES_M: [[f64; 2]; 2] = [[14.0, 3.0], [9.0, -4.0]];
/// Where the front scanner is on the vehicle.
pub(crate) const FRONT: Pose2 = Pose2 {
    x_m: 1.0,
    y_m: 0.0,
    yaw_rad: 0.0,
};
/// Where the rear scanner is: it looks back.
pub(crate) const REAR: Pose2 = Pose2 {
    x_m: -0.5,
    y_m: 0.0,
    yaw_rad: std::f64::consts::PI,
};

/// Distance from a place in a direction to the nearest box, metres; infinite if there is none.
pub(crate) fn range_m(from: &Pose2, boxes_m: &[[f64; 2]]) -> f32 {
    let (dy, dx) = from.yaw_rad.sin_cos();
    let mut nearest_m = f64::INFINITY;
    for [x_m, y_m] in boxes_m {
        // The ray is inside of the box where it is between both pairs of sides.
        let between = |at: f64, along: f64, centre: f64| {
            let sides = [centre - 0.5, centre + 0.5].map(|side| (side - at) / along);
            (sides[0].min(sides[1]), sides[0].max(sides[1]))
        };
        let (x_in, x_out) = between(from.x_m, dx, *x_m);
        let (y_in, y_out) = between(from.y_m, dy, *y_m);
        let (enters, leaves) = (x_in.max(y_in), x_out.min(y_out));
        if enters > 0.0 && enters < leaves {
            nearest_m = nearest_m.min(enters);
        }
    }
    #[expect(clippy::cast_possible_truncation, reason = "a range of a scan")]
    let range_m = nearest_m as f32;
    if range_m < 30.0 {
        range_m
    } else {
        f32::INFINITY
    }
}

/// What a scanner sees over half a circle.
pub(crate) fn scan(nanos: u64, frame_id: &str, world_from_sensor: &Pose2) -> LaserScan {
    let increment_rad = 0.25f32.to_radians();
    let ranges = (-360..=360)
        .map(|beam| {
            let yaw_rad = f64::from(beam) * f64::from(increment_rad);
            range_m(
                &world_from_sensor.then(&Pose2::new(0.0, 0.0, yaw_rad)),
                &BOXES_M,
            )
        })
        .collect();
    LaserScan {
        header: Header::at(nanos, frame_id),
        angle_min: -360.0 * increment_rad,
        angle_max: 360.0 * increment_rad,
        angle_increment: increment_rad,
        time_increment: 0.0,
        scan_time: 0.1,
        range_min: 0.1,
        range_max: 30.0,
        ranges,
        intensities: Vec::new(),
    }
}

pub(crate) fn odometry(nanos: u64, odom_from_vehicle: &Pose2) -> Odometry {
    let still = Vector3 {
        x: 0.0,
        y: 0.0,
        z: 0.0,
    };
    Odometry {
        header: Header::at(nanos, "odom"),
        child_frame_id: "base_link".to_owned(),
        pose: PoseWithCovariance {
            pose: ros_pose(odom_from_vehicle),
            covariance: [0.0; 36],
        },
        twist: TwistWithCovariance {
            twist: Twist {
                linear: Vector3 {
                    x: 2.0,
                    ..still.clone()
                },
                angular: still,
            },
            covariance: [0.0; 36],
        },
    }
}

pub(crate) fn transform(frame_id: &str, vehicle_from_sensor: &Pose2) -> TFMessage {
    let (z, w) = (vehicle_from_sensor.yaw_rad / 2.0).sin_cos();
    TFMessage {
        transforms: vec![TransformStamped {
            header: Header::at(NOW, "base_link"),
            child_frame_id: frame_id.to_owned(),
            transform: Transform {
                translation: Vector3 {
                    x: vehicle_from_sensor.x_m,
                    y: vehicle_from_sensor.y_m,
                    z: 0.3,
                },
                rotation: Quaternion {
                    x: 0.0,
                    y: 0.0,
                    z,
                    w,
                },
            },
        }],
    }
}

/// Straight along x at 2 m/s.
pub(crate) fn straight(step: u64) -> Pose2 {
    Pose2::new(0.2 * step as f64, 0.0, 0.0)
}

/// At 2 m/s on a circle of 8 m to the left.
pub(crate) fn turning(step: u64) -> Pose2 {
    let angle_rad = 0.2 * step as f64 / 8.0;
    Pose2::new(
        8.0 * angle_rad.sin(),
        8.0 * (1.0 - angle_rad.cos()),
        angle_rad,
    )
}

/// A message of a log that is still to be written.
#[derive(Debug, Clone)]
pub(crate) struct Message {
    pub(crate) topic: String,
    pub(crate) type_name: &'static str,
    pub(crate) log_nanos: u64,
    pub(crate) payload: Vec<u8>,
}

/// Encodes a message.
pub(crate) fn message<M: swath_bridge::msg::Message>(
    topic: &str,
    log_nanos: u64,
    content: &M,
) -> Message {
    Message {
        topic: topic.to_owned(),
        type_name: M::TYPE_NAME,
        log_nanos,
        payload: swath_bridge::cdr::to_vec(content).unwrap(),
    }
}

/// A drive of a log.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Drive {
    /// Where the vehicle is at a step of a tenth of a second.
    pub(crate) pose: fn(u64) -> Pose2,
    /// Steps of odometry; scans come for the first third of them.
    pub(crate) steps: u64,
    /// Stamp of the first odometry and of the first scan, nanoseconds.
    pub(crate) odom_nanos: u64,
    pub(crate) scan_nanos: u64,
    /// Time of the first recording, nanoseconds.
    pub(crate) log_nanos: u64,
}

/// 2 m/s along x for 6 s.
pub(crate) const STRAIGHT: Drive = Drive {
    pose: straight,
    steps: 60,
    odom_nanos: NOW,
    scan_nanos: NOW,
    log_nanos: NOW,
};

impl Drive {
    /// The messages in the order in which they are recorded.
    pub(crate) fn messages(&self) -> Vec<Message> {
        let mut messages = Vec::new();
        for step in 0..self.steps {
            let pose = (self.pose)(step);
            let [odom_nanos, scan_nanos, log_nanos] =
                [self.odom_nanos, self.scan_nanos, self.log_nanos].map(|from| from + step * STEP);
            let odometry = odometry(odom_nanos, &pose);
            messages.push(message("/odom", log_nanos, &odometry));
            if step < self.steps / 3 {
                let scan = scan(scan_nanos, "lidar", &pose.then(&FRONT));
                messages.push(message("/scan", log_nanos + 1000, &scan));
            }
        }
        messages
    }
}

/// The mounting of the front scanner.
pub(crate) fn mounting() -> Message {
    message("/tf_static", NOW, &transform("lidar", &FRONT))
}

pub(crate) fn write(path: &Path, messages: &[Message]) {
    let mut writer = Writer::create(path).unwrap();
    for message in messages {
        let stamps = Stamps {
            log_nanos: message.log_nanos,
            publish_nanos: message.log_nanos,
        };
        let (topic, type_name) = (&message.topic, message.type_name);
        writer
            .write_raw(topic, type_name, &message.payload, stamps)
            .unwrap();
    }
    writer.finish().unwrap();
}

/// The frames of a log and the report on it.
pub(crate) fn read(path: &Path, config: &IngestConfig) -> (Vec<Frame>, IngestReport) {
    let mut log = frames(path, config).unwrap();
    let all: Vec<Frame> = log.by_ref().map(Result::unwrap).collect();
    (all, log.report().clone())
}

pub(crate) fn read_plain(path: &Path) -> (Vec<Frame>, IngestReport) {
    read(path, &IngestConfig::default())
}

/// The error of a log that cannot be read.
pub(crate) fn error_of(path: &Path, config: &IngestConfig) -> String {
    frames(path, config).unwrap_err().to_string()
}

/// Centres of the occupied cells of a frame, in the world.
pub(crate) fn occupied_m(frame: &Frame) -> Vec<[f64; 2]> {
    let spec = &frame.occupancy.spec;
    let cells = frame.occupancy.cells.iter().enumerate();
    cells
        .filter(|(_, value)| **value == OCCUPIED)
        .map(|(index, _)| {
            let (x_m, y_m) = spec.centre_of(spec.cell_of_index(index));
            let at = frame.odom_from_vehicle.then(&Pose2::new(x_m, y_m, 0.0));
            [at.x_m, at.y_m]
        })
        .collect()
}

/// Checks that a frame has the boxes, and nothing where there is none.
pub(crate) fn assert_world(frame: &Frame) {
    let found = occupied_m(frame);
    let is_near = |[x, y]: &[f64; 2], [bx, by]: &[f64; 2], most_m: f64| {
        (x - bx).abs() < 0.5 + most_m && (y - by).abs() < 0.5 + most_m
    };
    for cell in &found {
        let is_box = BOXES_M.iter().any(|centre| is_near(cell, centre, 0.35));
        assert!(is_box, "{cell:?} is no box: {found:?}");
    }
    for centre in &BOXES_M {
        let is_seen = found.iter().any(|cell| is_near(cell, centre, 0.35));
        assert!(is_seen, "{centre:?} is missing: {found:?}");
    }
}

/// Checks that a frame was taken where the vehicle was.
pub(crate) fn assert_pose(frame: &Frame, expected: &Pose2) {
    let found = &frame.odom_from_vehicle;
    assert!(
        found.distance_m(expected) < 1e-6 && (found.yaw_rad - expected.yaw_rad).abs() < 1e-6,
        "{found:?}, expected {expected:?}"
    );
}
