//! Sensor messages that decode, chosen by the first byte, on their way to points, beams and grids.

#![no_main]

use libfuzzer_sys::fuzz_target;
use nalgebra::Isometry3;
use swath_bridge::cdr;
use swath_bridge::ingest::cloud::points_of;
use swath_bridge::ingest::scan::{BeamConfig, beams_of};
use swath_bridge::ingest::transform::TransformTree;
use swath_bridge::msg::nav::OccupancyGrid;
use swath_bridge::msg::sensor::{LaserScan, PointCloud2};
use swath_bridge::msg::tf2::TFMessage;
use swath_bridge::{GridSpec, Occupancy};

fuzz_target!(|data: &[u8]| {
    let Some((&kind, payload)) = data.split_first() else {
        return;
    };
    let identity = Isometry3::identity();
    match kind % 4 {
        0 => {
            if let Ok(cloud) = cdr::from_slice::<PointCloud2>(payload)
                && let Ok(points) = points_of(&cloud, &identity)
            {
                assert!(points.iter().flatten().all(|value| value.is_finite()));
            }
        }
        1 => {
            if let Ok(scan) = cdr::from_slice::<LaserScan>(payload) {
                let _ = beams_of(&scan, &identity, &BeamConfig { clear_m: 20.0, is_limit_return: payload.len() % 2 == 0 });
            }
        }
        2 => {
            if let Ok(message) = cdr::from_slice::<TFMessage>(payload) {
                let mut transforms = TransformTree::default();
                transforms.insert(&message);
                let _ = transforms.lookup("base_link", "lidar");
            }
        }
        _ => {
            if let Ok(message) = cdr::from_slice::<OccupancyGrid>(payload) {
                let spec = GridSpec::default();
                if let Ok(occupancy) = Occupancy::from_message(&message, &spec) {
                    assert_eq!(occupancy.spec, spec);
                }
            }
        }
    }
});
