use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions};
use proptest::prelude::*;
use tempfile::TempDir;

use super::*;
use crate::Error;
use crate::keys;
use crate::msg::geometry::{Point, Pose, PoseArray, Quaternion};
use crate::msg::header::Header;

fn poses(index: u64) -> PoseArray {
    let count = usize::try_from(index % 7).unwrap();
    let pose = Pose {
        position: Point {
            x: 1.0,
            y: 2.0,
            z: 3.0,
        },
        orientation: Quaternion {
            x: 0.0,
            y: 0.0,
            z: 0.6,
            w: 0.8,
        },
    };
    PoseArray {
        header: Header::at(index, "base_link"),
        poses: vec![pose; count],
    }
}

fn stamps(nanos: u64) -> Stamps {
    Stamps {
        log_nanos: nanos,
        publish_nanos: nanos + 1,
    }
}

/// Writes `count` messages, the log time of each `step_nanos` behind that of the one before.
fn record(path: &Path, count: u64, step_nanos: u64) {
    let mut writer = Writer::create(path).unwrap();
    let topic = keys::targets("v");
    for index in 0..count {
        let nanos = index * step_nanos;
        writer
            .write(&topic, &poses(index), nanos, nanos + 1)
            .unwrap();
    }
    assert_eq!(writer.messages(), count);
    writer.finish().unwrap();
}

fn quiet(_done: u64, _total: u64) {}

fn read(bytes: &[u8]) -> (Vec<RawMessage>, Option<Error>) {
    let reader = match Reader::new(Cursor::new(bytes), "in memory") {
        Ok(reader) => reader,
        Err(error) => return (Vec::new(), Some(error)),
    };
    let mut messages = Vec::new();
    for message in reader {
        match message {
            Ok(message) => messages.push(message),
            Err(error) => return (messages, Some(error)),
        }
    }
    (messages, None)
}

#[test]
fn what_was_written_is_read() {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("a.mcap");
    record(&path, 100, 100_000_000);
    let messages: Vec<RawMessage> = Reader::open(&path).unwrap().map(Result::unwrap).collect();
    assert_eq!(messages.len(), 100);
    for (index, message) in (0..).zip(&messages) {
        assert_eq!(&*message.topic, "/swath/vehicle/v/targets");
        assert_eq!(&*message.type_name, "geometry_msgs/msg/PoseArray");
        assert_eq!(u64::from(message.sequence), index);
        assert_eq!(message.log_nanos, index * 100_000_000);
        assert_eq!(message.publish_nanos, index * 100_000_000 + 1);
        assert_eq!(message.decode::<PoseArray>().unwrap(), poses(index));
    }
}

#[test]
fn the_same_messages_give_the_same_bytes() {
    let dir = TempDir::new().unwrap();
    let [a, b] = ["a", "b"].map(|name| dir.path().join(name));
    record(&a, 5000, 1_000_000);
    record(&b, 5000, 1_000_000);
    assert_eq!(std::fs::read(a).unwrap(), std::fs::read(b).unwrap());
}

#[test]
fn an_unfinished_file_lacks_no_more_than_a_second_of_log_time() {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("a.mcap");
    let mut writer = Writer::create(&path).unwrap();
    for index in 0..95 {
        let nanos = index * 100_000_000;
        writer
            .write(&keys::targets("v"), &poses(index), nanos, nanos)
            .unwrap();
    }
    let bytes = std::fs::read(&path).unwrap();
    let (messages, error) = read(&bytes);
    assert!(messages.len() >= 85, "{} messages", messages.len());
    let error = error.unwrap().to_string();
    assert!(error.contains("swath bridge recover"), "{error}");
}

#[test]
fn topics_that_are_not_wanted_are_left_out() {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("a.mcap");
    let mut writer = Writer::create(&path).unwrap();
    for index in 0..20 {
        writer
            .write(&keys::targets("a"), &poses(index), index, index)
            .unwrap();
        writer
            .write_as("/somewhere/else", &poses(index), index, index)
            .unwrap();
    }
    writer.finish().unwrap();
    let reader = Reader::open(&path).unwrap();
    let reader = reader.with_topics(|topic| topic == "/somewhere/else");
    let topics: Vec<_> = reader.map(|message| message.unwrap().topic).collect();
    assert_eq!(topics.len(), 20);
    assert!(topics.iter().all(|topic| &**topic == "/somewhere/else"));
}

#[test]
fn a_topic_keeps_its_type() {
    let dir = TempDir::new().unwrap();
    let mut writer = Writer::create(dir.path().join("a.mcap")).unwrap();
    let bytes = [0, 1, 0, 0];
    writer
        .write_raw("/a", "a_msgs/msg/A", &bytes, stamps(1))
        .unwrap();
    let error = writer
        .write_raw("/a", "a_msgs/msg/B", &bytes, stamps(2))
        .unwrap_err();
    assert!(error.to_string().contains("a_msgs/msg/A"), "{error}");
}

#[test]
fn a_message_of_another_type_is_refused_with_its_place() {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("a.mcap");
    record(&path, 1, 1);
    let message = Reader::open(&path).unwrap().next().unwrap().unwrap();
    let error = message.decode::<crate::msg::nav::Path>().unwrap_err();
    let text = error.to_string();
    assert!(text.contains("nav_msgs/msg/Path"), "{text}");
    assert!(text.contains("geometry_msgs/msg/PoseArray"), "{text}");
    assert!(
        text.contains(&format!("at byte {}", message.offset)),
        "{text}"
    );
}

#[test]
fn files_that_are_no_recordings_are_named_as_such() {
    for (bytes, expected) in [
        (&b""[..], "the file is empty"),
        (b"P5\n4 4\n255\n", "not an MCAP file"),
        (b"\x89MCAP0\r\n", "cut off"),
        (b"\x89MC", "not an MCAP file"),
    ] {
        let (messages, error) = read(bytes);
        assert!(messages.is_empty());
        let error = error.unwrap().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

/// A recording as others write it, in memory.
fn foreign(options: WriteOptions, type_name: &str) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = options.create(&mut bytes).unwrap();
    let schema = writer.add_schema(type_name, "ros2msg", b"x").unwrap();
    let channel = writer
        .add_channel(schema, "/a", "cdr", &BTreeMap::new())
        .unwrap();
    for sequence in 0..50 {
        let header = MessageHeader {
            channel_id: channel,
            sequence,
            log_time: u64::from(sequence) * 7,
            publish_time: 3,
        };
        let payload = crate::cdr::to_vec(&poses(sequence.into())).unwrap();
        writer.write_to_known_channel(&header, &payload).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes.into_inner()
}

#[test]
fn every_kind_of_chunk_that_others_write_is_read() {
    let options = || WriteOptions::new().profile("ros2");
    for (options, type_name) in [
        (options().use_chunks(false), "geometry_msgs/msg/PoseArray"),
        (options().compression(None), "geometry_msgs/msg/PoseArray"),
        (
            options().compression(Some(Compression::Lz4)),
            "geometry_msgs/PoseArray",
        ),
        (
            options()
                .compression(Some(Compression::Zstd))
                .chunk_size(Some(64)),
            "geometry_msgs/msg/PoseArray",
        ),
        (
            options().calculate_chunk_crcs(false),
            "geometry_msgs/msg/PoseArray",
        ),
    ] {
        let (messages, error) = read(&foreign(options, type_name));
        assert!(error.is_none(), "{error:?}");
        assert_eq!(messages.len(), 50);
        for (index, message) in (0..).zip(&messages) {
            assert_eq!(message.decode::<PoseArray>().unwrap(), poses(index));
        }
    }
}

#[test]
fn claimed_sizes_beyond_the_limit_are_refused() {
    let bytes = foreign(WriteOptions::new().compression(None), "a_msgs/msg/A");
    let chunk = chunk_at(&bytes);
    let mut hostile = bytes.clone();
    hostile[chunk + 9 + 16..][..8].copy_from_slice(&(1_u64 << 40).to_le_bytes());
    let error = read(&hostile).1.unwrap().to_string();
    assert!(error.contains("uncompressed"), "{error}");
    let mut hostile = bytes;
    hostile[chunk + 1..][..8].copy_from_slice(&(1_u64 << 60).to_le_bytes());
    let error = read(&hostile).1.unwrap().to_string();
    assert!(error.contains(&format!("at byte {chunk}")), "{error}");
}

fn chunk_at(bytes: &[u8]) -> usize {
    let header_len = u64::from_le_bytes(bytes[9..17].try_into().unwrap());
    let chunk = 17 + usize::try_from(header_len).unwrap();
    assert_eq!(bytes[chunk], 6);
    chunk
}

#[test]
fn a_changed_byte_in_a_chunk_is_noticed() {
    let bytes = foreign(WriteOptions::new().compression(None), "a_msgs/msg/A");
    let mut damaged = bytes.clone();
    let at = chunk_at(&bytes) + 200;
    damaged[at] ^= 0x10;
    let (messages, error) = read(&damaged);
    assert!(messages.is_empty());
    assert!(error.is_some());
}

#[test]
fn info_counts_what_is_there() {
    let dir = TempDir::new().unwrap();
    let path = dir.path().join("a.mcap");
    record(&path, 101, 10_000_000);
    let info = info(&path, &mut quiet).unwrap();
    assert_eq!(info.messages, 101);
    assert!((info.duration_s - 1.0).abs() < 1e-9);
    assert_eq!(info.bytes, std::fs::metadata(&path).unwrap().len());
    let [topic] = &info.topics[..] else {
        panic!("{info:?}");
    };
    assert_eq!(topic.topic, "/swath/vehicle/v/targets");
    assert!((topic.rate_hz - 100.0).abs() < 1e-9);
    assert_eq!(info.damage, None);
    assert!(info.to_string().contains("101 messages"), "{info}");
}

#[test]
fn recovering_a_whole_recording_loses_nothing() {
    let dir = TempDir::new().unwrap();
    let [input, output] = ["a", "b"].map(|name| dir.path().join(name));
    record(&input, 300, 20_000_000);
    let report = recover(&input, &output, Existing::Refuse, &mut quiet).unwrap();
    assert_eq!(report.messages, 300);
    assert_eq!((report.messages_lost, report.bytes_lost), (0, 0));
    assert!(report.damage.is_empty(), "{report:?}");
    assert_eq!(
        std::fs::read(input).unwrap(),
        std::fs::read(output).unwrap()
    );
    let same = dir.path().join("b");
    assert!(recover(&same, &same, Existing::Replace, &mut quiet).is_err());
}

#[test]
fn a_damaged_chunk_costs_its_own_messages_only_and_they_are_counted() {
    let dir = TempDir::new().unwrap();
    let [input, output] = ["a", "b"].map(|name| dir.path().join(name));
    let options = WriteOptions::new().compression(None).chunk_size(Some(500));
    let mut bytes = foreign(options, "geometry_msgs/msg/PoseArray");
    let (whole, _) = read(&bytes);
    // The first chunk also names the topic, which is then known from the index only.
    let at = chunk_at(&bytes) + 300;
    bytes[at] ^= 1;
    std::fs::write(&input, &bytes).unwrap();
    let report = recover(&input, &output, Existing::Refuse, &mut quiet).unwrap();
    assert!(report.messages_lost > 0);
    assert_eq!(report.messages + report.messages_lost, 50);
    assert_eq!(report.damage.len(), 1, "{report:?}");
    let (saved, error) = read(&std::fs::read(&output).unwrap());
    assert!(error.is_none());
    let lost = usize::try_from(report.messages_lost).unwrap();
    for (saved, original) in saved.iter().zip(&whole[lost..]) {
        assert_eq!(saved.payload, original.payload);
        assert_eq!(saved.sequence, original.sequence);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn recovering_a_truncated_file_saves_at_least_what_can_be_read(cut in 0.0..1.0_f64, packed in any::<bool>()) {
        let compression = packed.then_some(Compression::Zstd);
        let options = WriteOptions::new().compression(compression).chunk_size(Some(500));
        let bytes = foreign(options, "geometry_msgs/msg/PoseArray");
        let whole = read(&bytes).0;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below the length")]
        let len = (bytes.len() as f64 * cut) as usize;
        let readable = read(&bytes[..len]).0;
        let dir = TempDir::new().unwrap();
        let [input, output] = ["a", "b"].map(|name| dir.path().join(name));
        std::fs::write(&input, &bytes[..len]).unwrap();
        let Ok(report) = recover(&input, &output, Existing::Refuse, &mut quiet) else {
            // So little is left that it is no recording.
            prop_assert!(readable.is_empty() && len < 60);
            return Ok(());
        };
        let (saved, error) = read(&std::fs::read(&output).unwrap());
        prop_assert!(error.is_none(), "{error:?}");
        prop_assert!(saved.len() >= readable.len());
        prop_assert_eq!(u64::try_from(saved.len()).unwrap(), report.messages);
        for (saved, original) in saved.iter().zip(&whole) {
            prop_assert_eq!(&saved.payload, &original.payload);
            prop_assert_eq!(saved.log_nanos, original.log_nanos);
        }
        prop_assert!(!report.damage.is_empty());
    }

    #[test]
    fn recovering_anything_ends_and_gives_a_whole_recording(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        packed in any::<bool>(),
    ) {
        let compression = packed.then_some(Compression::Zstd);
        let options = WriteOptions::new().compression(compression).chunk_size(Some(500));
        let mut bytes = foreign(options, "geometry_msgs/msg/PoseArray");
        for (index, byte) in changes {
            let at = index.index(bytes.len());
            bytes[at] = byte;
        }
        let dir = TempDir::new().unwrap();
        let [input, output] = ["a", "b"].map(|name| dir.path().join(name));
        std::fs::write(&input, &bytes).unwrap();
        if let Ok(report) = recover(&input, &output, Existing::Refuse, &mut quiet) {
            let (saved, error) = read(&std::fs::read(&output).unwrap());
            prop_assert!(error.is_none(), "{error:?}");
            prop_assert_eq!(u64::try_from(saved.len()).unwrap(), report.messages);
        }
    }

    #[test]
    fn a_truncated_file_gives_its_beginning_and_an_error(cut in 0.0..1.0_f64, packed in any::<bool>()) {
        let compression = packed.then_some(Compression::Zstd);
        let options = WriteOptions::new().compression(compression).chunk_size(Some(500));
        let bytes = foreign(options, "geometry_msgs/msg/PoseArray");
        let (whole, error) = read(&bytes);
        prop_assert!(error.is_none());
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below the length")]
        let len = (bytes.len() as f64 * cut) as usize;
        let (messages, error) = read(&bytes[..len]);
        prop_assert!(error.is_some());
        prop_assert_eq!(&messages[..], &whole[..messages.len()]);
    }

    #[test]
    fn changed_bytes_never_panic(
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        packed in any::<bool>(),
        chunked in any::<bool>(),
    ) {
        let options = WriteOptions::new()
            .compression(packed.then_some(Compression::Zstd))
            .use_chunks(chunked)
            .calculate_chunk_crcs(false)
            .chunk_size(Some(500));
        let mut bytes = foreign(options, "geometry_msgs/msg/PoseArray");
        for (index, byte) in changes {
            let at = index.index(bytes.len());
            bytes[at] = byte;
        }
        for message in read(&bytes).0 {
            // Whether it decodes does not matter, only that it comes to an end.
            let _ = message.decode::<PoseArray>();
        }
    }

    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        let mut file = b"\x89MCAP0\r\n\x01\x00\x00\x00\x00\x00\x00\x00\x00".to_vec();
        file.extend(bytes);
        let _ = read(&file);
    }
}

#[test]
fn a_message_of_an_older_definition_is_refused_and_says_what_it_lacks() {
    let type_name = "swath_msgs/msg/PlanReport";
    let definition = crate::msg::schema_of(type_name).unwrap();
    let lacking: Vec<&str> = definition
        .lines()
        .filter(|line| !line.starts_with("string reason"))
        .collect();
    let mut bytes = Vec::new();
    let mut writer = mcap::Writer::new(Cursor::new(&mut bytes)).unwrap();
    let schema = writer
        .add_schema(type_name, "ros2msg", lacking.join("\n").as_bytes())
        .unwrap();
    let topic = "/swath/vehicle/v/plan";
    let channel = writer
        .add_channel(schema, topic, "cdr", &BTreeMap::new())
        .unwrap();
    let header = MessageHeader {
        channel_id: channel,
        sequence: 0,
        log_time: 1,
        publish_time: 1,
    };
    writer
        .write_to_known_channel(&header, &[0, 1, 0, 0, 9, 9])
        .unwrap();
    writer.finish().unwrap();
    drop(writer);
    let (messages, error) = read(&bytes);
    assert!(error.is_none(), "{error:?}");
    let decoded = messages[0].decode::<crate::msg::swath::PlanReport>();
    let error = decoded.unwrap_err().to_string();
    assert!(error.contains("another definition"), "{error}");
    assert!(error.contains("it lacks \"string reason\""), "{error}");
    // The right definition with a broken payload says nothing of the kind.
    let error = messages[0].decode::<PoseArray>().unwrap_err().to_string();
    assert!(!error.contains("another definition"), "{error}");
}
