//! Writes a message of every type, on every topic of swath, into a recording, and their values into a
//! JSON file, for programs that others wrote to compare: `every_message OUT.mcap OUT.json`.

use std::error::Error;

use serde_json::{Value, json};
use swath_bridge::msg::geometry::{
    Point, Pose, PoseArray, PoseStamped, PoseWithCovariance, Quaternion, Transform,
    TransformStamped, Twist, TwistWithCovariance, Vector3,
};
use swath_bridge::msg::header::{Duration, Header, Time};
use swath_bridge::msg::nav::{MapMetaData, OccupancyGrid, Odometry, Path};
use swath_bridge::msg::sensor::{LaserScan, PointCloud2, PointField};
use swath_bridge::msg::swath::{
    Evaluation, PlanReport, PlanarPose, Rejection, Sample, TargetPlan, TrainStatus, Weights,
};
use swath_bridge::msg::tf2::TFMessage;
use swath_bridge::recording::Writer;
use swath_bridge::{Outcome, StopReason, keys, msg::Message};

/// When the first message was sent; it was recorded a microsecond later.
const START_NANOS: u64 = 1_700_000_000_123_456_789;

/// The recording, and what is in it.
struct Out {
    writer: Writer,
    messages: Vec<Value>,
}

impl Out {
    fn add<M: Message>(&mut self, message: &M) -> Result<(), Box<dyn Error>> {
        self.add_on(&topic_of(M::TYPE_NAME), message)
    }

    fn add_on<M: Message>(&mut self, topic: &str, message: &M) -> Result<(), Box<dyn Error>> {
        let publish_nanos = START_NANOS + 1_000_000 * self.messages.len() as u64;
        let log_nanos = publish_nanos + 1000;
        self.writer
            .write_as(topic, message, log_nanos, publish_nanos)?;
        self.messages.push(json!({
            "topic": topic,
            "type": M::TYPE_NAME,
            "log_nanos": log_nanos,
            "publish_nanos": publish_nanos,
            "message": serde_json::to_value(message)?,
        }));
        Ok(())
    }
}

/// The topic on which swath carries a type, so that the recording says how it is carried; types that
/// have none of their own get one.
fn topic_of(type_name: &str) -> String {
    let key = match type_name {
        Sample::TYPE_NAME => keys::sample("g0").key().to_owned(),
        Weights::TYPE_NAME => keys::weights("main").key().to_owned(),
        TrainStatus::TYPE_NAME => keys::train_status("main").key().to_owned(),
        Evaluation::TYPE_NAME => keys::evaluation("main").key().to_owned(),
        PlanReport::TYPE_NAME => keys::plan("v0").key().to_owned(),
        OccupancyGrid::TYPE_NAME => keys::grid("v0").key().to_owned(),
        Odometry::TYPE_NAME => keys::odom("v0").key().to_owned(),
        Path::TYPE_NAME => keys::reference("v0").key().to_owned(),
        PoseArray::TYPE_NAME => keys::targets("v0").key().to_owned(),
        TFMessage::TYPE_NAME => keys::tf("v0").key().to_owned(),
        other => format!("every/{other}"),
    };
    keys::topic_of_key(&key)
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [recording, values] = &arguments[..] else {
        return Err("usage: every_message OUT.mcap OUT.json".into());
    };
    let mut out = Out {
        writer: Writer::create(recording)?,
        messages: Vec::new(),
    };
    geometry(&mut out)?;
    navigation(&mut out)?;
    sensors(&mut out)?;
    plans(&mut out)?;
    training(&mut out)?;
    progress(&mut out)?;
    out.writer.finish()?;
    std::fs::write(values, serde_json::to_string_pretty(&out.messages)?)?;
    Ok(())
}

fn header() -> Header {
    // A name of two bytes a letter: what follows it in the payload has to be aligned anew.
    Header::at(START_NANOS, "Fahrzeug-ä")
}

fn vector(x: f64) -> Vector3 {
    Vector3 {
        x,
        y: -x,
        z: 0.1 * x,
    }
}

fn pose(x: f64) -> Pose {
    Pose {
        position: Point { x, y: 0.5, z: -x },
        orientation: Quaternion {
            x: 0.0,
            y: 0.0,
            z: 0.6,
            w: 0.8,
        },
    }
}

fn covariance(first: f64) -> [f64; 36] {
    let mut covariance = [0.0; 36];
    for (value, step) in covariance.iter_mut().zip(0u8..) {
        *value = first + f64::from(step) / 7.0;
    }
    covariance
}

fn twist() -> Twist {
    Twist {
        linear: vector(1.5),
        angular: vector(-0.25),
    }
}

fn stamped(x: f64) -> PoseStamped {
    PoseStamped {
        header: header(),
        pose: pose(x),
    }
}

fn transform() -> TransformStamped {
    TransformStamped {
        header: header(),
        child_frame_id: "lidar".to_owned(),
        transform: Transform {
            translation: vector(1.7),
            rotation: pose(0.0).orientation,
        },
    }
}

fn geometry(out: &mut Out) -> Result<(), Box<dyn Error>> {
    out.add(&Time::from_nanos(START_NANOS))?;
    out.add(&Duration {
        sec: -2,
        nanosec: 999_999_999,
    })?;
    out.add(&header())?;
    out.add(&pose(1.0).position)?;
    out.add(&pose(1.0).orientation)?;
    out.add(&pose(2.0))?;
    out.add(&PoseArray {
        header: header(),
        poses: vec![pose(3.0), pose(4.0)],
    })?;
    out.add(&stamped(5.0))?;
    out.add(&PoseWithCovariance {
        pose: pose(6.0),
        covariance: covariance(0.5),
    })?;
    out.add(&vector(f64::MIN_POSITIVE))?;
    out.add(&transform().transform)?;
    out.add(&transform())?;
    out.add(&twist())?;
    out.add(&TwistWithCovariance {
        twist: twist(),
        covariance: covariance(-3.0),
    })?;
    let transforms = TFMessage {
        transforms: vec![transform(), transform()],
    };
    out.add(&transforms)?;
    out.add_on(
        &keys::topic_of_key(keys::tf_static("v0").key()),
        &transforms,
    )
}

fn navigation(out: &mut Out) -> Result<(), Box<dyn Error>> {
    let info = MapMetaData {
        map_load_time: Time::from_nanos(1),
        resolution: 0.2,
        width: 3,
        height: 2,
        origin: pose(-20.0),
    };
    out.add(&info)?;
    let grid = OccupancyGrid {
        header: header(),
        info,
        data: vec![-1, 0, 100, 50, -1, 127],
    };
    out.add(&grid)?;
    out.add_on(&keys::topic_of_key(keys::region("v0").key()), &grid)?;
    out.add_on(&keys::topic_of_key(keys::explored("v0").key()), &grid)?;
    let stop = Path {
        header: header(),
        poses: Vec::new(),
    };
    out.add_on(&keys::topic_of_key(keys::path("v0").key()), &stop)?;
    out.add(&Odometry {
        header: header(),
        child_frame_id: "base_link".to_owned(),
        pose: PoseWithCovariance {
            pose: pose(7.0),
            covariance: covariance(0.0),
        },
        twist: TwistWithCovariance {
            twist: twist(),
            covariance: covariance(1e-9),
        },
    })?;
    out.add(&Path {
        header: header(),
        poses: vec![stamped(0.0), stamped(0.2), stamped(0.4)],
    })
}

fn sensors(out: &mut Out) -> Result<(), Box<dyn Error>> {
    let field = |name: &str, offset, datatype| PointField {
        name: name.to_owned(),
        offset,
        datatype,
        count: 1,
    };
    out.add(&field("x", 0, PointField::FLOAT32))?;
    out.add(&LaserScan {
        header: header(),
        angle_min: -1.5,
        angle_max: 1.5,
        angle_increment: 1.0,
        time_increment: 1e-5,
        scan_time: 0.1,
        range_min: 0.05,
        range_max: 80.0,
        ranges: vec![1.0, f32::NAN, 3.3, 80.0],
        intensities: Vec::new(),
    })?;
    out.add(&PointCloud2 {
        header: header(),
        height: 1,
        width: 2,
        fields: vec![
            field("x", 0, PointField::FLOAT32),
            field("ring", 4, PointField::UINT16),
        ],
        is_bigendian: false,
        point_step: 6,
        row_step: 12,
        data: vec![0, 0, 128, 63, 7, 0, 0, 0, 0, 64, 255, 255],
        is_dense: true,
    })
}

fn planar(x_m: f32) -> PlanarPose {
    PlanarPose {
        x_m,
        y_m: 1.25,
        yaw_rad: -3.1,
    }
}

fn target(outcome: Outcome) -> TargetPlan {
    let solved = outcome == Outcome::Solved;
    TargetPlan {
        goal: planar(20.0),
        status: outcome.code(),
        cost: if solved { 21.75 } else { f64::NAN },
        bound: if solved { 1.2 } else { f32::NAN },
        length_m: if solved { 20.1 } else { f64::NAN },
        steps: u64::MAX,
        time_ms: 3.7,
        drivability: u8::from(solved),
        path: if solved {
            vec![planar(0.0), planar(0.2)]
        } else {
            Vec::new()
        },
        curvature_per_m: if solved { vec![0.0, -0.15] } else { Vec::new() },
    }
}

fn rejection(topic: &str, messages: u64) -> Rejection {
    Rejection {
        topic: topic.to_owned(),
        cause: "it does not decode".to_owned(),
        messages,
    }
}

fn plans(out: &mut Out) -> Result<(), Box<dyn Error>> {
    out.add(&planar(0.1))?;
    out.add(&rejection("weights", 1))?;
    out.add(&target(Outcome::Solved))?;
    out.add(&PlanReport {
        header: header(),
        vehicle: "v0".to_owned(),
        frame: 41,
        method: "tiev-fcn".to_owned(),
        scene: String::new(),
        speed_m_per_s: 1.4,
        weights_run: "main".to_owned(),
        weights_version: 3,
        weights_age_s: f32::NAN,
        consulted: "all".to_owned(),
        network_ms: 12.5,
        search_ms: 7.25,
        cpu_ms: 30.0,
        total_ms: 19.75,
        smooth_ms: 2.5,
        deadline_ms: 100.0,
        latency_ms: 21.0,
        grids_skipped: 2,
        start: planar(0.4),
        chosen: 0,
        targets: vec![target(Outcome::Solved), target(Outcome::GoalOccupied)],
        reason: StopReason::NoTransform.name().to_owned(),
        detail: "from \"Fahrzeug-ä\" to \"base_link\"".to_owned(),
        rejected: vec![rejection("odom", 3), rejection("grid", u64::MAX)],
    })
}

fn training(out: &mut Out) -> Result<(), Box<dyn Error>> {
    out.add(&Sample {
        header: header(),
        generator: "generator-0".to_owned(),
        sequence: 1,
        seed: 2,
        index: u64::MAX - 1,
        scene: "parking".to_owned(),
        scene_id: 77,
        speed_m_per_s: 2.5,
        goal: planar(30.0),
        outcome: Outcome::Solved.code(),
        rows: 3,
        cols: 5,
        resolution_m: 0.2,
        ego_row: 2,
        ego_col: 2,
        obstacles: vec![0b1000_0001, 0b0100_0000],
        reference: vec![255, 254],
        target: vec![0, 2],
        label: vec![1, 0],
        path: vec![planar(0.0), planar(30.0)],
        cost: 31.5,
        steps: 12_345,
    })?;
    out.add(&Weights {
        header: header(),
        run: "main".to_owned(),
        version: 3,
        step: 300,
        epoch: 2,
        architecture: "enet".to_owned(),
        input_rows: 408,
        input_cols: 152,
        vehicle: "digest".to_owned(),
        loss: 0.125,
        miou: f32::NAN,
        iou_path: 0.7,
        iou_background: 0.9,
        digest: std::array::from_fn(|index| u8::try_from(7 * index).unwrap_or(0)),
        public_key: vec![9; 32],
        signature: vec![8; 64],
        safetensors: (0..=255).collect(),
    })
}

fn progress(out: &mut Out) -> Result<(), Box<dyn Error>> {
    out.add(&TrainStatus {
        header: header(),
        run: "main".to_owned(),
        step: 300,
        epoch: 2,
        epochs: 300,
        samples: 30_000,
        samples_per_s: 41.5,
        received: 30_500,
        gaps: 1,
        duplicates: 2,
        rejected: 3,
        buffered: 500,
        learning_rate: 5e-4,
        loss: 0.125,
        miou: 0.8,
        weights_version: 3,
        eta_s: f32::NAN,
    })?;
    out.add(&Evaluation {
        header: header(),
        run: "main".to_owned(),
        weights_version: 3,
        predictor: "enet".to_owned(),
        split: "test".to_owned(),
        group: "scene/clutter".to_owned(),
        dilation_m: 1.4,
        samples: 2000,
        intersection_path: 1,
        union_path: 2,
        intersection_background: 3,
        union_background: 4,
        joined: 1900,
        ms_per_sample: 12.75,
    })
}
