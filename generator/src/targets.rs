//! Targets along and across the reference path.

use swath_bridge::{GridSpec, Pose2};

use crate::config::GeneratorConfig;
use crate::dice::Dice;
use crate::scene::{Scene, footprint};

/// Most tries to find a target that can be stood on.
const MAX_TRIES: usize = 40;
/// Room around a target's footprint, metres.
const ROOM_M: f64 = 0.25;

/// Chooses one of the targets that lie at equal distances along and across the reference.
///
/// Most targets are places where the vehicle could stand, on ground that is driven on; a small share
/// may be anywhere, so that unsolvable ones are seen as well. Without a free place the last try is
/// taken as it is.
pub(crate) fn choose(scene: &Scene, config: &GeneratorConfig, dice: &mut Dice) -> Pose2 {
    let may_be_anywhere = dice.chance(config.targets.anywhere_share);
    let mut target = Pose2::default();
    for _ in 0..MAX_TRIES {
        let (along_m, left_m) = draw_place(config, dice);
        target = scene.reference.beside(along_m, left_m);
        if !is_inside(&config.grid, &target) {
            continue;
        }
        let is_on_road = left_m >= scene.band_m.0 && left_m <= scene.band_m.1;
        let is_in_reach = (left_m - scene.ego_from_reference.y_m).abs()
            <= farthest_aside_m(scene, config, along_m);
        let stand = footprint(&config.vehicle, &target).grown(ROOM_M);
        if may_be_anywhere || (is_on_road && is_in_reach && scene.is_free(&stand)) {
            return target;
        }
    }
    target
}

/// How far the vehicle can get to a side over a distance along: an arc there and an arc back.
fn farthest_aside_m(scene: &Scene, config: &GeneratorConfig, along_m: f64) -> f64 {
    let curvature_per_m = config.vehicle.curvature_limit_per_m(scene.speed_m_per_s);
    0.25 * along_m * along_m * curvature_per_m
}

/// A row and a column of the targets: metres along and to the left.
fn draw_place(config: &GeneratorConfig, dice: &mut Dice) -> (f64, f64) {
    let targets = &config.targets;
    let (nearest_m, farthest_m) = (targets.along_m.0, targets.along_m.1);
    let rows = steps(farthest_m - nearest_m, targets.along_step_m) + 1;
    let columns = steps(targets.across_m, targets.across_step_m);
    let row = dice.below(rows);
    let column = dice.below(2 * columns + 1);
    let left_m = (column as f64 - columns as f64) * targets.across_step_m;
    (nearest_m + row as f64 * targets.along_step_m, left_m)
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "float to integer casts saturate, and validation bounds both numbers"
)]
fn steps(length_m: f64, step_m: f64) -> usize {
    (length_m.max(0.0) / step_m + 1e-9) as usize
}

/// Whether a pose lies on the grid, a metre from its edge.
fn is_inside(grid: &GridSpec, pose: &Pose2) -> bool {
    const MARGIN_M: f64 = 1.0;
    [(MARGIN_M, MARGIN_M), (-MARGIN_M, -MARGIN_M)]
        .into_iter()
        .all(|(dx, dy)| {
            let cell = grid.cell_at(pose.x_m + dx, pose.y_m + dy);
            grid.index_of(cell).is_some()
        })
}
