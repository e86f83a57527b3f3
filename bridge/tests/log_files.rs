//! Logs as users have them: folders, compressed files, other encodings, odd layouts, several sensors.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

mod world;

use std::collections::BTreeMap;
use std::path::Path;

use mcap::WriteOptions;
use mcap::records::MessageHeader;
use swath_bridge::ingest::{IngestConfig, SensorKind};
use swath_bridge::msg::header::Header;
use swath_bridge::msg::sensor::{LaserScan, PointCloud2, PointField};
use swath_bridge::recording::{Log, info};
use swath_bridge::{Frame, Pose2};
use tempfile::TempDir;
use world::{
    BOXES_M, FRONT, Message, NOW, REAR, STEP, STRAIGHT, assert_pose, assert_world, error_of,
    message, mounting, occupied_m, odometry, range_m, read, read_plain, scan, straight, transform,
    write,
};

fn log() -> Vec<Message> {
    [vec![mounting()], STRAIGHT.messages()].concat()
}

fn folder_with(metadata: &str, files: &[(&str, &[u8])]) -> TempDir {
    let folder = TempDir::new().unwrap();
    if !metadata.is_empty() {
        let text = format!(
            "rosbag2_bagfile_information:\n  version: 9\n  storage_identifier: mcap\n{metadata}"
        );
        std::fs::write(folder.path().join("metadata.yaml"), text).unwrap();
    }
    for (name, bytes) in files {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    folder
}

fn bytes_of(messages: &[Message]) -> Vec<u8> {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("a.mcap");
    write(&path, messages);
    std::fs::read(path).unwrap()
}

/// Two files: the mounting is in the first one only.
fn halves() -> [Vec<u8>; 2] {
    let all = log();
    [bytes_of(&all[..21]), bytes_of(&all[21..])]
}

fn expected() -> Vec<Frame> {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("log.mcap");
    write(&path, &log());
    let frames = read_plain(&path).0;
    assert_eq!(frames.len(), 20);
    frames
}

const TWO_FILES: &str = "  compression_format: \"\"\n  compression_mode: \"\"\n  \
    relative_file_paths:\n    - b_0.mcap\n    - b_1.mcap\n";

#[test]
fn a_folder_is_one_log() {
    let [first, second] = halves();
    let packed = [&first, &second].map(|bytes| zstd::encode_all(&bytes[..], 1).unwrap());
    let file_mode = TWO_FILES
        .replace("mode: \"\"", "mode: FILE")
        .replace("format: \"\"", "format: zstd");
    let packed_names = file_mode.replace(".mcap", ".mcap.zstd");
    let parents = TWO_FILES.replace("- b_", "- drive/b_");
    for folder in [
        folder_with(TWO_FILES, &[("b_0.mcap", &first), ("b_1.mcap", &second)]),
        // Without metadata: by name, and numbers count as numbers.
        folder_with("", &[("b_9.mcap", &first), ("b_10.mcap", &second)]),
        folder_with(
            &packed_names,
            &[("b_0.mcap.zstd", &packed[0]), ("b_1.mcap.zstd", &packed[1])],
        ),
        folder_with(
            &file_mode,
            &[("b_0.mcap.zstd", &packed[0]), ("b_1.mcap.zstd", &packed[1])],
        ),
        // Unpacked by hand since, and named as older versions name them.
        folder_with(
            &packed_names,
            &[("b_0.mcap", &first), ("b_1.mcap.zstd", &packed[1])],
        ),
        folder_with(&parents, &[("b_0.mcap", &first), ("b_1.mcap", &second)]),
        // The order of the files does not matter to what comes of them.
        folder_with("", &[("b_1.mcap", &second), ("b_2.mcap", &first)]),
    ] {
        assert_eq!(read_plain(folder.path()).0, expected());
        let found = info(folder.path(), &mut |_, _| ()).unwrap();
        assert_eq!((found.messages, found.files.len()), (81, 2), "{found}");
        assert!((found.duration_s - 5.9).abs() < 1e-9);
    }
}

#[test]
fn a_file_that_was_compressed_as_a_whole_is_read_like_any_other() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("log.mcap.zstd");
    let packed = zstd::encode_all(&bytes_of(&log())[..], 3).unwrap();
    std::fs::write(&path, &packed).unwrap();
    assert_eq!(read_plain(&path).0, expected());
    std::fs::write(&path, &packed[..packed.len() * 2 / 3]).unwrap();
    let error = error_of(&path, &IngestConfig::default());
    assert!(
        error.contains("log.mcap.zstd") && error.contains("zstd data end early"),
        "{error}"
    );
}

#[test]
fn messages_that_are_compressed_one_by_one_are_read_where_the_folder_says_so() {
    let mut messages = log();
    for message in &mut messages {
        message.payload = zstd::encode_all(&message.payload[..], 1).unwrap();
    }
    let bytes = bytes_of(&messages);
    let mode = "  compression_format: zstd\n  compression_mode: MESSAGE\n  \
                relative_file_paths:\n    - b.mcap\n";
    let folder = folder_with(mode, &[("b.mcap", &bytes)]);
    assert_eq!(read_plain(folder.path()).0, expected());
    // The file alone does not say so: the cause is named for each topic.
    let error = error_of(&folder.path().join("b.mcap"), &IngestConfig::default());
    for topic in ["/odom", "/scan", "/tf_static"] {
        assert!(
            error.contains(&format!("no usable message on {topic}")),
            "{error}"
        );
    }
    assert!(
        error.contains("compressed with zstd") && error.contains("metadata.yaml"),
        "{error}"
    );
}

#[test]
fn folders_that_lack_something_say_what() {
    let [first, second] = halves();
    let both: &[(&str, &[u8])] = &[("b_0.mcap", &first), ("b_1.mcap", &second)];
    for (folder, said) in [
        (folder_with(TWO_FILES, &both[..1]), "b_1.mcap: is named by"),
        (
            folder_with("", &[("notes.txt", b"x")]),
            "expected a recording",
        ),
        (
            folder_with("  relative_file_paths: []\n", both),
            "relative_file_paths",
        ),
        (
            folder_with(
                &TWO_FILES
                    .replace("b_1", "b_0")
                    .replace("mode: \"\"", "mode: FILE"),
                both,
            ),
            "compression_format",
        ),
    ] {
        let error = error_of(folder.path(), &IngestConfig::default());
        assert!(error.contains(said), "{error}");
    }
    // A file that the metadata do not name is left out with a word; the other half alone has no mounting.
    let named = TWO_FILES.replace("    - b_1.mcap\n", "");
    let folder = folder_with(&named, both);
    let found = Log::open(folder.path()).unwrap();
    assert_eq!(found.files().len(), 1);
    assert!(
        found.warnings()[0].contains("b_1.mcap"),
        "{:?}",
        found.warnings()
    );
    let error = error_of(&folder.path().join("b_1.mcap"), &IngestConfig::default());
    assert!(error.contains("--mount /scan="), "{error}");
    let config = IngestConfig {
        mount: vec!["1,0,0.3,0,0,0".parse().unwrap()],
        ..IngestConfig::default()
    };
    let (frames, _) = read(&folder.path().join("b_1.mcap"), &config);
    assert_eq!(frames.len(), 10);
    assert_pose(&frames[0], &straight(10));
    frames.iter().for_each(assert_world);
}

/// The log in an MCAP file with another encoding of messages or other names of types.
fn foreign(path: &Path, encoding: &str, messages: &[Message]) {
    let file = std::fs::File::create(path).unwrap();
    let mut writer = WriteOptions::new()
        .create(std::io::BufWriter::new(file))
        .unwrap();
    let mut channels = BTreeMap::new();
    for message in messages {
        let id = *channels.entry(message.topic.clone()).or_insert_with(|| {
            let schema = writer
                .add_schema(message.type_name, "ros2msg", b"x")
                .unwrap();
            let none = BTreeMap::new();
            writer
                .add_channel(schema, &message.topic, encoding, &none)
                .unwrap()
        });
        let header = MessageHeader {
            channel_id: id,
            sequence: 0,
            log_time: message.log_nanos,
            publish_time: message.log_nanos,
        };
        writer
            .write_to_known_channel(&header, &message.payload)
            .unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn encodings_that_cannot_be_read_are_named_for_each_topic() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("log.mcap");
    let head = |second: u8| {
        let mut messages = log();
        for message in &mut messages {
            message.payload[1] = second;
        }
        messages
    };
    for (encoding, messages, said) in [
        ("ros1", log(), "encoded as \"ros1\", expected \"cdr\""),
        ("json", log(), "encoded as \"json\""),
        ("protobuf", log(), "encoded as \"protobuf\""),
        ("cdr", head(7), "00 07 (XCDR2, little endian)"),
        ("cdr", head(3), "00 03 (parameter list CDR, little endian)"),
    ] {
        foreign(&path, encoding, &messages);
        let error = error_of(&path, &IngestConfig::default());
        for topic in ["/odom", "/scan", "/tf_static"] {
            let cause = format!("no usable message on {topic}");
            assert!(error.contains(&cause), "{error}");
        }
        assert_eq!(error.matches(said).count(), 3, "{error}");
        assert!(error.contains("convert"), "{error}");
    }
    // Names of types that are none of ROS are listed with their encoding.
    let mut others = log();
    for message in &mut others {
        message.type_name = "foxglove.LaserScan";
    }
    foreign(&path, "protobuf", &others);
    let error = error_of(&path, &IngestConfig::default());
    assert!(
        error.contains("/scan (foxglove.LaserScan encoded as \"protobuf\", 20 messages)"),
        "{error}"
    );
}

#[test]
fn zero_bytes_behind_messages_are_padding() {
    let folder = TempDir::new().unwrap();
    for multiple in [4, 8, 16] {
        let mut messages = log();
        for message in &mut messages {
            let len = message.payload.len().next_multiple_of(multiple);
            message.payload.resize(len, 0);
        }
        let path = folder.path().join(format!("{multiple}.mcap"));
        write(&path, &messages);
        assert_eq!(read_plain(&path).0, expected(), "{multiple}");
    }
}

/// A log of a vehicle that stands before a thin post 9 m ahead, which one beam sees.
fn post(limit_m: impl Fn(u64) -> f32, nothing_m: f32) -> Vec<[f64; 2]> {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("log.mcap");
    let mut messages = vec![mounting()];
    for step in 0..60 {
        let nanos = NOW + step * STEP;
        messages.push(message("/odom", nanos, &odometry(nanos, &Pose2::default())));
        let mut scan = scan(nanos, "lidar", &FRONT);
        scan.ranges.fill(nothing_m);
        scan.ranges[360] = 8.0;
        scan.range_max = limit_m(step);
        messages.push(message("/scan", nanos, &scan));
    }
    write(&path, &messages);
    let frames = read_plain(&path).0;
    occupied_m(frames.last().unwrap())
}

#[test]
fn a_greatest_range_that_is_the_largest_reading_hides_nothing() {
    let is_post = |found: &[[f64; 2]]| {
        !found.is_empty()
            && found
                .iter()
                .all(|[x, y]| (x - 9.0).abs() < 0.3 && y.abs() < 0.3)
    };
    // The control, then the largest reading, beside infinity or NaN.
    assert!(is_post(&post(|_| 30.0, f32::INFINITY)));
    assert!(is_post(&post(|_| 8.0, f32::INFINITY)));
    assert!(is_post(&post(|_| 8.0, f32::NAN)));
    // A fixed one that stands for nothing.
    assert!(is_post(&post(|_| 30.0, 30.0)));
    assert_eq!(post(|_| 8.0, 8.0), Vec::<[f64; 2]>::new());
}

/// The boxes and the ground around them as rows of a cloud, as a lidar 1 m ahead and 1.7 m up sees them.
fn cloud(nanos: u64, world_from_vehicle: &Pose2, row_step: Option<u32>) -> PointCloud2 {
    const ROWS: u32 = 4;
    let mut points: Vec<[f64; 3]> = Vec::new();
    for [x_m, y_m] in BOXES_M {
        for side in -5..=5 {
            for up in 0..8 {
                points.push([x_m - 0.5, y_m + 0.1 * f64::from(side), 0.2 * f64::from(up)]);
            }
        }
    }
    for ring in 4..30 {
        for degree in 0..180 {
            let (sin, cos) = (2.0 * f64::from(degree)).to_radians().sin_cos();
            let (ahead_m, left_m) = (f64::from(ring) * cos, f64::from(ring) * sin);
            let at = world_from_vehicle.then(&Pose2::new(ahead_m, left_m, 0.0));
            // What a box hides is not seen.
            let sensor = world_from_vehicle.then(&FRONT);
            let (dx_m, dy_m) = (at.x_m - sensor.x_m, at.y_m - sensor.y_m);
            let towards = Pose2::new(sensor.x_m, sensor.y_m, dy_m.atan2(dx_m));
            if f64::from(range_m(&towards, &BOXES_M)) > dx_m.hypot(dy_m) {
                points.push([at.x_m, at.y_m, 0.0]);
            }
        }
    }
    points.truncate(points.len() / ROWS as usize * ROWS as usize);
    let sensor_from_world = world_from_vehicle.then(&FRONT).inverse();
    let mut data = Vec::new();
    for [x, y, z] in &points {
        let at = sensor_from_world.then(&Pose2::new(*x, *y, 0.0));
        for metres in [at.x_m, at.y_m, z - 1.7] {
            #[expect(clippy::cast_possible_truncation, reason = "coordinates of a point")]
            data.extend((metres as f32).to_le_bytes());
        }
    }
    let width = u32::try_from(points.len()).unwrap() / ROWS;
    assert_eq!(width * ROWS * 12, u32::try_from(data.len()).unwrap());
    let field = |(name, index): (&str, u32)| PointField {
        name: name.to_owned(),
        offset: 4 * index,
        datatype: PointField::FLOAT32,
        count: 1,
    };
    PointCloud2 {
        header: Header::at(nanos, "velodyne"),
        height: ROWS,
        width,
        fields: [("x", 0), ("y", 1), ("z", 2)].map(field).to_vec(),
        is_bigendian: false,
        point_step: 12,
        row_step: row_step.unwrap_or(12 * width),
        data,
        is_dense: true,
    }
}

fn clouds(row_step: Option<u32>) -> Vec<Message> {
    let mut mounted = transform("velodyne", &FRONT);
    mounted.transforms[0].transform.translation.z = 1.7;
    let mut messages = vec![message("/tf_static", NOW, &mounted)];
    for step in 0..10 {
        let nanos = NOW + step * STEP;
        let pose = straight(step);
        messages.push(message("/odom", nanos, &odometry(nanos, &pose)));
        messages.push(message("/points", nanos, &cloud(nanos, &pose, row_step)));
    }
    messages
}

#[test]
fn organised_clouds_with_a_wrong_row_step_are_read_with_one_warning() {
    let folder = TempDir::new().unwrap();
    let frames_of = |name: &str, row_step| {
        let path = folder.path().join(name);
        write(&path, &clouds(row_step));
        read_plain(&path)
    };
    let (good, report) = frames_of("good", None);
    assert_eq!(good.len(), 10);
    assert_eq!(report.warnings, Vec::<String>::new());
    good.iter().for_each(assert_world);
    for row_step in [0, 1, 57_216, u32::MAX] {
        let (frames, report) = frames_of(&row_step.to_string(), Some(row_step));
        assert_eq!(frames, good, "{row_step}");
        assert_eq!(report.warnings.len(), 1, "{:?}", report.warnings);
        assert!(
            report.warnings[0].contains("/points: row_step"),
            "{:?}",
            report.warnings
        );
    }
}

/// A vehicle between the boxes, with a scanner before and one behind.
fn two_scanners() -> Vec<Message> {
    let mut messages = vec![
        message("/tf_static", NOW, &transform("front", &FRONT)),
        message("/tf_static", NOW, &transform("rear", &REAR)),
    ];
    for step in 0..20 {
        let nanos = NOW + step * STEP;
        let pose = Pose2::new(11.0 + 0.05 * step as f64, 0.0, 0.0);
        messages.push(message("/odom", nanos, &odometry(nanos, &pose)));
        for (topic, frame, mount) in [
            ("/front/scan", "front", &FRONT),
            ("/rear/scan", "rear", &REAR),
        ] {
            let scan: LaserScan = scan(nanos, frame, &pose.then(mount));
            messages.push(message(topic, nanos, &scan));
        }
    }
    messages
}

fn has_box(frame: &Frame, centre: [f64; 2]) -> bool {
    let [x, y] = centre;
    occupied_m(frame)
        .iter()
        .any(|[a, b]| (a - x).abs() < 0.85 && (b - y).abs() < 0.85)
}

#[test]
fn all_sensors_see_one_map_and_topics_can_be_chosen() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("log.mcap");
    write(&path, &two_scanners());
    let (frames, report) = read_plain(&path);
    assert_eq!(
        (frames.len(), report.sweeps, report.sensors.len()),
        (20, 40, 2)
    );
    for frame in &frames {
        assert_world(frame);
    }
    let topics = |names: &[&str]| IngestConfig {
        scan_topics: names.iter().map(|name| (*name).to_owned()).collect(),
        ..IngestConfig::default()
    };
    for (names, front, rear) in [
        (&["/front/scan"][..], true, false),
        (&["rear/scan"], false, true),
        (&["/rear/scan", "/front/scan"], true, true),
    ] {
        let (frames, _) = read(&path, &topics(names));
        assert_eq!(frames.len(), 20);
        for frame in &frames {
            assert_eq!(has_box(frame, BOXES_M[0]), front, "{names:?}");
            assert_eq!(has_box(frame, BOXES_M[1]), rear, "{names:?}");
        }
    }
    // One mounting for two sensors can only be a mistake.
    let unclear = IngestConfig {
        mount: vec!["1,0,0,0,0,0".parse().unwrap()],
        ..IngestConfig::default()
    };
    let error = error_of(&path, &unclear);
    assert!(error.contains("--mount /front/scan="), "{error}");
}

#[test]
fn a_cloud_and_scanners_are_used_together() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("log.mcap");
    let mut messages = clouds(None);
    messages.extend(two_scanners_behind());
    write(&path, &messages);
    let (frames, report) = read_plain(&path);
    let kinds: Vec<SensorKind> = report.sensors.iter().map(|sensor| sensor.kind).collect();
    assert_eq!(
        kinds
            .iter()
            .filter(|kind| **kind == SensorKind::Scan)
            .count(),
        2
    );
    // The cloud's sweeps become frames.
    assert_eq!((frames.len(), report.sweeps), (10, 30));
    for frame in &frames {
        assert_world(frame);
    }
    let points = IngestConfig {
        points_topics: vec!["/points".to_owned()],
        ..IngestConfig::default()
    };
    assert_eq!(read(&path, &points).1.sensors.len(), 1);
}

/// Scans of the drive of the clouds.
fn two_scanners_behind() -> Vec<Message> {
    let mut messages = vec![
        message("/tf_static", NOW, &transform("front", &FRONT)),
        message("/tf_static", NOW, &transform("rear", &REAR)),
    ];
    for step in 0..10 {
        let nanos = NOW + step * STEP;
        for (topic, frame, mount) in [
            ("/front/scan", "front", &FRONT),
            ("/rear/scan", "rear", &REAR),
        ] {
            let scan = scan(nanos, frame, &straight(step).then(mount));
            messages.push(message(topic, nanos, &scan));
        }
    }
    messages
}
