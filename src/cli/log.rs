//! How drive logs are read: options of every command that takes them.

use clap::Args;
use swath_bridge::ingest::{Clock, IngestConfig, Mount};

/// How drive logs are read; what is not given is as the configuration says.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "How logs are read")]
pub(crate) struct LogOptions {
    /// Topic of point clouds to use; may be given again [default: all clouds and scans]
    #[arg(long, value_name = "TOPIC")]
    pub(crate) points: Vec<String>,
    /// Topic of laser scans to use; may be given again [default: all clouds and scans]
    #[arg(long, value_name = "TOPIC")]
    pub(crate) scan: Vec<String>,
    /// Topic of the odometry [default: the one with the most messages]
    #[arg(long, value_name = "TOPIC")]
    pub(crate) odom: Option<String>,
    /// Where a sensor is on the vehicle: [TOPIC=]x,y,z,roll,pitch,yaw in metres and radians, instead of
    /// what the log's transforms say; may be given again
    #[arg(long, value_name = "MOUNT", allow_hyphen_values = true)]
    pub(crate) mount: Vec<Mount>,
    /// Which times count: the stamps of the messages, or the times of recording (for logs with two clocks)
    #[arg(long, value_name = "stamp|record", value_parser = parse_clock)]
    pub(crate) clock: Option<Clock>,
}

fn parse_clock(text: &str) -> Result<Clock, String> {
    match text {
        "stamp" => Ok(Clock::Stamp),
        "record" => Ok(Clock::Record),
        _ => Err("expected stamp or record".to_owned()),
    }
}

impl LogOptions {
    /// A configuration with what was given on the command line.
    pub(crate) fn apply(&self, config: IngestConfig) -> IngestConfig {
        let is_chosen = !self.points.is_empty() || !self.scan.is_empty();
        IngestConfig {
            points_topics: if is_chosen {
                self.points.clone()
            } else {
                config.points_topics
            },
            scan_topics: if is_chosen {
                self.scan.clone()
            } else {
                config.scan_topics
            },
            odom_topic: self.odom.clone().or(config.odom_topic),
            mount: if self.mount.is_empty() {
                config.mount
            } else {
                self.mount.clone()
            },
            clock: self.clock.unwrap_or(config.clock),
            ..config
        }
    }

    /// The options as they are given on a command line.
    pub(crate) fn arguments(&self) -> Vec<String> {
        let mut arguments = Vec::new();
        let mut add = |name: &str, value: String| arguments.push(format!("--{name}={value}"));
        for topic in &self.points {
            add("points", topic.clone());
        }
        for topic in &self.scan {
            add("scan", topic.clone());
        }
        if let Some(topic) = &self.odom {
            add("odom", topic.clone());
        }
        for mount in &self.mount {
            add("mount", mount.to_string());
        }
        if let Some(clock) = self.clock {
            let name = match clock {
                Clock::Stamp => "stamp",
                Clock::Record => "record",
            };
            add("clock", name.to_owned());
        }
        arguments
    }
}
