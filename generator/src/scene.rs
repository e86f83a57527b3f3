//! Procedural scenes: what stands and moves around a vehicle, and the path it is to follow.
//!
//! A scene is drawn in the frame of its road and handed out in the frame of the vehicle, which
//! stands beside the reference path with a small offset and heading of its own. Nothing that the
//! vehicle would have hit on its way here is left in it.

mod clutter;
mod intersection;
mod kind;
mod narrow;
mod pace;
mod parking;
mod road;
mod roadside;
mod site;
mod traffic;
mod way;

use std::f64::consts::TAU;
use std::sync::Arc;

use swath_bridge::{Pose2, Vehicle};

pub use kind::SceneKind;

use crate::config::{GeneratorConfig, Span};
use crate::course::Course;
use crate::dice::{Dice, Purpose};
use crate::shape::{Footprint, Shape, Solid};
use site::Site;

/// How far scenes reach along their reference path, metres from the vehicle.
pub(crate) const REACH: Span = Span(-28.0, 105.0);

/// Something that moves on a circle or a straight line, at a constant speed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mover {
    /// Its centre at time 0.
    pub pose: Pose2,
    /// Forward, m/s.
    pub speed_m_per_s: f64,
    /// Counter-clockwise, rad/s.
    pub turn_rad_per_s: f64,
    /// Along its heading, metres.
    pub length_m: f64,
    /// Across, metres.
    pub width_m: f64,
}

/// What is around a vehicle, in its frame at time 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Kind of scene, or the name of the log it came from.
    pub name: String,
    /// Whether it is a moment of a log, whose map holds what the past has seen.
    pub is_recorded: bool,
    /// Centres of the cells that a log's map has occupied; empty in a procedural scene.
    pub known: Arc<[[f64; 2]]>,
    /// What stands still.
    pub solids: Vec<Solid>,
    /// What moves.
    pub movers: Vec<Mover>,
    /// The reference path; 0 along it is beside the vehicle.
    pub reference: Course,
    /// Lines that run beside the reference, metres to its left, 0 included: lanes.
    pub lanes_m: Vec<f64>,
    /// How far to the left one may drive from the reference: lowest (right, negative) and highest.
    pub band_m: Span,
    /// The vehicle's place against the reference: metres to the left and heading.
    pub ego_from_reference: Pose2,
    /// The vehicle's speed, m/s.
    pub speed_m_per_s: f64,
}

/// Where something was at a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// Seconds; 0 is now, the past is negative.
    pub time_s: f64,
    /// The vehicle's pose.
    pub pose: Pose2,
}

impl Mover {
    /// The pose of its centre at a time.
    pub fn pose_at(&self, time_s: f64) -> Pose2 {
        let turn_rad = self.turn_rad_per_s * time_s;
        let chord_m = if turn_rad.abs() < 1e-6 {
            self.speed_m_per_s * time_s
        } else {
            2.0 * self.speed_m_per_s / self.turn_rad_per_s * libm::sin(0.5 * turn_rad)
        };
        let (sin, cos) = libm::sincos(0.5 * turn_rad);
        self.pose
            .then(&Pose2::new(chord_m * cos, chord_m * sin, turn_rad % TAU))
    }

    /// Its outline at a time.
    pub fn shape_at(&self, time_s: f64) -> Shape {
        Shape::Rectangle {
            centre: self.pose_at(time_s),
            length_m: self.length_m,
            width_m: self.width_m,
        }
    }
}

/// The footprint of a vehicle whose rear axle's middle is at `pose`.
pub(crate) fn footprint(vehicle: &Vehicle, pose: &Pose2) -> Footprint {
    Footprint {
        pose: *pose,
        front_m: vehicle.front_m,
        rear_m: vehicle.rear_m,
        half_width_m: vehicle.half_width_m,
    }
}

impl Scene {
    /// The procedural scene of a seed and an index. The configured kinds take
    /// turns.
    pub fn procedural(seed: u64, index: u64, config: &GeneratorConfig) -> Self {
        let kind = SceneKind::of_index(&config.kinds, index);
        let mut site = Site::new(config, Dice::new(seed, Purpose::Scene, index, 0));
        let layout = match kind {
            SceneKind::Straight => road::straight(&mut site),
            SceneKind::Curved => road::curved(&mut site),
            SceneKind::SShaped => road::s_shaped(&mut site),
            SceneKind::Turn => intersection::turn(&mut site),
            SceneKind::Narrow => narrow::narrow(&mut site),
            SceneKind::Parking => parking::parking(&mut site),
            SceneKind::Clutter => clutter::clutter(&mut site),
        };
        site.finish(kind, layout)
    }

    /// Whether a footprint stands clear of everything at time 0.
    pub fn is_free(&self, footprint: &Footprint) -> bool {
        let touches = |shape: &Shape| shape.touches(footprint);
        !self.solids.iter().any(|solid| touches(&solid.shape))
            && !self
                .movers
                .iter()
                .any(|mover| touches(&mover.shape_at(0.0)))
            && !self.known.iter().any(|&cell| footprint.holds(cell))
    }

    /// Where the vehicle was at a time of the past, or will be if it keeps to the reference: an
    /// offset of heading dies away over a few metres.
    pub fn ego_at(&self, time_s: f64) -> Pose2 {
        self.ego_along(self.speed_m_per_s * time_s)
    }

    /// The same by the distance driven.
    fn ego_along(&self, along_m: f64) -> Pose2 {
        const RELAX_M: f64 = 6.0;
        let left = libm::exp(-along_m.abs() / RELAX_M);
        let heading_rad = self.ego_from_reference.yaw_rad;
        let drift_m = heading_rad * RELAX_M * (1.0 - left);
        let offset_m = self.ego_from_reference.y_m + if along_m < 0.0 { -drift_m } else { drift_m };
        self.reference
            .at(along_m)
            .then(&Pose2::new(0.0, offset_m, heading_rad * left))
    }

    /// The same scene some time later, in the vehicle's frame of then.
    #[must_use]
    pub fn later(&self, time_s: f64) -> Self {
        let now_from_then = self.ego_at(time_s);
        let then_from_now = now_from_then.inverse();
        let along_m = self.speed_m_per_s * time_s;
        let reference_from_now = self.reference.at(along_m).inverse();
        let movers = self.movers.iter().map(|mover| Mover {
            pose: then_from_now.then(&mover.pose_at(time_s)),
            ..*mover
        });
        let solids = self.solids.iter().map(|solid| Solid {
            shape: solid.shape.seen_from(&then_from_now),
            height: solid.height,
        });
        let (begin_m, _) = self.reference.span_m();
        Self {
            name: self.name.clone(),
            is_recorded: self.is_recorded,
            known: Arc::clone(&self.known),
            solids: solids.collect(),
            movers: movers.collect(),
            reference: self
                .reference
                .seen_from(&then_from_now)
                .starting_at(begin_m - along_m),
            lanes_m: self.lanes_m.clone(),
            band_m: self.band_m,
            ego_from_reference: reference_from_now.then(&now_from_then),
            speed_m_per_s: self.speed_m_per_s,
        }
    }

    /// The vehicle's way over the last `history_s`, oldest first, the last one now. In a moment of a
    /// log there is nothing but now.
    pub fn trail(&self, history_s: f64, period_s: f64) -> Vec<Moment> {
        let history_s = if self.is_recorded { 0.0 } else { history_s };
        let mut trail: Vec<Moment> = (0..crate::config::MAX_SWEEPS)
            .map(|sweep| -(sweep as f64) * period_s)
            .take_while(|time_s| *time_s >= -history_s)
            .map(|time_s| Moment {
                time_s,
                pose: self.ego_at(time_s),
            })
            .collect();
        trail.reverse();
        trail
    }
}

#[cfg(test)]
mod tests;
