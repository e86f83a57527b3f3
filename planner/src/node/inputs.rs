//! What a node is told, apart from weights: taken, counted where it cannot be used, and seen from the
//! vehicle when a grid comes.

use swath_bridge::msg::geometry::PoseArray;
use swath_bridge::msg::nav::{OccupancyGrid, Odometry, Path};
use swath_bridge::msg::swath::{Rejection, Weights};
use swath_bridge::msg::tf2::TFMessage;
use swath_bridge::poses::pose_of_ros;
use swath_bridge::transforms::frame_name;
use swath_bridge::{Occupancy, Pose2, Session, StopReason, Subscriber, keys};
use tokio::time::Instant;

use super::stops::Stop;
use super::track::Moment;
use super::{Node, Seen};
use crate::Error;
use crate::targets::MAX_TARGETS;

/// Messages of a kind that may wait while a frame is planned.
const QUEUE: usize = 16;
/// The same for transforms, of which each frame may send its own.
const TF_QUEUE: usize = 256;
/// Maximum number of poses of a reference; the rest is left out.
const MAX_REFERENCE_POSES: usize = 65_536;

const UNDECODABLE: &str = "it does not decode";

/// Everything that a node listens to.
pub(super) struct Inputs {
    pub(super) grid: Subscriber<OccupancyGrid>,
    pub(super) odom: Subscriber<Odometry>,
    pub(super) tf: Subscriber<TFMessage>,
    pub(super) tf_static: Subscriber<TFMessage>,
    pub(super) reference: Subscriber<Path>,
    pub(super) targets: Subscriber<PoseArray>,
    pub(super) weights: Subscriber<Weights>,
}

impl Inputs {
    pub(super) async fn new(session: &Session, id: &str, run: &str) -> Result<Self, Error> {
        Ok(Self {
            grid: session.subscriber(&keys::grid(id), 1).await?,
            odom: session.subscriber(&keys::odom(id), QUEUE).await?,
            tf: session.subscriber(&keys::tf(id), TF_QUEUE).await?,
            tf_static: session.subscriber(&keys::tf_static(id), TF_QUEUE).await?,
            reference: session.subscriber(&keys::reference(id), QUEUE).await?,
            targets: session.subscriber(&keys::targets(id), QUEUE).await?,
            weights: session.subscriber(&keys::weights(run), QUEUE).await?,
        })
    }

    /// Messages that did not decode, by topic.
    fn undecodable(&self) -> [(&'static str, u64); 7] {
        [
            ("grid", self.grid.counts().undecodable),
            ("odom", self.odom.counts().undecodable),
            ("tf", self.tf.counts().undecodable),
            ("tf_static", self.tf_static.counts().undecodable),
            ("reference", self.reference.counts().undecodable),
            ("targets", self.targets.counts().undecodable),
            ("weights", self.weights.counts().undecodable),
        ]
    }
}

/// Poses in the frame that they were given in.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Given {
    pub(super) frame: String,
    pub(super) poses: Vec<Pose2>,
    /// Why they cannot be used, if they cannot.
    pub(super) fault: Option<&'static str>,
}

impl Node {
    /// Counts a message that could not be used, and logs it at a limited rate for each cause.
    pub(super) fn reject(
        &mut self,
        topic: &'static str,
        cause: &'static str,
        detail: &dyn std::fmt::Display,
    ) {
        if let Some(line) = self.rejects.note(topic, cause, detail, Instant::now()) {
            tracing::warn!("{line}");
        }
    }

    /// Messages that could not be used, by topic and cause.
    pub(super) fn rejections(&self) -> Vec<Rejection> {
        let mut rejections = self.rejects.rejections();
        let undecodable = self.inputs.undecodable().into_iter();
        let undecodable = undecodable.filter(|(_, messages)| *messages > 0);
        rejections.extend(undecodable.map(|(topic, messages)| Rejection {
            topic: topic.to_owned(),
            cause: UNDECODABLE.to_owned(),
            messages,
        }));
        rejections
    }

    pub(super) fn take_odom(&mut self, odom: &Odometry) {
        match self.frames.read(odom) {
            Ok(odometry) => {
                self.speed_m_per_s = odometry.moment.speed_m_per_s.abs();
                self.follower.take(odometry);
            }
            Err(fault) => self.reject("odom", fault.cause(), &fault),
        }
    }

    pub(super) fn take_tf(&mut self, message: &TFMessage, is_static: bool) {
        let topic = if is_static { "tf_static" } else { "tf" };
        let (rejects, now) = (&mut self.rejects, Instant::now());
        self.frames.take(message, is_static, |fault, child| {
            let detail = format!("{}: child frame {child:?}", fault.name());
            if let Some(line) = rejects.note(topic, fault.name(), &detail, now) {
                tracing::warn!("{line}");
            }
        });
    }

    pub(super) fn take_reference(&mut self, path: &Path) {
        let frame = frame_name(&path.header.frame_id);
        // A path that does not say has the frame that all its poses say.
        let frame = match (frame, path.poses.first()) {
            ("", Some(first)) => frame_name(&first.header.frame_id),
            (frame, _) => frame,
        };
        let is_other = |other: &str| !other.is_empty() && frame_name(other) != frame;
        let other = path
            .poses
            .iter()
            .find(|pose| is_other(&pose.header.frame_id));
        let other = other.map(|pose| pose.header.frame_id.clone());
        let poses = path.poses.iter().map(|stamped| pose_of_ros(&stamped.pose));
        self.reference = self.given(Listed {
            topic: "reference",
            frame,
            poses: poses.take(MAX_REFERENCE_POSES).collect(),
            all: path.poses.len(),
        });
        if let Some(other) = other {
            let fault = "its poses are in several frames";
            self.reject(
                "reference",
                fault,
                &format!("{fault}: {frame:?} and {other:?}"),
            );
            self.reference.fault = Some(fault);
        }
    }

    pub(super) fn take_targets(&mut self, targets: &PoseArray) {
        let poses = targets.poses.iter().map(pose_of_ros);
        self.targets = self.given(Listed {
            topic: "targets",
            frame: frame_name(&targets.header.frame_id),
            poses: poses.take(MAX_TARGETS).collect(),
            all: targets.poses.len(),
        });
    }

    /// Takes poses of a message; those that are not finite are left out, and if none is left but there
    /// were some, the message cannot be used.
    fn given(&mut self, listed: Listed<'_>) -> Given {
        let Listed {
            topic,
            frame,
            mut poses,
            all,
        } = listed;
        let taken = poses.len();
        if taken < all {
            let fault = "it has more poses than are used";
            self.reject(
                topic,
                fault,
                &format!("{fault}: {} of {all} left out", all - taken),
            );
        }
        poses.retain(Pose2::is_finite);
        let mut given = Given {
            frame: frame.to_owned(),
            poses,
            fault: None,
        };
        if given.poses.len() < taken {
            let fault = "it has poses that are not finite";
            let bad = taken - given.poses.len();
            self.reject(topic, fault, &format!("{fault}: {bad} of {taken} left out"));
            given.fault = given.poses.is_empty().then_some(fault);
        }
        given
    }

    /// What is known, in the vehicle's frame when a grid was made.
    pub(super) fn seen_from_vehicle(&mut self, grid: &OccupancyGrid) -> Result<Seen, Stop> {
        let at_nanos = grid.header.stamp.nanos();
        let moment = self.follower.moment_at(at_nanos);
        let seer = Seer {
            at_nanos,
            moment: moment.as_ref(),
        };
        let vehicle_from_frame = self.vehicle_from("grid", &grid.header.frame_id, seer)?;
        let occupancy = Occupancy::from_message_in(grid, &self.config.grid, &vehicle_from_frame);
        let occupancy = occupancy.map_err(|error| {
            let cause = match &error {
                swath_bridge::Error::UnusableGrid { fault, .. } => fault.name(),
                _ => "it cannot be worked with",
            };
            self.reject("grid", cause, &error);
            Stop::new(StopReason::BadInput, format!("grid: {error}"))
        })?;
        let (reference, targets) = (self.reference.clone(), self.targets.clone());
        Ok(Seen {
            vehicle_from_frame,
            occupancy,
            reference: self.given_from_vehicle("reference", reference, seer)?,
            targets: self.given_from_vehicle("targets", targets, seer)?,
        })
    }

    fn given_from_vehicle(
        &mut self,
        topic: &'static str,
        given: Given,
        seer: Seer<'_>,
    ) -> Result<Vec<Pose2>, Stop> {
        if let Some(fault) = given.fault {
            return Err(Stop::new(StopReason::BadInput, format!("{topic}: {fault}")));
        }
        if given.poses.is_empty() {
            return Ok(Vec::new());
        }
        let vehicle_from_frame = self.vehicle_from(topic, &given.frame, seer)?;
        if vehicle_from_frame == Pose2::default() {
            return Ok(given.poses);
        }
        let seen = given.poses.iter().map(|pose| vehicle_from_frame.then(pose));
        Ok(seen.collect())
    }

    /// Where a frame is in the vehicle's.
    fn vehicle_from(
        &mut self,
        topic: &'static str,
        frame: &str,
        seer: Seer<'_>,
    ) -> Result<Pose2, Stop> {
        let found = self.frames.vehicle_from(frame, seer.at_nanos, seer.moment);
        found.map_err(|error| {
            let stop = Stop::not_seen(topic, &error);
            self.reject(topic, stop.reason.name(), &error);
            stop
        })
    }
}

/// The vehicle at the time of a grid.
#[derive(Debug, Clone, Copy)]
struct Seer<'a> {
    /// Nanoseconds since the Unix epoch; 0 asks for the newest.
    at_nanos: u64,
    /// Where it was, if odometry says.
    moment: Option<&'a Moment>,
}

/// Poses of a message on a topic, as many as are used.
struct Listed<'a> {
    topic: &'static str,
    frame: &'a str,
    poses: Vec<Pose2>,
    /// Poses that the message has.
    all: usize,
}
