//! Which pose each message has, and in which order messages come.

use std::collections::BTreeMap;
use std::path::Path;

use super::choice::Chosen;
use super::collect::{Collector, Sweep, Topic};
use super::{Event, Of, Sensor, Survey};
use crate::Error;
use crate::ingest::config::{Clock, IngestConfig};
use crate::ingest::drives::{Drive, Mark, Matches, drives_of, match_marks};
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
    let mut odometry = collector
        .topics
        .remove(&chosen.odometry)
        .unwrap_or_default();
    let times = Times::of(&odometry.odometry, of.config.clock);
    let odometry_span = span_of(
        odometry
            .odometry
            .iter()
            .map(|(_, mark)| times.of_mark(*mark)),
    );
    let drives = drives(&mut odometry, times, (&chosen.odometry, &of))?;
    let mut warnings = of.log.warnings().to_vec();
    warnings.append(&mut collector.warnings);
    if drives.len() > 1 {
        warnings.push(format!(
            "the times on {} begin again or pause: the log is {} drives, each with a map and a \
             reference of its own",
            chosen.odometry,
            drives.len()
        ));
    }
    let mut sensors = Vec::new();
    let mut found: Vec<Found> = Vec::new();
    let mut apart = Vec::new();
    for (topic, kind, mount) in chosen.sensors {
        let mut of_topic = collector.topics.remove(&topic).unwrap_or_default();
        let sweeps = std::mem::take(&mut of_topic.sweeps);
        let marks: Vec<Mark> = sweeps
            .iter()
            .map(|sweep| times.of_mark(sweep.mark))
            .collect();
        let matches = match_marks(&drives, &marks);
        let number = u8::try_from(sensors.len()).unwrap_or(u8::MAX);
        let events = events_of(&sweeps, &marks, &matches, Of::Sensor(number));
        let matched = events.len() as u64;
        if events.is_empty() {
            let spans = Spans {
                sensor: span_of(marks.iter().copied()),
                odometry: odometry_span,
            };
            apart.push(spans.describe((&topic, of_topic.messages), &chosen.odometry, of.config));
        }
        if matches.shifted > 0 {
            warnings.push(shifted(&topic, &chosen.odometry, &matches));
        }
        sensors.push(Sensor {
            kind,
            sweeps: of_topic.messages,
            without_pose: of_topic.usable - matched,
            frame_id: of_topic.frame_id,
            mounting: mount.map(|mount| mount.vehicle_from_sensor()),
            is_limit_return: of_topic.habits.is_limit_return(),
            topic,
        });
        found.push(events);
    }
    if found.iter().all(Vec::is_empty) {
        return Err(Error::BadFile {
            path: of.path.to_owned(),
            what: apart.join("; "),
        });
    }
    warnings.append(&mut apart);
    lead(&sensors, &mut found);
    found.push(transform_events(
        &collector.transform_messages,
        &drives,
        times,
    ));
    let mut events: Found = found.into_iter().flatten().collect();
    events.sort_by_key(|(event, entry)| (event.drive, event.nanos, event.of, entry.place()));
    for (place, (_, entry)) in events.iter().enumerate() {
        let key = u64::try_from(place).unwrap_or(u64::MAX);
        if !collector.index.push(entry.with_key(key)) {
            return Err(Error::BadFile {
                path: of.path.to_owned(),
                what: "too many messages of sensors and transforms".to_owned(),
            });
        }
    }
    let topics: Vec<String> = sensors.iter().map(|sensor| sensor.topic.clone()).collect();
    let transforms = transform_topics(&collector.topics);
    let wanted = move |topic: &str| {
        topics
            .iter()
            .chain(&transforms)
            .any(|wanted| wanted == topic)
    };
    Ok(Survey {
        sensors,
        vehicle_frame: match odometry.child_frame_id {
            frame if frame.is_empty() => "base_link".to_owned(),
            frame => frame,
        },
        odom_topic: chosen.odometry,
        drives,
        transforms: collector.transforms,
        messages: OrderedReader::new(of.log, collector.index, of.definitions, wanted),
        events: events.into_iter().map(|(event, _)| event).collect(),
        bad_messages: collector.bad_messages,
        warnings,
    })
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

fn drives(
    odometry: &mut Topic,
    times: Times,
    (name, of): (&str, &Arrangement<'_>),
) -> Result<Vec<Drive>, Error> {
    let fixes = std::mem::take(&mut odometry.odometry);
    let fixes = fixes.into_iter().map(|(fix, mark)| {
        let mark = times.of_mark(mark);
        let fix = Fix {
            nanos: mark.nanos,
            ..fix
        };
        (fix, mark)
    });
    drives_of(fixes.collect()).map_err(|count| Error::BadFile {
        path: of.path.to_owned(),
        what: format!(
            "the times on {name} go back {count} times, expected at most {}: are there two senders, or \
             no usable stamps (--clock record takes the times of recording)?",
            super::super::drives::MAX_DRIVES
        ),
    })
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

/// Transforms belong to the drive that has a pose at their time, or else to the first one, where they
/// come before everything else: most are sent once and hold for the whole log.
fn transform_events(messages: &[Sweep], drives: &[Drive], times: Times) -> Found {
    let marks: Vec<Mark> = messages
        .iter()
        .map(|sweep| times.of_mark(sweep.mark))
        .collect();
    let matches = match_marks(drives, &marks);
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

/// From when to when sensor and odometry have messages.
struct Spans {
    sensor: Span,
    odometry: Span,
}

impl Spans {
    fn describe(
        &self,
        (topic, sweeps): (&str, u64),
        odometry: &str,
        config: &IngestConfig,
    ) -> String {
        let text = |span: Span| {
            span.map_or("nothing".to_owned(), |(first, last)| {
                format!("{:.3} s to {:.3} s", first as f64 / 1e9, last as f64 / 1e9)
            })
        };
        let advice = match config.clock {
            Clock::Stamp => {
                ". Where they come from two clocks, --clock record takes the times of recording instead"
            }
            Clock::Record => "",
        };
        format!(
            "{odometry} has no pose at the time of any of the {sweeps} messages on {topic}: {topic} is \
             from {}, {odometry} from {}{advice}",
            text(self.sensor),
            text(self.odometry)
        )
    }
}

fn shifted(topic: &str, odometry: &str, matches: &Matches) -> String {
    format!(
        "{} messages on {topic} are left out: they were recorded at other times than the poses on \
         {odometry} that have their stamps. The clock of one of the two began again. --clock record takes \
         the times of recording instead",
        matches.shifted
    )
}
