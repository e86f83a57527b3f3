//! Our CDR beside `cdr-encoding`, on messages of the sizes that swath moves.
//!
//! Both start from the same serde types; `cdr-encoding` leaves out the four bytes of encapsulation.

#![expect(
    clippy::unwrap_used,
    reason = "a bench may stop where a program may not"
)]

use std::hint::black_box;

use byteorder::LittleEndian;
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use swath_bridge::cdr;
use swath_bridge::msg::Message;
use swath_bridge::msg::geometry::{
    Point, Pose, PoseWithCovariance, Quaternion, Twist, TwistWithCovariance, Vector3,
};
use swath_bridge::msg::header::{Header, Time};
use swath_bridge::msg::nav::{MapMetaData, OccupancyGrid, Odometry};
use swath_bridge::msg::sensor::{LaserScan, PointCloud2, PointField};

fn pose() -> Pose {
    Pose {
        position: Point {
            x: 1.5,
            y: -2.5,
            z: 0.0,
        },
        orientation: Quaternion {
            x: 0.0,
            y: 0.0,
            z: 0.6,
            w: 0.8,
        },
    }
}

fn odometry() -> Odometry {
    let zero = || Vector3 {
        x: 0.0,
        y: 0.0,
        z: 0.0,
    };
    Odometry {
        header: Header::at(12_345, "odom"),
        child_frame_id: "base_link".to_owned(),
        pose: PoseWithCovariance {
            pose: pose(),
            covariance: [0.25; 36],
        },
        twist: TwistWithCovariance {
            twist: Twist {
                linear: zero(),
                angular: zero(),
            },
            covariance: [0.5; 36],
        },
    }
}

fn grid() -> OccupancyGrid {
    OccupancyGrid {
        header: Header::at(12_345, "base_link"),
        info: MapMetaData {
            map_load_time: Time::from_nanos(0),
            resolution: 0.2,
            width: 401,
            height: 151,
            origin: pose(),
        },
        data: (0..401 * 151)
            .map(|cell| i8::from(cell % 7 == 0) * 100)
            .collect(),
    }
}

fn scan() -> LaserScan {
    LaserScan {
        header: Header::at(12_345, "laser"),
        angle_min: -1.5,
        angle_max: 1.5,
        angle_increment: 0.003,
        time_increment: 0.0,
        scan_time: 0.1,
        range_min: 0.1,
        range_max: 80.0,
        ranges: vec![7.5; 1081],
        intensities: Vec::new(),
    }
}

fn sweep() -> PointCloud2 {
    const POINTS: u32 = 120_000;
    const STEP: u32 = 16;
    let field = |name: &str, offset| PointField {
        name: name.to_owned(),
        offset,
        datatype: 7,
        count: 1,
    };
    let bytes = (0..POINTS * STEP).map(|byte| u8::try_from(byte % 251).unwrap_or(0));
    PointCloud2 {
        header: Header::at(12_345, "lidar"),
        height: 1,
        width: POINTS,
        fields: vec![field("x", 0), field("y", 4), field("z", 8)],
        is_bigendian: false,
        point_step: STEP,
        row_step: POINTS * STEP,
        data: bytes.collect(),
        is_dense: true,
    }
}

fn compare<M: Message + PartialEq + std::fmt::Debug>(criterion: &mut Criterion, message: &M) {
    let name = M::TYPE_NAME.rsplit('/').next().unwrap_or_default();
    let ours = cdr::to_vec(message).unwrap();
    let theirs = cdr_encoding::to_vec::<M, LittleEndian>(message).unwrap();
    assert_eq!(ours[4..], theirs, "both write the same bytes");
    let bytes = u64::try_from(ours.len()).unwrap_or(0);

    let mut group = criterion.benchmark_group("encode");
    group.throughput(Throughput::Bytes(bytes));
    group.bench_function(BenchmarkId::new("swath", name), |bencher| {
        bencher.iter(|| cdr::to_vec(black_box(message)).unwrap());
    });
    group.bench_function(BenchmarkId::new("cdr-encoding", name), |bencher| {
        bencher.iter(|| cdr_encoding::to_vec::<M, LittleEndian>(black_box(message)).unwrap());
    });
    group.finish();

    let mut group = criterion.benchmark_group("decode");
    group.throughput(Throughput::Bytes(bytes));
    group.bench_function(BenchmarkId::new("swath", name), |bencher| {
        bencher.iter(|| cdr::from_slice::<M>(black_box(&ours)).unwrap());
    });
    group.bench_function(BenchmarkId::new("cdr-encoding", name), |bencher| {
        let decode = cdr_encoding::from_bytes::<M, LittleEndian>;
        bencher.iter(|| decode(black_box(&theirs)).unwrap());
    });
    group.finish();
}

fn every_size(criterion: &mut Criterion) {
    compare(criterion, &odometry());
    compare(criterion, &scan());
    compare(criterion, &grid());
    compare(criterion, &sweep());
}

criterion_group!(benches, every_size);
criterion_main!(benches);
