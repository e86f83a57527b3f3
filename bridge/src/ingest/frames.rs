//! A log as a stream of frames.

use std::path::{Path, PathBuf};

use nalgebra::Isometry3;

use super::cloud::points_of;
use super::config::IngestConfig;
use super::mapper::Mapper;
use super::odometry::Moment;
use super::scan::beams_of;
use super::survey::{SensorKind, Survey, survey};
use crate::Error;
use crate::frame::Frame;
use crate::msg::Message;
use crate::msg::header::Header;
use crate::msg::sensor::{LaserScan, PointCloud2};
use crate::msg::tf2::TFMessage;
use crate::recording::{RawMessage, Reader};

/// Most warnings that are kept.
const MAX_WARNINGS: usize = 16;

/// What was made of a log, and what was not.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct IngestReport {
    /// Topic of the sensor.
    pub sensor_topic: String,
    /// Topic of the odometry.
    pub odom_topic: String,
    /// Sweeps read so far.
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

/// The frames of a log, one a sweep, in the order of the file.
///
/// Messages that cannot be used are counted in [`Frames::report`] and passed over; a file that
/// cannot be read on ends with an error.
#[derive(Debug)]
pub struct Frames {
    path: PathBuf,
    reader: Reader,
    survey: Survey,
    mapper: Mapper,
    config: IngestConfig,
    report: IngestReport,
    first_bad: Option<Error>,
    jumps: Option<u32>,
    last_frame_nanos: Option<u64>,
    is_done: bool,
}

/// The frames of a log: any MCAP file of CDR messages with `sensor_msgs/PointCloud2` or
/// `sensor_msgs/LaserScan`, and `nav_msgs/Odometry`.
///
/// The log is read twice: first for the whole drive, since a frame's reference is the odometry still
/// to come, then for the sweeps, one at a time. The vehicle's frame is the odometry's child frame,
/// whatever that is on the vehicle; sensors are placed in it by `/tf_static` and `/tf`.
///
/// # Errors
/// [`Error::MissingTopic`] lists what the file has instead; [`Error::Io`] and
/// [`Error::BadRecording`] where it cannot be read.
pub fn frames(path: &Path, config: &IngestConfig) -> Result<Frames, Error> {
    let mapper = Mapper::new(config)?;
    let survey = survey(path, config)?;
    let mut wanted = survey.transform_topics.clone();
    wanted.push(survey.sensor_topic.clone());
    let reader =
        Reader::open(path)?.with_topics(move |topic| wanted.iter().any(|wanted| wanted == topic));
    Ok(Frames {
        path: path.to_owned(),
        reader,
        mapper,
        config: config.clone(),
        report: IngestReport {
            sensor_topic: survey.sensor_topic.clone(),
            odom_topic: survey.odom_topic.clone(),
            bad_messages: survey.bad_messages,
            ..IngestReport::default()
        },
        survey,
        first_bad: None,
        jumps: None,
        last_frame_nanos: None,
        is_done: false,
    })
}

impl Frames {
    /// What was made of the log so far.
    pub const fn report(&self) -> &IngestReport {
        &self.report
    }

    /// Number of sweeps of the log.
    pub const fn sweeps(&self) -> u64 {
        self.survey.sweeps
    }

    /// Kind of the sensor.
    pub const fn kind(&self) -> SensorKind {
        self.survey.kind
    }

    fn take(&mut self, message: &RawMessage) -> Result<Option<Frame>, Error> {
        if *message.topic == *self.survey.sensor_topic {
            return self.take_sweep(message);
        }
        if *message.type_name == *TFMessage::TYPE_NAME {
            self.survey.transforms.insert(&message.decode()?);
        }
        Ok(None)
    }

    fn take_sweep(&mut self, message: &RawMessage) -> Result<Option<Frame>, Error> {
        self.report.sweeps += 1;
        let (nanos, moment) = match self.survey.kind {
            SensorKind::Points => {
                let cloud: PointCloud2 = message.decode()?;
                let Some((nanos, moment)) = self.moment(&cloud.header, message.log_nanos) else {
                    return Ok(None);
                };
                let vehicle_from_sensor = self.mounting(&cloud.header.frame_id);
                let points = points_of(&cloud, &vehicle_from_sensor)?;
                let at = vehicle_from_sensor.translation.vector;
                #[expect(clippy::cast_possible_truncation, reason = "a place on the vehicle")]
                let sensor = [at.x as f32, at.y as f32, at.z as f32];
                self.mapper
                    .add_points(&points, sensor, &moment.odom_from_vehicle, nanos)?;
                (nanos, moment)
            }
            SensorKind::Scan => {
                let scan: LaserScan = message.decode()?;
                let Some((nanos, moment)) = self.moment(&scan.header, message.log_nanos) else {
                    return Ok(None);
                };
                let vehicle_from_sensor = self.mounting(&scan.header.frame_id);
                let at = vehicle_from_sensor.translation.vector;
                #[expect(
                    clippy::cast_possible_truncation,
                    reason = "configured and on the vehicle"
                )]
                let (clear_m, sensor) = (self.config.clear_m as f32, (at.x as f32, at.y as f32));
                let ends = beams_of(&scan, &vehicle_from_sensor, clear_m)?;
                let beams = (ends.as_slice(), scan.angle_increment);
                self.mapper
                    .add_scan(beams, sensor, &moment.odom_from_vehicle, nanos)?;
                (nanos, moment)
            }
        };
        Ok(self.frame(nanos, &moment))
    }

    /// When a sweep was taken and where the vehicle was then; begins a new map where the odometry
    /// jumped.
    fn moment(&mut self, header: &Header, log_nanos: u64) -> Option<(u64, Moment)> {
        let nanos = self.survey.nanos_of(header, log_nanos);
        let Some(moment) = self.survey.track.at(nanos) else {
            self.report.without_pose += 1;
            return None;
        };
        if self
            .jumps
            .replace(moment.jumps)
            .is_some_and(|jumps| jumps != moment.jumps)
        {
            self.mapper.clear();
            let topic = &self.survey.odom_topic;
            self.report
                .warn(|| format!("{topic} jumps: the map begins anew behind each jump"));
        }
        Some((nanos, moment))
    }

    /// Where the sensor is in the vehicle's frame.
    fn mounting(&mut self, sensor_frame: &str) -> Isometry3<f64> {
        let vehicle_frame = &self.survey.vehicle_frame;
        if let Some(found) = self.survey.transforms.lookup(vehicle_frame, sensor_frame) {
            return found;
        }
        for stand_in in ["base_link", "base_footprint"] {
            if let Some(found) = self.survey.transforms.lookup(stand_in, sensor_frame) {
                self.report.warn(|| {
                    format!(
                        "no transform from {sensor_frame:?} to the odometry's {vehicle_frame:?}: \
                         took that to {stand_in:?} for it"
                    )
                });
                return found;
            }
        }
        self.report.warn(|| {
            let known: Vec<&str> = self.survey.transforms.frames().take(20).collect();
            format!(
                "NO TRANSFORM from {sensor_frame:?} to {vehicle_frame:?} (known: {known:?}): the \
                 sensor is taken to be at the vehicle's origin, looking forward; grids are shifted \
                 and turned if it is not"
            )
        });
        Isometry3::identity()
    }

    fn frame(&mut self, nanos: u64, moment: &Moment) -> Option<Frame> {
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
            reference: self.survey.track.reference(
                moment,
                self.config.reference_step_m,
                &self.config.spec,
            ),
        })
    }

    /// The end of a log; an error if not one of its sweeps was of use.
    fn finish(&mut self) -> Option<Result<Frame, Error>> {
        self.is_done = true;
        if self.report.frames > 0 || self.report.sweeps == 0 {
            return None;
        }
        Some(Err(self.first_bad.take().unwrap_or_else(|| {
            Error::BadFile {
                path: self.path.clone(),
                what: format!(
                    "{} has no pose at the time of any of the {} messages on {}",
                    self.survey.odom_topic, self.report.sweeps, self.survey.sensor_topic
                ),
            }
        })))
    }
}

impl Iterator for Frames {
    type Item = Result<Frame, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.is_done {
            let message = match self.reader.next() {
                Some(Ok(message)) => message,
                Some(Err(error)) => {
                    self.is_done = true;
                    return Some(Err(error));
                }
                None => return self.finish(),
            };
            match self.take(&message) {
                Ok(None) => {}
                Ok(Some(frame)) => return Some(Ok(frame)),
                Err(error) => {
                    self.report.bad_messages += 1;
                    self.report
                        .warn(|| format!("{}: passed over: {error}", message.topic));
                    self.first_bad.get_or_insert(error);
                }
            }
        }
        None
    }
}
