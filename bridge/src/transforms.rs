//! Where frames are in each other at a given time: the newest seconds of what `tf` says.
//!
//! A [`TransformBuffer`] keeps, for a limited number of frames, a limited history of each frame's
//! transform from its parent. A lookup goes from both frames to their nearest common ancestor and takes
//! every transform on the way at the time that is asked for: between two samples it interpolates, before
//! the first and after the last it takes the nearest if that is not too far off. What it gives is a
//! transform in the plane; one that tilts is refused, because it has none.
//!
//! A transform is fixed, and holds at any time, if it came on a topic of static transforms or if its
//! stamp is zero. A lookup at time zero takes the newest sample of each frame, as in ROS.

mod frame;

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::geometry::Pose2;
use crate::ingest::transform::{MAX_DEPTH, isometry_of, normalised, rotation_of};
use crate::msg::geometry::{Quaternion, TransformStamped};
use crate::msg::tf2::TFMessage;

use frame::Frame;

/// Maximum number of frames that have a parent. When it is reached, the frame that has been known for
/// longest without being asked for gives way to the new one.
pub const MAX_BUFFERED_FRAMES: usize = 1024;
/// Maximum length of a frame's name, bytes.
pub const MAX_NAME_BYTES: usize = 256;
/// Maximum distance between two frames, metres along an axis.
pub const MAX_DISTANCE_M: f64 = 1e8;
/// Maximum angle between the vertical axes of two frames that still share a plane, degrees.
pub const MAX_TILT_DEG: f64 = 20.0;

/// Maximum number of frames that an error names.
const MAX_LISTED: usize = 8;

/// The frame of a name without the leading slash that older systems write.
pub fn frame_name(name: &str) -> &str {
    normalised(name)
}

/// The tilt of an orientation against the vertical, degrees in 0 to 180; `None` if it is no rotation.
/// All zeros count as no rotation.
pub fn tilt_deg(orientation: &Quaternion) -> Option<f64> {
    rotation_of(orientation).map(|rotation| tilt_of(&rotation))
}

fn tilt_of(rotation: &UnitQuaternion<f64>) -> f64 {
    let up = rotation * Vector3::z();
    libm::acos(up.z.clamp(-1.0, 1.0)).to_degrees()
}

/// Why a transform was not taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum TransformFault {
    /// A number is not finite, or the quaternion is no rotation.
    NotRigid,
    /// The frames are more than [`MAX_DISTANCE_M`] apart.
    TooFar,
    /// The child or the parent has no name.
    NoName,
    /// A name is longer than [`MAX_NAME_BYTES`].
    LongName,
    /// Child and parent are the same frame.
    OwnParent,
}

impl TransformFault {
    /// What is wrong, in a few words that are the same for all transforms.
    pub const fn name(self) -> &'static str {
        match self {
            Self::NotRigid => "a transform is not finite or has no rotation",
            Self::TooFar => "a transform leads too far away",
            Self::NoName => "a transform has a frame without a name",
            Self::LongName => "the name of a frame is too long",
            Self::OwnParent => "a frame is its own parent",
        }
    }
}

/// Why there is no transform between two frames.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NoTransform {
    /// No chain of transforms joins the two frames.
    #[error("no transform from {from:?} to {to:?}: {why}")]
    NotConnected {
        /// The frame that something is in.
        from: String,
        /// The frame that it is wanted in.
        to: String,
        /// What is known of the two.
        why: String,
    },
    /// A transform of the chain has no sample near the time.
    #[error(
        "no transform from {from:?} to {to:?}: the nearest of {child:?} in {parent:?} is {off_s:.2} s \
         off, at most {max_age_s} s is allowed"
    )]
    TooFarOff {
        /// The frame that something is in.
        from: String,
        /// The frame that it is wanted in.
        to: String,
        /// The frame whose transform it is.
        child: String,
        /// Its parent.
        parent: String,
        /// Time between the nearest sample and the time that was asked for, seconds.
        off_s: f64,
        /// The limit, seconds.
        max_age_s: f64,
    },
    /// The two frames do not share a plane.
    #[error(
        "no transform from {from:?} to {to:?} in the plane: it tilts by {tilt_deg:.0} degrees, expected \
         at most {MAX_TILT_DEG}"
    )]
    Tilted {
        /// The frame that something is in.
        from: String,
        /// The frame that it is wanted in.
        to: String,
        /// Angle between the vertical axes, degrees.
        tilt_deg: f64,
    },
}

/// A transform that is known from elsewhere, as that of odometry. It comes before what the buffer has of
/// its child.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link<'a> {
    /// Name of the parent.
    pub parent: &'a str,
    /// Name of the child.
    pub child: &'a str,
    /// The child's pose in the parent.
    pub parent_from_child: Pose2,
}

/// Transforms of frames from their parents, each with its newest seconds.
#[derive(Debug, Clone)]
pub struct TransformBuffer {
    frames: BTreeMap<Arc<str>, Frame>,
    /// Frames that nobody has asked for, the one that is known for longest first.
    unused: VecDeque<Arc<str>>,
    max_age_nanos: u64,
}

/// A frame of a chain towards the root: the parent that it leads to, and the transform if it comes from
/// elsewhere.
struct Step<'a> {
    child: &'a str,
    parent: &'a str,
    known: Option<&'a Pose2>,
}

impl TransformBuffer {
    /// An empty buffer. A sample is used for times that are at most `max_age_s` before or after it,
    /// seconds.
    pub fn new(max_age_s: f64) -> Self {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "float to integer casts saturate"
        )]
        let max_age_nanos = (max_age_s * 1e9) as u64;
        Self {
            frames: BTreeMap::new(),
            unused: VecDeque::new(),
            max_age_nanos,
        }
    }

    /// Number of frames that have a parent.
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// Whether nothing is known.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// Takes every transform of a message; `on_fault` is told of those that cannot be used.
    pub fn insert(
        &mut self,
        message: &TFMessage,
        is_static: bool,
        mut on_fault: impl FnMut(TransformFault, &TransformStamped),
    ) {
        for stamped in &message.transforms {
            if let Err(fault) = self.insert_one(stamped, is_static) {
                on_fault(fault, stamped);
            }
        }
    }

    fn insert_one(
        &mut self,
        stamped: &TransformStamped,
        is_static: bool,
    ) -> Result<(), TransformFault> {
        let child = normalised(&stamped.child_frame_id);
        let parent = normalised(&stamped.header.frame_id);
        if child.is_empty() || parent.is_empty() {
            return Err(TransformFault::NoName);
        }
        if child.len().max(parent.len()) > MAX_NAME_BYTES {
            return Err(TransformFault::LongName);
        }
        if child == parent {
            return Err(TransformFault::OwnParent);
        }
        let transform = isometry_of(&stamped.transform).ok_or(TransformFault::NotRigid)?;
        if transform.translation.vector.amax() > MAX_DISTANCE_M {
            return Err(TransformFault::TooFar);
        }
        let stamp_nanos = stamped.header.stamp.nanos();
        let stamp_nanos = (!is_static && stamp_nanos > 0).then_some(stamp_nanos);
        if let Some(frame) = self.frames.get_mut(child) {
            frame.insert(parent, stamp_nanos, transform);
            return Ok(());
        }
        self.make_room();
        let child: Arc<str> = child.into();
        let mut frame = Frame::new(parent);
        frame.insert(parent, stamp_nanos, transform);
        self.frames.insert(Arc::clone(&child), frame);
        self.unused.push_back(child);
        Ok(())
    }

    /// Forgets a frame if there are too many: one that nobody has asked for, if there is one.
    fn make_room(&mut self) {
        while self.frames.len() >= MAX_BUFFERED_FRAMES {
            match self.unused.pop_front() {
                Some(name) => {
                    if self.frames.get(&name).is_some_and(|frame| !frame.is_used) {
                        self.frames.remove(&name);
                    }
                }
                // Every frame was asked for at some time; from now on that no longer counts.
                None => {
                    for (name, frame) in &mut self.frames {
                        frame.is_used = false;
                        self.unused.push_back(Arc::clone(name));
                    }
                }
            }
        }
    }

    /// `to_from_from` in the plane at a time, nanoseconds since the Unix epoch; at 0 the newest.
    ///
    /// # Errors
    /// [`NoTransform`] says what is missing.
    pub fn lookup(
        &mut self,
        to: &str,
        from: &str,
        at_nanos: u64,
        link: Option<Link<'_>>,
    ) -> Result<Pose2, NoTransform> {
        let (to, from) = (normalised(to), normalised(from));
        if to == from {
            return Ok(Pose2::default());
        }
        let link = link.map(|link| Link {
            parent: normalised(link.parent),
            child: normalised(link.child),
            ..link
        });
        let link = link.filter(|link| link.parent != link.child);
        let (up, down) = (
            self.to_root(from, link.as_ref()),
            self.to_root(to, link.as_ref()),
        );
        let ends = Ends { from, to };
        let Some((ups, downs)) = meeting(&up, &down, &ends) else {
            return Err(self.not_connected(&up, &down, &ends));
        };
        let ancestor_from_from = self.along(&up[..ups], at_nanos, &ends)?;
        let ancestor_from_to = self.along(&down[..downs], at_nanos, &ends)?;
        let to_from_from = ancestor_from_to.inverse() * ancestor_from_from;
        let used: Vec<Arc<str>> = up[..ups]
            .iter()
            .chain(&down[..downs])
            .map(|step| Arc::from(step.child))
            .collect();
        for name in used {
            if let Some(frame) = self.frames.get_mut(&name) {
                frame.is_used = true;
            }
        }
        in_plane(&to_from_from, &ends)
    }

    /// The steps from a frame towards the root, until there is no parent or a frame comes again.
    fn to_root<'a>(&'a self, frame: &'a str, link: Option<&'a Link<'a>>) -> Vec<Step<'a>> {
        let mut steps: Vec<Step<'a>> = Vec::new();
        let mut child = frame;
        while steps.len() < MAX_DEPTH {
            let (parent, known) = match (link, self.frames.get(child)) {
                (Some(link), _) if link.child == child => {
                    (link.parent, Some(&link.parent_from_child))
                }
                (_, Some(frame)) => (&*frame.parent, None),
                (_, None) => break,
            };
            let is_loop = parent == frame || steps.iter().any(|step| step.parent == parent);
            steps.push(Step {
                child,
                parent,
                known,
            });
            if is_loop {
                break;
            }
            child = parent;
        }
        steps
    }

    /// The transform of a whole chain: its last parent from its first child.
    fn along(
        &self,
        steps: &[Step<'_>],
        at_nanos: u64,
        ends: &Ends<'_>,
    ) -> Result<Isometry3<f64>, NoTransform> {
        let mut last_from_first = Isometry3::identity();
        for step in steps {
            let parent_from_child = match (step.known, self.frames.get(step.child)) {
                (Some(known), _) => isometry_in_plane(known),
                (None, Some(frame)) => {
                    frame
                        .at(at_nanos, self.max_age_nanos)
                        .map_err(|off_nanos| NoTransform::TooFarOff {
                            from: ends.from.to_owned(),
                            to: ends.to.to_owned(),
                            child: step.child.to_owned(),
                            parent: step.parent.to_owned(),
                            off_s: off_nanos as f64 / 1e9,
                            max_age_s: self.max_age_nanos as f64 / 1e9,
                        })?
                }
                // A step is either known from elsewhere or of a frame that is buffered.
                (None, None) => Isometry3::identity(),
            };
            last_from_first = parent_from_child * last_from_first;
        }
        Ok(last_from_first)
    }

    fn not_connected(&self, up: &[Step<'_>], down: &[Step<'_>], ends: &Ends<'_>) -> NoTransform {
        let looped = loop_of(up, ends.from).or_else(|| loop_of(down, ends.to));
        let roots = (self.root(up, ends.from), self.root(down, ends.to));
        let why = match (looped, roots) {
            (Some(frame), _) => format!("the frames above {frame:?} form a loop"),
            (None, (Some(one), Some(other))) => format!(
                "the frames above them end at {one:?} and at {other:?}, and nothing joins those"
            ),
            (None, (None, Some(_))) => {
                format!("nothing is known of {:?}; {}", ends.from, self.listing())
            }
            (None, (Some(_), None)) => {
                format!("nothing is known of {:?}; {}", ends.to, self.listing())
            }
            (None, (None, None)) => format!("nothing is known of either; {}", self.listing()),
        };
        NoTransform::NotConnected {
            from: ends.from.to_owned(),
            to: ends.to.to_owned(),
            why,
        }
    }

    /// Where a chain that begins with a frame ends, if anything is known of the frame.
    fn root<'a>(&self, steps: &[Step<'a>], frame: &'a str) -> Option<&'a str> {
        if let Some(last) = steps.last() {
            return Some(last.parent);
        }
        let is_parent = self.frames.values().any(|known| *known.parent == *frame);
        is_parent.then_some(frame)
    }

    fn listing(&self) -> String {
        if self.frames.is_empty() {
            return "no transform has come".to_owned();
        }
        let names: Vec<&str> = self
            .frames
            .keys()
            .take(MAX_LISTED)
            .map(|name| &**name)
            .collect();
        let more = self.frames.len() - names.len();
        let more = if more == 0 {
            String::new()
        } else {
            format!(" and {more} more")
        };
        format!("the known frames are {names:?}{more}")
    }
}

/// The two frames of a lookup.
struct Ends<'a> {
    from: &'a str,
    to: &'a str,
}

/// The numbers of steps on both sides to the nearest common ancestor.
fn meeting(up: &[Step<'_>], down: &[Step<'_>], ends: &Ends<'_>) -> Option<(usize, usize)> {
    let downs_to = |frame: &str| {
        if frame == ends.to {
            return Some(0);
        }
        let found = down.iter().position(|step| step.parent == frame);
        found.map(|index| index + 1)
    };
    if let Some(downs) = downs_to(ends.from) {
        return Some((0, downs));
    }
    up.iter()
        .enumerate()
        .find_map(|(index, step)| downs_to(step.parent).map(|downs| (index + 1, downs)))
}

/// The frame at which a chain comes to itself again, if it does.
fn loop_of<'a>(steps: &[Step<'a>], first: &'a str) -> Option<&'a str> {
    let (last, before) = steps.split_last()?;
    let is_loop = last.parent == first || before.iter().any(|step| step.parent == last.parent);
    is_loop.then_some(last.parent)
}

fn isometry_in_plane(pose: &Pose2) -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::new(pose.x_m, pose.y_m, 0.0),
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), pose.yaw_rad),
    )
}

/// The plane's part of a transform: its place, and the heading of its x axis.
fn in_plane(to_from_from: &Isometry3<f64>, ends: &Ends<'_>) -> Result<Pose2, NoTransform> {
    let tilt_deg = tilt_of(&to_from_from.rotation);
    if tilt_deg.is_nan() || tilt_deg > MAX_TILT_DEG {
        return Err(NoTransform::Tilted {
            from: ends.from.to_owned(),
            to: ends.to.to_owned(),
            tilt_deg,
        });
    }
    let forward = to_from_from.rotation * Vector3::x();
    let at = to_from_from.translation.vector;
    Ok(Pose2::new(at.x, at.y, libm::atan2(forward.y, forward.x)))
}

#[cfg(test)]
mod tests;
