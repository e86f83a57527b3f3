//! How a vehicle goes on from where it stands.

use swath_bridge::{Pose2, Vehicle};
use swath_planner::after_arc;

use super::site::keep_off;
use super::{Scene, footprint};
use crate::config::GeneratorConfig;
use crate::shape::{Footprint, Shape};

/// How far a driver who is not boxed in can go on, in arcs of this length, metres.
const ARC_M: f64 = 3.0;
const ARCS: usize = 3;
/// Curvatures of the arcs that are tried, as shares of the limit; the likeliest first.
const BENDS: [f64; 5] = [0.0, 0.5, -0.5, 1.0, -1.0];
/// Distance between two footprints on the way, metres.
const STEP_M: f64 = 0.5;
/// What a map makes of an outline is wider by up to this, metres.
const CELL_M: f64 = 0.2;

impl Scene {
    /// The same as a moment of a drive: if the vehicle could not go on without reversing, nothing
    /// stands in the first metres of its way. Moments of logs stay as they were.
    #[must_use]
    pub(crate) fn on_a_drive(mut self, config: &GeneratorConfig) -> Self {
        if self.is_recorded || goes_on(&self, &config.vehicle) {
            return self;
        }
        let way: Vec<(f64, Footprint)> = ahead(&self, config).map(|ground| (0.0, ground)).collect();
        for solid in std::mem::take(&mut self.solids) {
            keep_off(&way, solid.shape, solid.height, &mut self.solids);
        }
        let stands_in = |shape: &Shape| way.iter().any(|(_, ground)| shape.touches(ground));
        self.movers.retain(|mover| !stands_in(&mover.shape_at(0.0)));
        self
    }
}

/// The ground of its first metres on, if it keeps to the reference, with room around it.
pub(super) fn ahead<'a>(
    scene: &'a Scene,
    config: &'a GeneratorConfig,
) -> impl Iterator<Item = Footprint> + 'a {
    steps(ARC_M * ARCS as f64).map(|along_m| {
        let pose = scene.ego_along(along_m);
        footprint(&config.vehicle, &pose).grown(config.ego.room_m)
    })
}

/// Whether some way of arcs that the vehicle can drive leads out of where it stands, forward.
pub(super) fn goes_on(scene: &Scene, vehicle: &Vehicle) -> bool {
    let curvature_per_m = vehicle.curvature_limit_per_m(scene.speed_m_per_s);
    goes_on_from(scene, (vehicle, curvature_per_m), &Pose2::default(), ARCS)
}

fn goes_on_from(
    scene: &Scene,
    (vehicle, curvature_per_m): (&Vehicle, f64),
    pose: &Pose2,
    arcs: usize,
) -> bool {
    arcs == 0
        || BENDS.iter().any(|bend| {
            let after = |along_m: f64| after_arc(pose, along_m, bend * curvature_per_m * along_m);
            let is_free =
                |along_m: f64| scene.is_free(&footprint(vehicle, &after(along_m)).grown(CELL_M));
            steps(ARC_M).all(is_free)
                && goes_on_from(scene, (vehicle, curvature_per_m), &after(ARC_M), arcs - 1)
        })
}

/// Distances up to a length, without 0.
fn steps(length_m: f64) -> impl Iterator<Item = f64> {
    (1_u32..)
        .map(|step| f64::from(step) * STEP_M)
        .take_while(move |&along_m| along_m <= length_m)
}
