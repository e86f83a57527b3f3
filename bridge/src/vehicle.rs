//! The vehicle's dimensions: one configuration that generator and planner share and weights name.

use serde::{Deserialize, Serialize};

use crate::Error;

/// Dimensions of a car-like vehicle, from the middle of its rear axle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
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
}

impl Default for Vehicle {
    fn default() -> Self {
        Self {
            wheelbase_m: 2.3,
            front_m: 3.62,
            rear_m: 0.58,
            half_width_m: 0.885,
            min_turning_radius_m: 5.5,
        }
    }
}

impl Vehicle {
    /// Checks that the dimensions are those of a vehicle.
    ///
    /// # Errors
    /// [`Error::InvalidVehicle`] names the field that is out of range.
    pub fn validate(&self) -> Result<(), Error> {
        for (name, value, most) in [
            ("wheelbase_m", self.wheelbase_m, 20.0),
            ("front_m", self.front_m, 20.0),
            ("rear_m", self.rear_m, 20.0),
            ("half_width_m", self.half_width_m, 5.0),
            ("min_turning_radius_m", self.min_turning_radius_m, 100.0),
        ] {
            if !(value > 0.0 && value <= most) {
                return Err(Error::InvalidVehicle {
                    field: name,
                    value,
                    most,
                });
            }
        }
        Ok(())
    }

    /// A short name for these dimensions: the first 16 hexadecimal digits of a BLAKE3 digest.
    ///
    /// Weights carry it, so that a planner sees when they were trained for another vehicle.
    pub fn digest(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        for value in [
            self.wheelbase_m,
            self.front_m,
            self.rear_m,
            self.half_width_m,
            self.min_turning_radius_m,
        ] {
            hasher.update(&value.to_le_bytes());
        }
        hasher.finalize().to_hex()[..16].to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_vehicle_is_valid_and_every_dimension_counts() {
        let vehicle = Vehicle::default();
        vehicle.validate().unwrap();
        let longer = Vehicle {
            front_m: 3.63,
            ..vehicle
        };
        assert_ne!(vehicle.digest(), longer.digest());
        assert!(
            Vehicle {
                rear_m: f64::NAN,
                ..vehicle
            }
            .validate()
            .is_err()
        );
    }
}
