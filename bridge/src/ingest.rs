//! Drive logs to obstacle grids: lidar and odometry in, [`Frame`](crate::Frame)s out.
//!
//! [`frames`] reads a log; [`write_grids`] writes what it gives as messages and pictures. [`Mapper`]
//! is the part that knows no files: sweeps in, grids out. A log is a file, a compressed file or a
//! rosbag2 folder; all its sensors see one map, unless some are chosen.
//!
//! What a sweep says is taken in the plane: the odometry's height, roll and pitch are not used, since
//! many logs have none; the ground is found anew in each sweep instead. Points are not corrected for
//! the vehicle's motion during a sweep.

mod beams;
pub mod cloud;
mod config;
mod drives;
mod evidence;
mod frames;
mod grids;
mod ground;
mod mapper;
mod mount;
pub mod odometry;
mod polar;
pub mod scan;
mod survey;
pub mod transform;

pub use config::{Clock, IngestConfig};
pub use frames::{Frames, IngestReport, SensorReport, frames};
pub use grids::{GridWriter, GridsOut, MAX_PICTURES, Progress, picture_of, write_grids};
pub use mapper::{MAX_SENSORS, Mapper};
pub use mount::Mount;
pub use survey::{MAX_EVENTS, MAX_TOPICS, SensorKind};
