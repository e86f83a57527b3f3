use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};
use std::f64::consts::PI;
use std::sync::Arc;

use proptest::prelude::*;
use swath_bridge::{Cell, GridSpec, Vehicle};

use super::*;
use crate::Plane;
use crate::motion::MotionModel;

mod bounds;

/// Dijkstra over the same graph, made anew from its definition: offsets, exact angles, and rectangles
/// tested against each occupied square by separating axes.
struct Oracle {
    spec: GridSpec,
    vehicle: Vehicle,
    occupied: Vec<Cell>,
    /// Directions as reduced offsets with their angles, ascending.
    directions: Vec<((i32, i32), f64)>,
    curvature_per_m: f64,
}

fn gcd(a: i32, b: i32) -> i32 {
    if b == 0 { a.abs() } else { gcd(b, a % b) }
}

fn angle_of((d_row, d_col): (i32, i32)) -> f64 {
    f64::from(-d_col).atan2(f64::from(-d_row))
}

fn difference(a: f64, b: f64) -> f64 {
    let d = (a - b).rem_euclid(2.0 * PI);
    if d > PI { d - 2.0 * PI } else { d }
}

impl Oracle {
    fn new(spec: GridSpec, vehicle: &Vehicle, occupied: Vec<Cell>, speed: f64) -> Self {
        let mut directions = Vec::new();
        for d_row in -10..=10i32 {
            for d_col in -10..=10i32 {
                if gcd(d_row, d_col) == 1 {
                    directions.push(((d_row, d_col), angle_of((d_row, d_col))));
                }
            }
        }
        directions.sort_by(|a, b| a.1.total_cmp(&b.1));
        let curvature_per_m = (2.0 / (speed * speed)).min(1.0 / vehicle.min_turning_radius_m);
        Self {
            spec,
            vehicle: *vehicle,
            occupied,
            directions,
            curvature_per_m,
        }
    }

    fn corners(&self, at: (f64, f64), yaw: f64, ahead_m: f64) -> [(f64, f64); 4] {
        let v = &self.vehicle;
        let (front, rear) = (v.front_m + ahead_m, -v.rear_m);
        [
            (front, v.half_width_m),
            (front, -v.half_width_m),
            (rear, -v.half_width_m),
            (rear, v.half_width_m),
        ]
        .map(|(x, y)| {
            (
                at.0 + yaw.cos() * x - yaw.sin() * y,
                at.1 + yaw.sin() * x + yaw.cos() * y,
            )
        })
    }

    fn hits(&self, at: (f64, f64), yaw: f64, ahead_m: f64) -> bool {
        let rectangle = self.corners(at, yaw, ahead_m);
        self.occupied.iter().any(|&cell| {
            let (x, y) = self.spec.centre_of(cell);
            let h = self.spec.resolution_m / 2.0;
            let square = [
                (x + h, y + h),
                (x + h, y - h),
                (x - h, y - h),
                (x - h, y + h),
            ];
            let axes = [
                (1.0, 0.0),
                (0.0, 1.0),
                (yaw.cos(), yaw.sin()),
                (-yaw.sin(), yaw.cos()),
            ];
            axes.iter().all(|axis| {
                let along = |points: &[(f64, f64); 4]| {
                    let values = points.map(|p| p.0 * axis.0 + p.1 * axis.1);
                    (
                        values.iter().copied().fold(f64::INFINITY, f64::min),
                        values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
                    )
                };
                let ((low, high), (other_low, other_high)) = (along(&rectangle), along(&square));
                low <= other_high && other_low <= high
            })
        })
    }

    fn turn_hits(&self, at: (f64, f64), from: f64, turn: f64) -> bool {
        let pieces = (turn.abs() / 0.002).ceil().max(1.0);
        let mut piece = 0.0;
        while piece <= pieces {
            if self.hits(at, from + turn * piece / pieces, 0.0) {
                return true;
            }
            piece += 1.0;
        }
        false
    }

    fn neighbours(&self, (cell, heading): (Cell, usize)) -> Vec<((Cell, usize), f64)> {
        let (reduced, from) = self.directions[heading];
        let count = self.directions.len();
        let mut found = Vec::new();
        for (index, &((d_row, d_col), angle)) in self.directions.iter().enumerate() {
            let turn = difference(angle, from);
            let is_next = (index + 1) % count == heading || (heading + 1) % count == index;
            if turn.abs() > 1.6 {
                continue;
            }
            let repeats_unit = d_row == 0 || d_col == 0 || d_row.abs() == d_col.abs();
            for k in 1..=10 {
                if d_row.abs().max(d_col.abs()) * k > 10 || (k > 1 && repeats_unit) {
                    break;
                }
                let unit =
                    |offset: (i32, i32)| f64::from(offset.0).hypot(f64::from(offset.1)) * 0.2;
                let length_m = unit((d_row * k, d_col * k));
                let limit = self.curvature_per_m * (unit(reduced) + length_m) / 2.0;
                let to = Cell::new(cell.row + d_row * k, cell.col + d_col * k);
                if self.spec.index_of(to).is_none()
                    || (turn.abs() > limit && index != heading && !is_next)
                {
                    continue;
                }
                let at = self.spec.centre_of(cell);
                if self.turn_hits(at, from, turn) || self.hits(at, angle, length_m) {
                    continue;
                }
                found.push(((to, index), length_m + turn.abs()));
            }
        }
        found
    }

    /// The optimal cost to a goal, if it can be reached.
    fn cost_to(&self, goal: &Pose2) -> Option<f64> {
        let ahead = self.directions.iter().position(|d| d.0 == (-1, 0)).unwrap();
        let start = (self.spec.ego(), ahead);
        let mut best = BTreeMap::from([(start, 0.0)]);
        let mut open = BinaryHeap::from([(Reverse(0u64), start)]);
        while let Some((Reverse(bits), state)) = open.pop() {
            let cost = f64::from_bits(bits);
            if cost > best[&state] {
                continue;
            }
            let (x, y) = self.spec.centre_of(state.0);
            let turn = difference(self.directions[state.1].1, goal.yaw_rad).abs();
            if (x - goal.x_m).hypot(y - goal.y_m) <= 0.5 && turn <= 15f64.to_radians() {
                return Some(cost);
            }
            for (next, step) in self.neighbours(state) {
                let new_cost = cost + step;
                if best.get(&next).is_none_or(|&known| new_cost < known) {
                    best.insert(next, new_cost);
                    open.push((Reverse(new_cost.to_bits()), next));
                }
            }
        }
        None
    }
}

fn small_vehicle() -> Vehicle {
    Vehicle {
        wheelbase_m: 0.4,
        front_m: 0.52,
        rear_m: 0.17,
        half_width_m: 0.23,
        min_turning_radius_m: 2.0,
        ..Vehicle::default()
    }
    .with_limits_of_its_size()
}

fn small_spec() -> GridSpec {
    GridSpec {
        rows: 22,
        cols: 17,
        resolution_m: 0.2,
        ego_row: 18,
        ego_col: 8,
    }
}

fn scene() -> impl Strategy<Value = (Vec<Cell>, Pose2)> {
    let cell = (0i32..15, 0i32..17).prop_map(|(row, col)| Cell::new(row, col));
    let goal = (0.8..3.2f64, -1.2..1.2f64, -1.2..1.2f64);
    (proptest::collection::vec(cell, 0..14), goal)
        .prop_map(|(cells, (x, y, yaw))| (cells, Pose2::new(x, y, yaw)))
}

fn map_with(spec: GridSpec, vehicle: &Vehicle, occupied: &[Cell]) -> CollisionMap {
    let model = Arc::new(MotionModel::new(vehicle, spec.resolution_m).unwrap());
    let mut obstacles = Plane::empty(spec.rows, spec.cols);
    for &cell in occupied {
        obstacles.set(cell);
    }
    CollisionMap::new(model, spec, &obstacles).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn tiev_finds_the_cost_that_dijkstra_finds((occupied, goal) in scene()) {
        let (spec, vehicle) = (small_spec(), small_vehicle());
        let map = map_with(spec, &vehicle, &occupied);
        let successors = map.model().successors(1.4);
        let mut memory = SearchMemory::new();
        let found =
            search(&map, &successors, (&goal, Guidance::NONE), Limits::default(), &mut memory).unwrap();
        let oracle = Oracle::new(spec, &vehicle, occupied, 1.4);
        if let Some(cost) = oracle.cost_to(&goal) {
            prop_assert_eq!(found.outcome, Outcome::Solved);
            prop_assert!((found.cost - cost).abs() < 1e-4, "{} against {cost}", found.cost);
        } else {
            prop_assert_ne!(found.outcome, Outcome::Solved);
        }
    }

    #[test]
    fn every_path_starts_at_the_vehicle_reaches_the_goal_and_hits_nothing(
        (occupied, goal) in scene(), weight in 0.1..1.0f64, seed: u8,
    ) {
        let (spec, vehicle) = (small_spec(), small_vehicle());
        let map = map_with(spec, &vehicle, &occupied);
        let successors = map.model().successors(1.4);
        let mut cells = Plane::empty(spec.rows, spec.cols);
        for index in 0..spec.len() {
            if (index * usize::from(seed)) % 7 < 3 {
                cells.set_index(index);
            }
        }
        let oracle = Oracle::new(spec, &vehicle, occupied, 1.4);
        let mut memory = SearchMemory::new();
        for region in [Guidance::NONE, Guidance::inside(&cells, weight)] {
            let found =
                search(&map, &successors, (&goal, region), Limits::default(), &mut memory).unwrap();
            if found.outcome != Outcome::Solved {
                prop_assert!(found.path.is_empty() && found.cost.is_nan());
                continue;
            }
            prop_assert_eq!(found.path[0], Pose2::new(0.0, 0.0, 0.0));
            let last = found.path[found.path.len() - 1];
            prop_assert!(last.distance_m(&goal) <= 0.5);
            prop_assert!(difference(last.yaw_rad, goal.yaw_rad).abs() <= 15f64.to_radians());
            let (mut length_m, mut turned_rad) = (0.0, 0.0);
            for pair in found.path.windows(2) {
                let step_m = pair[0].distance_m(&pair[1]);
                let turn = difference(pair[1].yaw_rad, pair[0].yaw_rad);
                length_m += step_m;
                turned_rad += turn.abs();
                prop_assert!(step_m <= 0.2 + 1e-9);
                prop_assert!(step_m == 0.0 || turn == 0.0, "a pose both moves and turns");
                prop_assert!(!oracle.turn_hits((pair[0].x_m, pair[0].y_m), pair[0].yaw_rad, turn));
                prop_assert!(!oracle.hits((pair[0].x_m, pair[0].y_m), pair[1].yaw_rad, step_m));
            }
            prop_assert!((length_m - found.length_m).abs() < 1e-6);
            prop_assert!((length_m + turned_rad - found.cost).abs() < 1e-6);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// `tiev_finds_the_cost_that_dijkstra_finds` holds the one, this the other to it.
    #[test]
    fn neither_the_informed_bound_nor_going_backwards_changes_outcome_or_cost(
        (occupied, goal) in scene(), back in any::<bool>(), limit_m in 0.3..4.0f64,
    ) {
        let vehicle = Vehicle { min_turning_radius_m: limit_m, ..small_vehicle() }
            .with_limits_of_its_size();
        // Coarse cells allow sharper turns, up to turning around.
        let spec = GridSpec { resolution_m: if back { 0.8 } else { 0.2 }, ..small_spec() };
        let goal = Pose2::new(goal.x_m, goal.y_m, goal.yaw_rad + if back { PI } else { 0.0 });
        let map = map_with(spec, &vehicle, &occupied);
        let successors = map.model().successors(0.5);
        let mut memory = SearchMemory::new();
        let run = |bound, memory: &mut SearchMemory| {
            search_bounded(&map, &successors, (&goal, bound), Limits::default(), memory).unwrap()
        };
        let plain = run(Bound::Euclidean, &mut memory);
        let informed = run(Bound::Informed, &mut memory);
        prop_assert_eq!(informed.outcome, plain.outcome);
        if plain.outcome == Outcome::Solved {
            prop_assert!((informed.cost - plain.cost).abs() < 1e-4);
        }
        let goal_states = Goal::new(&map, &goal);
        if let Ok(goal_states) = goal_states {
            let mut backward = backward::Backward::default();
            let mut look = |most| backward.search(&map, &successors, &goal_states, most);
            let expected = if plain.outcome == Outcome::Solved {
                Finding::Reachable
            } else {
                Finding::Unreachable
            };
            prop_assert_eq!(look(usize::MAX), expected);
            let few = look(40);
            prop_assert!(few == expected || few == Finding::Unknown);
        }
        // The memory of an informed search leaves no trace in a plain one.
        let again =
            search(&map, &successors, (&goal, Guidance::NONE), Limits::default(), &mut memory).unwrap();
        prop_assert_eq!(again.steps, plain.steps);
    }
}

#[test]
fn a_whole_region_of_weight_one_changes_nothing_and_a_narrow_one_saves_steps() {
    let spec = GridSpec::default();
    let map = map_with(
        spec,
        &Vehicle::default(),
        &[Cell::new(200, 75), Cell::new(200, 76)],
    );
    let successors = map.model().successors(1.4);
    let goal = Pose2::new(40.0, 0.0, 0.0);
    let mut memory = SearchMemory::new();
    let mut run = |region| {
        search(
            &map,
            &successors,
            (&goal, region),
            Limits::default(),
            &mut memory,
        )
        .unwrap()
    };
    let plain = run(Guidance::NONE);
    let mut everywhere = Plane::empty(spec.rows, spec.cols);
    (0..spec.len()).for_each(|index| everywhere.set_index(index));
    assert_eq!(run(Guidance::inside(&everywhere, 1.0)), plain);
    let mut strip = Plane::empty(spec.rows, spec.cols);
    strip.draw_line(&spec, &plain.path, 1.4);
    let guided = run(Guidance::inside(&strip, 0.15));
    assert_eq!(guided.outcome, Outcome::Solved);
    assert!(
        guided.steps < plain.steps,
        "{} against {}",
        guided.steps,
        plain.steps
    );
}

#[test]
fn outcomes_tell_why_there_is_no_path() {
    let spec = small_spec();
    let run = |occupied: &[Cell], goal: Pose2, limits: Limits<'_>| {
        let map = map_with(spec, &small_vehicle(), occupied);
        let successors = map.model().successors(1.4);
        let mut memory = SearchMemory::new();
        search(
            &map,
            &successors,
            (&goal, Guidance::NONE),
            limits,
            &mut memory,
        )
        .unwrap()
        .outcome
    };
    let goal = Pose2::new(2.0, 0.0, 0.0);
    let none = Limits::default();
    assert_eq!(run(&[], goal, none), Outcome::Solved);
    assert_eq!(run(&[spec.ego()], goal, none), Outcome::StartOccupied);
    assert_eq!(
        run(&[], Pose2::new(9.0, 0.0, 0.0), none),
        Outcome::OutOfBounds
    );
    assert_eq!(
        run(&[], Pose2::new(f64::NAN, 0.0, 0.0), none),
        Outcome::OutOfBounds
    );
    let around_goal: Vec<Cell> = (4..13)
        .flat_map(|row| (4..13).map(move |col| Cell::new(row, col)))
        .collect();
    assert_eq!(run(&around_goal, goal, none), Outcome::GoalOccupied);
    let wall: Vec<Cell> = (0..17).map(|col| Cell::new(12, col)).collect();
    assert_eq!(
        run(&wall, Pose2::new(2.6, 0.0, 0.0), none),
        Outcome::Unreachable
    );
    let few = Limits {
        max_expansions: Some(3),
        ..none
    };
    assert_eq!(run(&[], goal, few), Outcome::BudgetExhausted);
    let stop = || Some(Outcome::Cancelled);
    let stopped = Limits {
        stop: Some(&stop),
        ..none
    };
    assert_eq!(
        run(&wall, Pose2::new(2.6, 0.0, 0.0), stopped),
        Outcome::Cancelled
    );
}

#[test]
fn regions_that_do_not_fit_are_refused() {
    let map = map_with(small_spec(), &small_vehicle(), &[]);
    let successors = map.model().successors(1.4);
    let mut memory = SearchMemory::new();
    let goal = Pose2::new(2.0, 0.0, 0.0);
    let small = Plane::empty(3, 3);
    let fitting = Plane::empty(22, 17);
    for (cells, weight) in [(&small, 0.5), (&fitting, 0.0), (&fitting, f64::NAN)] {
        let region = Guidance::inside(cells, weight);
        let found = search(
            &map,
            &successors,
            (&goal, region),
            Limits::default(),
            &mut memory,
        );
        assert!(found.is_err());
    }
}
