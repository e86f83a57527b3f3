//! Which pose each message has, and in which order messages come.

use std::collections::BTreeMap;
use std::path::Path;

use super::choice::Chosen;
use super::collect::{Collector, Sweep, Topic};
use super::{Event, Of, Sensor, Survey};
use crate::Error;
use crate::ingest::config::{Clock, IngestConfig};
use crate::ingest::drives::{Drive, MAX_DRIVES, Mark, Matches, drives_of, match_marks};
use crate::ingest::odometry::Fix;
use crate::recording::Log;
use crate::recording::order::{Entry, OrderedReader};

/// The log that a survey was made of.
pub(super) struct Arrangement<'a> {
    pub(super) log: Log,
    pub(super) definitions: crate::recording::DefinitionsByFile,
    pub(super) path: &'a Path,
    pub(super) config: &'a IngestConfig,
}

/// Which times count.
#[derive(Debug, Clone, Copy)]
struct Times {
    has_stamps: bool,
}

impl Times {
    /// Stamps that are all the same, as those of senders that leave them at 0, are of no use.
    fn of(odometry: &[(Fix, Mark)], clock: Clock) -> Self {
        let first = odometry.first().map(|(fix, _)| fix.nanos);
        let is_one = odometry.len() < 2 && first != Some(0);
        let are_different = || odometry.iter().any(|(fix, _)| Some(fix.nanos) != first);
        Self {
            has_stamps: clock == Clock::Stamp && (is_one || are_different()),
        }
    }

    /// When a message was sent: its stamp, or the time of recording where that is of no use.
    const fn of_mark(self, mark: Mark) -> Mark {
        let has_stamp = self.has_stamps && mark.nanos != 0;
        Mark {
            nanos: if has_stamp {
                mark.nanos
            } else {
                mark.log_nanos
            },
            ..mark
        }
    }
}

/// Events with the places of their messages.
type Found = Vec<(Event, Entry)>;

/// Gives every message its drive and moment, and puts them in their order.
pub(super) fn arrange(
    mut collector: Collector,
    chosen: Chosen,
    of: Arrangement<'_>,
) -> Result<Survey, Error> {
    let mut warnings = of.log.warnings().to_vec();
    warnings.append(&mut collector.warnings);
    let mut odometry = Odometry::of(&mut collector, chosen.odometry, &of)?;
    warnings.extend(odometry.warning());
    let mut sensors = Vec::new();
    let mut found: Vec<Found> = Vec::new();
    let mut without: Vec<String> = Vec::new();
    for (topic, kind, mount) in chosen.sensors {
        let number = u8::try_from(sensors.len()).unwrap_or(u8::MAX);
        let mut matched = odometry.match_sensor(
            collector.topics.remove(&topic).unwrap_or_default(),
            Of::Sensor(number),
        );
        if matched.events.is_empty() {
            let what = odometry.no_pose(&topic, &matched, of.config.clock);
            without.push(what);
        }
        if matched.shifted > 0 {
            warnings.push(shifted(&topic, &odometry.name, matched.shifted));
        }
        sensors.push(Sensor {
            kind,
            sweeps: matched.topic.messages,
            without_pose: matched.topic.usable - matched.events.len() as u64,
            frame_id: std::mem::take(&mut matched.topic.frame_id),
            mounting: mount.map(|mount| mount.vehicle_from_sensor()),
            is_limit_return: matched.topic.habits.is_limit_return(),
            topic,
        });
        found.push(matched.events);
    }
    if found.iter().all(Vec::is_empty) {
        return Err(Error::BadFile {
            path: of.path.to_owned(),
            what: without.join("; "),
        });
    }
    warnings.append(&mut without);
    lead(&sensors, &mut found);
    found.push(odometry.match_transforms(&collector.transform_messages));
    let events = in_order(found, &mut collector, of.path)?;
    let topics: Vec<String> = sensors
        .iter()
        .map(|sensor| sensor.topic.clone())
        .chain(transform_topics(&collector.topics))
        .collect();
    let wanted = move |topic: &str| topics.iter().any(|wanted| wanted == topic);
    Ok(Survey {
        sensors,
        vehicle_frame: match std::mem::take(&mut odometry.child_frame_id) {
            frame if frame.is_empty() => "base_link".to_owned(),
            frame => frame,
        },
        odom_topic: odometry.name,
        drives: odometry.drives,
        transforms: collector.transforms,
        messages: OrderedReader::new(of.log, collector.index, of.definitions, wanted),
        events,
        bad_messages: collector.bad_messages,
        warnings,
    })
}

/// Puts events in the order of drives and time, and their messages into the index.
fn in_order(
    found: Vec<Found>,
    collector: &mut Collector,
    path: &Path,
) -> Result<Vec<Event>, Error> {
    let mut events: Found = found.into_iter().flatten().collect();
    events.sort_by_key(|(event, entry)| (event.drive, event.nanos, event.of, entry.place()));
    for (place, (_, entry)) in events.iter().enumerate() {
        let key = u64::try_from(place).unwrap_or(u64::MAX);
        if !collector.index.push(entry.with_key(key)) {
            return Err(Error::BadFile {
                path: path.to_owned(),
                what: "too many messages of sensors and transforms".to_owned(),
            });
        }
    }
    Ok(events.into_iter().map(|(event, _)| event).collect())
}

/// The odometry of a log, and what is told by it.
struct Odometry {
    name: String,
    child_frame_id: String,
    times: Times,
    span: Span,
    drives: Vec<Drive>,
}

/// The sweeps of a sensor that have a pose.
struct Matched {
    topic: Topic,
    span: Span,
    events: Found,
    shifted: u64,
}

impl Odometry {
    fn of(collector: &mut Collector, name: String, of: &Arrangement<'_>) -> Result<Self, Error> {
        let topic = collector.topics.remove(&name).unwrap_or_default();
        let times = Times::of(&topic.odometry, of.config.clock);
        let fixes: Vec<(Fix, Mark)> = topic
            .odometry
            .into_iter()
            .map(|(fix, mark)| {
                let mark = times.of_mark(mark);
                let nanos = mark.nanos;
                (Fix { nanos, ..fix }, mark)
            })
            .collect();
        let span = span_of(fixes.iter().map(|(_, mark)| *mark));
        let drives = drives_of(fixes).map_err(|count| Error::BadFile {
            path: of.path.to_owned(),
            what: format!(
                "the times on {name} go back {count} times, expected at most {MAX_DRIVES}: are there two \
                 senders, or no usable stamps (--clock record takes the times of recording)?"
            ),
        })?;
        Ok(Self {
            name,
            child_frame_id: topic.child_frame_id,
            times,
            span,
            drives,
        })
    }

    fn warning(&self) -> Option<String> {
        (self.drives.len() > 1).then(|| {
            format!(
                "the times on {} begin again: the log is {} drives, each with a map and a reference of \
                 its own",
                self.name,
                self.drives.len()
            )
        })
    }

    fn match_sensor(&self, mut topic: Topic, of: Of) -> Matched {
        let sweeps = std::mem::take(&mut topic.sweeps);
        let marks = self.marks_of(&sweeps);
        let matches = match_marks(&self.drives, &marks);
        Matched {
            topic,
            span: span_of(marks.iter().copied()),
            events: events_of(&sweeps, &marks, &matches, of),
            shifted: matches.shifted,
        }
    }

    fn marks_of(&self, sweeps: &[Sweep]) -> Vec<Mark> {
        let marks = sweeps.iter().map(|sweep| self.times.of_mark(sweep.mark));
        marks.collect()
    }

    /// Transforms belong to the drive that has a pose at their time, or else to the first one, where they
    /// come before everything else: most are sent once and hold for the whole log.
    fn match_transforms(&self, messages: &[Sweep]) -> Found {
        let marks = self.marks_of(messages);
        let matches = match_marks(&self.drives, &marks);
        let all = messages.iter().zip(&marks).zip(&matches.drives);
        all.map(|((sweep, mark), drive)| {
            let event = Event {
                drive: drive.unwrap_or(0),
                nanos: if drive.is_some() { mark.nanos } else { 0 },
                of: Of::Transforms,
            };
            (event, sweep.entry)
        })
        .collect()
    }

    /// Why not one sweep of a sensor has a pose.
    fn no_pose(&self, topic: &str, matched: &Matched, clock: Clock) -> String {
        let text = |span: Span| {
            span.map_or("nothing".to_owned(), |(first, last)| {
                format!("{:.3} s to {:.3} s", first as f64 / 1e9, last as f64 / 1e9)
            })
        };
        let advice = match clock {
            Clock::Stamp => {
                ". Where they come from two clocks, --clock record takes the times of recording instead"
            }
            Clock::Record => "",
        };
        let name = &self.name;
        format!(
            "{name} has no pose at the time of any of the {} messages on {topic}: {topic} is from {}, \
             {name} from {}{advice}",
            matched.topic.messages,
            text(matched.span),
            text(self.span)
        )
    }
}

fn transform_topics(topics: &BTreeMap<String, Topic>) -> Vec<String> {
    use crate::msg::Message;
    use crate::msg::tf2::TFMessage;
    topics
        .iter()
        .filter(|(_, topic)| topic.type_name == TFMessage::TYPE_NAME)
        .map(|(name, _)| name.clone())
        .collect()
}

fn events_of(sweeps: &[Sweep], marks: &[Mark], matches: &Matches, of: Of) -> Found {
    let all = sweeps.iter().zip(marks).zip(&matches.drives);
    all.filter_map(|((sweep, mark), drive)| {
        let event = Event {
            drive: (*drive)?,
            nanos: mark.nanos,
            of,
        };
        Some((event, sweep.entry))
    })
    .collect()
}

/// Lets the sweeps of one sensor become frames: a 3D lidar before a planar one, then the one with the most
/// sweeps. It comes behind the others of the same moment, so that its frames hold what those see.
fn lead(sensors: &[Sensor], found: &mut [Found]) {
    let used = (0..sensors.len()).filter(|number| !found[*number].is_empty());
    let leader = used.min_by_key(|number| {
        let sensor = &sensors[*number];
        (sensor.kind, std::cmp::Reverse(found[*number].len()))
    });
    let Some(events) = leader.and_then(|number| found.get_mut(number)) else {
        return;
    };
    for (event, _) in events {
        if let Of::Sensor(number) = event.of {
            event.of = Of::Leader(number);
        }
    }
}

/// From when to when, nanoseconds.
type Span = Option<(u64, u64)>;

fn span_of(marks: impl Iterator<Item = Mark>) -> Span {
    marks.fold(None, |span, mark| {
        let (first, last) = span.unwrap_or((mark.nanos, mark.nanos));
        Some((first.min(mark.nanos), last.max(mark.nanos)))
    })
}

fn shifted(topic: &str, odometry: &str, count: u64) -> String {
    format!(
        "{count} messages on {topic} are left out: they were recorded at other times than the poses on \
         {odometry} that have their stamps. The clock of one of the two began again. --clock record takes \
         the times of recording instead"
    )
}
