//! The vehicle: dimensions and limits that generator and planner share and weights name.

mod turning;

use serde::{Deserialize, Serialize};

pub use turning::{CurvatureAtSpeed, CurvatureBySpeed, SpeedLimits};

use crate::Error;

/// Where nothing is said of the rate, the wheels go from straight to full lock over this share of the
/// smallest turning radius, as the paper's vehicle's do (0.3 1/m² at 5.5 m).
const LOCK_SHARE: f64 = 1.0 / (0.3 * 5.5 * 5.5);

/// A car-like vehicle, measured from the middle of its rear axle.
///
/// In a file, the keys below the turning radius may be left out. The paper's vehicle then has the paper's
/// values. Any other vehicle has no table of curvatures, and changes its curvature as fast for its size.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(from = "VehicleFile")]
pub struct Vehicle {
    /// Distance between the axles, metres.
    pub wheelbase_m: f64,
    /// Rear axle to the front bumper, metres.
    pub front_m: f64,
    /// Rear axle to the rear bumper, metres.
    pub rear_m: f64,
    /// Half of the width, metres.
    pub half_width_m: f64,
    /// Smallest radius that the rear axle's middle can turn on, metres.
    pub min_turning_radius_m: f64,
    /// Largest change of curvature along the path, 1/m²: how fast the wheels are turned.
    pub max_curvature_rate_per_m2: f64,
    /// Largest lateral acceleration, m/s²; with the speed it limits the curvature.
    pub max_lateral_acceleration_m_per_s2: f64,
    /// Further limits of curvature by speed; may be empty.
    pub curvature_by_speed: CurvatureBySpeed,
}

/// A vehicle as a file gives it.
#[derive(Debug, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct VehicleFile {
    wheelbase_m: Option<f64>,
    front_m: Option<f64>,
    rear_m: Option<f64>,
    half_width_m: Option<f64>,
    min_turning_radius_m: Option<f64>,
    max_curvature_rate_per_m2: Option<f64>,
    max_lateral_acceleration_m_per_s2: Option<f64>,
    curvature_by_speed: Option<CurvatureBySpeed>,
}

impl From<VehicleFile> for Vehicle {
    fn from(file: VehicleFile) -> Self {
        let paper = Self::default();
        let dimensions = Self {
            wheelbase_m: file.wheelbase_m.unwrap_or(paper.wheelbase_m),
            front_m: file.front_m.unwrap_or(paper.front_m),
            rear_m: file.rear_m.unwrap_or(paper.rear_m),
            half_width_m: file.half_width_m.unwrap_or(paper.half_width_m),
            min_turning_radius_m: file
                .min_turning_radius_m
                .unwrap_or(paper.min_turning_radius_m),
            ..paper
        };
        let by_default = if dimensions == paper {
            paper
        } else {
            dimensions.with_limits_of_its_size()
        };
        Self {
            max_curvature_rate_per_m2: file
                .max_curvature_rate_per_m2
                .unwrap_or(by_default.max_curvature_rate_per_m2),
            max_lateral_acceleration_m_per_s2: file
                .max_lateral_acceleration_m_per_s2
                .unwrap_or(by_default.max_lateral_acceleration_m_per_s2),
            curvature_by_speed: file
                .curvature_by_speed
                .unwrap_or(by_default.curvature_by_speed),
            ..dimensions
        }
    }
}

impl Default for Vehicle {
    /// The paper's vehicle.
    fn default() -> Self {
        Self {
            wheelbase_m: 2.3,
            front_m: 3.62,
            rear_m: 0.58,
            half_width_m: 0.885,
            min_turning_radius_m: 5.5,
            max_curvature_rate_per_m2: 0.3,
            max_lateral_acceleration_m_per_s2: 2.0,
            curvature_by_speed: CurvatureBySpeed::paper(),
        }
    }
}

impl Vehicle {
    /// The same dimensions, without a table of curvatures and with a rate of curvature that fits the
    /// turning radius.
    #[must_use]
    pub fn with_limits_of_its_size(self) -> Self {
        let radius_m = self.min_turning_radius_m;
        Self {
            max_curvature_rate_per_m2: 1.0 / (LOCK_SHARE * radius_m * radius_m),
            curvature_by_speed: CurvatureBySpeed::default(),
            ..self
        }
    }

    /// The largest curvature at a speed, 1/m: the least of what the turning radius, the lateral
    /// acceleration and the table of curvatures allow.
    pub fn curvature_limit_per_m(&self, speed_m_per_s: f64) -> f64 {
        (1.0 / self.min_turning_radius_m).min(self.curvature_at_speed_per_m(speed_m_per_s))
    }

    /// What the speed alone allows, 1/m; infinite at a standstill without a table.
    pub fn curvature_at_speed_per_m(&self, speed_m_per_s: f64) -> f64 {
        self.speed_limits().curvature_per_m(speed_m_per_s)
    }

    /// How its speed limits the curvature.
    pub const fn speed_limits(&self) -> SpeedLimits {
        SpeedLimits {
            max_lateral_acceleration_m_per_s2: self.max_lateral_acceleration_m_per_s2,
            curvature_by_speed: self.curvature_by_speed,
        }
    }

    /// Checks that the dimensions are those of a vehicle, and that each limit can be honoured.
    ///
    /// # Errors
    /// [`Error::InvalidVehicle`] names the field that is out of range, [`Error::CurvatureBySpeed`] says
    /// what is wrong with the table.
    pub fn validate(&self) -> Result<(), Error> {
        for (field, value, least, most) in [
            ("wheelbase_m", self.wheelbase_m, 0.01, 20.0),
            ("front_m", self.front_m, 0.01, 20.0),
            ("rear_m", self.rear_m, 0.01, 20.0),
            ("half_width_m", self.half_width_m, 0.01, 5.0),
            (
                "min_turning_radius_m",
                self.min_turning_radius_m,
                0.1,
                100.0,
            ),
            (
                "max_curvature_rate_per_m2",
                self.max_curvature_rate_per_m2,
                1e-4,
                1000.0,
            ),
            (
                "max_lateral_acceleration_m_per_s2",
                self.max_lateral_acceleration_m_per_s2,
                0.01,
                100.0,
            ),
        ] {
            if !(value >= least && value <= most) {
                return Err(Error::InvalidVehicle {
                    field,
                    value,
                    least,
                    most,
                });
            }
        }
        self.curvature_by_speed.validate(self.min_turning_radius_m)
    }

    /// A short name for this vehicle: the first 16 hexadecimal digits of a BLAKE3 digest.
    ///
    /// Weights carry it, so that a planner sees when they were trained for another vehicle. The limits
    /// count where they are not the paper's.
    pub fn digest(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        let mut add = |value: f64| {
            hasher.update(&value.to_le_bytes());
        };
        add(self.wheelbase_m);
        add(self.front_m);
        add(self.rear_m);
        add(self.half_width_m);
        add(self.min_turning_radius_m);
        let paper = Self::default();
        if self.max_curvature_rate_per_m2 != paper.max_curvature_rate_per_m2
            || self.speed_limits() != paper.speed_limits()
        {
            add(self.max_curvature_rate_per_m2);
            add(self.max_lateral_acceleration_m_per_s2);
            for row in self.curvature_by_speed.rows() {
                add(row.speed_km_per_h);
                add(row.curvature_per_m);
            }
        }
        hasher.finalize().to_hex()[..16].to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of_file(text: &str) -> Vehicle {
        serde_json::from_str(text).unwrap()
    }

    #[test]
    fn the_default_vehicle_is_valid_and_every_number_counts() {
        let vehicle = Vehicle::default();
        vehicle.validate().unwrap();
        let others = [
            Vehicle {
                front_m: 3.63,
                ..vehicle
            },
            Vehicle {
                max_curvature_rate_per_m2: 0.2,
                ..vehicle
            },
            Vehicle {
                max_lateral_acceleration_m_per_s2: 1.0,
                ..vehicle
            },
            Vehicle {
                curvature_by_speed: CurvatureBySpeed::default(),
                ..vehicle
            },
        ];
        for other in others {
            assert_ne!(vehicle.digest(), other.digest());
        }
        let broken = Vehicle {
            rear_m: f64::NAN,
            ..vehicle
        };
        assert!(broken.validate().is_err());
    }

    #[test]
    fn weights_of_the_papers_vehicle_keep_its_name() {
        assert_eq!(Vehicle::default().digest(), "5a8a06f117e93dc5");
    }

    #[test]
    fn a_small_turning_radius_is_what_limits_a_slow_robot() {
        let robot = of_file(
            r#"{"wheelbase_m": 0.5, "front_m": 0.6, "rear_m": 0.2,
            "half_width_m": 0.3, "min_turning_radius_m": 0.9}"#,
        );
        robot.validate().unwrap();
        assert!((robot.curvature_limit_per_m(0.5) - 1.0 / 0.9).abs() < 1e-12);
        assert!((robot.curvature_limit_per_m(0.0) - 1.0 / 0.9).abs() < 1e-12);
        // 2 m/s² at 2 m/s.
        assert!((robot.curvature_limit_per_m(2.0) - 0.5).abs() < 1e-12);
        assert!((robot.curvature_limit_per_m(-2.0) - 0.5).abs() < 1e-12);
        assert!(robot.curvature_limit_per_m(f64::NAN) < 0.001);
        assert!((robot.max_curvature_rate_per_m2 - 0.3 * (5.5f64 / 0.9).powi(2)).abs() < 1e-9);
        // One other dimension is enough for another vehicle.
        let tight = of_file(r#"{"min_turning_radius_m": 3.0}"#);
        assert!((tight.curvature_limit_per_m(1.4) - 1.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn a_file_that_says_nothing_means_the_papers_vehicle_and_one_that_says_all_is_taken_as_it_is() {
        assert_eq!(of_file("{}"), Vehicle::default());
        assert_eq!(of_file(r#"{"wheelbase_m": 2.3}"#), Vehicle::default());
        let all = Vehicle {
            min_turning_radius_m: 7.0,
            max_curvature_rate_per_m2: 0.1,
            ..Vehicle::default()
        };
        assert_eq!(of_file(&serde_json::to_string(&all).unwrap()), all);
        assert!(serde_json::from_str::<Vehicle>(r#"{"wheel_base_m": 2.3}"#).is_err());
    }

    #[test]
    fn a_table_that_hides_the_turning_radius_is_refused() {
        let hidden = Vehicle {
            min_turning_radius_m: 3.0,
            ..Vehicle::default()
        };
        let said = hidden.validate().unwrap_err().to_string();
        assert!(said.contains("min_turning_radius_m"), "{said}");
        hidden.with_limits_of_its_size().validate().unwrap();
    }
}
