//! Choosing the topics that grids are made from.

use std::path::Path;

use super::SensorKind;
use super::collect::{Collector, Topic};
use crate::Error;
use crate::ingest::config::IngestConfig;
use crate::ingest::mapper::MAX_SENSORS;
use crate::ingest::mount::Mount;
use crate::msg::Message;
use crate::msg::nav::Odometry;
use crate::msg::sensor::{LaserScan, PointCloud2};
use crate::msg::tf2::TFMessage;

/// The topics that were chosen.
#[derive(Debug)]
pub(super) struct Chosen {
    /// Those of the sensors, each with the mounting that its user gives.
    pub(super) sensors: Vec<(String, SensorKind, Option<Mount>)>,
    pub(super) odometry: String,
}

/// Chooses topics as the configuration says, or else all sensors and the busiest odometry.
pub(super) fn choose(
    collector: &mut Collector,
    path: &Path,
    config: &IngestConfig,
) -> Result<Chosen, Error> {
    let missing = |wanted: String| Error::MissingTopic {
        path: path.to_owned(),
        wanted,
        found: collector.listing(),
    };
    let sensors = sensors_of(collector, config).map_err(missing)?;
    let odometry = odometry_of(collector, config).map_err(missing)?;
    let topics = sensors.iter().map(|(topic, _)| topic).chain([&odometry]);
    let unusable: Vec<&String> = topics
        .filter(|topic| {
            let found = collector.topics.get(*topic);
            found.is_some_and(|found| found.usable == 0)
        })
        .collect();
    if !unusable.is_empty() {
        return Err(no_usable(collector, path, &unusable));
    }
    if sensors.len() > MAX_SENSORS {
        let names: Vec<&str> = sensors.iter().map(|(topic, _)| topic.as_str()).collect();
        return Err(Error::BadFile {
            path: path.to_owned(),
            what: format!(
                "{} sensors ({}), expected at most {MAX_SENSORS}: choose some with --points and --scan",
                names.len(),
                names.join(", ")
            ),
        });
    }
    let sensors = mounted(&sensors, path, config)?;
    Ok(Chosen { sensors, odometry })
}

/// The error of a log of whose topics some have not one message that can be read. It tells the cause for
/// each, transforms included.
fn no_usable(collector: &Collector, path: &Path, chosen: &[&String]) -> Error {
    let is_unusable = |topic: &Topic| topic.usable == 0 && topic.cause.is_some();
    let transforms = collector
        .topics
        .iter()
        .filter(|(_, topic)| topic.type_name == TFMessage::TYPE_NAME && is_unusable(topic));
    let names = transforms
        .map(|(name, _)| name)
        .chain(chosen.iter().copied());
    let causes: Vec<String> = names
        .filter_map(|name| {
            let topic = collector.topics.get(name)?;
            let cause = topic.cause.as_deref().unwrap_or("no cause is known");
            // Path and topic are said already.
            let cause = cause
                .split_once(&format!(": {name}: "))
                .map_or(cause, |(_, cause)| cause);
            Some(format!(
                "no usable message on {name} ({} messages): {cause}",
                topic.messages
            ))
        })
        .collect();
    Error::BadFile {
        path: path.to_owned(),
        what: causes.join("; "),
    }
}

fn sensors_of(
    collector: &Collector,
    config: &IngestConfig,
) -> Result<Vec<(String, SensorKind)>, String> {
    let mut chosen: Vec<(String, SensorKind)> = Vec::new();
    for (names, type_name, kind) in [
        (
            &config.points_topics,
            PointCloud2::TYPE_NAME,
            SensorKind::Points,
        ),
        (&config.scan_topics, LaserScan::TYPE_NAME, SensorKind::Scan),
    ] {
        for name in names {
            let topic = named(collector, name, type_name)
                .ok_or_else(|| format!("{type_name} on {name:?}"))?;
            if !chosen.iter().any(|(known, _)| *known == topic) {
                chosen.push((topic, kind));
            }
        }
    }
    if chosen.is_empty() {
        let topics = collector.topics.iter();
        chosen.extend(topics.filter_map(|(name, topic)| Some((name.clone(), topic.kind()?))));
    }
    if chosen.is_empty() {
        return Err(format!(
            "{} or {}",
            PointCloud2::TYPE_NAME,
            LaserScan::TYPE_NAME
        ));
    }
    Ok(chosen)
}

fn odometry_of(collector: &Collector, config: &IngestConfig) -> Result<String, String> {
    match config.odom_topic.as_deref() {
        Some(name) => named(collector, name, Odometry::TYPE_NAME)
            .ok_or_else(|| format!("{} on {name:?}", Odometry::TYPE_NAME)),
        // The one with the most messages; between equal ones the first by name.
        None => collector
            .topics
            .iter()
            .filter(|(_, topic)| topic.type_name == Odometry::TYPE_NAME)
            .min_by_key(|(_, topic)| std::cmp::Reverse((topic.usable, topic.messages)))
            .map(|(name, _)| name.clone())
            .ok_or_else(|| Odometry::TYPE_NAME.to_owned()),
    }
}

fn bare(name: &str) -> &str {
    name.strip_prefix('/').unwrap_or(name)
}

/// A topic by its name, with or without the slash in front.
fn named(collector: &Collector, name: &str, type_name: &str) -> Option<String> {
    collector
        .topics
        .iter()
        .find(|(topic, found)| bare(topic) == bare(name) && found.type_name == type_name)
        .map(|(topic, _)| topic.clone())
}

/// Gives each sensor the mounting that is named for it.
fn mounted(
    sensors: &[(String, SensorKind)],
    path: &Path,
    config: &IngestConfig,
) -> Result<Vec<(String, SensorKind, Option<Mount>)>, Error> {
    let names: Vec<&str> = sensors.iter().map(|(topic, _)| topic.as_str()).collect();
    let bad = |what: String| Error::BadFile {
        path: path.to_owned(),
        what,
    };
    for mount in &config.mount {
        match mount.topic.as_deref() {
            None if sensors.len() > 1 => {
                return Err(bad(format!(
                    "a mounting without a topic, but the log has {} sensors: say which one is meant, as \
                     in --mount {}=x,y,z,roll,pitch,yaw (they are {})",
                    sensors.len(),
                    names.first().copied().unwrap_or_default(),
                    names.join(", ")
                )));
            }
            Some(topic) if !names.iter().any(|name| bare(name) == bare(topic)) => {
                return Err(bad(format!(
                    "a mounting of {topic:?}, which is none of the sensors: {}",
                    names.join(", ")
                )));
            }
            _ => {}
        }
    }
    let mount_of = |name: &str| {
        config.mount.iter().find(|mount| {
            let topic = mount.topic.as_deref();
            topic.is_none_or(|topic| bare(topic) == bare(name))
        })
    };
    Ok(sensors
        .iter()
        .map(|(topic, kind)| (topic.clone(), *kind, mount_of(topic).cloned()))
        .collect())
}
