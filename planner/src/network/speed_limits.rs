//! How a vehicle's speed limits its turns, in the metadata of weights files.

use std::collections::BTreeMap;

use swath_bridge::{CurvatureAtSpeed, CurvatureBySpeed, SpeedLimits, Vehicle};

use crate::Error;

const ACCELERATION: &str = "max_lateral_acceleration_m_per_s2";
/// Rows, as `km/h:1/m` with commas between.
const CURVATURE: &str = "curvature_by_speed";

pub(super) fn to_metadata(limits: &SpeedLimits) -> BTreeMap<String, String> {
    let rows = limits.curvature_by_speed.rows().iter();
    let rows: Vec<String> = rows
        .map(|row| format!("{}:{}", row.speed_km_per_h, row.curvature_per_m))
        .collect();
    let acceleration = limits.max_lateral_acceleration_m_per_s2.to_string();
    [(ACCELERATION, acceleration), (CURVATURE, rows.join(","))]
        .map(|(key, value)| (key.to_owned(), value))
        .into()
}

/// Reads the limits; where the metadata says nothing, they are those of the paper's vehicle.
pub(super) fn from_metadata(metadata: &BTreeMap<String, String>) -> Result<SpeedLimits, Error> {
    let paper = Vehicle::default().speed_limits();
    let wrong = |key: &str, found: &str, expected: &str| Error::Weights {
        what: format!(
            "{key} is {:?}, expected {expected}",
            super::predictor::clip(found)
        ),
    };
    let is_positive = |value: &f64| *value > 0.0 && value.is_finite();
    let max_lateral_acceleration_m_per_s2 = match metadata.get(ACCELERATION) {
        None => paper.max_lateral_acceleration_m_per_s2,
        Some(text) => text
            .parse()
            .ok()
            .filter(is_positive)
            .ok_or_else(|| wrong(ACCELERATION, text, "a positive number"))?,
    };
    let curvature_by_speed = match metadata.get(CURVATURE) {
        None => paper.curvature_by_speed,
        Some(text) => table(text)
            .ok_or_else(|| wrong(CURVATURE, text, "at most 16 rows of km/h:1/m, or nothing"))?,
    };
    Ok(SpeedLimits {
        max_lateral_acceleration_m_per_s2,
        curvature_by_speed,
    })
}

fn table(text: &str) -> Option<CurvatureBySpeed> {
    let row = |row: &str| {
        let (speed, curvature) = row.split_once(':')?;
        let row = CurvatureAtSpeed {
            speed_km_per_h: speed.parse().ok()?,
            curvature_per_m: curvature.parse().ok()?,
        };
        (row.speed_km_per_h.is_finite() && row.curvature_per_m > 0.0).then_some(row)
    };
    let rows = text.split(',').filter(|row| !row.is_empty());
    let rows: Option<Vec<_>> = rows.map(row).collect();
    CurvatureBySpeed::of_rows(&rows?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_come_back_as_they_were() {
        let paper = Vehicle::default().speed_limits();
        let bare = Vehicle::default().with_limits_of_its_size().speed_limits();
        for limits in [paper, bare] {
            assert_eq!(from_metadata(&to_metadata(&limits)).unwrap(), limits);
        }
        assert_eq!(from_metadata(&BTreeMap::new()).unwrap(), paper);
        for text in ["5", "5:x", "5:-1", "nan:1", &"1:1,".repeat(17)] {
            let metadata = BTreeMap::from([(CURVATURE.to_owned(), text.to_owned())]);
            let said = from_metadata(&metadata).unwrap_err().to_string();
            assert!(said.contains(CURVATURE), "{said}");
        }
    }
}
