//! Augmentation as in the paper: added vehicles and a shifted reference.
//!
//! Added vehicles stand along the reference path and its parallels. The lidar sees them with the rest
//! of the scene, so only the faces that it can see are drawn, and they hide what is behind them. On
//! the map of a log they hide nothing that is known already: the map remembers it from before.

use swath_bridge::{Pose2, Vehicle};

use crate::config::GeneratorConfig;
use crate::dice::Dice;
use crate::scene::{Scene, footprint};
use crate::shape::{Footprint, Height, Shape, Solid};

/// Adds vehicles to a scene. None stands on the vehicle or on its target.
pub(crate) fn add_vehicles(
    scene: &mut Scene,
    target: &Pose2,
    config: &GeneratorConfig,
    dice: &mut Dice,
) {
    let kept_free = kept_free(&config.vehicle, target, config.ego.room_m);
    for _ in 0..dice.count(config.augment.vehicles) {
        let along_m = dice.within(config.augment.along_m);
        let lane_m = scene.lanes_m[dice.below(scene.lanes_m.len())];
        let left_m = lane_m + config.augment.offset_m * dice.bell();
        let mut centre = scene.reference.beside(along_m, left_m);
        centre.yaw_rad += config.augment.heading_rad * dice.bell();
        let (length_m, width_m) = size_m(dice);
        let shape = Shape::Rectangle {
            centre,
            length_m,
            width_m,
        };
        let stand = Footprint {
            pose: centre,
            front_m: 0.5 * length_m,
            rear_m: 0.5 * length_m,
            half_width_m: 0.5 * width_m,
        };
        let is_wanted = !kept_free.iter().any(|free| shape.touches(free));
        if is_wanted && scene.is_free(&stand.grown(0.3)) {
            scene.solids.push(Solid {
                shape,
                height: Height::Tall,
            });
        }
    }
}

fn kept_free(vehicle: &Vehicle, target: &Pose2, room_m: f64) -> [Footprint; 2] {
    [Pose2::default(), *target].map(|pose| footprint(vehicle, &pose).grown(room_m.max(0.3)))
}

/// Length and width of an added vehicle.
fn size_m(dice: &mut Dice) -> (f64, f64) {
    use crate::config::Span;
    if dice.chance(0.15) {
        (dice.within(Span(5.0, 9.0)), dice.within(Span(2.0, 2.5)))
    } else {
        (dice.within(Span(3.8, 4.9)), dice.within(Span(1.65, 1.95)))
    }
}

/// The reference as an inaccurate localisation gives it: shifted along and across and turned about
/// the vehicle, perhaps without the part behind the vehicle.
pub(crate) fn shifted_reference(
    scene: &Scene,
    config: &GeneratorConfig,
    dice: &mut Dice,
) -> Vec<Pose2> {
    let augment = &config.augment;
    let shift = Pose2::new(
        augment.shift_along_m * dice.bell(),
        augment.shift_across_m * dice.bell(),
        augment.shift_rad * dice.bell(),
    );
    let is_cut = dice.chance(augment.cut_share);
    reference_poses(scene, is_cut)
        .iter()
        .map(|pose| shift.then(pose))
        .collect()
}

/// The reference a metre at a time, as far as any grid may reach.
pub(crate) fn reference_poses(scene: &Scene, is_cut: bool) -> Vec<Pose2> {
    const FARTHEST_M: f64 = 90.0;
    let (begin_m, end_m) = scene.reference.span_m();
    let mut along_m = if is_cut { begin_m.max(0.0) } else { begin_m };
    let end_m = end_m.min(FARTHEST_M);
    let mut poses = Vec::new();
    while along_m < end_m {
        poses.push(scene.reference.at(along_m));
        along_m += 1.0;
    }
    poses.push(scene.reference.at(end_m));
    poses
}
