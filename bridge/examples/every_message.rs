//! Writes a recording with one message on every topic of swath, for programs of others to read.
//!
//! `cargo run --release -p swath-bridge --example every_message -- FILE.mcap`

use std::error::Error;

use swath_bridge::keys;
use swath_bridge::msg::geometry::{
    Point, Pose, PoseArray, PoseStamped, PoseWithCovariance, Quaternion, Twist,
    TwistWithCovariance, Vector3,
};
use swath_bridge::msg::header::{Header, Time};
use swath_bridge::msg::nav::{MapMetaData, OccupancyGrid, Odometry, Path};
use swath_bridge::msg::swath::{
    Evaluation, PlanReport, PlanarPose, Sample, TargetPlan, TrainStatus, Weights,
};
use swath_bridge::recording::Writer;

/// Stamp of every message, nanoseconds since the Unix epoch.
const STAMP_NANOS: u64 = 1_700_000_000_123_456_789;

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args_os()
        .nth(1)
        .ok_or("expected a file to write")?;
    let mut writer = Writer::create(path)?;
    let mut nanos = STAMP_NANOS;
    macro_rules! write {
        ($topic:ident($name:literal), $message:expr) => {
            writer.write(&keys::$topic($name), &$message, nanos, STAMP_NANOS)?;
            nanos += 1_000_000;
        };
    }
    write!(sample("g0"), sample());
    write!(weights("r0"), weights());
    write!(train_status("r0"), train_status());
    write!(evaluation("r0"), evaluation());
    write!(grid("v0"), grid());
    write!(odom("v0"), odometry());
    write!(reference("v0"), path_of(3));
    write!(targets("v0"), targets());
    write!(plan("v0"), plan());
    write!(path("v0"), path_of(0));
    write!(region("v0"), grid());
    write!(explored("v0"), grid());
    let _ = nanos;
    writer.finish()?;
    Ok(())
}

fn header() -> Header {
    Header::at(STAMP_NANOS, "base_link")
}

fn pose(x: f64) -> Pose {
    Pose {
        position: Point { x, y: -2.5, z: 0.0 },
        orientation: Quaternion {
            x: 0.0,
            y: 0.0,
            z: 0.6,
            w: 0.8,
        },
    }
}

fn planar(x_m: f32) -> PlanarPose {
    PlanarPose {
        x_m,
        y_m: -1.5,
        yaw_rad: 0.25,
    }
}

fn sample() -> Sample {
    let plane = |byte| vec![byte; (401 * 151_usize).div_ceil(8)];
    Sample {
        header: header(),
        generator: "g0".to_owned(),
        sequence: 7,
        seed: u64::MAX,
        index: 9,
        scene: "straight".to_owned(),
        scene_id: 11,
        speed_m_per_s: 1.5,
        goal: planar(40.0),
        outcome: 0,
        rows: 401,
        cols: 151,
        resolution_m: 0.25,
        ego_row: 300,
        ego_col: 75,
        obstacles: plane(1),
        reference: plane(2),
        target: plane(3),
        label: plane(255),
        path: vec![planar(0.0), planar(40.0)],
        cost: 40.5,
        steps: 1234,
    }
}

fn weights() -> Weights {
    Weights {
        header: header(),
        run: "r0".to_owned(),
        version: 3,
        step: 200,
        epoch: 2,
        architecture: "enet".to_owned(),
        input_rows: 408,
        input_cols: 152,
        vehicle: "digest".to_owned(),
        loss: 0.5,
        miou: 0.75,
        iou_path: 0.625,
        iou_background: 0.875,
        digest: [9; 32],
        public_key: vec![1; 32],
        signature: vec![2; 64],
        safetensors: vec![3; 1000],
    }
}

fn train_status() -> TrainStatus {
    TrainStatus {
        header: header(),
        run: "r0".to_owned(),
        step: 200,
        epoch: 2,
        epochs: 300,
        samples: 20_000,
        samples_per_s: 12.5,
        received: 21_000,
        gaps: 3,
        duplicates: 2,
        rejected: 1,
        buffered: 64,
        learning_rate: 0.5,
        loss: 0.25,
        miou: f32::NAN,
        weights_version: 3,
        eta_s: f32::NAN,
    }
}

fn evaluation() -> Evaluation {
    Evaluation {
        header: header(),
        run: "r0".to_owned(),
        weights_version: 3,
        predictor: "enet".to_owned(),
        split: "test".to_owned(),
        dilation_m: 1.5,
        samples: 2000,
        intersection_path: 10,
        union_path: 20,
        intersection_background: 30,
        union_background: 40,
        ms_per_sample: 2.5,
    }
}

fn grid() -> OccupancyGrid {
    OccupancyGrid {
        header: header(),
        info: MapMetaData {
            map_load_time: Time::from_nanos(STAMP_NANOS),
            resolution: 0.25,
            width: 3,
            height: 2,
            origin: pose(-20.0),
        },
        data: vec![-1, 0, 100, 0, 50, -1],
    }
}

fn odometry() -> Odometry {
    let vector = |x| Vector3 { x, y: 0.0, z: 0.0 };
    Odometry {
        header: header(),
        child_frame_id: "base_link".to_owned(),
        pose: PoseWithCovariance {
            pose: pose(1.5),
            covariance: [0.25; 36],
        },
        twist: TwistWithCovariance {
            twist: Twist {
                linear: vector(1.5),
                angular: vector(0.0),
            },
            covariance: [0.5; 36],
        },
    }
}

fn path_of(count: u32) -> Path {
    let poses = (0..count).map(|index| PoseStamped {
        header: header(),
        pose: pose(f64::from(index)),
    });
    Path {
        header: header(),
        poses: poses.collect(),
    }
}

fn targets() -> PoseArray {
    PoseArray {
        header: header(),
        poses: vec![pose(10.0), pose(20.0)],
    }
}

fn plan() -> PlanReport {
    let target = |status, path| TargetPlan {
        goal: planar(20.0),
        status,
        cost: 20.5,
        length_m: 20.25,
        steps: 99,
        time_ms: 1.5,
        path,
    };
    PlanReport {
        header: header(),
        vehicle: "v0".to_owned(),
        frame: 5,
        method: "tiev-fcn".to_owned(),
        scene: String::new(),
        speed_m_per_s: 1.5,
        weights_run: "r0".to_owned(),
        weights_version: 3,
        weights_age_s: 2.5,
        network_ms: 3.5,
        search_ms: 4.5,
        cpu_ms: 5.5,
        total_ms: 6.5,
        latency_ms: 7.5,
        grids_skipped: 1,
        targets: vec![
            target(0, vec![planar(0.0), planar(20.0)]),
            target(1, Vec::new()),
        ],
    }
}
