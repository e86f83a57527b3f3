use std::f64::consts::FRAC_PI_2;

use swath_bridge::msg::geometry::{Transform, TransformStamped, Vector3};
use swath_bridge::msg::header::Header;
use swath_bridge::poses::{odometry_message, ros_pose};
use swath_bridge::{Frame, GridSpec, Occupancy};

use super::*;

const SECOND: u64 = 1_000_000_000;

fn odometry(parent: &str, child: &str, at_nanos: u64, pose: Pose2) -> Odometry {
    let frame = Frame {
        stamp_nanos: at_nanos,
        occupancy: Occupancy::filled(GridSpec::default(), 0),
        odom_from_vehicle: pose,
        speed_m_per_s: 2.0,
        turn_rad_per_s: 0.5,
        reference: Vec::new(),
    };
    let mut odometry = odometry_message(&Header::at(at_nanos, child), &frame);
    parent.clone_into(&mut odometry.header.frame_id);
    odometry
}

fn transform(parent: &str, child: &str, at_nanos: u64, pose: Pose2) -> TFMessage {
    let pose = ros_pose(&pose);
    TFMessage {
        transforms: vec![TransformStamped {
            header: Header::at(at_nanos, parent),
            child_frame_id: child.to_owned(),
            transform: Transform {
                translation: Vector3 {
                    x: pose.position.x,
                    y: pose.position.y,
                    z: 0.0,
                },
                rotation: pose.orientation,
            },
        }],
    }
}

fn frames(vehicle: &str) -> Frames {
    Frames::new(FramesConfig {
        vehicle: vehicle.to_owned(),
        ..FramesConfig::default()
    })
}

fn take(frames: &mut Frames, message: &TFMessage) {
    frames.take(message, false, |fault, child| panic!("{child}: {fault:?}"));
}

fn assert_near(found: &Pose2, expected: &Pose2) {
    assert!(
        found.distance_m(expected) < 1e-9 && (found.yaw_rad - expected.yaw_rad).abs() < 1e-9,
        "{found:?}, expected {expected:?}"
    );
}

#[test]
fn the_vehicles_frame_is_as_it_is_whatever_its_slash() {
    let mut frames = frames("");
    for name in ["", "/", "base_link", "/base_link"] {
        let found = frames.vehicle_from(name, SECOND, None).unwrap();
        assert_eq!(found, Pose2::default(), "{name:?}");
    }
    assert!(frames.vehicle_from("base_footprint", SECOND, None).is_err());
    // Odometry names it.
    let of = odometry("odom", "/base_footprint", SECOND, Pose2::default());
    frames.read(&of).unwrap();
    assert!(frames.vehicle_from("base_footprint", SECOND, None).is_ok());
    assert!(frames.vehicle_from("base_link", SECOND, None).is_err());
}

#[test]
fn odometry_joins_its_frame_and_tf_what_is_beyond() {
    let mut frames = frames("");
    let pose = Pose2::new(10.0, 4.0, FRAC_PI_2);
    let read = frames
        .read(&odometry("/odom", "base_link", SECOND, pose))
        .unwrap();
    let moment = Some(&read.moment);
    let from_odom = frames.vehicle_from("odom", SECOND, moment).unwrap();
    // By hand: the odometry's origin is 4 m behind the vehicle, 10 m to its left.
    assert_near(&from_odom, &Pose2::new(-4.0, 10.0, -FRAC_PI_2));
    take(
        &mut frames,
        &transform("map", "odom", SECOND, Pose2::new(1.0, 0.0, 0.0)),
    );
    let from_map = frames.vehicle_from("/map", SECOND, moment).unwrap();
    assert_near(&from_map, &Pose2::new(-4.0, 11.0, -FRAC_PI_2));
    // Also where tf has the vehicle elsewhere: odometry comes first.
    take(
        &mut frames,
        &transform("odom", "base_link", SECOND, Pose2::default()),
    );
    let from_odom = frames.vehicle_from("odom", SECOND, moment).unwrap();
    assert_near(&from_odom, &Pose2::new(-4.0, 10.0, -FRAC_PI_2));
    // And alone where there is no odometry at the time.
    assert_near(
        &frames.vehicle_from("odom", SECOND, None).unwrap(),
        &Pose2::default(),
    );
}

#[test]
fn missing_odometry_is_told_from_missing_transforms() {
    let mut frames = frames("");
    let error = frames.vehicle_from("odom", SECOND, None).unwrap_err();
    assert!(matches!(error, NotSeen::NoOdometry { .. }), "{error}");
    assert!(
        error.to_string().contains("no odometry has come"),
        "{error}"
    );
    frames
        .read(&odometry("odom", "base_link", SECOND, Pose2::default()))
        .unwrap();
    let error = frames.vehicle_from("odom", 3 * SECOND, None).unwrap_err();
    assert!(error.to_string().contains("2.00 s older"), "{error}");
    let error = frames.vehicle_from("mars", SECOND, None).unwrap_err();
    assert!(matches!(error, NotSeen::NoTransform(_)), "{error}");
    assert!(
        error.to_string().contains("from \"mars\" to \"base_link\""),
        "{error}"
    );
}

#[test]
fn odometry_without_frames_is_that_of_the_vehicle_in_odom() {
    let mut frames = frames("chassis");
    let read = frames
        .read(&odometry("", "", SECOND, Pose2::new(3.0, 0.0, 0.0)))
        .unwrap();
    let found = frames
        .vehicle_from("odom", SECOND, Some(&read.moment))
        .unwrap();
    assert_near(&found, &Pose2::new(-3.0, 0.0, 0.0));
    assert!(frames.vehicle_from("chassis", SECOND, None).is_ok());
}

#[test]
fn odometry_of_another_part_is_moved_to_the_vehicle() {
    let mut frames = frames("base_link");
    let of_mast = odometry("odom", "mast", SECOND, Pose2::new(5.0, 0.0, 0.0));
    let fault = frames.read(&of_mast).unwrap_err();
    assert!(matches!(fault, OdometryFault::NoTransform(_)), "{fault}");
    // The mast stands 1 m ahead of the vehicle's origin and 2 m to its left, looking forward.
    take(
        &mut frames,
        &transform("base_link", "mast", 0, Pose2::new(1.0, 2.0, 0.0)),
    );
    let read = frames.read(&of_mast).unwrap();
    assert_near(&read.moment.odom_from_vehicle, &Pose2::new(4.0, -2.0, 0.0));
    // It turns to the left at 0.5 rad/s, so what is 2 m to the right of the mast is 1 m/s faster.
    assert!((read.moment.speed_m_per_s - 3.0).abs() < 1e-9, "{read:?}");
    let found = frames
        .vehicle_from("odom", SECOND, Some(&read.moment))
        .unwrap();
    assert_near(&found, &Pose2::new(-4.0, 2.0, 0.0));
    let found = frames
        .vehicle_from("mast", SECOND, Some(&read.moment))
        .unwrap();
    assert_near(&found, &Pose2::new(1.0, 2.0, 0.0));
}

#[test]
fn a_vehicle_frame_below_the_odometrys_keeps_its_place() {
    let mut frames = frames("base_link");
    take(
        &mut frames,
        &transform("base_footprint", "base_link", 0, Pose2::new(0.5, 0.0, 0.0)),
    );
    let of = odometry("odom", "base_footprint", SECOND, Pose2::new(5.0, 0.0, 0.0));
    let read = frames.read(&of).unwrap();
    assert_near(&read.moment.odom_from_vehicle, &Pose2::new(5.5, 0.0, 0.0));
    for (frame, expected) in [
        ("base_footprint", Pose2::new(-0.5, 0.0, 0.0)),
        ("odom", Pose2::new(-5.5, 0.0, 0.0)),
    ] {
        let found = frames
            .vehicle_from(frame, SECOND, Some(&read.moment))
            .unwrap();
        assert_near(&found, &expected);
    }
}

#[test]
fn a_second_odometry_is_refused_until_the_first_one_stops() {
    let mut frames = frames("");
    let first = |at| odometry("odom", "base_link", at, Pose2::default());
    let second = |at| odometry("ekf", "base_link", at, Pose2::default());
    assert!(!frames.read(&first(SECOND)).unwrap().is_anew);
    let fault = frames.read(&second(SECOND + 1)).unwrap_err();
    assert!(fault.to_string().contains("\"ekf\""), "{fault}");
    assert!(!frames.read(&first(SECOND + 2)).unwrap().is_anew);
    assert!(frames.read(&second(2 * SECOND)).unwrap().is_anew);
    assert!(!frames.read(&second(2 * SECOND + 1)).unwrap().is_anew);
}

#[test]
fn odometry_that_is_upside_down_is_refused() {
    let mut frames = frames("");
    let mut of = odometry("odom", "base_link", SECOND, Pose2::default());
    of.pose.pose.orientation.x = 1.0;
    of.pose.pose.orientation.w = 0.0;
    let fault = frames.read(&of).unwrap_err();
    assert_eq!(fault, OdometryFault::Tilted { tilt_deg: 180.0 });
}

#[test]
fn ages_out_of_range_are_refused() {
    for max_age_s in [-1.0, f64::NAN, 1e9] {
        let config = FramesConfig {
            max_age_s,
            ..FramesConfig::default()
        };
        assert!(
            config
                .validate()
                .unwrap_err()
                .to_string()
                .contains("frames.max_age_s")
        );
    }
    FramesConfig::default().validate().unwrap();
}
