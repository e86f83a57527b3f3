//! Logs that others wrote, read to their end. They are not part of the project: without them this is
//! skipped, and says so.

#![expect(clippy::print_stderr, reason = "a skipped test says so")]

use std::collections::BTreeMap;
use std::path::PathBuf;

use swath_bridge::msg::nav::Odometry;
use swath_bridge::msg::sensor::{LaserScan, PointCloud2};
use swath_bridge::msg::tf2::TFMessage;
use swath_bridge::recording::{Existing, Reader, info, recover};

fn logs() -> Option<PathBuf> {
    let data = std::env::var_os("SWATH_DATA").map_or_else(
        || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"),
        PathBuf::from,
    );
    let logs = data.join("logs");
    if logs.is_dir() {
        return Some(logs);
    }
    eprintln!("SKIPPED: no logs at {}; set SWATH_DATA", logs.display());
    None
}

#[test]
fn every_message_of_every_log_decodes() {
    let Some(logs) = logs() else { return };
    let mut counts: BTreeMap<(String, String), u64> = BTreeMap::new();
    for entry in std::fs::read_dir(&logs).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "mcap") {
            continue;
        }
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        for message in Reader::open(&path).unwrap() {
            let message = message.unwrap();
            match &*message.type_name {
                "sensor_msgs/msg/PointCloud2" => drop(message.decode::<PointCloud2>().unwrap()),
                "sensor_msgs/msg/LaserScan" => drop(message.decode::<LaserScan>().unwrap()),
                "nav_msgs/msg/Odometry" => drop(message.decode::<Odometry>().unwrap()),
                "tf2_msgs/msg/TFMessage" => drop(message.decode::<TFMessage>().unwrap()),
                other => panic!("{}: {other}", path.display()),
            }
            let key = (name.clone(), message.topic.to_string());
            *counts.entry(key).or_default() += 1;
        }
    }
    let count = |name: &str, topic: &str| counts[&(name.to_owned(), topic.to_owned())];
    assert_eq!(count("kitti_seqA", "/points"), 39);
    assert_eq!(count("kitti_seqA", "/odom"), 154);
    assert_eq!(count("radish_freiburg_campus", "/scan"), 2008);
}

#[test]
fn a_log_of_others_is_described_and_recovered_whole() {
    let Some(logs) = logs() else { return };
    let log = logs.join("radish_intel.mcap");
    let dir = tempfile::TempDir::new().unwrap();
    let copy = dir.path().join("copy.mcap");
    let report = recover(&log, &copy, Existing::Refuse, &mut |_, _| {}).unwrap();
    assert!(report.damage.is_empty(), "{report:?}");
    let [original, copied] = [&log, &copy].map(|path| info(path, &mut |_, _| {}).unwrap());
    assert_eq!(original.topics, copied.topics);
    assert_eq!(original.messages, report.messages);
}
