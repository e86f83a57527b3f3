use proptest::prelude::*;
use swath_bridge::{Cell, GridSpec, Outcome, cdr};

use super::*;
use crate::{Run, SampleStream};

fn generator() -> Arc<Generator> {
    Arc::new(Generator::new(GeneratorConfig::default(), Scenes::Procedural).unwrap())
}

fn plane(sample: &Sample, packed: &[u8]) -> Plane {
    Plane::from_packed(sample.rows, sample.cols, packed.to_vec()).unwrap()
}

#[test]
fn a_sample_is_the_same_bytes_alone_in_a_stream_and_on_any_number_of_threads() {
    let generator = generator();
    let run = Run {
        seed: 7,
        first: 100,
        count: Some(21),
    };
    let mut memory = SearchMemory::new();
    let alone: Vec<Vec<u8>> = (100..121)
        .rev()
        .map(|index| cdr::to_vec(&generator.sample(7, index, &mut memory).unwrap()).unwrap())
        .collect();
    for workers in [1, 3] {
        let streamed: Vec<Vec<u8>> = SampleStream::start(&generator, run, workers)
            .unwrap()
            .map(|sample| cdr::to_vec(&sample.unwrap()).unwrap())
            .collect();
        assert!(streamed.iter().eq(alone.iter().rev()), "{workers} workers");
    }
    let again = generate_sample(7, 100, &GeneratorConfig::default()).unwrap();
    assert_eq!(cdr::to_vec(&again).unwrap(), alone[20]);
}

#[test]
fn five_samples_share_a_target_but_neither_obstacles_nor_reference() {
    let generator = generator();
    let mut memory = SearchMemory::new();
    let samples: Vec<Sample> = (35..40)
        .map(|index| generator.sample(3, index, &mut memory).unwrap())
        .collect();
    let other = generator.sample(3, 40, &mut memory).unwrap();
    for (position, sample) in samples.iter().enumerate() {
        assert_eq!(sample.goal, samples[0].goal);
        assert_eq!(sample.target, samples[0].target);
        assert_eq!(sample.scene_id, samples[0].scene_id);
        for later in &samples[position + 1..] {
            assert_ne!(sample.obstacles, later.obstacles);
            assert_ne!(sample.reference, later.reference);
        }
    }
    assert_ne!(other.scene_id, samples[0].scene_id);
    assert_ne!(other.goal, samples[0].goal);
}

#[test]
fn the_label_does_not_see_the_shift_of_the_reference() {
    let mut config = GeneratorConfig::default();
    let shifted = generate_sample(11, 2, &config).unwrap();
    config.augment.shift_across_m = 0.0;
    config.augment.shift_along_m = 0.0;
    config.augment.shift_rad = 0.0;
    let straight = generate_sample(11, 2, &config).unwrap();
    assert_ne!(shifted.reference, straight.reference);
    assert_eq!(
        Sample {
            reference: Vec::new(),
            ..shifted
        },
        Sample {
            reference: Vec::new(),
            ..straight
        }
    );
}

#[test]
fn most_targets_can_be_reached_and_far_ones_are_among_them() {
    let generator = generator();
    let run = Run {
        seed: 1,
        first: 0,
        count: Some(140),
    };
    let samples: Vec<Sample> = SampleStream::start(&generator, run, 0)
        .unwrap()
        .map(Result::unwrap)
        .collect();
    let solved = |sample: &&Sample| sample.outcome == Outcome::Solved.code();
    let reached = samples.iter().filter(solved).count();
    assert!(reached >= 105, "{reached} of 140");
    assert!(
        samples
            .iter()
            .filter(solved)
            .any(|sample| sample.goal.x_m > 40.0)
    );
    let kinds: std::collections::BTreeSet<&str> =
        samples.iter().map(|sample| sample.scene.as_str()).collect();
    assert_eq!(kinds.len(), 7);
}

/// FNV-1a.
fn digest(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

/// Holds the promise that a seed means the same on every machine. A change of what is drawn changes
/// these numbers, and is then to be noted as a change of every data set.
#[test]
fn known_samples_are_what_they_were_on_the_first_machine() {
    let generator = generator();
    let mut memory = SearchMemory::new();
    let digests: Vec<u64> = (0..7)
        .map(|kind| generator.sample(1, 5 * kind, &mut memory).unwrap())
        .map(|sample| {
            digest(
                &[
                    sample.obstacles,
                    sample.reference,
                    sample.target,
                    sample.label,
                ]
                .concat(),
            )
        })
        .collect();
    assert_eq!(digests, KNOWN);
}

const KNOWN: [u64; 7] = [
    0x535e_e68b_a2c2_ccce,
    0xe960_1885_69dc_6a7b,
    0x95cb_ca77_755e_6103,
    0xa574_1e65_fc37_b272,
    0x5181_141b_02e5_7855,
    0xb5de_c05f_1515_2daa,
    0xc721_435d_8dd2_b63a,
];

/// Whether the full footprint at a pose holds the centre of an occupied cell.
fn hits(vehicle: &swath_bridge::Vehicle, pose: &PlanarPose, obstacles: &[(f64, f64)]) -> bool {
    let (sin, cos) = f64::from(pose.yaw_rad).sin_cos();
    obstacles.iter().any(|(x, y)| {
        let (dx, dy) = (x - f64::from(pose.x_m), y - f64::from(pose.y_m));
        let (ahead, left) = (cos * dx + sin * dy, cos * dy - sin * dx);
        ahead > -vehicle.rear_m && ahead < vehicle.front_m && left.abs() < vehicle.half_width_m
    })
}

fn centres(spec: &GridSpec, plane: &Plane) -> Vec<(f64, f64)> {
    (0..plane.len())
        .filter(|&index| plane.get_index(index))
        .map(|index| spec.centre_of(spec.cell_of_index(index)))
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn samples_are_whole_and_their_paths_drivable(seed: u64, index: u64) {
        let config = GeneratorConfig::default();
        let spec = config.grid;
        let mut fast = config.clone();
        fast.label.max_expansions = 20_000;
        let sample = generate_sample(seed, index, &fast).unwrap();
        let (obstacles, label) = (plane(&sample, &sample.obstacles), plane(&sample, &sample.label));
        let target = plane(&sample, &sample.target);
        prop_assert_eq!((sample.seed, sample.index), (seed, index));
        let outcome = Outcome::from_code(sample.outcome).unwrap();
        prop_assert_ne!(outcome, Outcome::StartOccupied);
        if outcome != Outcome::Solved {
            prop_assert_eq!(label.count(), 0);
            prop_assert!(sample.path.is_empty());
            return Ok(());
        }
        prop_assert!(target.count() > 0);
        prop_assert!(label.get(Cell::new(300, 75)));
        let (first, last) = (&sample.path[0], &sample.path[sample.path.len() - 1]);
        prop_assert!(first.x_m.hypot(first.y_m) < 1e-3);
        prop_assert!((last.x_m - sample.goal.x_m).hypot(last.y_m - sample.goal.y_m) < 0.501);
        let occupied = centres(&spec, &obstacles);
        for pose in &sample.path {
            prop_assert!(!hits(&config.vehicle, pose, &occupied), "{pose:?} hits an obstacle");
        }
        for (x_m, y_m) in centres(&spec, &label) {
            let nearest_m = sample
                .path
                .iter()
                .map(|pose| (x_m - f64::from(pose.x_m)).hypot(y_m - f64::from(pose.y_m)))
                .fold(f64::INFINITY, f64::min);
            prop_assert!(nearest_m < 1.4 + 0.11, "the label is {nearest_m} m off the path");
        }
    }
}
