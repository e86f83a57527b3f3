//! Going through a log once.

use std::collections::BTreeMap;
use std::path::Path;

use super::{MAX_EVENTS, MAX_TOPICS, SensorKind};
use crate::Error;
use crate::ingest::drives::Mark;
use crate::ingest::odometry::{Fix, MAX_POSES};
use crate::ingest::scan::RangeHabits;
use crate::ingest::transform::TransformTree;
use crate::msg::Message;
use crate::msg::header::Header;
use crate::msg::nav::Odometry;
use crate::msg::sensor::{LaserScan, PointCloud2};
use crate::msg::tf2::TFMessage;
use crate::recording::RawMessage;
use crate::recording::order::{Entry, Index};

/// Most messages with transforms that change; of further ones the last transforms count.
const MAX_TRANSFORM_MESSAGES: usize = 1_000_000;

/// A topic of a log.
#[derive(Debug, Default)]
pub(super) struct Topic {
    pub(super) type_name: String,
    pub(super) encoding: String,
    pub(super) messages: u64,
    /// Messages that are of use, as far as they were looked at.
    pub(super) usable: u64,
    /// Why the first message that is of no use is none.
    pub(super) cause: Option<String>,
    pub(super) odometry: Vec<(Fix, Mark)>,
    /// Frame of the vehicle, in odometry.
    pub(super) child_frame_id: String,
    pub(super) sweeps: Vec<Sweep>,
    /// Frame of the first sweep.
    pub(super) frame_id: String,
    pub(super) habits: RangeHabits,
}

/// A message of a sensor or with transforms. The mark's time is the stamp.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sweep {
    pub(super) mark: Mark,
    pub(super) entry: Entry,
}

impl Topic {
    /// The kind of sensor whose messages are on the topic.
    pub(super) fn kind(&self) -> Option<SensorKind> {
        match self.type_name.as_str() {
            PointCloud2::TYPE_NAME => Some(SensorKind::Points),
            LaserScan::TYPE_NAME => Some(SensorKind::Scan),
            _ => None,
        }
    }
}

/// Why a message was not taken.
enum Fault {
    /// It is of no use by itself.
    Unusable(String),
    /// The log cannot be worked with.
    Fatal(Error),
}

impl Fault {
    fn unusable(cause: &Error) -> Self {
        Self::Unusable(cause.to_string())
    }
}

/// What has been found in a log.
#[derive(Debug, Default)]
pub(super) struct Collector {
    pub(super) topics: BTreeMap<String, Topic>,
    pub(super) transforms: TransformTree,
    pub(super) transform_messages: Vec<Sweep>,
    pub(super) index: Index,
    pub(super) bad_messages: u64,
    pub(super) warnings: Vec<String>,
    position: u64,
    events: usize,
}

impl Collector {
    pub(super) fn take(&mut self, message: &RawMessage, path: &Path) -> Result<(), Error> {
        self.position += 1;
        if !self.topics.contains_key(&*message.topic) {
            if self.topics.len() >= MAX_TOPICS {
                return Ok(());
            }
            let topic = Topic {
                type_name: message.type_name.to_string(),
                encoding: message.channel.encoding.clone(),
                ..Topic::default()
            };
            self.topics.insert(message.topic.to_string(), topic);
        }
        let Some(mut topic) = self.topics.remove(&*message.topic) else {
            return Ok(());
        };
        topic.messages += 1;
        let taken = match &*message.type_name {
            Odometry::TYPE_NAME => self.take_odometry(&mut topic, message, path),
            TFMessage::TYPE_NAME => self.take_transforms(message),
            PointCloud2::TYPE_NAME => self.take_points(&mut topic, message, path),
            LaserScan::TYPE_NAME => self.take_scan(&mut topic, message, path),
            _ => Ok(()),
        };
        match taken {
            Ok(()) => topic.usable += 1,
            Err(Fault::Unusable(cause)) => {
                self.bad_messages += 1;
                topic.cause.get_or_insert(cause);
            }
            Err(Fault::Fatal(error)) => return Err(error),
        }
        self.topics.insert(message.topic.to_string(), topic);
        Ok(())
    }

    fn mark(&self, stamp_nanos: u64, message: &RawMessage) -> Mark {
        Mark {
            nanos: stamp_nanos,
            log_nanos: message.log_nanos,
            position: self.position,
        }
    }

    fn take_odometry(
        &self,
        topic: &mut Topic,
        message: &RawMessage,
        path: &Path,
    ) -> Result<(), Fault> {
        let odometry: Odometry = message.decode().map_err(|error| Fault::unusable(&error))?;
        let stamp_nanos = odometry.header.stamp.nanos();
        let Some(fix) = Fix::of(&odometry, stamp_nanos) else {
            return Err(Fault::Unusable("a pose that is not finite".to_owned()));
        };
        if topic.odometry.len() == MAX_POSES {
            return Err(Fault::Fatal(Error::BadFile {
                path: path.to_owned(),
                what: format!("{}: expected at most {MAX_POSES} messages", message.topic),
            }));
        }
        topic.odometry.push((fix, self.mark(stamp_nanos, message)));
        topic.child_frame_id = odometry.child_frame_id;
        Ok(())
    }

    fn take_transforms(&mut self, message: &RawMessage) -> Result<(), Fault> {
        let transforms: TFMessage = message.decode().map_err(|error| Fault::unusable(&error))?;
        let has_changed = self.transforms.is_changed_by(&transforms);
        let passed_over = self.transforms.insert(&transforms) as u64;
        if has_changed {
            let stamp_nanos = transforms
                .transforms
                .first()
                .map_or(0, |first| first.header.stamp.nanos());
            let mark = self.mark(stamp_nanos, message);
            let entry = self.index.entry(message, 0);
            match entry.filter(|_| self.transform_messages.len() < MAX_TRANSFORM_MESSAGES) {
                Some(entry) => self.transform_messages.push(Sweep { mark, entry }),
                None => self.warn_of_transforms(),
            }
        }
        if passed_over > 0 {
            // One of the bad ones is counted by the caller.
            self.bad_messages += passed_over - 1;
            return Err(Fault::Unusable("a transform that is none".to_owned()));
        }
        Ok(())
    }

    fn warn_of_transforms(&mut self) {
        let what = format!(
            "more than {MAX_TRANSFORM_MESSAGES} messages change transforms: behind those the last \
             transforms of the log count"
        );
        if !self.warnings.contains(&what) {
            self.warnings.push(what);
        }
    }

    fn take_points(
        &mut self,
        topic: &mut Topic,
        message: &RawMessage,
        path: &Path,
    ) -> Result<(), Fault> {
        let header = message.header().map_err(|error| Fault::unusable(&error))?;
        self.add_sweep(topic, message, &header, path)
    }

    fn take_scan(
        &mut self,
        topic: &mut Topic,
        message: &RawMessage,
        path: &Path,
    ) -> Result<(), Fault> {
        let scan: LaserScan = message.decode().map_err(|error| Fault::unusable(&error))?;
        topic.habits.add(&scan);
        self.add_sweep(topic, message, &scan.header, path)
    }

    fn add_sweep(
        &mut self,
        topic: &mut Topic,
        message: &RawMessage,
        header: &Header,
        path: &Path,
    ) -> Result<(), Fault> {
        if topic.sweeps.is_empty() {
            topic.frame_id.clone_from(&header.frame_id);
        }
        let entry = self.index.entry(message, 0);
        let Some(entry) = entry.filter(|_| self.events < MAX_EVENTS) else {
            return Err(Fault::Fatal(Error::BadFile {
                path: path.to_owned(),
                what: format!("expected at most {MAX_EVENTS} messages of sensors"),
            }));
        };
        self.events += 1;
        let mark = self.mark(header.stamp.nanos(), message);
        topic.sweeps.push(Sweep { mark, entry });
        Ok(())
    }

    /// The topics with their types and numbers of messages, for an error.
    pub(super) fn listing(&self) -> String {
        const MOST_LISTED: usize = 40;
        if self.topics.is_empty() {
            return "no messages".to_owned();
        }
        let mut parts: Vec<String> = self
            .topics
            .iter()
            .take(MOST_LISTED)
            .map(|(name, topic)| {
                let encoding = match topic.encoding.as_str() {
                    "cdr" => String::new(),
                    other => format!(" encoded as {other:?}"),
                };
                format!(
                    "{name} ({}{encoding}, {} messages)",
                    topic.type_name, topic.messages
                )
            })
            .collect();
        if self.topics.len() > MOST_LISTED {
            parts.push(format!("and {} more", self.topics.len() - MOST_LISTED));
        }
        parts.join(", ")
    }
}
