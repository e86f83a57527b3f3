//! Time from a sweep of 120,000 points to a grid, on one core: decoding the cloud's bytes, finding
//! the ground, accumulating and rasterising.

use criterion::{Criterion, criterion_group, criterion_main};
use nalgebra::Isometry3;
use swath_bridge::Pose2;
use swath_bridge::ingest::cloud::points_of;
use swath_bridge::ingest::{IngestConfig, Mapper};
use swath_bridge::msg::header::Header;
use swath_bridge::msg::sensor::{PointCloud2, PointField};

/// Beams above each other, as of a 64-line lidar.
const LINES: u32 = 64;
/// Directions of a turn; with 64 lines 120,000 points.
const DIRECTIONS: u32 = 1875;
/// Height of the lidar, metres.
const HEIGHT_M: f64 = 1.8;
/// Distance from one parked car to the next, metres.
const CARS_APART_M: f64 = 7.0;
/// Distance driven from sweep to sweep, metres.
const STEP_M: f64 = 0.5;
/// Sweeps until the street looks the same again.
const SWEEPS: u32 = 14;

/// Range of a beam in a street between two walls with a row of cars on each side, metres.
fn range_m(driven_m: f64, azimuth_rad: f64, elevation_rad: f64) -> f64 {
    let (sin, cos) = libm::sincos(azimuth_rad);
    let slope = libm::tan(elevation_rad);
    let mut range_m = if slope < -0.02 {
        HEIGHT_M / -slope
    } else {
        100.0
    };
    for (side_m, height_m) in [(3.0, 1.5), (-4.0, 1.5), (9.0, 12.0), (-11.0, 12.0)] {
        let at_m = side_m / sin;
        let along_m = driven_m + at_m * cos + 1000.0 * CARS_APART_M;
        let is_gap = height_m < 2.0 && libm::fmod(along_m, CARS_APART_M) > 4.5;
        if at_m > 0.0 && at_m < range_m && HEIGHT_M + slope * at_m < height_m && !is_gap {
            range_m = at_m;
        }
    }
    range_m
}

fn sweep(driven_m: f64) -> PointCloud2 {
    let mut data = Vec::new();
    for line in 0..LINES {
        let elevation_rad = (2.0 - 26.8 * f64::from(line) / f64::from(LINES)).to_radians();
        for step in 0..DIRECTIONS {
            let azimuth_rad =
                std::f64::consts::TAU * (f64::from(step) + 0.5) / f64::from(DIRECTIONS);
            let range_m = range_m(driven_m, azimuth_rad, elevation_rad);
            let (sin, cos) = libm::sincos(azimuth_rad);
            for metres in [
                range_m * cos,
                range_m * sin,
                range_m * libm::tan(elevation_rad),
            ] {
                #[expect(clippy::cast_possible_truncation, reason = "coordinates of a point")]
                data.extend((metres as f32).to_le_bytes());
            }
            data.extend(0.5f32.to_le_bytes());
        }
    }
    let names = ["x", "y", "z", "intensity"];
    PointCloud2 {
        header: Header::at(0, "lidar"),
        height: 1,
        width: LINES * DIRECTIONS,
        fields: (0..)
            .zip(names)
            .map(|(index, name)| PointField {
                name: name.to_owned(),
                offset: 4 * index,
                datatype: PointField::FLOAT32,
                count: 1,
            })
            .collect(),
        is_bigendian: false,
        point_step: 16,
        row_step: LINES * DIRECTIONS * 16,
        data,
        is_dense: true,
    }
}

fn grid_from_a_sweep(criterion: &mut Criterion) {
    let clouds: Vec<PointCloud2> = (0..SWEEPS)
        .map(|step| sweep(f64::from(step) * STEP_M))
        .collect();
    let vehicle_from_sensor = Isometry3::translation(0.8, 0.0, HEIGHT_M);
    let mut mapper = Mapper::new(&IngestConfig::default()).expect("the default is valid");
    let mut step = 0u32;
    criterion.bench_function("grid from a sweep of 120,000 points", |bencher| {
        bencher.iter(|| {
            let odom_from_vehicle = Pose2::new(f64::from(step) * STEP_M, 0.0, 0.0);
            let cloud = &clouds[(step % SWEEPS) as usize];
            step += 1;
            let points = points_of(cloud, &vehicle_from_sensor).expect("the cloud is valid");
            mapper
                .add_points(
                    &points,
                    [0.8, 0.0, 1.8],
                    &odom_from_vehicle,
                    u64::from(step) * 100_000_000,
                )
                .expect("the pose is valid");
            mapper.occupancy()
        });
    });
}

criterion_group!(benches, grid_from_a_sweep);
criterion_main!(benches);
