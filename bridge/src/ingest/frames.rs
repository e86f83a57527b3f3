//! A log as a stream of frames.

use std::path::{Path, PathBuf};

use nalgebra::Isometry3;

use super::cloud::{oddity_of, points_of};
use super::config::IngestConfig;
use super::mapper::Mapper;
use super::odometry::Moment;
use super::scan::{BeamConfig, beams_of};
use super::survey::{Event, Of, SensorKind, Survey, survey};
use crate::Error;
use crate::frame::Frame;
use crate::msg::sensor::{LaserScan, PointCloud2};
use crate::msg::tf2::TFMessage;
use crate::recording::RawMessage;

/// Most warnings that are kept.
const MAX_WARNINGS: usize = 16;
/// Time without a sweep of the sensor whose sweeps become frames, from which on those of the others do,
/// nanoseconds.
const LEADER_PAUSE_NANOS: u64 = 500_000_000;
/// Frames that stand in for the odometry's where there is no transform to that.
const STAND_INS: [&str; 2] = ["base_link", "base_footprint"];

/// What was made of a log, and what was not.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct IngestReport {
    /// The sensors, in the order in which they were named or else by topic.
    pub sensors: Vec<SensorReport>,
    /// Topic of the odometry.
    pub odom_topic: String,
    /// Drives of the log: more than one where its clock began again.
    pub drives: u64,
    /// Sweeps read so far, of all sensors.
    pub sweeps: u64,
    /// Frames given so far.
    pub frames: u64,
    /// Messages that did not decode or could not be meant.
    pub bad_messages: u64,
    /// Sweeps at moments for which the odometry has no pose.
    pub without_pose: u64,
    /// What a reader of the result has to know, each said once.
    pub warnings: Vec<String>,
}

/// A sensor of a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SensorReport {
    /// Topic.
    pub topic: String,
    /// Kind.
    pub kind: SensorKind,
    /// Messages on the topic.
    pub sweeps: u64,
    /// Those of them for which the odometry has no pose.
    pub without_pose: u64,
}

impl IngestReport {
    fn warn(&mut self, what: impl FnOnce() -> String) {
        if self.warnings.len() < MAX_WARNINGS {
            let what = what();
            if !self.warnings.contains(&what) {
                tracing::warn!("{what}");
                self.warnings.push(what);
            }
        }
    }
}

/// The frames of a log, one a sweep, drive by drive and in the order of time.
///
/// Where a log has several sensors, the sweeps of one of them become frames, those of the others are
/// added to its map. Messages that cannot be used are counted in [`Frames::report`] and passed over; a
/// file that cannot be read on ends with an error.
#[derive(Debug)]
pub struct Frames {
    path: PathBuf,
    survey: Survey,
    mapper: Mapper,
    config: IngestConfig,
    report: IngestReport,
    first_bad: Option<Error>,
    /// The drive and the number of jumps in it up to the last sweep.
    stretch: Option<(u32, u32)>,
    last_lead_nanos: Option<u64>,
    last_frame_nanos: Option<u64>,
    is_done: bool,
}

/// The frames of a log: CDR messages of ROS 2 with `sensor_msgs/PointCloud2` or
/// `sensor_msgs/LaserScan`, and `nav_msgs/Odometry`, in an MCAP file, a file that was compressed with zstd,
/// or a rosbag2 folder.
///
/// The log is read twice: first for all drives, since a frame's reference is the odometry still to
/// come, then for the sweeps, a window of them at a time. The vehicle's frame is the odometry's child
/// frame, whatever that is on the vehicle; sensors are placed in it by `/tf_static` and `/tf`, or by
/// [`IngestConfig::mount`].
///
/// # Errors
/// [`Error::MissingTopic`] lists what the log has instead; [`Error::MissingTransform`] if nobody says where
/// a sensor is; [`Error::BadFile`] if no message can be used, with the causes, or no sweep has a pose, with
/// the times; [`Error::Io`] and [`Error::BadRecording`] where it cannot be read.
pub fn frames(path: &Path, config: &IngestConfig) -> Result<Frames, Error> {
    let mapper = Mapper::new(config)?;
    let mut survey = survey(path, config)?;
    let without_pose = survey
        .sensors
        .iter()
        .map(|sensor| sensor.without_pose)
        .sum();
    let usable: u64 = survey
        .events
        .iter()
        .filter(|event| event.of != Of::Transforms)
        .count() as u64;
    let all: u64 = survey.sensors.iter().map(|sensor| sensor.sweeps).sum();
    let mut frames = Frames {
        path: path.to_owned(),
        mapper,
        config: config.clone(),
        report: IngestReport {
            sensors: survey.sensors.iter().map(SensorReport::of).collect(),
            odom_topic: survey.odom_topic.clone(),
            drives: survey.drives.len() as u64,
            // Those that cannot be used are not read again.
            sweeps: all - usable,
            bad_messages: survey.bad_messages,
            without_pose,
            ..IngestReport::default()
        },
        first_bad: None,
        stretch: None,
        last_lead_nanos: None,
        last_frame_nanos: None,
        is_done: false,
        survey: {
            survey.warnings.truncate(MAX_WARNINGS);
            survey
        },
    };
    for warning in std::mem::take(&mut frames.survey.warnings) {
        frames.report.warn(|| warning);
    }
    for number in 0..frames.survey.sensors.len() {
        let frame_id = frames.survey.sensors[number].frame_id.clone();
        frames.mounting(number, &frame_id)?;
    }
    Ok(frames)
}

impl SensorReport {
    fn of(sensor: &super::survey::Sensor) -> Self {
        Self {
            topic: sensor.topic.clone(),
            kind: sensor.kind,
            sweeps: sensor.sweeps,
            without_pose: sensor.without_pose,
        }
    }
}

impl Frames {
    /// What was made of the log so far.
    pub const fn report(&self) -> &IngestReport {
        &self.report
    }

    /// Number of sweeps of the log, of all sensors.
    pub fn sweeps(&self) -> u64 {
        self.survey.sensors.iter().map(|sensor| sensor.sweeps).sum()
    }

    fn take(&mut self, event: Event, message: &RawMessage) -> Result<Option<Frame>, Error> {
        let (number, is_leader) = match event.of {
            Of::Transforms => {
                self.survey
                    .transforms
                    .insert(&message.decode::<TFMessage>()?);
                return Ok(None);
            }
            Of::Sensor(number) => (usize::from(number), false),
            Of::Leader(number) => (usize::from(number), true),
        };
        self.report.sweeps += 1;
        let drive = &self.survey.drives[event.drive as usize];
        let Some(moment) = drive.track.at(event.nanos) else {
            self.report.without_pose += 1;
            return Ok(None);
        };
        self.begin_stretch((event.drive, moment.jumps));
        self.mapper.select(number);
        match self.survey.sensors[number].kind {
            SensorKind::Points => self.add_points(number, message, (event.nanos, &moment))?,
            SensorKind::Scan => self.add_scan(number, message, (event.nanos, &moment))?,
        }
        if is_leader {
            self.last_lead_nanos = Some(event.nanos);
        } else {
            // A drive waits as long for its first sweep of the leader.
            let last_nanos = *self.last_lead_nanos.get_or_insert(event.nanos);
            if event.nanos.saturating_sub(last_nanos) < LEADER_PAUSE_NANOS {
                self.mapper.note_free();
                return Ok(None);
            }
        }
        Ok(self.frame(event, &moment))
    }

    /// Begins a new map where the odometry jumped, or with another drive.
    fn begin_stretch(&mut self, stretch: (u32, u32)) {
        let before = self.stretch.replace(stretch);
        let Some(before) = before.filter(|before| *before != stretch) else {
            return;
        };
        self.mapper.clear();
        if before.0 == stretch.0 {
            let topic = &self.survey.odom_topic;
            self.report
                .warn(|| format!("{topic} jumps or pauses: the map begins anew behind each jump"));
        } else {
            self.last_frame_nanos = None;
            self.last_lead_nanos = None;
        }
    }

    fn add_points(
        &mut self,
        number: usize,
        message: &RawMessage,
        (nanos, moment): (u64, &Moment),
    ) -> Result<(), Error> {
        let cloud: PointCloud2 = message.decode()?;
        let vehicle_from_sensor = self.mounting(number, &cloud.header.frame_id)?;
        let points = points_of(&cloud, &vehicle_from_sensor)?;
        if let Some(oddity) = oddity_of(&cloud) {
            self.warn_once_of(&message.topic, &oddity);
        }
        let at = vehicle_from_sensor.translation.vector;
        #[expect(clippy::cast_possible_truncation, reason = "a place on the vehicle")]
        let sensor = [at.x as f32, at.y as f32, at.z as f32];
        self.mapper
            .add_points(&points, sensor, &moment.odom_from_vehicle, nanos)
    }

    fn add_scan(
        &mut self,
        number: usize,
        message: &RawMessage,
        (nanos, moment): (u64, &Moment),
    ) -> Result<(), Error> {
        let scan: LaserScan = message.decode()?;
        let vehicle_from_sensor = self.mounting(number, &scan.header.frame_id)?;
        let at = vehicle_from_sensor.translation.vector;
        #[expect(
            clippy::cast_possible_truncation,
            reason = "configured and on the vehicle"
        )]
        let (clear_m, sensor) = (self.config.clear_m as f32, (at.x as f32, at.y as f32));
        let beam_config = BeamConfig {
            clear_m,
            is_limit_return: self.survey.sensors[number].is_limit_return,
        };
        let ends = beams_of(&scan, &vehicle_from_sensor, &beam_config)?;
        let beams = (ends.as_slice(), scan.angle_increment);
        self.mapper
            .add_scan(beams, sensor, &moment.odom_from_vehicle, nanos)
    }

    /// Warns of something about a topic, once however often it comes with other numbers.
    fn warn_once_of(&mut self, topic: &str, what: &str) {
        let about = |text: &str| text.split(' ').next().map(str::to_owned);
        let begin = format!("{topic}: {}", about(what).unwrap_or_default());
        if !self
            .report
            .warnings
            .iter()
            .any(|warning| warning.starts_with(&begin))
        {
            self.report.warn(|| format!("{topic}: {what}"));
        }
    }

    /// Where a sensor is in the vehicle's frame.
    fn mounting(&mut self, number: usize, sensor_frame: &str) -> Result<Isometry3<f64>, Error> {
        let sensor = &self.survey.sensors[number];
        if let Some(mounting) = sensor.mounting {
            return Ok(mounting);
        }
        let vehicle_frame = &self.survey.vehicle_frame;
        if let Some(found) = self.survey.transforms.lookup(vehicle_frame, sensor_frame) {
            return Ok(found);
        }
        for stand_in in STAND_INS {
            if let Some(found) = self.survey.transforms.lookup(stand_in, sensor_frame) {
                self.report.warn(|| {
                    format!(
                        "no transform from {sensor_frame:?} to the odometry's {vehicle_frame:?}: \
                         took that to {stand_in:?} for it"
                    )
                });
                return Ok(found);
            }
        }
        let known: Vec<&str> = self.survey.transforms.frames().take(20).collect();
        Err(Error::MissingTransform {
            path: self.path.clone(),
            topic: sensor.topic.as_str().into(),
            sensor_frame: sensor_frame.into(),
            vehicle_frame: vehicle_frame.as_str().into(),
            known: if known.is_empty() {
                "none".into()
            } else {
                known.join(", ").into()
            },
        })
    }

    fn frame(&mut self, event: Event, moment: &Moment) -> Option<Frame> {
        let nanos = event.nanos;
        let is_soon = self.last_frame_nanos.is_some_and(|last| {
            nanos >= last && ((nanos - last) as f64) < self.config.min_interval_s * 1e9
        });
        if is_soon {
            return None;
        }
        self.last_frame_nanos = Some(nanos);
        self.report.frames += 1;
        Some(Frame {
            stamp_nanos: nanos,
            occupancy: self.mapper.occupancy(),
            odom_from_vehicle: moment.odom_from_vehicle,
            speed_m_per_s: moment.speed_m_per_s,
            turn_rad_per_s: moment.turn_rad_per_s,
            reference: self.survey.drives[event.drive as usize].track.reference(
                moment,
                self.config.reference_step_m,
                &self.config.spec,
            ),
        })
    }

    /// The end of a log; an error if not one of its sweeps was of use.
    fn finish(&mut self) -> Option<Result<Frame, Error>> {
        self.is_done = true;
        if self.report.frames > 0 {
            return None;
        }
        self.first_bad.take().map(Err)
    }
}

impl Iterator for Frames {
    type Item = Result<Frame, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.is_done {
            let (place, message) = match self.survey.messages.next() {
                Some(Ok(next)) => next,
                Some(Err(error)) => {
                    self.is_done = true;
                    return Some(Err(error));
                }
                None => return self.finish(),
            };
            let place = usize::try_from(place).unwrap_or(usize::MAX);
            let Some(&event) = self.survey.events.get(place) else {
                continue;
            };
            match self.take(event, &message) {
                Ok(None) => {}
                Ok(Some(frame)) => return Some(Ok(frame)),
                Err(error @ Error::MissingTransform { .. }) => {
                    self.is_done = true;
                    return Some(Err(error));
                }
                Err(error) => {
                    self.report.bad_messages += 1;
                    let what = format!("passed over: {error}");
                    self.warn_once_of(&message.topic, &what);
                    self.first_bad.get_or_insert(error);
                }
            }
        }
        None
    }
}
