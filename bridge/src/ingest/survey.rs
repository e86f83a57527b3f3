//! What a log holds: its topics, the whole drive, and where the sensors are mounted.

use std::collections::BTreeMap;
use std::path::Path;

use super::config::IngestConfig;
use super::odometry::{Fix, MAX_POSES, Track};
use super::transform::TransformTree;
use crate::Error;
use crate::msg::Message;
use crate::msg::header::Header;
use crate::msg::nav::Odometry;
use crate::msg::sensor::{LaserScan, PointCloud2};
use crate::msg::tf2::TFMessage;
use crate::recording::{RawMessage, Reader};

/// Most topics of a log that are told apart; messages on further ones are passed over.
pub const MAX_TOPICS: usize = 4096;

/// The kind of sensor that grids are made from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SensorKind {
    /// A 3D lidar.
    Points,
    /// A planar lidar.
    Scan,
}

/// What a log holds.
#[derive(Debug)]
pub(crate) struct Survey {
    pub(crate) sensor_topic: String,
    pub(crate) kind: SensorKind,
    /// Messages on the sensor's topic.
    pub(crate) sweeps: u64,
    pub(crate) odom_topic: String,
    /// The frame whose poses the odometry gives: the vehicle's.
    pub(crate) vehicle_frame: String,
    pub(crate) track: Track,
    pub(crate) transforms: TransformTree,
    /// Topics of transforms.
    pub(crate) transform_topics: Vec<String>,
    /// Whether stamps in headers are of use; else the times of recording are taken.
    pub(crate) has_stamps: bool,
    /// Messages of odometry and transforms that were of no use.
    pub(crate) bad_messages: u64,
}

#[derive(Debug, Default)]
struct Topic {
    type_name: String,
    messages: u64,
    drive: Drive,
}

/// A topic's odometry, by the headers' stamps and by the times of recording.
#[derive(Debug, Default)]
struct Drive {
    fixes: Vec<(Fix, u64)>,
    vehicle_frame: String,
}

#[derive(Debug, Default)]
struct Collector {
    topics: BTreeMap<String, Topic>,
    transforms: TransformTree,
    bad_messages: u64,
}

/// Reads a whole log, but decodes odometry and transforms only.
pub(crate) fn survey(path: &Path, config: &IngestConfig) -> Result<Survey, Error> {
    let mut collector = Collector::default();
    for message in Reader::open(path)? {
        collector.take(&message?, path)?;
    }
    collector.choose(path, config)
}

impl Collector {
    fn take(&mut self, message: &RawMessage, path: &Path) -> Result<(), Error> {
        if !self.topics.contains_key(&*message.topic) {
            if self.topics.len() >= MAX_TOPICS {
                return Ok(());
            }
            let type_name = message.type_name.to_string();
            self.topics.insert(
                message.topic.to_string(),
                Topic {
                    type_name,
                    ..Topic::default()
                },
            );
        }
        let Some(topic) = self.topics.get_mut(&*message.topic) else {
            return Ok(());
        };
        topic.messages += 1;
        if *message.type_name == *TFMessage::TYPE_NAME {
            match message.decode::<TFMessage>() {
                Ok(transforms) => {
                    self.bad_messages += self.transforms.insert(&transforms) as u64;
                }
                Err(_) => self.bad_messages += 1,
            }
        } else if *message.type_name == *Odometry::TYPE_NAME {
            let odometry = message.decode::<Odometry>().ok();
            let fix = odometry
                .as_ref()
                .and_then(|odometry| Fix::of(odometry, odometry.header.stamp.nanos()));
            let (Some(odometry), Some(fix)) = (odometry, fix) else {
                self.bad_messages += 1;
                return Ok(());
            };
            if topic.drive.fixes.len() == MAX_POSES {
                return Err(Error::BadFile {
                    path: path.to_owned(),
                    what: format!("{}: expected at most {MAX_POSES} messages", message.topic),
                });
            }
            topic.drive.fixes.push((fix, message.log_nanos));
            topic.drive.vehicle_frame = odometry.child_frame_id;
        }
        Ok(())
    }

    fn choose(mut self, path: &Path, config: &IngestConfig) -> Result<Survey, Error> {
        let found = self.listing();
        let missing = |wanted: String| Error::MissingTopic {
            path: path.to_owned(),
            wanted,
            found: found.clone(),
        };
        let (sensor_topic, kind) = self.sensor(config).map_err(missing)?;
        let odom_topic = self
            .find(Odometry::TYPE_NAME, config.odom_topic.as_deref())
            .and_then(|topic| topic.ok_or_else(|| Odometry::TYPE_NAME.to_owned()))
            .map_err(missing)?;
        let sweeps = self
            .topics
            .get(&sensor_topic)
            .map_or(0, |topic| topic.messages);
        let drive = self
            .topics
            .get_mut(&odom_topic)
            .map(|topic| std::mem::take(&mut topic.drive))
            .unwrap_or_default();
        if drive.fixes.is_empty() {
            return Err(missing(format!("usable message on {odom_topic}")));
        }
        let transform_topics = self
            .topics
            .iter()
            .filter(|(_, topic)| topic.type_name == TFMessage::TYPE_NAME)
            .map(|(name, _)| name.clone())
            .collect();
        let has_stamps = has_stamps(&drive.fixes);
        let fixes = drive.fixes.into_iter().map(|(fix, log_nanos)| {
            if has_stamps {
                fix
            } else {
                Fix {
                    nanos: log_nanos,
                    ..fix
                }
            }
        });
        Ok(Survey {
            sensor_topic,
            kind,
            sweeps,
            odom_topic,
            vehicle_frame: match drive.vehicle_frame {
                frame if frame.is_empty() => "base_link".to_owned(),
                frame => frame,
            },
            track: Track::new(fixes.collect()),
            transforms: self.transforms,
            transform_topics,
            has_stamps,
            bad_messages: self.bad_messages,
        })
    }

    /// The topic that grids are made from: points before scans, unless a scan is named. The error
    /// says what was looked for.
    fn sensor(&self, config: &IngestConfig) -> Result<(String, SensorKind), String> {
        let (points, scan) = (config.points_topic.as_deref(), config.scan_topic.as_deref());
        if (points.is_some() || scan.is_none())
            && let Some(topic) = self.find(PointCloud2::TYPE_NAME, points)?
        {
            return Ok((topic, SensorKind::Points));
        }
        match self.find(LaserScan::TYPE_NAME, scan)? {
            Some(topic) => Ok((topic, SensorKind::Scan)),
            None => Err(format!(
                "{} or {}",
                PointCloud2::TYPE_NAME,
                LaserScan::TYPE_NAME
            )),
        }
    }

    /// The topic of a type that is named, or else the busiest one, if there is any.
    fn find(&self, type_name: &str, named: Option<&str>) -> Result<Option<String>, String> {
        match named {
            None => Ok(self.busiest(type_name)),
            Some(name) => match self.topic_named(name, type_name) {
                Some(topic) => Ok(Some(topic)),
                None => Err(format!("{type_name} on {name:?}")),
            },
        }
    }

    /// A topic by its name, with or without the slash in front.
    fn topic_named(&self, name: &str, type_name: &str) -> Option<String> {
        let bare = |name: &str| name.strip_prefix('/').unwrap_or(name).to_owned();
        self.topics
            .iter()
            .find(|(topic, found)| bare(topic) == bare(name) && found.type_name == type_name)
            .map(|(topic, _)| topic.clone())
    }

    /// The topic of a type with the most messages; between equal ones the first by name.
    fn busiest(&self, type_name: &str) -> Option<String> {
        self.topics
            .iter()
            .filter(|(_, topic)| topic.type_name == type_name)
            .min_by_key(|(_, topic)| std::cmp::Reverse(topic.messages))
            .map(|(name, _)| name.clone())
    }

    fn listing(&self) -> String {
        const MOST_LISTED: usize = 40;
        if self.topics.is_empty() {
            return "no messages".to_owned();
        }
        let mut parts: Vec<String> = self
            .topics
            .iter()
            .take(MOST_LISTED)
            .map(|(name, topic)| {
                format!("{name} ({}, {} messages)", topic.type_name, topic.messages)
            })
            .collect();
        if self.topics.len() > MOST_LISTED {
            parts.push(format!("and {} more", self.topics.len() - MOST_LISTED));
        }
        parts.join(", ")
    }
}

/// Stamps that are all the same, as those of senders that leave them at 0, are of no use.
fn has_stamps(fixes: &[(Fix, u64)]) -> bool {
    let first = fixes.first().map(|(fix, _)| fix.nanos);
    fixes.len() < 2 && first != Some(0) || fixes.iter().any(|(fix, _)| Some(fix.nanos) != first)
}

impl Survey {
    /// When a message was taken: its header's stamp, or the time of recording where that is of no use.
    pub(crate) fn nanos_of(&self, header: &Header, log_nanos: u64) -> u64 {
        let stamp_nanos = header.stamp.nanos();
        if self.has_stamps && stamp_nanos != 0 {
            stamp_nanos
        } else {
            log_nanos
        }
    }
}
