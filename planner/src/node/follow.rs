//! From frame to frame: where a path is to begin, which one is followed, and until when.

use serde::{Deserialize, Serialize};
use swath_bridge::{GridSpec, Pose2, Vehicle};

use super::course::{Course, Kept};
use super::frames::Read;
use super::track::{Moment, Track};
use crate::choice::ChoiceConfig;
use crate::frame::Start;
use crate::{Error, PathPoint, Plane};

/// Share of the newest frame in the time that frames are expected to take.
const NEWEST_SHARE: f64 = 0.2;
/// Longest time that a frame is expected to take, seconds.
const MOST_LATENCY_S: f64 = 0.5;

/// Most of the settings below.
const MOST_STABLE_S: f64 = 5.0;
const MOST_EXPIRES_S: f64 = 60.0;
const MOST_WORTH: f64 = 1e6;

/// How the chosen path is kept up.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FollowConfig {
    /// Which path is chosen.
    pub choice: ChoiceConfig,
    /// How long the vehicle follows a path before the next one may differ, seconds, beside the time that
    /// planning takes.
    pub stable_s: f64,
    /// After so long without a grid, the path is withdrawn, seconds.
    pub expires_s: f64,
}

impl Default for FollowConfig {
    fn default() -> Self {
        Self {
            choice: ChoiceConfig::default(),
            stable_s: 0.3,
            expires_s: 1.0,
        }
    }
}

impl FollowConfig {
    /// Whether every setting is in its range.
    ///
    /// # Errors
    /// [`Error::FollowConfig`] names the first that is not.
    pub fn validate(&self) -> Result<(), Error> {
        let choice = &self.choice;
        for (field, value, most) in [
            ("stable_s", self.stable_s, MOST_STABLE_S),
            ("expires_s", self.expires_s, MOST_EXPIRES_S),
            ("choice.progress", choice.progress, MOST_WORTH),
            ("choice.cost", choice.cost, MOST_WORTH),
            ("choice.aside", choice.aside, MOST_WORTH),
            ("choice.change", choice.change, MOST_WORTH),
            ("choice.most_change_m", choice.most_change_m, MOST_WORTH),
        ] {
            if !(0.0..=most).contains(&value) {
                return Err(Error::FollowConfig { field, value, most });
            }
        }
        Ok(())
    }
}

/// Where the paths of a frame begin, and what they go on from.
#[derive(Debug, Clone, Default)]
pub(super) struct Departure {
    pub(super) kept: Kept,
    /// The goal that was chosen before, in the vehicle's frame.
    pub(super) last_goal: Option<Pose2>,
    moment: Option<Moment>,
}

impl Departure {
    /// The same frame, with paths that begin where the vehicle was when the grid was made.
    pub(super) fn at_vehicle(self) -> Self {
        Self {
            kept: Kept {
                points: Vec::new(),
                start: Start {
                    pose: Pose2::default(),
                    curvature_per_m: self.moment.and_then(|moment| moment.curvature_per_m()),
                },
            },
            ..self
        }
    }
}

/// What is known of the vehicle's motion and the path that it follows.
#[derive(Debug)]
pub(super) struct Follower {
    config: FollowConfig,
    track: Track,
    course: Option<Course>,
    latency_s: f64,
}

impl Follower {
    pub(super) fn new(config: FollowConfig) -> Self {
        Self {
            config,
            track: Track::default(),
            course: None,
            latency_s: 0.0,
        }
    }

    /// Takes note of where the vehicle was. If that is in other frames than before, what was known is
    /// forgotten.
    pub(super) fn take(&mut self, odometry: Read) {
        if odometry.is_anew {
            self.track.clear();
            self.course = None;
        }
        self.track.take(odometry.moment);
    }

    /// Where the vehicle was at a time and how it moved; at time 0, as far as it is known.
    pub(super) fn moment_at(&self, stamp_nanos: u64) -> Option<Moment> {
        self.track.at(stamp_nanos)
    }

    /// Where paths for a grid are to begin: on the path that is followed if it is still free, else where
    /// the vehicle will be if it goes on as it does; without odometry, where it is.
    pub(super) fn depart(
        &self,
        stamp_nanos: u64,
        ground: (&GridSpec, &Plane),
        (vehicle, curvature_limit_per_m): (&Vehicle, f64),
    ) -> Departure {
        let Some(moment) = self.track.at(stamp_nanos) else {
            return Departure::default();
        };
        let course = self.course.as_ref();
        let ahead_m = moment.speed_m_per_s * (self.latency_s + self.config.stable_s);
        let kept = course
            .and_then(|course| course.kept(&moment.odom_from_vehicle, ahead_m.max(0.0)))
            .filter(|kept| kept.is_free(ground, vehicle, curvature_limit_per_m));
        Departure {
            kept: kept.unwrap_or_else(|| Kept {
                points: Vec::new(),
                start: Start {
                    pose: moment.moved_by(self.latency_s),
                    curvature_per_m: moment.curvature_per_m(),
                },
            }),
            last_goal: course.map(|course| course.goal(&moment.odom_from_vehicle)),
            moment: Some(moment),
        }
    }

    /// Follows a path that begins where a departure said; returns all of it, from the vehicle on.
    pub(super) fn follow(
        &mut self,
        departure: &Departure,
        (path, goal): (&[PathPoint], &Pose2),
    ) -> Vec<PathPoint> {
        let path = departure.kept.followed_by(path);
        self.course = departure
            .moment
            .map(|moment| Course::new(&path, goal, &moment.odom_from_vehicle));
        path
    }

    /// Follows nothing.
    pub(super) fn stop(&mut self) {
        self.course = None;
    }

    /// Takes note of how long a frame took.
    pub(super) fn took(&mut self, latency_s: f64) {
        let latency_s = latency_s.clamp(0.0, MOST_LATENCY_S);
        self.latency_s += NEWEST_SHARE * (latency_s - self.latency_s);
    }
}
