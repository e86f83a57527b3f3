//! Which frame is which, and where each lies in the vehicle's when a grid was made.
//!
//! - A frame without a name is the vehicle's own, and so is the frame of the configured name. Without a
//!   configured name the vehicle's frame is the child frame of the odometry, and `base_link` until some
//!   odometry has named another.
//! - Odometry without a frame is in `odom`; without a child frame it is the vehicle's. Either is said once.
//! - The odometry's frame is joined with the vehicle's by odometry, at the time that is asked for. All other
//!   frames are joined by transforms, which may lead over the odometry's.
//! - Odometry of a child frame that is not the configured vehicle's is moved to that by transforms.
//! - A leading slash is no part of a name.

use serde::{Deserialize, Serialize};
use swath_bridge::Pose2;
use swath_bridge::msg::nav::Odometry;
use swath_bridge::msg::tf2::TFMessage;
use swath_bridge::transforms::{
    Link, MAX_TILT_DEG, NoTransform, TransformBuffer, TransformFault, frame_name, tilt_deg,
};

use super::track::{MAX_GAP_S, Moment};
use crate::Error;

/// The vehicle's frame where nobody names another.
const VEHICLE_FRAME: &str = "base_link";
/// The odometry's frame where it does not say.
const ODOM_FRAME: &str = "odom";
/// Upper limit of the age of transforms, seconds.
const MAX_AGE_LIMIT_S: f64 = 3600.0;

/// How frames are told apart.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FramesConfig {
    /// Name of the vehicle's frame; empty for the child frame of the odometry, which is `base_link` until
    /// some odometry has named another.
    pub vehicle: String,
    /// Maximum time between a transform and the grid that it is used for, seconds, 0 to 3600. Transforms
    /// that are static are used for any grid.
    pub max_age_s: f64,
}

impl Default for FramesConfig {
    fn default() -> Self {
        Self {
            vehicle: String::new(),
            max_age_s: 1.0,
        }
    }
}

impl FramesConfig {
    /// Whether every setting is in its range.
    ///
    /// # Errors
    /// [`Error::FramesConfig`] names the one that is not.
    pub fn validate(&self) -> Result<(), Error> {
        let value = self.max_age_s;
        if !(0.0..=MAX_AGE_LIMIT_S).contains(&value) {
            return Err(Error::FramesConfig {
                field: "max_age_s",
                value,
                max: MAX_AGE_LIMIT_S,
            });
        }
        Ok(())
    }
}

/// Why odometry was not used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(super) enum OdometryFault {
    #[error("the pose or the motion is not finite")]
    NotFinite,
    #[error("no car moves so: {speed_m_per_s} m/s, {turn_rad_per_s} rad/s")]
    TooFast {
        speed_m_per_s: f64,
        turn_rad_per_s: f64,
    },
    #[error("the pose is tilted by {tilt_deg:.0} degrees, expected at most {MAX_TILT_DEG}")]
    Tilted { tilt_deg: f64 },
    #[error(
        "it is of {child:?} in {parent:?}, but that of {used_child:?} in {used_parent:?} is used"
    )]
    OtherFrame {
        child: String,
        parent: String,
        used_child: String,
        used_parent: String,
    },
    #[error(transparent)]
    NoTransform(#[from] NoTransform),
}

impl OdometryFault {
    /// The same words for all odometry with this fault.
    pub(super) const fn cause(&self) -> &'static str {
        match self {
            Self::NotFinite => "the pose or the motion is not finite",
            Self::TooFast { .. } => "no car moves so",
            Self::Tilted { .. } => "the pose is tilted",
            Self::OtherFrame { .. } => "it is in other frames than the odometry that is used",
            Self::NoTransform(_) => "its child frame is not joined with the vehicle's frame",
        }
    }
}

/// Why something in a frame cannot be seen from the vehicle.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(super) enum NotSeen {
    #[error("no transform from {frame:?} to {vehicle:?}: {why}")]
    NoOdometry {
        frame: String,
        vehicle: String,
        why: String,
    },
    #[error(transparent)]
    NoTransform(#[from] NoTransform),
}

/// The frames that odometry joins.
#[derive(Debug, Clone, PartialEq, Eq)]
struct OdometryFrames {
    parent: String,
    child: String,
    /// Time of the newest odometry in them.
    stamp_nanos: u64,
}

/// All that is known of frames.
#[derive(Debug)]
pub(super) struct Frames {
    config: FramesConfig,
    transforms: TransformBuffer,
    odometry: Option<OdometryFrames>,
    has_warned: bool,
}

/// Odometry that can be used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Read {
    pub(super) moment: Moment,
    /// Whether it is in other frames than the odometry before, which tells nothing of where that was.
    pub(super) is_anew: bool,
}

impl Frames {
    pub(super) fn new(config: FramesConfig) -> Self {
        Self {
            transforms: TransformBuffer::new(config.max_age_s),
            config,
            odometry: None,
            has_warned: false,
        }
    }

    /// Takes transforms; `on_fault` is told of those that cannot be used, with their child frame.
    pub(super) fn take(
        &mut self,
        message: &TFMessage,
        is_static: bool,
        mut on_fault: impl FnMut(TransformFault, &str),
    ) {
        self.transforms
            .insert(message, is_static, |fault, stamped| {
                on_fault(fault, &stamped.child_frame_id);
            });
    }

    /// Name of the vehicle's frame.
    fn vehicle(&self) -> &str {
        let configured = frame_name(&self.config.vehicle);
        if !configured.is_empty() {
            return configured;
        }
        self.odometry
            .as_ref()
            .map_or(VEHICLE_FRAME, |frames| &frames.child)
    }

    /// The vehicle's motion that odometry tells of.
    pub(super) fn read(&mut self, odom: &Odometry) -> Result<Read, OdometryFault> {
        let moment = Moment::of(odom)?;
        match tilt_deg(&odom.pose.pose.orientation) {
            Some(tilt_deg) if tilt_deg > MAX_TILT_DEG => {
                return Err(OdometryFault::Tilted { tilt_deg });
            }
            Some(_) => {}
            None => return Err(OdometryFault::NotFinite),
        }
        let frames = self.frames_of(odom);
        let is_anew = self.is_anew(&frames)?;
        let moment = self.moved_to_vehicle(moment, &frames.child)?;
        self.odometry = Some(frames);
        Ok(Read { moment, is_anew })
    }

    fn frames_of(&mut self, odom: &Odometry) -> OdometryFrames {
        let parent = frame_name(&odom.header.frame_id);
        let child = frame_name(&odom.child_frame_id);
        let configured = frame_name(&self.config.vehicle);
        let vehicle = if configured.is_empty() {
            VEHICLE_FRAME
        } else {
            configured
        };
        let or = |name: &str, default: &str| {
            let name = if name.is_empty() { default } else { name };
            name.to_owned()
        };
        let frames = OdometryFrames {
            parent: or(parent, ODOM_FRAME),
            child: or(child, vehicle),
            stamp_nanos: odom.header.stamp.nanos(),
        };
        if (parent.is_empty() || child.is_empty()) && !self.has_warned {
            self.has_warned = true;
            tracing::warn!(
                "odometry does not name both of its frames: taken for that of {:?} in {:?}",
                frames.child,
                frames.parent
            );
        }
        frames
    }

    /// Whether the frames are other ones than those of the odometry before.
    fn is_anew(&self, frames: &OdometryFrames) -> Result<bool, OdometryFault> {
        let Some(used) = &self.odometry else {
            return Ok(false);
        };
        if (&used.parent, &used.child) == (&frames.parent, &frames.child) {
            return Ok(false);
        }
        let apart_s = used.stamp_nanos.abs_diff(frames.stamp_nanos) as f64 / 1e9;
        if apart_s > MAX_GAP_S {
            return Ok(true);
        }
        Err(OdometryFault::OtherFrame {
            child: frames.child.clone(),
            parent: frames.parent.clone(),
            used_child: used.child.clone(),
            used_parent: used.parent.clone(),
        })
    }

    /// The motion of the configured vehicle's frame instead of the odometry's child frame.
    fn moved_to_vehicle(&mut self, moment: Moment, child: &str) -> Result<Moment, NoTransform> {
        let vehicle = frame_name(&self.config.vehicle).to_owned();
        if vehicle.is_empty() || vehicle == child {
            return Ok(moment);
        }
        let lookup = self
            .transforms
            .lookup(child, &vehicle, moment.stamp_nanos, None);
        Ok(moment.of_part(&lookup?))
    }

    /// Where a frame is in the vehicle's at a time, given where the vehicle is then; at time 0, where it
    /// was seen last.
    pub(super) fn vehicle_from(
        &mut self,
        frame: &str,
        at_nanos: u64,
        moment: Option<&Moment>,
    ) -> Result<Pose2, NotSeen> {
        let (frame, vehicle) = (frame_name(frame).to_owned(), self.vehicle().to_owned());
        if frame.is_empty() || frame == vehicle {
            return Ok(Pose2::default());
        }
        let odom_from_vehicle = moment.map(|moment| &moment.odom_from_vehicle);
        let found = self.look_up(&vehicle, &frame, at_nanos, odom_from_vehicle);
        let Err(error) = found else {
            return Ok(found?);
        };
        // Odometry is what is missing if any odometry would do.
        let anywhere = Pose2::default();
        let would_do = moment.is_none()
            && match self.look_up(&vehicle, &frame, at_nanos, Some(&anywhere)) {
                Ok(_) => true,
                Err(error) => matches!(error, NoTransform::Tilted { .. }),
            };
        if !would_do {
            return Err(error.into());
        }
        Err(NotSeen::NoOdometry {
            why: self.why_no_odometry(at_nanos),
            frame,
            vehicle,
        })
    }

    fn why_no_odometry(&self, at_nanos: u64) -> String {
        let Some(odometry) = &self.odometry else {
            return "no odometry has come that could be used".to_owned();
        };
        let newest = odometry.stamp_nanos;
        let off_s = newest.abs_diff(at_nanos) as f64 / 1e9;
        let side = if newest < at_nanos { "older" } else { "newer" };
        format!(
            "the newest odometry is {off_s:.2} s {side} than the grid, at most {MAX_GAP_S} s is allowed"
        )
    }

    /// The transform of a frame to the vehicle's, where the vehicle is so in the odometry's.
    fn look_up(
        &mut self,
        vehicle: &str,
        frame: &str,
        at_nanos: u64,
        odom_from_vehicle: Option<&Pose2>,
    ) -> Result<Pose2, NoTransform> {
        let (parent, child) = match &self.odometry {
            Some(frames) => (frames.parent.clone(), frames.child.clone()),
            None => (ODOM_FRAME.to_owned(), vehicle.to_owned()),
        };
        let Some(odom_from_vehicle) = odom_from_vehicle else {
            return self.transforms.lookup(vehicle, frame, at_nanos, None);
        };
        let link = Link {
            parent: &parent,
            child: vehicle,
            parent_from_child: *odom_from_vehicle,
        };
        let found = self.transforms.lookup(vehicle, frame, at_nanos, Some(link));
        if child == vehicle || !matches!(found, Err(NoTransform::NotConnected { .. })) {
            return found;
        }
        // The vehicle's frame may be below the child frame, and the wanted one beside it.
        let vehicle_from_child = self.transforms.lookup(vehicle, &child, at_nanos, None);
        let Ok(vehicle_from_child) = vehicle_from_child else {
            return found;
        };
        let link = Link {
            child: &child,
            parent_from_child: odom_from_vehicle.then(&vehicle_from_child),
            ..link
        };
        self.transforms.lookup(vehicle, frame, at_nanos, Some(link))
    }
}

#[cfg(test)]
mod tests;
