//! What comes of smoothing a path.

use serde::{Deserialize, Serialize};
use swath_bridge::{Drivability, Pose2};

use crate::path_point::PathPoint;

/// What the last attempt within the limits lacked.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shortfall {
    /// It comes too near to an obstacle.
    Contact,
    /// It misses the goal's tolerance.
    Goal,
    /// It leaves the map.
    OffMap,
    /// There was nothing to smooth: no length, too much of it, or numbers that are not finite.
    Input,
    /// It was stopped.
    Time,
}

/// A smoothed path.
#[derive(Debug, Clone, PartialEq)]
pub struct DrivablePath {
    /// At most [`super::POINT_SPACING_M`] apart.
    pub points: Vec<PathPoint>,
    /// Whether it can be driven.
    pub drivability: Drivability,
    /// Why not [`Drivability::AtSpeed`].
    pub shortfall: Option<Shortfall>,
    /// Iterations of all attempts.
    pub iterations: usize,
}

impl DrivablePath {
    /// Whether the vehicle can drive it at its speed.
    pub fn is_drivable(&self) -> bool {
        self.drivability == Drivability::AtSpeed
    }

    /// Its length, metres.
    pub fn length_m(&self) -> f64 {
        self.points.last().map_or(0.0, |point| point.at_m)
    }

    /// Its largest curvature, 1/m.
    pub fn max_curvature_per_m(&self) -> f64 {
        let curvatures = self.points.iter().map(|point| point.curvature_per_m.abs());
        curvatures.fold(0.0, f64::max)
    }
}

/// The chords as they are, for want of better.
pub(super) fn as_chords(chords: &[Pose2], shortfall: Shortfall, iterations: usize) -> DrivablePath {
    let mut at_m = 0.0;
    let mut last: Option<&Pose2> = None;
    let mut points = Vec::with_capacity(chords.len());
    for pose in chords {
        at_m += last.map_or(0.0, |last| last.distance_m(pose));
        last = Some(pose);
        points.push(PathPoint {
            pose: *pose,
            curvature_per_m: 0.0,
            at_m,
        });
    }
    DrivablePath {
        points,
        drivability: Drivability::TurnsOnTheSpot,
        shortfall: Some(shortfall),
        iterations,
    }
}
