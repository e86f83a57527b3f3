//! What a log holds: its topics, its drives, where the sensors are mounted, and which message comes when.

mod choice;
mod collect;
mod timing;

use std::path::Path;

use nalgebra::Isometry3;

use super::config::IngestConfig;
use super::drives::Drive;
use super::transform::TransformTree;
use crate::Error;
use crate::recording::Log;
use crate::recording::order::OrderedReader;
use collect::Collector;

/// Most topics of a log that are told apart; messages on further ones are passed over.
pub const MAX_TOPICS: usize = 4096;
/// Most messages of sensors, and of transforms that change, in a log.
pub const MAX_EVENTS: usize = 8_000_000;

/// The kind of sensor that grids are made from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum SensorKind {
    /// A 3D lidar.
    Points,
    /// A planar lidar.
    Scan,
}

/// A sensor of a log.
#[derive(Debug, Clone)]
pub(crate) struct Sensor {
    pub(crate) topic: String,
    pub(crate) kind: SensorKind,
    /// Messages on its topic.
    pub(crate) sweeps: u64,
    /// Those of them for which the odometry has no pose.
    pub(crate) without_pose: u64,
    /// The frame of its first message.
    pub(crate) frame_id: String,
    /// Where it is in the vehicle's frame, if its user says so.
    pub(crate) mounting: Option<Isometry3<f64>>,
    /// Whether a range that is exactly the greatest one is a return.
    pub(crate) is_limit_return: bool,
}

/// Whose message an event is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Of {
    Transforms,
    /// The number of the sensor.
    Sensor(u8),
    /// The sensor whose sweeps become frames, by its number.
    Leader(u8),
}

/// A message that matters, with the drive and the moment it belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Event {
    pub(crate) drive: u32,
    pub(crate) nanos: u64,
    pub(crate) of: Of,
}

/// What a log holds.
#[derive(Debug)]
pub(crate) struct Survey {
    pub(crate) sensors: Vec<Sensor>,
    pub(crate) odom_topic: String,
    /// The frame whose poses the odometry gives: the vehicle's.
    pub(crate) vehicle_frame: String,
    pub(crate) drives: Vec<Drive>,
    pub(crate) transforms: TransformTree,
    /// Events, in the order of drives and time.
    pub(crate) events: Vec<Event>,
    /// Their messages; the key of each is the place of its event.
    pub(crate) messages: OrderedReader,
    /// Messages that were of no use.
    pub(crate) bad_messages: u64,
    pub(crate) warnings: Vec<String>,
}

/// Reads a whole log, but decodes only what is small.
pub(crate) fn survey(path: &Path, config: &IngestConfig) -> Result<Survey, Error> {
    let log = Log::open(path)?;
    let mut reader = log.reader()?;
    let mut collector = Collector::default();
    for message in &mut reader {
        collector.take(&message?, path)?;
    }
    let chosen = choice::choose(&mut collector, path, config)?;
    timing::arrange(
        collector,
        chosen,
        timing::Arrangement {
            log,
            definitions: reader.into_definitions(),
            path,
            config,
        },
    )
}
