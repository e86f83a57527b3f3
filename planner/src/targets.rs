//! Targets at equal distances along and across a reference path (Algorithm 2, `getTargets`).

use serde::{Deserialize, Serialize};
use swath_bridge::{GridSpec, Pose2};

use crate::Error;
use crate::polyline::Polyline;

/// Most targets of one frame.
pub const MAX_TARGETS: usize = 256;

/// Farthest that a target may be wanted, metres.
pub const MAX_DISTANCE_M: f64 = 1000.0;
/// Least distance between targets across the reference, metres.
const MIN_ACROSS_M: f64 = 0.01;

/// Rows are set at most so many times closer to make up for places off the grid.
const MAX_CROWDING: usize = 3;

/// Where targets are placed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TargetConfig {
    /// Number of targets, at most [`MAX_TARGETS`].
    pub count: usize,
    /// Distance of the nearest targets along the reference, metres.
    pub nearest_m: f64,
    /// Distance of the farthest targets along the reference, metres; they stay on the grid.
    pub farthest_m: f64,
    /// Distance between targets across the reference, metres.
    pub across_m: f64,
}

impl Default for TargetConfig {
    fn default() -> Self {
        Self {
            count: 50,
            nearest_m: 8.0,
            farthest_m: 55.0,
            across_m: 1.75,
        }
    }
}

impl TargetConfig {
    /// Checks every field: counts up to [`MAX_TARGETS`], distances up to [`MAX_DISTANCE_M`], the farthest
    /// no nearer than the nearest, and some space between targets.
    ///
    /// # Errors
    /// [`swath_bridge::Error::InvalidConfig`] names the field that is out of range.
    pub fn validate(&self) -> Result<(), Error> {
        for (field, value, least, most) in [
            ("count", self.count as f64, 0.0, MAX_TARGETS as f64),
            ("nearest_m", self.nearest_m, 0.0, MAX_DISTANCE_M),
            (
                "farthest_m",
                self.farthest_m,
                self.nearest_m,
                MAX_DISTANCE_M,
            ),
            ("across_m", self.across_m, MIN_ACROSS_M, MAX_DISTANCE_M),
        ] {
            if !(least..=most).contains(&value) {
                return Err(Error::Bridge(swath_bridge::Error::InvalidConfig {
                    field,
                    value,
                    least,
                    most,
                }));
            }
        }
        Ok(())
    }
}

/// Samples targets along and across a reference path in the vehicle frame.
///
/// One column of targets for up to 2, three for up to 14, five for more; the farthest row comes first
/// and in each row the middle. Distances count from the reference's point nearest to the vehicle.
/// Targets have the reference's heading. Places off the grid are left out and rows are set closer
/// instead, so there are fewer targets than asked for only where there is hardly any room; without a
/// reference ahead there are none.
pub fn sample_targets(reference: &[Pose2], spec: &GridSpec, config: &TargetConfig) -> Vec<Pose2> {
    let count = config.count.min(MAX_TARGETS);
    let line = Polyline::new(reference);
    let columns = match count {
        0 => return Vec::new(),
        1..=2 => 1,
        3..=14 => 3,
        _ => 5,
    };
    let Some((start_m, _)) = line.nearest(&Pose2::default()) else {
        return Vec::new();
    };
    let Some(farthest_m) = line.farthest_on(spec, start_m, config.farthest_m) else {
        return Vec::new();
    };
    let nearest_m = (start_m + config.nearest_m).min(farthest_m);
    let fewest_rows = count.div_ceil(columns);
    let mut targets = Vec::new();
    for rows in fewest_rows..=MAX_CROWDING * fewest_rows {
        targets = grid_of_targets(
            &line,
            spec,
            (farthest_m, nearest_m),
            (rows, columns),
            config,
        );
        if targets.len() >= count {
            break;
        }
    }
    targets.truncate(count);
    targets
}

/// The places of a number of rows and columns that are on the grid.
fn grid_of_targets(
    line: &Polyline<'_>,
    spec: &GridSpec,
    (farthest_m, nearest_m): (f64, f64),
    (rows, columns): (usize, usize),
    config: &TargetConfig,
) -> Vec<Pose2> {
    let mut targets = Vec::with_capacity(rows * columns);
    for row in 0..rows {
        let share = if rows == 1 {
            0.0
        } else {
            row as f64 / (rows - 1) as f64
        };
        let Some(middle) = line.at(farthest_m + share * (nearest_m - farthest_m)) else {
            continue;
        };
        for column in 0..columns {
            // 0, 1, −1, 2, −2: the middle first, then alternating sides.
            let side = if column % 2 == 0 { -1.0 } else { 1.0 };
            let across_m = config.across_m * side * column.div_ceil(2) as f64;
            let target = middle.then(&Pose2::new(0.0, across_m, 0.0));
            if spec
                .index_of(spec.cell_at(target.x_m, target.y_m))
                .is_some()
            {
                targets.push(target);
            }
        }
    }
    targets
}

#[cfg(test)]
mod tests {
    use super::*;

    fn straight(length_m: f64) -> Vec<Pose2> {
        (0..=60)
            .map(|k| Pose2::new(length_m * f64::from(k) / 60.0, 0.0, 0.0))
            .collect()
    }

    #[test]
    fn what_cannot_be_placed_is_named() {
        TargetConfig::default().validate().unwrap();
        let good = TargetConfig::default();
        for (field, bad) in [
            (
                "count",
                TargetConfig {
                    count: MAX_TARGETS + 1,
                    ..good
                },
            ),
            (
                "nearest_m",
                TargetConfig {
                    nearest_m: -1.0,
                    ..good
                },
            ),
            (
                "farthest_m",
                TargetConfig {
                    farthest_m: 7.9,
                    ..good
                },
            ),
            (
                "farthest_m",
                TargetConfig {
                    farthest_m: f64::INFINITY,
                    ..good
                },
            ),
            (
                "across_m",
                TargetConfig {
                    across_m: f64::NAN,
                    ..good
                },
            ),
            (
                "across_m",
                TargetConfig {
                    across_m: 0.0,
                    ..good
                },
            ),
        ] {
            let said = bad.validate().unwrap_err().to_string();
            assert!(said.starts_with(&format!("{field} is ")), "{said}");
        }
    }

    #[test]
    fn targets_lie_at_equal_distances_along_and_across_the_reference() {
        let config = TargetConfig::default();
        let targets = sample_targets(&straight(58.0), &GridSpec::default(), &config);
        assert_eq!(targets.len(), 50);
        assert!((targets[0].x_m - 55.0).abs() < 1e-6 && targets[0].y_m.abs() < 1e-9);
        for row in targets.chunks(5) {
            let across: Vec<f64> = row.iter().map(|target| target.y_m).collect();
            for (got, wanted) in across.iter().zip([0.0, 1.75, -1.75, 3.5, -3.5]) {
                assert!((got - wanted).abs() < 1e-9, "{across:?}");
            }
        }
        let step_m = (55.0 - 8.0) / 9.0;
        assert!((targets[0].x_m - targets[5].x_m - step_m).abs() < 1e-6);
        assert!((targets[49].x_m - 8.0).abs() < 1e-6);
    }

    #[test]
    fn every_count_of_the_papers_table_is_met() {
        for count in [1, 3, 7, 10, 15, 20, 30, 40, 50] {
            let config = TargetConfig {
                count,
                ..TargetConfig::default()
            };
            let targets = sample_targets(&straight(58.0), &GridSpec::default(), &config);
            assert_eq!(targets.len(), count);
        }
    }

    #[test]
    fn distances_count_from_the_vehicle_wherever_the_reference_begins() {
        let spec = GridSpec::default();
        let config = TargetConfig::default();
        let from_behind: Vec<Pose2> = (-18..=58)
            .map(|k| Pose2::new(f64::from(k), 0.4, 0.0))
            .collect();
        let targets = sample_targets(&from_behind, &spec, &config);
        assert!((targets[0].x_m - 55.0).abs() < 1e-6 && (targets[49].x_m - 8.0).abs() < 1e-6);
        let behind_only: Vec<Pose2> = (0..9)
            .map(|k| Pose2::new(f64::from(k) - 10.0, 0.0, 0.0))
            .collect();
        assert!(sample_targets(&behind_only, &spec, &config).is_empty());
    }

    #[test]
    fn places_off_the_grid_are_made_up_for() {
        let spec = GridSpec::default();
        let config = TargetConfig::default();
        let sideways: Vec<Pose2> = (0..=40)
            .map(|k| 0.1 * f64::from(k))
            .map(|t| Pose2::new(12.0 * t, 3.6 * t, 0.29))
            .collect();
        let targets = sample_targets(&sideways, &spec, &config);
        assert_eq!(targets.len(), 50);
        assert!(
            targets
                .iter()
                .all(|t| spec.index_of(spec.cell_at(t.x_m, t.y_m)).is_some())
        );
    }

    #[test]
    fn short_odd_and_missing_references_give_what_they_can() {
        let spec = GridSpec::default();
        let config = TargetConfig::default();
        assert!(sample_targets(&[], &spec, &config).is_empty());
        assert!(sample_targets(&[Pose2::default()], &spec, &config).is_empty());
        let repeated = [
            Pose2::default(),
            Pose2::default(),
            Pose2::new(f64::NAN, 0.0, 0.0),
        ];
        assert!(sample_targets(&repeated, &spec, &config).is_empty());
        let short = sample_targets(&straight(5.0), &spec, &config);
        assert!(short.iter().all(|target| target.x_m <= 5.0 + 1e-9) && !short.is_empty());
        let leaving = sample_targets(&straight(200.0), &spec, &config);
        assert!(
            leaving
                .iter()
                .all(|t| spec.index_of(spec.cell_at(t.x_m, t.y_m)).is_some())
        );
    }
}
