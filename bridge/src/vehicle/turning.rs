//! Limits of curvature by speed, as a table.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::Error;

/// Stands for a speed that is no number, m/s.
const UNKNOWN_SPEED_M_PER_S: f64 = 100.0;
/// Most rows of a table.
const MAX_ROWS: usize = 16;

/// TiEV's table, the paper's: speed in km/h and the largest curvature in 1/m that it allows.
const PAPER: [(f64, f64); 8] = [
    (5.0, 0.2),
    (10.0, 0.134_37),
    (20.0, 0.039_39),
    (30.0, 0.019_22),
    (40.0, 0.011_55),
    (50.0, 0.007_78),
    (60.0, 0.005_6),
    (70.0, 0.004_29),
];

/// One row: a speed and the largest curvature that it allows.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CurvatureAtSpeed {
    /// Speed, km/h, as such tables are given.
    pub speed_km_per_h: f64,
    /// Largest curvature, 1/m.
    pub curvature_per_m: f64,
}

/// At most 16 rows of growing speed; between them the curvature is interpolated, outside it is that of
/// the nearest row. Without rows every curvature is allowed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CurvatureBySpeed {
    rows: [CurvatureAtSpeed; MAX_ROWS],
    count: usize,
}

impl CurvatureBySpeed {
    /// The paper's table.
    pub fn paper() -> Self {
        let mut table = Self::default();
        for (speed_km_per_h, curvature_per_m) in PAPER {
            table.rows[table.count] = CurvatureAtSpeed {
                speed_km_per_h,
                curvature_per_m,
            };
            table.count += 1;
        }
        table
    }

    /// The table of some rows; `None` if there are more than 16.
    pub fn of_rows(rows: &[CurvatureAtSpeed]) -> Option<Self> {
        let mut table = Self::default();
        table.rows.get_mut(..rows.len())?.copy_from_slice(rows);
        table.count = rows.len();
        Some(table)
    }

    /// The rows.
    pub fn rows(&self) -> &[CurvatureAtSpeed] {
        &self.rows[..self.count]
    }

    /// The largest curvature at a speed, 1/m; that of the highest speed for what is no number.
    pub(super) fn at(&self, speed_m_per_s: f64) -> f64 {
        let speed_km_per_h = speed_m_per_s.abs() * 3.6;
        let rows = self.rows();
        let (Some(first), Some(last)) = (rows.first(), rows.last()) else {
            return f64::INFINITY;
        };
        if speed_km_per_h.is_nan() || speed_km_per_h >= last.speed_km_per_h {
            return last.curvature_per_m;
        }
        rows.windows(2)
            .find(|pair| speed_km_per_h < pair[1].speed_km_per_h)
            .map_or(first.curvature_per_m, |pair| {
                let share = (speed_km_per_h - pair[0].speed_km_per_h)
                    / (pair[1].speed_km_per_h - pair[0].speed_km_per_h);
                let change = pair[1].curvature_per_m - pair[0].curvature_per_m;
                pair[0].curvature_per_m + share.max(0.0) * change
            })
    }

    /// Checks that speeds grow, curvatures do not, and that the vehicle may turn as tightly as it can.
    pub(super) fn validate(&self, min_turning_radius_m: f64) -> Result<(), Error> {
        let wrong = |what: String| Err(Error::CurvatureBySpeed { what });
        for (number, row) in self.rows().iter().enumerate() {
            let CurvatureAtSpeed {
                speed_km_per_h,
                curvature_per_m,
            } = *row;
            if !((0.0..=500.0).contains(&speed_km_per_h)
                && curvature_per_m > 0.0
                && curvature_per_m <= 10.0)
            {
                return wrong(format!(
                    "row {}: {speed_km_per_h} km/h and {curvature_per_m} 1/m, expected 0 to 500 km/h \
                     and more than 0 to 10 1/m",
                    number + 1
                ));
            }
        }
        for (number, pair) in self.rows().windows(2).enumerate() {
            if pair[1].speed_km_per_h <= pair[0].speed_km_per_h
                || pair[1].curvature_per_m > pair[0].curvature_per_m
            {
                return wrong(format!(
                    "row {}: speeds must grow from row to row, and curvatures must not",
                    number + 2
                ));
            }
        }
        if let Some(first) = self.rows().first()
            && first.curvature_per_m * min_turning_radius_m < 1.0 - 1e-9
        {
            return wrong(format!(
                "it allows at most {} 1/m, so min_turning_radius_m = {min_turning_radius_m} is never \
                 reached: leave the table out, or give the vehicle's own",
                first.curvature_per_m
            ));
        }
        Ok(())
    }
}

/// How a speed limits the curvature, whatever the vehicle's turning radius is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedLimits {
    /// Largest lateral acceleration, m/s².
    pub max_lateral_acceleration_m_per_s2: f64,
    /// Further limits by speed.
    pub curvature_by_speed: CurvatureBySpeed,
}

impl SpeedLimits {
    /// What a speed allows, 1/m; infinite at a standstill without a table.
    pub fn curvature_per_m(&self, speed_m_per_s: f64) -> f64 {
        // A speed that is no number counts as a high one.
        let speed_m_per_s = if speed_m_per_s.is_nan() {
            UNKNOWN_SPEED_M_PER_S
        } else {
            speed_m_per_s
        };
        let squared = speed_m_per_s * speed_m_per_s;
        let by_acceleration = self.max_lateral_acceleration_m_per_s2 / squared;
        by_acceleration.min(self.curvature_by_speed.at(speed_m_per_s))
    }
}

impl Serialize for CurvatureBySpeed {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.rows().serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for CurvatureBySpeed {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let rows = Vec::<CurvatureAtSpeed>::deserialize(deserializer)?;
        Self::of_rows(&rows).ok_or_else(|| {
            serde::de::Error::custom(format!("{} rows, expected at most {MAX_ROWS}", rows.len()))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curvature_follows_tievs_table() {
        let table = CurvatureBySpeed::paper();
        for (speed_km_per_h, curvature) in PAPER {
            assert!((table.at(speed_km_per_h / 3.6) - curvature).abs() < 1e-9);
        }
        assert_eq!(table.at(0.0), 0.2);
        assert_eq!(table.at(99.0), 0.004_29);
        assert_eq!(table.at(f64::NAN), 0.004_29);
        let between = table.at(7.5 / 3.6);
        assert!((between - f64::midpoint(0.2, 0.134_37)).abs() < 1e-9);
    }

    #[test]
    fn tables_that_cannot_be_meant_are_refused() {
        let table = |rows: &[(f64, f64)]| {
            let rows: Vec<_> = rows
                .iter()
                .map(|&(speed_km_per_h, curvature_per_m)| CurvatureAtSpeed {
                    speed_km_per_h,
                    curvature_per_m,
                })
                .collect();
            CurvatureBySpeed::of_rows(&rows)
        };
        let said =
            |rows: &[(f64, f64)]| table(rows).unwrap().validate(5.5).unwrap_err().to_string();
        assert!(said(&[(5.0, f64::NAN)]).contains("row 1"));
        assert!(said(&[(5.0, 0.2), (5.0, 0.1)]).contains("row 2"));
        assert!(said(&[(5.0, 0.2), (6.0, 0.3)]).contains("row 2"));
        assert!(said(&[(5.0, 0.1)]).contains("min_turning_radius_m"));
        assert!(table(&[(1.0, 0.2); 17]).is_none());
        table(&[]).unwrap().validate(0.5).unwrap();
    }
}
