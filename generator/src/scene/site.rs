//! A scene under construction, in the frame of its road.

use std::f64::consts::PI;
use std::sync::Arc;

use swath_bridge::Pose2;

use super::{Mover, Scene, SceneKind, footprint, pace};
use crate::config::{GeneratorConfig, Span};
use crate::course::Course;
use crate::dice::Dice;
use crate::shape::{Footprint, Height, Segment, Shape, Solid};

/// Most things of a scene, so that no configuration asks for all memory.
const MAX_SOLIDS: usize = 4000;

/// What a kind of scene decides beside its solids.
pub(super) struct Layout {
    /// The reference path; 0 along it is where the vehicle stands.
    pub reference: Course,
    /// Lanes, metres to the left of the reference.
    pub lanes_m: Vec<f64>,
    /// How far to either side one may drive.
    pub band_m: Span,
    /// A curvature that the scene needs beyond that of its reference, 1/m.
    pub curvature_per_m: f64,
    /// Scales the vehicle's offset and heading against the reference.
    pub ego_freedom: f64,
}

/// The things that stand and move, and chance.
pub(super) struct Site<'a> {
    pub config: &'a GeneratorConfig,
    pub dice: Dice,
    pub solids: Vec<Solid>,
    pub movers: Vec<Mover>,
    /// Edges of ground that is driven on: houses and walls stay off it.
    pub edges: Vec<Segment>,
}

impl<'a> Site<'a> {
    pub(super) fn new(config: &'a GeneratorConfig, dice: Dice) -> Self {
        Self {
            config,
            dice,
            solids: Vec::new(),
            movers: Vec::new(),
            edges: Vec::new(),
        }
    }

    /// Adds something.
    pub(super) fn add(&mut self, shape: Shape, height: Height) {
        if self.solids.len() < MAX_SOLIDS {
            self.solids.push(Solid { shape, height });
        }
    }

    /// Adds something tall.
    pub(super) fn add_tall(&mut self, shape: Shape) {
        self.add(shape, Height::Tall);
    }

    /// Adds a line through points, if there are at least two.
    pub(super) fn add_line(&mut self, points: Vec<[f64; 2]>, thickness_m: f64, height: Height) {
        if points.len() >= 2 {
            let shape = Shape::Line {
                points,
                thickness_m,
            };
            self.add(shape, height);
        }
    }

    /// Adds a rectangle, tall.
    pub(super) fn add_box(&mut self, centre: Pose2, length_m: f64, width_m: f64) {
        self.add_tall(Shape::Rectangle {
            centre,
            length_m,
            width_m,
        });
    }

    /// Adds a disc, tall.
    pub(super) fn add_disc(&mut self, centre: Pose2, radius_m: f64) {
        self.add_tall(Shape::Disc {
            centre: [centre.x_m, centre.y_m],
            radius_m,
        });
    }

    /// Length and width of a vehicle: mostly cars, some vans and lorries.
    pub(super) fn vehicle_size_m(&mut self) -> (f64, f64) {
        match self.dice.below(12) {
            0 => (
                self.dice.within(Span(6.5, 11.5)),
                self.dice.within(Span(2.3, 2.55)),
            ),
            1 | 2 => (
                self.dice.within(Span(4.9, 6.0)),
                self.dice.within(Span(1.9, 2.1)),
            ),
            _ => (
                self.dice.within(Span(3.7, 4.9)),
                self.dice.within(Span(1.65, 1.92)),
            ),
        }
    }

    /// Whether a rectangle would stand clear of every other one by a margin.
    pub(super) fn has_room_for(&self, centre: &Pose2, size_m: (f64, f64), margin_m: f64) -> bool {
        let wanted = Footprint {
            pose: *centre,
            front_m: 0.5 * size_m.0,
            rear_m: 0.5 * size_m.0,
            half_width_m: 0.5 * size_m.1,
        }
        .grown(margin_m);
        let is_clear = |shape: &Shape| match shape {
            Shape::Rectangle { centre: other, .. } if other.distance_m(centre) > 16.0 => true,
            Shape::Rectangle { .. } => !shape.touches(&wanted),
            _ => true,
        };
        self.solids.iter().all(|solid| is_clear(&solid.shape))
            && self
                .movers
                .iter()
                .all(|mover| is_clear(&mover.shape_at(0.0)))
    }

    /// Puts the vehicle beside the reference and hands the scene out in its frame.
    pub(super) fn finish(mut self, kind: SceneKind, layout: Layout) -> Scene {
        let ego = &self.config.ego;
        let ego_from_reference = Pose2::new(
            0.0,
            (self.dice.bell() * ego.offset_m).clamp(-0.7, 0.7) * layout.ego_freedom,
            (self.dice.bell() * ego.heading_rad).clamp(-0.3 * PI, 0.3 * PI) * layout.ego_freedom,
        );
        let bend = (0..18)
            .map(|step| {
                layout
                    .reference
                    .curvature_per_m(f64::from(step) * 2.5)
                    .abs()
            })
            .fold(layout.curvature_per_m, f64::max);
        let speed_m_per_s = pace::draw(&mut self.dice, self.config, 1.5 * bend + 0.01);
        let road_from_vehicle = layout.reference.at(0.0).then(&ego_from_reference);
        let vehicle_from_road = road_from_vehicle.inverse();
        let mut scene = Scene {
            name: kind.name().to_owned(),
            is_recorded: false,
            known: Arc::from([]),
            solids: Vec::new(),
            movers: Vec::new(),
            reference: layout.reference.seen_from(&vehicle_from_road),
            lanes_m: layout.lanes_m,
            band_m: layout.band_m,
            ego_from_reference,
            speed_m_per_s,
        };
        let way = way_here(&scene, self.config);
        for solid in &self.solids {
            let shape = solid.shape.seen_from(&vehicle_from_road);
            keep_off(&way, shape, solid.height, &mut scene.solids);
        }
        for mover in &self.movers {
            let mover = Mover {
                pose: vehicle_from_road.then(&mover.pose),
                ..*mover
            };
            let collides = way
                .iter()
                .any(|(time_s, footprint)| mover.shape_at(*time_s).touches(footprint));
            if !collides {
                scene.movers.push(mover);
            }
        }
        scene
    }
}

/// The ground that the vehicle has stood on over the last seconds, with room around it.
fn way_here(scene: &Scene, config: &GeneratorConfig) -> Vec<(f64, Footprint)> {
    const STEP_S: f64 = 0.5;
    scene
        .trail(config.lidar.history_s + STEP_S, STEP_S)
        .into_iter()
        .map(|moment| {
            let here = footprint(&config.vehicle, &moment.pose).grown(config.ego.room_m);
            (moment.time_s, here)
        })
        .collect()
}

/// Keeps a shape if it stands clear of the way; of a line, the pieces that do.
pub(super) fn keep_off(
    way: &[(f64, Footprint)],
    shape: Shape,
    height: Height,
    kept: &mut Vec<Solid>,
) {
    if !way.iter().any(|(_, footprint)| shape.touches(footprint)) {
        kept.push(Solid { shape, height });
        return;
    }
    let Shape::Line {
        points,
        thickness_m,
    } = shape
    else {
        return;
    };
    for pair in points.windows(2) {
        let piece = Shape::Line {
            points: pair.to_vec(),
            thickness_m,
        };
        if !way.iter().any(|(_, footprint)| piece.touches(footprint)) {
            kept.push(Solid {
                shape: piece,
                height,
            });
        }
    }
}
