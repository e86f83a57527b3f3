use std::f64::consts::{FRAC_PI_2, PI};

use proptest::prelude::*;

use super::TransformFault::{LongName, NoName, NotRigid, OwnParent, TooFar};
use super::frame::MAX_SAMPLES;
use super::*;
use crate::msg::geometry::{Transform, Vector3 as RosVector};
use crate::msg::header::Header;

const SECOND: u64 = 1_000_000_000;

/// A transform with an orientation as roll, pitch and yaw.
fn tilted(
    parent: &str,
    child: &str,
    at_nanos: u64,
    xyz: [f64; 3],
    rpy: [f64; 3],
) -> TransformStamped {
    let q = UnitQuaternion::from_euler_angles(rpy[0], rpy[1], rpy[2]);
    TransformStamped {
        header: Header::at(at_nanos, parent),
        child_frame_id: child.to_owned(),
        transform: Transform {
            translation: RosVector {
                x: xyz[0],
                y: xyz[1],
                z: xyz[2],
            },
            rotation: Quaternion {
                x: q.i,
                y: q.j,
                z: q.k,
                w: q.w,
            },
        },
    }
}

fn stamped(parent: &str, child: &str, at_nanos: u64, pose: Pose2) -> TransformStamped {
    let xyz = [pose.x_m, pose.y_m, 0.0];
    tilted(parent, child, at_nanos, xyz, [0.0, 0.0, pose.yaw_rad])
}

/// Takes transforms; the faults that were found.
fn put(buffer: &mut TransformBuffer, transforms: Vec<TransformStamped>) -> Vec<TransformFault> {
    let mut faults = Vec::new();
    buffer.insert(&TFMessage { transforms }, false, |fault, _| {
        faults.push(fault);
    });
    faults
}

fn buffer(transforms: Vec<TransformStamped>) -> TransformBuffer {
    let mut buffer = TransformBuffer::new(1.0);
    assert!(put(&mut buffer, transforms).is_empty());
    buffer
}

fn assert_near(found: &Pose2, expected: &Pose2) {
    assert!(
        found.distance_m(expected) < 1e-9 && (found.yaw_rad - expected.yaw_rad).abs() < 1e-9,
        "{found:?}, expected {expected:?}"
    );
}

#[test]
fn chains_lead_over_the_common_ancestor_and_back() {
    let mut buffer = buffer(vec![
        stamped("map", "odom", 0, Pose2::new(10.0, 0.0, FRAC_PI_2)),
        stamped("odom", "/base_link", 0, Pose2::new(2.0, 0.0, 0.0)),
        stamped("/map", "site", 0, Pose2::new(0.0, 5.0, PI)),
    ]);
    // By hand: the vehicle is at (10, 2) in the map, turned to the left by a quarter.
    let map_from_vehicle = buffer.lookup("map", "base_link", SECOND, None).unwrap();
    assert_near(&map_from_vehicle, &Pose2::new(10.0, 2.0, FRAC_PI_2));
    // The site's x axis points against the map's, from (0, 5): the vehicle is at (−10, 3) in it.
    let site_from_vehicle = buffer.lookup("/site", "base_link", SECOND, None).unwrap();
    assert_near(&site_from_vehicle, &Pose2::new(-10.0, 3.0, -FRAC_PI_2));
    let back = buffer.lookup("base_link", "site", SECOND, None).unwrap();
    assert_near(&site_from_vehicle.then(&back), &Pose2::default());
    let same = buffer.lookup("/nowhere", "nowhere", SECOND, None).unwrap();
    assert_eq!(same, Pose2::default());
}

#[test]
fn between_samples_a_transform_is_interpolated_and_beyond_them_the_nearest_is_taken() {
    let mut buffer = buffer(vec![
        stamped("odom", "base_link", 10 * SECOND, Pose2::new(0.0, 0.0, 0.0)),
        stamped("odom", "base_link", 11 * SECOND, Pose2::new(4.0, 2.0, 1.0)),
    ]);
    let mut at = |nanos| buffer.lookup("odom", "base_link", nanos, None);
    assert_near(
        &at(10 * SECOND + SECOND / 4).unwrap(),
        &Pose2::new(1.0, 0.5, 0.25),
    );
    assert_near(&at(9 * SECOND).unwrap(), &Pose2::default());
    assert_near(&at(12 * SECOND).unwrap(), &Pose2::new(4.0, 2.0, 1.0));
    // Time zero asks for the newest.
    assert_near(&at(0).unwrap(), &Pose2::new(4.0, 2.0, 1.0));
    let late = at(12 * SECOND + SECOND / 2).unwrap_err().to_string();
    assert!(
        late.contains("1.50 s off") && late.contains("\"base_link\" in \"odom\""),
        "{late}"
    );
}

#[test]
fn a_late_a_doubled_and_an_earlier_time_are_told_apart() {
    let mut buffer = buffer(vec![
        stamped("odom", "base_link", 10 * SECOND, Pose2::new(0.0, 0.0, 0.0)),
        stamped("odom", "base_link", 12 * SECOND, Pose2::new(2.0, 0.0, 0.0)),
        // Doubled with another value: the first stays.
        stamped("odom", "base_link", 12 * SECOND, Pose2::new(99.0, 0.0, 0.0)),
        // Late: it goes where its stamp belongs.
        stamped("odom", "base_link", 11 * SECOND, Pose2::new(0.0, 8.0, 0.0)),
    ]);
    let at = |buffer: &mut TransformBuffer, nanos| buffer.lookup("odom", "base_link", nanos, None);
    assert_near(
        &at(&mut buffer, 11 * SECOND).unwrap(),
        &Pose2::new(0.0, 8.0, 0.0),
    );
    assert_near(
        &at(&mut buffer, 12 * SECOND).unwrap(),
        &Pose2::new(2.0, 0.0, 0.0),
    );
    // A recording that starts over.
    put(
        &mut buffer,
        vec![stamped(
            "odom",
            "base_link",
            SECOND,
            Pose2::new(7.0, 0.0, 0.0),
        )],
    );
    assert_near(
        &at(&mut buffer, SECOND).unwrap(),
        &Pose2::new(7.0, 0.0, 0.0),
    );
    assert!(at(&mut buffer, 12 * SECOND).is_err());
}

#[test]
fn a_fixed_transform_holds_at_any_time() {
    let mut buffer = TransformBuffer::new(1.0);
    let transforms = vec![stamped(
        "base_link",
        "lidar",
        5 * SECOND,
        Pose2::new(1.0, 0.0, 0.0),
    )];
    buffer.insert(&TFMessage { transforms }, true, |fault, _| {
        panic!("{fault:?}")
    });
    for nanos in [0, SECOND, 1000 * SECOND] {
        let found = buffer.lookup("base_link", "lidar", nanos, None).unwrap();
        assert_near(&found, &Pose2::new(1.0, 0.0, 0.0));
    }
}

#[test]
fn loops_end_and_say_so() {
    let mut buffer = buffer(vec![
        stamped("a", "b", SECOND, Pose2::new(1.0, 0.0, 0.0)),
        stamped("b", "a", SECOND, Pose2::new(1.0, 0.0, 0.0)),
        stamped("a", "c", SECOND, Pose2::new(1.0, 0.0, 0.0)),
    ]);
    let error = buffer
        .lookup("base_link", "c", SECOND, None)
        .unwrap_err()
        .to_string();
    assert!(error.contains("form a loop"), "{error}");
    // What does not need the loop is still found.
    assert!(buffer.lookup("a", "c", SECOND, None).is_ok());
}

#[test]
fn what_is_no_transform_is_named_and_changes_nothing() {
    let mut buffer = buffer(vec![stamped(
        "odom",
        "base_link",
        SECOND,
        Pose2::new(1.0, 0.0, 0.0),
    )]);
    let nan = stamped(
        "odom",
        "base_link",
        2 * SECOND,
        Pose2::new(f64::NAN, 0.0, 0.0),
    );
    let mut infinite = stamped("odom", "base_link", 2 * SECOND, Pose2::default());
    infinite.transform.rotation.w = f64::INFINITY;
    let faults = put(
        &mut buffer,
        vec![
            nan,
            infinite,
            stamped("odom", "base_link", 2 * SECOND, Pose2::new(1e9, 0.0, 0.0)),
            stamped("", "x", 1, Pose2::default()),
            stamped("x", "/", 1, Pose2::default()),
            stamped("/x", "x", 1, Pose2::default()),
            stamped("x", &"y".repeat(MAX_NAME_BYTES + 1), 1, Pose2::default()),
        ],
    );
    assert_eq!(
        faults,
        [
            NotRigid, NotRigid, TooFar, NoName, NoName, OwnParent, LongName
        ]
    );
    let found = buffer
        .lookup("odom", "base_link", 2 * SECOND, None)
        .unwrap();
    assert_near(&found, &Pose2::new(1.0, 0.0, 0.0));
    assert_eq!(buffer.len(), 1);
}

#[test]
fn ten_thousand_frames_do_not_push_out_those_that_are_used() {
    let mut buffer = buffer(vec![stamped("map", "odom", 0, Pose2::new(3.0, 0.0, 0.0))]);
    assert!(buffer.lookup("map", "odom", SECOND, None).is_ok());
    let flood = |from: u32| {
        let names = from..from + 10_000;
        names
            .map(|k| stamped("map", &format!("junk{k}"), SECOND, Pose2::default()))
            .collect::<Vec<_>>()
    };
    for round in 0..3 {
        put(&mut buffer, flood(10_000 * round));
        assert!(buffer.len() <= MAX_BUFFERED_FRAMES);
        let found = buffer.lookup("map", "odom", SECOND, None).unwrap();
        assert_near(&found, &Pose2::new(3.0, 0.0, 0.0));
    }
    // One that comes after them finds room.
    put(
        &mut buffer,
        vec![stamped("odom", "base_link", 0, Pose2::default())],
    );
    assert!(buffer.lookup("map", "base_link", SECOND, None).is_ok());
    // Also where every frame was asked for.
    let names: Vec<String> = buffer.frames.keys().map(ToString::to_string).collect();
    for name in names {
        buffer.lookup("map", &name, SECOND, None).unwrap();
    }
    put(
        &mut buffer,
        vec![stamped("odom", "late", 0, Pose2::default())],
    );
    assert!(buffer.lookup("odom", "late", SECOND, None).is_ok());
    assert!(buffer.len() <= MAX_BUFFERED_FRAMES && buffer.unused.len() <= MAX_BUFFERED_FRAMES);
}

#[test]
fn a_frames_history_is_limited_and_longer_than_two_seconds_at_any_rate() {
    for period_nanos in [1_000_000, 10_000_000, 20_000_000, 100_000_000] {
        let mut buffer = TransformBuffer::new(1.0);
        let newest = 10 * SECOND;
        let mut nanos = SECOND;
        while nanos <= newest {
            let pose = Pose2::new(nanos as f64 / 1e9, 0.0, 0.0);
            put(&mut buffer, vec![stamped("odom", "base_link", nanos, pose)]);
            nanos += period_nanos;
        }
        assert!(buffer.frames["base_link"].samples() <= MAX_SAMPLES);
        let found = buffer
            .lookup("odom", "base_link", 8 * SECOND, None)
            .unwrap();
        assert_near(&found, &Pose2::new(8.0, 0.0, 0.0));
    }
}

#[test]
fn deep_chains_end() {
    let deep = (0..200).map(|k| {
        stamped(
            &format!("f{k}"),
            &format!("f{}", k + 1),
            0,
            Pose2::new(1.0, 0.0, 0.0),
        )
    });
    let mut buffer = buffer(deep.collect());
    let near = buffer.lookup("f0", "f60", SECOND, None).unwrap();
    assert_near(&near, &Pose2::new(60.0, 0.0, 0.0));
    assert!(buffer.lookup("f0", "f199", SECOND, None).is_err());
}

#[test]
fn a_tilt_is_refused_unless_it_is_that_of_a_slope_or_cancels_out() {
    let mut buffer = buffer(vec![
        tilted("map", "slope", 0, [0.0; 3], [0.0, 0.2, 0.3]),
        tilted("map", "wall", 0, [0.0; 3], [0.0, 1.2, 0.0]),
        tilted("map", "upside_down", 0, [0.0; 3], [PI, 0.0, 0.0]),
        tilted("upside_down", "upright", 0, [0.0, 0.0, 1.0], [PI, 0.0, 0.5]),
    ]);
    assert!(buffer.lookup("map", "slope", SECOND, None).is_ok());
    for (name, degrees) in [("wall", "69 degrees"), ("upside_down", "180 degrees")] {
        let error = buffer
            .lookup("map", name, SECOND, None)
            .unwrap_err()
            .to_string();
        assert!(error.contains(degrees), "{error}");
    }
    let upright = buffer.lookup("map", "upright", SECOND, None).unwrap();
    assert!((upright.yaw_rad + 0.5).abs() < 1e-9, "{upright:?}");
}

#[test]
fn what_is_known_from_elsewhere_comes_before_what_is_buffered() {
    let mut buffer = buffer(vec![
        stamped("map", "odom", 0, Pose2::new(100.0, 0.0, 0.0)),
        stamped("other", "base_link", 0, Pose2::new(5.0, 5.0, 0.0)),
    ]);
    let link = Link {
        parent: "/odom",
        child: "base_link",
        parent_from_child: Pose2::new(1.0, 2.0, 0.5),
    };
    let found = buffer
        .lookup("map", "base_link", SECOND, Some(link))
        .unwrap();
    assert_near(&found, &Pose2::new(101.0, 2.0, 0.5));
    let error = buffer
        .lookup("map", "base_link", SECOND, None)
        .unwrap_err()
        .to_string();
    assert!(error.contains("end at \"other\" and at \"map\""), "{error}");
    let error = buffer
        .lookup("base_link", "mars", SECOND, Some(link))
        .unwrap_err()
        .to_string();
    assert!(error.contains("nothing is known of \"mars\""), "{error}");
}

proptest! {
    #[test]
    fn nothing_that_comes_does_harm(
        transforms in proptest::collection::vec(
            (0u8..6, 0u8..6, 0u64..40, any::<[f64; 4]>()),
            0..200,
        ),
        queries in proptest::collection::vec((0u8..7, 0u8..7, 0u64..50), 0..20),
    ) {
        let mut buffer = TransformBuffer::new(1.0);
        let transforms = transforms.into_iter().map(|(parent, child, at, numbers)| {
            let mut one = stamped(&parent.to_string(), &child.to_string(), at * SECOND, Pose2::new(numbers[0], numbers[1], 0.0));
            (one.transform.rotation.z, one.transform.rotation.w) = (numbers[2], numbers[3]);
            one
        });
        put(&mut buffer, transforms.collect());
        for (to, from, at) in queries {
            let (to, from) = (to.to_string(), from.to_string());
            if let Ok(pose) = buffer.lookup(&to, &from, at * SECOND, None) {
                prop_assert!(pose.is_finite(), "{:?}", pose);
            }
        }
    }
}
