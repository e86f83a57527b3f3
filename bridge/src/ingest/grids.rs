//! Grids of a log as a recording that a planner can be fed from, and as pictures.

use std::path::{Path, PathBuf};

use super::config::IngestConfig;
use super::frames::{Frames, IngestReport, frames};
use crate::Error;
use crate::frame::Frame;
use crate::geometry::Pose2;
use crate::keys::{self, Topic};
use crate::msg::header::Header;
use crate::msg::nav::{OccupancyGrid, Odometry, Path as PathMessage};
use crate::picture::{BLUE, GREEN, Picture};
use crate::poses::{odometry_message, path_message};
use crate::recording::{Existing, Writer, check_out};
use crate::vehicle::Vehicle;

/// Most pictures of a log; of longer logs every second, third, ... frame is drawn.
pub const MAX_PICTURES: u64 = 100;
/// Pixels of a picture along the side of a cell.
const PIXELS_A_CELL: u32 = 4;
/// Frame of the vehicle in the messages that are written.
const VEHICLE_FRAME: &str = "base_link";

/// How far a log has been read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Sweeps read.
    pub sweeps: u64,
    /// Sweeps of the log.
    pub of_sweeps: u64,
    /// Frames written.
    pub frames: u64,
}

/// Writes frames as the messages of a vehicle: grid, odometry and reference.
#[derive(Debug)]
pub struct GridWriter {
    writer: Writer,
    grid: Topic<OccupancyGrid>,
    odom: Topic<Odometry>,
    reference: Topic<PathMessage>,
    /// What is added to stamps for the times of recording, nanoseconds.
    shift_nanos: u64,
    last_log_nanos: Option<u64>,
}

/// Time between the drives of a log in the times of recording, nanoseconds.
const BETWEEN_DRIVES_NANOS: u64 = 1_000_000_000;

impl GridWriter {
    /// Begins a recording of the vehicle of this name.
    ///
    /// # Errors
    /// As [`Writer::create_with`].
    pub fn create(path: &Path, vehicle_id: &str, existing: Existing) -> Result<Self, Error> {
        Ok(Self {
            writer: Writer::create_with(path, existing)?,
            shift_nanos: 0,
            last_log_nanos: None,
            grid: keys::grid(vehicle_id),
            odom: keys::odom(vehicle_id),
            reference: keys::reference(vehicle_id),
        })
    }

    /// Writes a frame. Where stamps go back, since a log is several drives, the times of recording go on:
    /// what is recorded stays in the order in which it is written.
    ///
    /// # Errors
    /// As [`Writer::write`].
    pub fn write(&mut self, frame: &Frame) -> Result<(), Error> {
        let nanos = frame.stamp_nanos;
        let header = Header::at(nanos, VEHICLE_FRAME);
        let reference = path_message(&header, &frame.reference);
        let odometry = odometry_message(&header, frame);
        let grid = frame.occupancy.to_message(header);
        let mut log_nanos = nanos.saturating_add(self.shift_nanos);
        if let Some(last) = self.last_log_nanos
            && log_nanos < last
        {
            log_nanos = last.saturating_add(BETWEEN_DRIVES_NANOS);
            self.shift_nanos = log_nanos - nanos.min(log_nanos);
        }
        self.last_log_nanos = Some(log_nanos);
        self.writer
            .write(&self.reference, &reference, log_nanos, nanos)?;
        self.writer.write(&self.odom, &odometry, log_nanos, nanos)?;
        self.writer.write(&self.grid, &grid, log_nanos, nanos)
    }

    /// Finishes the file.
    ///
    /// # Errors
    /// As [`Writer::finish`].
    pub fn finish(self) -> Result<(), Error> {
        self.writer.finish()
    }
}

/// Where grids of a log are written to.
#[derive(Debug, Clone, Copy)]
pub struct GridsOut<'a> {
    /// The recording.
    pub recording: &'a Path,
    /// What becomes of a recording that is there already.
    pub existing: Existing,
    /// The directory for pictures, if there are to be any.
    pub pictures: Option<&'a Path>,
}

/// Makes grids of a log and writes them as a recording: grid, odometry and reference of each frame,
/// and, if there is a directory for them, pictures. `progress` is called for each frame.
///
/// # Errors
/// As [`frames`], [`GridWriter::create`], [`GridWriter::write`] and [`Picture::write_png`].
pub fn write_grids(
    log: &Path,
    out: &GridsOut<'_>,
    config: &IngestConfig,
    progress: &mut dyn FnMut(Progress),
) -> Result<IngestReport, Error> {
    check_out(out.recording, out.existing)?;
    let mut frames = frames(log, config)?;
    if let Some(directory) = out.pictures {
        std::fs::create_dir_all(directory).map_err(|source| Error::Io {
            path: directory.to_owned(),
            source,
        })?;
    }
    let mut writer = None;
    let every = frames.sweeps().div_ceil(MAX_PICTURES).max(1);
    while let Some(frame) = frames.next() {
        let frame = frame?;
        // A log without a single frame leaves no file behind.
        let opened = match writer.take() {
            Some(opened) => opened,
            None => GridWriter::create(out.recording, &config.vehicle_id, out.existing)?,
        };
        writer.insert(opened).write(&frame)?;
        let number = frames.report().frames - 1;
        if let Some(directory) = out.pictures.filter(|_| number.is_multiple_of(every)) {
            let path: PathBuf = directory.join(format!("{number:06}.png"));
            picture_of(&frame, &config.vehicle).write_png(&path)?;
        }
        progress(progress_of(&frames));
    }
    match writer {
        Some(writer) => writer.finish()?,
        None => {
            return Err(Error::BadFile {
                path: log.to_owned(),
                what: "no frame comes of it".to_owned(),
            });
        }
    }
    Ok(frames.report().clone())
}

/// A frame as a picture: the grid, the vehicle, its reference and a scale.
pub fn picture_of(frame: &Frame, vehicle: &Vehicle) -> Picture {
    let mut picture = Picture::of(&frame.occupancy, PIXELS_A_CELL);
    picture.line(&frame.reference, GREEN, 2.0);
    picture.vehicle(&Pose2::default(), vehicle, BLUE);
    picture.scale_bar();
    picture
}

fn progress_of(frames: &Frames) -> Progress {
    Progress {
        sweeps: frames.report().sweeps,
        of_sweeps: frames.sweeps(),
        frames: frames.report().frames,
    }
}
