//! From the state that reached the goal back to the start, and to poses that can be driven through.

use swath_bridge::{Outcome, Pose2};

use super::TargetResult;
use super::memory::{Parent, SearchMemory, State};
use crate::action::AHEAD;
use crate::collision::CollisionMap;

/// Farthest that two poses of a path may lie apart, metres.
pub(crate) const POSE_SPACING_M: f64 = 0.2;

/// The result whose path ends in `last`.
pub(super) fn trace(
    map: &CollisionMap,
    memory: &SearchMemory,
    last: State,
    steps: u64,
) -> TargetResult {
    let actions = actions_to(map, |state| memory.parent(state), last);
    along(map, &actions, steps)
}

/// The result of driving actions from the start.
pub(super) fn along(map: &CollisionMap, actions: &[u16], steps: u64) -> TargetResult {
    let model = map.model();
    let mut result = TargetResult {
        cost: 0.0,
        length_m: 0.0,
        ..TargetResult::without_path(Outcome::Solved, steps)
    };
    let mut heading = AHEAD;
    let mut cell = map.spec().ego();
    let (x_m, y_m) = map.spec().centre_of(cell);
    result
        .path
        .push(Pose2::new(x_m, y_m, yaw_rad(map, heading)));
    for &action in actions {
        let action = &model.table().actions()[usize::from(action)];
        let length_m = action.length_cells * model.resolution_m();
        result.length_m += length_m;
        result.cost += length_m + model.turn_rad(heading, action.direction).abs();
        let (from_x_m, from_y_m) = map.spec().centre_of(cell);
        cell.row += action.d_row;
        cell.col += action.d_col;
        let (to_x_m, to_y_m) = map.spec().centre_of(cell);
        let yaw_rad = yaw_rad(map, action.direction);
        if action.direction != heading {
            result.path.push(Pose2::new(from_x_m, from_y_m, yaw_rad));
        }
        heading = action.direction;
        // A hair of slack keeps a chord that is a multiple of the spacing from being cut once more.
        let pieces = libm::ceil(length_m / POSE_SPACING_M - 1e-9).max(1.0);
        let mut piece = 1.0;
        while piece < pieces {
            let share = piece / pieces;
            let x_m = from_x_m + share * (to_x_m - from_x_m);
            let y_m = from_y_m + share * (to_y_m - from_y_m);
            result.path.push(Pose2::new(x_m, y_m, yaw_rad));
            piece += 1.0;
        }
        result.path.push(Pose2::new(to_x_m, to_y_m, yaw_rad));
    }
    result
}

/// Heading of a direction, radians in (−π, π].
fn yaw_rad(map: &CollisionMap, direction: u8) -> f64 {
    swath_bridge::geometry::wrap_angle_rad(map.model().table().angle_rad(direction))
}

/// Actions from the start to a state, in driving order; `parent` tells how a state was reached.
pub(super) fn actions_to(
    map: &CollisionMap,
    parent: impl Fn(State) -> Parent,
    last: State,
) -> Vec<u16> {
    let spec = map.spec();
    let mut actions = Vec::new();
    let mut state = last;
    while let Some((number, from_direction)) = parent(state).step() {
        actions.push(number);
        let action = &map.model().table().actions()[usize::from(number)];
        let mut cell = spec.cell_of_index(state.cell());
        cell.row -= action.d_row;
        cell.col -= action.d_col;
        let Some(index) = spec.index_of(cell) else {
            break;
        };
        state = State::new(index, from_direction);
    }
    actions.reverse();
    actions
}
