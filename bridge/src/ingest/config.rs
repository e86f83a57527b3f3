//! How a log becomes grids.

use serde::{Deserialize, Serialize};

use super::mount::Mount;
use crate::Error;
use crate::geometry::GridSpec;
use crate::vehicle::Vehicle;

/// Which times say when something was seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Clock {
    /// The stamps in the messages' headers; the times of recording where odometry has no stamps.
    #[default]
    Stamp,
    /// The times of recording, for logs in which sensor and odometry have different clocks.
    Record,
}

/// How a log becomes grids.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct IngestConfig {
    /// Size and place of the grids.
    pub spec: GridSpec,
    /// The vehicle that carried the sensor; returns from inside its outline are its own.
    pub vehicle: Vehicle,
    /// Topics of `sensor_msgs/PointCloud2` to use. Where neither these nor those of scans are named, all
    /// are used.
    pub points_topics: Vec<String>,
    /// Topics of `sensor_msgs/LaserScan` to use. Where neither these nor those of points are named, all
    /// are used.
    pub scan_topics: Vec<String>,
    /// Topic of `nav_msgs/Odometry`; none: the one with the most messages.
    pub odom_topic: Option<String>,
    /// Which times say when something was seen.
    pub clock: Clock,
    /// Where sensors are mounted, in the place of what the log's transforms say.
    pub mount: Vec<Mount>,
    /// How long sweeps of a 3D lidar count, seconds, 0 to 60.
    pub accumulate_s: f64,
    /// How long planar scans count, seconds, 0 to 60. They see one line of the world each, and often
    /// only ahead.
    pub accumulate_scans_s: f64,
    /// Distance driven after which a sweep does not count any more, metres, 0 to 500.
    pub accumulate_m: f64,
    /// Least height over the ground of an obstacle, metres, 0.05 to 2: kerbs are below the default.
    pub min_height_m: f64,
    /// What is higher above the ground than this is passed under, metres, above the least height.
    pub max_height_m: f64,
    /// Steepest ground, rise over run, 0.01 to 1.
    pub max_slope: f64,
    /// Width around the vehicle's outline in which returns of a 3D lidar count as its own, metres, 0
    /// to 2.
    pub own_margin_m: f64,
    /// Returns nearer to a 3D lidar than this count as the vehicle's own, metres, 0 to 10: roofs and
    /// mirrors reach beyond the outline where the vehicle's frame is not at its rear axle.
    pub own_range_m: f64,
    /// Half the side of the square around the vehicle's origin in which returns of planar scans count
    /// as its own, metres, 0 to 10. Such lidars look past the vehicle that carries them, which is
    /// often smaller than the one that is planned for.
    pub own_scan_m: f64,
    /// How far a beam of a planar scan that hit nothing clears, metres, 0 to 1000.
    pub clear_m: f64,
    /// Returns that a cell and its eight neighbours need together to count as occupied.
    pub min_returns: u32,
    /// Least time between two frames, seconds: sweeps between them are accumulated only.
    pub min_interval_s: f64,
    /// Distance between the poses of a reference, metres, 0.1 to 10.
    pub reference_step_m: f64,
    /// Name of the vehicle in the topics that are written.
    pub vehicle_id: String,
}

impl Default for IngestConfig {
    fn default() -> Self {
        Self {
            spec: GridSpec::default(),
            vehicle: Vehicle::default(),
            points_topics: Vec::new(),
            scan_topics: Vec::new(),
            odom_topic: None,
            clock: Clock::Stamp,
            mount: Vec::new(),
            accumulate_s: 3.0,
            accumulate_scans_s: 10.0,
            accumulate_m: 60.0,
            min_height_m: 0.25,
            max_height_m: 2.2,
            max_slope: 0.15,
            own_margin_m: 0.2,
            own_range_m: 2.1,
            own_scan_m: 0.3,
            clear_m: 15.0,
            min_returns: 3,
            min_interval_s: 0.0,
            reference_step_m: 1.0,
            vehicle_id: "v0".to_owned(),
        }
    }
}

impl IngestConfig {
    /// Checks that every value is in its range.
    ///
    /// # Errors
    /// [`Error::InvalidConfig`] names the field, [`Error::InvalidGrid`] and
    /// [`Error::InvalidVehicle`] likewise.
    pub fn validate(&self) -> Result<(), Error> {
        self.spec.validate()?;
        self.vehicle.validate()?;
        if let Some(mount) = self.mount.iter().find(|mount| !mount.is_valid()) {
            return Err(Error::BadSetting {
                name: "mount",
                value: format!("{mount:?}"),
                expected: "places of at most 100 m and finite angles",
            });
        }
        for (field, value, least, most) in [
            ("accumulate_s", self.accumulate_s, 0.0, 60.0),
            ("accumulate_scans_s", self.accumulate_scans_s, 0.0, 60.0),
            ("accumulate_m", self.accumulate_m, 0.0, 500.0),
            ("min_height_m", self.min_height_m, 0.05, 2.0),
            ("max_height_m", self.max_height_m, self.min_height_m, 20.0),
            ("max_slope", self.max_slope, 0.01, 1.0),
            ("own_margin_m", self.own_margin_m, 0.0, 2.0),
            ("own_range_m", self.own_range_m, 0.0, 10.0),
            ("own_scan_m", self.own_scan_m, 0.0, 10.0),
            ("clear_m", self.clear_m, 0.0, 1000.0),
            ("min_returns", f64::from(self.min_returns), 0.0, 1000.0),
            ("min_interval_s", self.min_interval_s, 0.0, 3600.0),
            ("reference_step_m", self.reference_step_m, 0.1, 10.0),
        ] {
            if !(value >= least && value <= most) {
                return Err(Error::InvalidConfig {
                    field,
                    value,
                    least,
                    most,
                });
            }
        }
        Ok(())
    }
}
