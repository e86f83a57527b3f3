//! Logs whose clocks or whose order are not what one would like: each frame has the pose and the
//! obstacles of its own moment all the same, or the log is refused with the reason.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

mod world;

use std::path::Path;

use swath_bridge::Frame;
use swath_bridge::ingest::{Clock, GridsOut, IngestConfig, IngestReport, write_grids};
use swath_bridge::recording::{Existing, Reader};
use tempfile::TempDir;
use world::{
    Drive, Message, NOW, REAR, SECOND, STEP, STRAIGHT, assert_pose, assert_world, error_of,
    message, mounting, read, read_plain, scan, straight, transform, turning, write,
};

/// A simulation's second drive, which turns; its clock began again.
const SECOND_DRIVE: Drive = Drive {
    pose: turning,
    odom_nanos: 10 * SECOND,
    scan_nanos: 10 * SECOND,
    log_nanos: NOW + 20 * SECOND,
    ..STRAIGHT
};

/// The first one.
const FIRST_DRIVE: Drive = Drive {
    odom_nanos: 10 * SECOND,
    scan_nanos: 10 * SECOND,
    ..STRAIGHT
};

fn frames_of(messages: Vec<Message>) -> (Vec<Frame>, IngestReport) {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("log.mcap");
    write(&path, &[vec![mounting()], messages].concat());
    read_plain(&path)
}

/// Checks the frames of a straight drive and of one that turns behind it.
fn assert_drives(frames: &[Frame], first: u64) {
    for (number, frame) in (0..).zip(frames) {
        if number < first {
            assert_pose(frame, &straight(number));
        } else {
            assert_pose(frame, &turning(number - first));
        }
        assert_world(frame);
    }
}

#[test]
fn clocks_that_run_on_are_the_control() {
    let (frames, report) = frames_of(STRAIGHT.messages());
    assert_eq!((frames.len(), report.drives), (20, 1));
    assert_drives(&frames, 20);
    assert_eq!(report.warnings, Vec::<String>::new());
}

#[test]
fn a_clock_that_begins_again_makes_two_drives_with_a_warning() {
    let messages = [FIRST_DRIVE.messages(), SECOND_DRIVE.messages()].concat();
    let (frames, report) = frames_of(messages);
    assert_eq!(
        (frames.len(), report.drives, report.without_pose),
        (40, 2, 0)
    );
    assert_drives(&frames, 20);
    // The first frame of the second drive knows nothing of the first, and its way turns.
    let way = &frames[20].reference;
    assert!(way.len() > 5 && way.last().unwrap().y_m > 1.0, "{way:?}");
    let way = &frames[19].reference;
    assert!(way.iter().all(|pose| pose.y_m.abs() < 1e-6), "{way:?}");
    assert_eq!(report.warnings.len(), 1, "{:?}", report.warnings);
    assert!(report.warnings[0].contains("begin again"));
}

#[test]
fn several_restarts_and_log_times_that_restart_too_are_told_apart() {
    for log_goes_on in [true, false] {
        let third = Drive {
            log_nanos: NOW + 40 * SECOND,
            ..FIRST_DRIVE
        };
        let messages: Vec<Message> = [FIRST_DRIVE, SECOND_DRIVE, third]
            .iter()
            .flat_map(|drive| {
                let log_nanos = if log_goes_on {
                    drive.log_nanos
                } else {
                    10 * SECOND
                };
                Drive {
                    log_nanos,
                    ..*drive
                }
                .messages()
            })
            .collect();
        let (frames, report) = frames_of(messages);
        assert_eq!((frames.len(), report.drives), (60, 3), "{log_goes_on}");
        assert_drives(&frames[..40], 20);
        assert_drives(&frames[40..], 20);
    }
}

#[test]
fn where_only_one_clock_begins_again_no_pose_is_made_up() {
    // Odometry begins again, the scanner's stamps go on; and the other way round.
    let late = SECOND_DRIVE.log_nanos - NOW;
    let odometry_only = Drive {
        scan_nanos: 10 * SECOND + late,
        ..SECOND_DRIVE
    };
    let scanner_only = Drive {
        odom_nanos: 10 * SECOND + late,
        ..SECOND_DRIVE
    };
    for second in [odometry_only, scanner_only] {
        let messages = [FIRST_DRIVE.messages(), second.messages()].concat();
        let (frames, report) = frames_of(messages.clone());
        assert_eq!((frames.len(), report.without_pose), (20, 20));
        assert_drives(&frames, 20);
        // The times of recording tell what belongs together.
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("log.mcap");
        write(&path, &[vec![mounting()], messages].concat());
        let config = IngestConfig {
            clock: Clock::Record,
            ..IngestConfig::default()
        };
        let (frames, report) = read(&path, &config);
        assert_eq!((frames.len(), report.without_pose), (40, 0));
        for frame in &frames {
            assert_world(frame);
        }
    }
}

#[test]
fn a_short_restart_of_the_odometry_alone_is_noticed_too() {
    // 2 s into the drive odometry begins again; the scanner's stamps, which go on, mean later poses now.
    let first = Drive {
        steps: 20,
        ..FIRST_DRIVE
    };
    let second = Drive {
        odom_nanos: 10 * SECOND,
        scan_nanos: 12 * SECOND + 2 * STEP,
        log_nanos: NOW + 2 * SECOND,
        ..SECOND_DRIVE
    };
    let (frames, report) = frames_of([first.messages(), second.messages()].concat());
    assert_eq!((frames.len(), report.without_pose), (6, 20), "{report:?}");
    let said = report
        .warnings
        .iter()
        .any(|warning| warning.contains("--clock record"));
    assert!(said, "{:?}", report.warnings);
}

#[test]
fn files_that_were_merged_topic_by_topic_or_half_by_half_give_the_same_frames() {
    let expected = frames_of(STRAIGHT.messages()).0;
    let mut by_topic = STRAIGHT.messages();
    by_topic.sort_by(|a, b| b.topic.cmp(&a.topic));
    let mut by_odometry = STRAIGHT.messages();
    by_odometry.sort_by(|a, b| a.topic.cmp(&b.topic));
    let mut halves = STRAIGHT.messages();
    halves.rotate_left(30);
    let mut backwards = STRAIGHT.messages();
    backwards.reverse();
    let mut shuffled = STRAIGHT.messages();
    shuffled.sort_by_cached_key(|message| message.log_nanos / 1000 * 7919 % 6007);
    for messages in [by_topic, by_odometry, halves, backwards, shuffled] {
        let (frames, report) = frames_of(messages);
        assert_eq!(frames, expected);
        assert_eq!(report.drives, 1);
    }
    // The mounting comes last.
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("log.mcap");
    write(&path, &[STRAIGHT.messages(), vec![mounting()]].concat());
    assert_eq!(read_plain(&path).0, expected);
}

#[test]
fn restarts_in_a_file_stored_topic_by_topic_are_told_apart() {
    for log_goes_on in [true, false] {
        let second = Drive {
            log_nanos: if log_goes_on { NOW + 20 * SECOND } else { NOW },
            ..SECOND_DRIVE
        };
        let mut messages = [FIRST_DRIVE.messages(), second.messages()].concat();
        messages.sort_by(|a, b| a.topic.cmp(&b.topic));
        let (frames, report) = frames_of(messages);
        assert_eq!((frames.len(), report.drives), (40, 2), "{log_goes_on}");
        assert_drives(&frames, 20);
    }
}

#[test]
fn log_times_of_0_do_no_harm_where_there_are_stamps() {
    let expected = frames_of(STRAIGHT.messages()).0;
    for without in [3, 80] {
        let mut messages = STRAIGHT.messages();
        for message in &mut messages[..without] {
            message.log_nanos = 0;
        }
        let (frames, report) = frames_of(messages.clone());
        assert_eq!(frames, expected, "{without}");
        assert_eq!(report.without_pose, 0);
        messages.sort_by(|a, b| b.topic.cmp(&a.topic));
        assert_eq!(frames_of(messages).0, expected, "{without}, by topic");
    }
}

#[test]
fn two_clocks_are_named_with_their_times_unless_those_of_recording_are_taken() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("log.mcap");
    let boot = Drive {
        scan_nanos: 3484 * SECOND + 250_000_000,
        ..STRAIGHT
    };
    write(&path, &[vec![mounting()], boot.messages()].concat());
    let error = error_of(&path, &IngestConfig::default());
    for part in [
        "/scan is from 3484.250 s to 3486.150 s",
        "/odom from 1700000000.000 s to 1700000005.900 s",
        "--clock record",
    ] {
        assert!(error.contains(part), "{error}");
    }
    let config = IngestConfig {
        clock: Clock::Record,
        ..IngestConfig::default()
    };
    let (frames, _) = read(&path, &config);
    assert_eq!(frames.len(), 20);
    for (step, frame) in (0..).zip(&frames) {
        // Scans were recorded a microsecond behind the odometry.
        let expected = straight(step);
        assert!((frame.odom_from_vehicle.x_m - expected.x_m).abs() < 1e-4);
        assert_world(frame);
    }
}

#[test]
fn a_sensor_with_a_clock_of_its_own_is_named_beside_one_that_is_used() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("log.mcap");
    let mut messages = vec![
        mounting(),
        message("/tf_static", NOW, &transform("rear_laser", &REAR)),
    ];
    messages.extend(STRAIGHT.messages());
    for step in 0..20 {
        let rear = scan(
            100 * SECOND + step * STEP,
            "rear_laser",
            &straight(step).then(&REAR),
        );
        messages.push(message("/rear/scan", NOW + step * STEP, &rear));
    }
    write(&path, &messages);
    let (frames, report) = read_plain(&path);
    assert_eq!(
        (frames.len(), report.sweeps, report.without_pose),
        (20, 40, 20)
    );
    let said = |part: &str| report.warnings.iter().any(|warning| warning.contains(part));
    assert!(said("messages on /rear/scan"), "{:?}", report.warnings);
}

/// The log times of a recording's grids.
fn log_times(path: &Path) -> Vec<u64> {
    let messages = Reader::open(path).unwrap().map(Result::unwrap);
    let grids = messages.filter(|message| message.topic.ends_with("/grid"));
    grids.map(|message| message.log_nanos).collect()
}

#[test]
fn grids_of_several_drives_stay_in_their_order() {
    let folder = TempDir::new().unwrap();
    let [log, out] = ["log.mcap", "grids.mcap"].map(|name| folder.path().join(name));
    let messages = [FIRST_DRIVE.messages(), SECOND_DRIVE.messages()].concat();
    write(&log, &[vec![mounting()], messages].concat());
    let to = GridsOut {
        recording: &out,
        existing: Existing::Refuse,
        pictures: None,
    };
    write_grids(&log, &to, &IngestConfig::default(), &mut |_| ()).unwrap();
    let times = log_times(&out);
    assert_eq!(times.len(), 40);
    assert!(times.windows(2).all(|pair| pair[0] < pair[1]), "{times:?}");
    assert_eq!(times[20] - times[19], SECOND);
    // It is not overwritten, and what is there stays.
    let error = write_grids(&log, &to, &IngestConfig::default(), &mut |_| ()).unwrap_err();
    assert!(error.to_string().contains("--force"), "{error}");
    assert_eq!(log_times(&out), times);
}
