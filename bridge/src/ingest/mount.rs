//! Where a sensor is mounted, as its user says.

use std::str::FromStr;

use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use serde::{Deserialize, Serialize};

/// Farthest from the vehicle's origin that a sensor can be mounted, metres along each axis.
const MAX_OFFSET_M: f64 = 100.0;

/// Where a sensor is in the vehicle's frame. It is taken instead of what the log's transforms say.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Mount {
    /// Topic of the sensor, with or without the slash in front; none: that of the only sensor.
    pub topic: Option<String>,
    /// Forward, metres, -100 to 100.
    pub x_m: f64,
    /// Left, metres, -100 to 100.
    pub y_m: f64,
    /// Up, metres, -100 to 100.
    pub z_m: f64,
    /// Turn about the forward axis, radians; it comes first.
    pub roll_rad: f64,
    /// Turn about the left axis, radians.
    pub pitch_rad: f64,
    /// Turn about the upward axis, radians, to the left; it comes last.
    pub yaw_rad: f64,
}

impl Mount {
    /// The sensor's pose in the vehicle's frame.
    pub fn vehicle_from_sensor(&self) -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::new(self.x_m, self.y_m, self.z_m),
            UnitQuaternion::from_euler_angles(self.roll_rad, self.pitch_rad, self.yaw_rad),
        )
    }

    /// Whether every number is one that a mounting can have.
    pub fn is_valid(&self) -> bool {
        let is_near = |m: f64| m.abs() <= MAX_OFFSET_M;
        let angles_rad = [self.roll_rad, self.pitch_rad, self.yaw_rad];
        is_near(self.x_m)
            && is_near(self.y_m)
            && is_near(self.z_m)
            && angles_rad.iter().all(|angle_rad| angle_rad.is_finite())
    }
}

/// As [`Mount::from_str`] reads it.
impl std::fmt::Display for Mount {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if let Some(topic) = &self.topic {
            write!(formatter, "{topic}=")?;
        }
        write!(
            formatter,
            "{},{},{},{},{},{}",
            self.x_m, self.y_m, self.z_m, self.roll_rad, self.pitch_rad, self.yaw_rad
        )
    }
}

impl FromStr for Mount {
    type Err = String;

    /// Reads `[TOPIC=]x,y,z,roll,pitch,yaw`.
    fn from_str(text: &str) -> Result<Self, String> {
        let (topic, numbers) = match text.rsplit_once('=') {
            Some(("", _)) => return Err("no topic before the =".to_owned()),
            Some((topic, numbers)) => (Some(topic.trim().to_owned()), numbers),
            None => (None, text),
        };
        let parsed: Result<Vec<f64>, String> = numbers
            .split(',')
            .map(|number| {
                let number = number.trim();
                number
                    .parse()
                    .map_err(|_not_one| format!("{number:?} is no number"))
            })
            .collect();
        let parsed = parsed?;
        let [x_m, y_m, z_m, roll_rad, pitch_rad, yaw_rad] = parsed[..] else {
            return Err(format!(
                "{} numbers, expected x,y,z,roll,pitch,yaw (metres, radians)",
                parsed.len()
            ));
        };
        let mount = Self {
            topic,
            x_m,
            y_m,
            z_m,
            roll_rad,
            pitch_rad,
            yaw_rad,
        };
        if mount.is_valid() {
            Ok(mount)
        } else {
            Err(format!(
                "expected places of at most {MAX_OFFSET_M} m and finite angles"
            ))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;
    use std::f64::consts::{FRAC_PI_2, PI};

    #[test]
    fn a_mounting_is_read_with_and_without_a_topic() {
        let mount: Mount = "1,-0.5, 0.3,0,0,1.5".parse().unwrap();
        assert_eq!(
            (mount.topic.as_deref(), mount.y_m, mount.yaw_rad),
            (None, -0.5, 1.5)
        );
        let mount: Mount = "/rear/scan=-0.5,0,0.3,0,0,3.14".parse().unwrap();
        assert_eq!(mount.topic.as_deref(), Some("/rear/scan"));
        assert_eq!(mount.to_string().parse(), Ok(mount));
        for (wrong, said) in [
            ("1,2,3", "3 numbers"),
            ("1,2,3,4,5,x", "\"x\""),
            ("", "\"\""),
            ("=1,2,3,4,5,6", "no topic"),
            ("1,2,inf,0,0,0", "100 m"),
            ("1,2,3,0,0,nan", "finite"),
        ] {
            let error = wrong.parse::<Mount>().unwrap_err();
            assert!(error.contains(said), "{wrong}: {error}");
        }
    }

    #[test]
    fn roll_comes_first_and_yaw_last() {
        let mount = Mount {
            x_m: 1.0,
            roll_rad: PI,
            yaw_rad: FRAC_PI_2,
            ..Mount::default()
        };
        let forward = mount.vehicle_from_sensor() * Point3::new(2.0, 1.0, 0.0);
        assert!(
            (forward - Point3::new(2.0, 2.0, 0.0)).norm() < 1e-12,
            "{forward}"
        );
    }
}
