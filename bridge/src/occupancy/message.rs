//! Occupancy to and from `nav_msgs/OccupancyGrid`.
//!
//! A message's index runs along x first and its origin is the corner of cell (0, 0), so its last
//! cell is row 0, column 0 of the vehicle's grid.

use super::resample::Source;
use super::{OCCUPIED, Occupancy, UNKNOWN};
use crate::Error;
use crate::geometry::{GridSpec, MAX_GRID_SIDE_CELLS, Pose2};
use crate::msg::geometry::{Point, Pose, Quaternion};
use crate::msg::header::Header;
use crate::msg::nav::{MapMetaData, OccupancyGrid};
use crate::poses::pose_of_ros;
use crate::transforms::{MAX_DISTANCE_M, MAX_TILT_DEG, tilt_deg};

/// Least turn between two grids that counts, radians: over 4096 cells, one of less moves the last one by
/// a fifth of a cell.
const LEAST_TURN_RAD: f64 = 5e-5;

/// What about a grid's message cannot be worked with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum GridFault {
    /// Sides of no or too many cells, or data of another length.
    Size,
    /// The side of a cell.
    Resolution,
    /// The origin is not finite, too far away or no pose.
    Origin,
    /// The origin is tilted out of the plane.
    Tilted,
    /// A value of a cell.
    Value,
    /// The vehicle is not on the grid, or the grid is turned against it, where neither is allowed.
    Place,
}

impl GridFault {
    /// The same words for all grids with this fault.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Size => "the size cannot be worked with",
            Self::Resolution => "the resolution is out of range",
            Self::Origin => "the origin is not a pose nearby",
            Self::Tilted => "the origin is tilted",
            Self::Value => "a cell's value is out of range",
            Self::Place => "the vehicle does not stand along it",
        }
    }
}

fn unusable<T>(fault: GridFault, what: String) -> Result<T, Error> {
    Err(Error::UnusableGrid { fault, what })
}

impl Occupancy {
    /// The message that says the same.
    pub fn to_message(&self, header: Header) -> OccupancyGrid {
        let spec = &self.spec;
        let (rows, cols) = (spec.rows as usize, spec.cols as usize);
        let mut data = Vec::with_capacity(spec.len());
        for col in (0..cols).rev() {
            data.extend((0..rows).rev().map(|row| self.cells[row * cols + col]));
        }
        let corner_m =
            |ego: u32, cells: u32| (f64::from(ego) - f64::from(cells) + 0.5) * spec.resolution_m;
        #[expect(
            clippy::cast_possible_truncation,
            reason = "the message type holds the resolution as f32"
        )]
        let resolution = spec.resolution_m as f32;
        OccupancyGrid {
            info: MapMetaData {
                map_load_time: header.stamp.clone(),
                resolution,
                width: spec.rows,
                height: spec.cols,
                origin: Pose {
                    position: Point {
                        x: corner_m(spec.ego_row, spec.rows),
                        y: corner_m(spec.ego_col, spec.cols),
                        z: 0.0,
                    },
                    orientation: Quaternion {
                        x: 0.0,
                        y: 0.0,
                        z: 0.0,
                        w: 1.0,
                    },
                },
            },
            header,
            data,
        }
    }

    /// What a message in the vehicle's frame says on the grid of `spec`.
    ///
    /// # Errors
    /// As [`Occupancy::from_message_in`].
    pub fn from_message(message: &OccupancyGrid, spec: &GridSpec) -> Result<Self, Error> {
        Self::from_message_in(message, spec, &Pose2::default())
    }

    /// What a message in a frame that lies so in the vehicle's says on the grid of `spec`. Its origin
    /// may be turned in its frame, too.
    ///
    /// Where the message's cells are those of `spec` this is exact. Else a cell is as occupied as the
    /// most occupied of the message's cells that it overlaps, and unknown if one of them is unknown
    /// and none is occupied. Cells that the message does not cover are unknown.
    ///
    /// # Errors
    /// [`Error::UnusableGrid`] says what about the message cannot be worked with: sizes that are zero,
    /// too large or do not fit the data, a resolution or origin that is not finite, an origin that is
    /// tilted by more than [`MAX_TILT_DEG`], values outside −1 to 100. [`Error::InvalidGrid`] as
    /// [`GridSpec::validate`].
    pub fn from_message_in(
        message: &OccupancyGrid,
        spec: &GridSpec,
        vehicle_from_frame: &Pose2,
    ) -> Result<Self, Error> {
        spec.validate()?;
        let (mut source, frame_from_source) = checked(message)?;
        let vehicle_from_source = vehicle_from_frame.then(&frame_from_source);
        if !vehicle_from_source.is_finite() {
            return unusable(
                GridFault::Origin,
                format!("its frame is at {vehicle_from_frame:?}, which is not finite"),
            );
        }
        if vehicle_from_source.yaw_rad.abs() >= LEAST_TURN_RAD {
            return Ok(source.turned(spec, &vehicle_from_source));
        }
        source.origin_m = (vehicle_from_source.x_m, vehicle_from_source.y_m);
        Ok(source.resampled(spec))
    }

    /// What a message in the vehicle's frame says on a grid of the message's own size and resolution.
    ///
    /// # Errors
    /// As [`Occupancy::from_message`], and where the vehicle's origin is off the grid, or the grid is
    /// turned against the vehicle.
    pub fn from_message_as_is(message: &OccupancyGrid) -> Result<Self, Error> {
        let (source, origin) = checked(message)?;
        if origin.yaw_rad.abs() >= LEAST_TURN_RAD {
            return unusable(
                GridFault::Place,
                format!(
                    "its origin is turned by {:.3} rad, expected axes along the vehicle's",
                    origin.yaw_rad
                ),
            );
        }
        Ok(source.resampled(&source.own_spec()?))
    }
}

/// The cells of a message that can be worked with, and the pose of their corner in the message's frame.
fn checked(message: &OccupancyGrid) -> Result<(Source<'_>, Pose2), Error> {
    let info = &message.info;
    let sides = 1..=MAX_GRID_SIDE_CELLS;
    if !sides.contains(&info.width) || !sides.contains(&info.height) {
        return unusable(
            GridFault::Size,
            format!(
                "{} x {} cells, expected 1 to {MAX_GRID_SIDE_CELLS} a side",
                info.width, info.height
            ),
        );
    }
    let wanted = info.width as usize * info.height as usize;
    if message.data.len() != wanted {
        return unusable(
            GridFault::Size,
            format!(
                "{} x {} cells need {wanted} values, found {}",
                info.width,
                info.height,
                message.data.len()
            ),
        );
    }
    if !(info.resolution >= 0.001 && info.resolution <= 100.0) {
        return unusable(
            GridFault::Resolution,
            format!(
                "resolution {} m, expected 0.001 to 100 m a cell",
                info.resolution
            ),
        );
    }
    let origin = checked_origin(&info.origin)?;
    if let Some(index) = message
        .data
        .iter()
        .position(|value| !(UNKNOWN..=OCCUPIED).contains(value))
    {
        return unusable(
            GridFault::Value,
            format!(
                "value {} at index {index}, expected -1 to 100",
                message.data[index]
            ),
        );
    }
    let source = Source {
        cells: &message.data,
        width: info.width,
        height: info.height,
        resolution_m: shortest_decimal(info.resolution),
        origin_m: (origin.x_m, origin.y_m),
    };
    Ok((source, origin))
}

/// The origin in the plane. All zeros, which many publishers leave as orientation, count as no turn.
fn checked_origin(origin: &Pose) -> Result<Pose2, Error> {
    let Pose {
        position,
        orientation,
    } = origin;
    let is_near = |value: f64| value.abs() <= MAX_DISTANCE_M;
    if !(is_near(position.x) && is_near(position.y)) {
        return unusable(
            GridFault::Origin,
            format!(
                "origin ({}, {}) is not finite or too far away",
                position.x, position.y
            ),
        );
    }
    let Quaternion { x, y, z, w } = orientation;
    let Some(tilt_deg) = tilt_deg(orientation) else {
        return unusable(
            GridFault::Origin,
            format!("the quaternion {x} {y} {z} {w} of its origin is no rotation"),
        );
    };
    if tilt_deg > MAX_TILT_DEG {
        return unusable(
            GridFault::Tilted,
            format!(
                "origin is tilted by {tilt_deg:.0} degrees (quaternion {x} {y} {z} {w}), expected at \
                 most {MAX_TILT_DEG}"
            ),
        );
    }
    Ok(pose_of_ros(origin))
}

/// The number that was meant: 0.2 rather than the nearest f32 to it, 0.20000000298, whose error adds
/// up along a wide grid.
fn shortest_decimal(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}

#[cfg(test)]
mod tests;
