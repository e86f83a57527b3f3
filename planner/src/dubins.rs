//! The shortest path of a forward-only car of bounded curvature between two poses in the open, after
//! L. Dubins (1957): the best of six words of arcs and straight lines.

use swath_bridge::Pose2;
use swath_bridge::geometry::wrap_angle_rad;

use crate::segment::{Segment, cost_of};

/// Most steps of a path that is given.
const MAX_POSES: f64 = 50_000.0;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Turn {
    Left,
    Straight,
    Right,
}

impl Turn {
    const fn sign(self) -> f64 {
        match self {
            Self::Left => 1.0,
            Self::Straight => 0.0,
            Self::Right => -1.0,
        }
    }
}

use Turn::{Left, Right, Straight};

const WORDS: [[Turn; 3]; 6] = [
    [Left, Straight, Left],
    [Right, Straight, Right],
    [Left, Straight, Right],
    [Right, Straight, Left],
    [Right, Left, Right],
    [Left, Right, Left],
];

/// A path of three parts, lengths in turning radii.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Word {
    turns: [Turn; 3],
    lengths: [f64; 3],
}

impl Word {
    fn length(&self) -> f64 {
        self.lengths.iter().sum()
    }
}

/// The shortest path from `from` to `to` with turns of at least `radius_m`, as poses at most `step_m`
/// apart; empty if an argument is not finite, radius or step not positive or the way absurdly long.
///
/// Of words of the same length the first in the order LSL, RSR, LSR, RSL, RLR, LRL is taken.
pub fn shortest_path(from: &Pose2, to: &Pose2, radius_m: f64, step_m: f64) -> Vec<Pose2> {
    let positive = |value: f64| value > 0.0 && value.is_finite();
    if !(from.is_finite() && to.is_finite() && positive(radius_m) && positive(step_m)) {
        return Vec::new();
    }
    let there = from.inverse().then(to);
    let goal = Pose2::new(there.x_m / radius_m, there.y_m / radius_m, there.yaw_rad);
    let words = WORDS.iter().filter_map(|&turns| word(turns, &goal));
    let best = words.fold(None, |best: Option<Word>, word| match best {
        Some(best) if best.length() <= word.length() => Some(best),
        _ => Some(word),
    });
    match best {
        Some(best) if best.length() * radius_m <= MAX_POSES * step_m => {
            sample(from, &best, radius_m, step_m)
        }
        _ => Vec::new(),
    }
}

/// The drive from `from` to `to` whose metres and radians add up to the least, with turns of `radius_m`;
/// none if an argument is not finite or the radius not positive.
///
/// That need not be the shortest: three arcs may be shorter than two with a straight line between, and
/// turn more.
pub(crate) fn cheapest(from: &Pose2, to: &Pose2, radius_m: f64) -> Option<[Segment; 3]> {
    if !(from.is_finite() && to.is_finite() && radius_m > 0.0 && radius_m.is_finite()) {
        return None;
    }
    let there = from.inverse().then(to);
    let goal = Pose2::new(there.x_m / radius_m, there.y_m / radius_m, there.yaw_rad);
    let segment = |turn: Turn, length: f64| Segment {
        curvature_per_m: turn.sign() / radius_m,
        length_m: length * radius_m,
    };
    let drives = WORDS.iter().filter_map(|&turns| {
        let word = word(turns, &goal)?;
        let [first, middle, last] = [0, 1, 2].map(|k| segment(turns[k], word.lengths[k]));
        Some([first, middle, last])
    });
    drives.min_by(|a, b| cost_of(a).total_cmp(&cost_of(b)))
}

/// The heading with which an arc of `radius_m` and a straight line from a pose arrive at a point; none if
/// the point lies inside the circle.
pub(crate) fn arrival_yaw_rad(from: &Pose2, (x_m, y_m): (f64, f64), radius_m: f64) -> Option<f64> {
    let there = from.inverse().then(&Pose2::new(x_m, y_m, 0.0));
    let side = if there.y_m < 0.0 { -1.0 } else { 1.0 };
    // From the circle's centre, mirrored to the left.
    let (dx_m, dy_m) = (there.x_m, there.y_m.abs() - radius_m);
    let square = dx_m * dx_m + dy_m * dy_m - radius_m * radius_m;
    (square >= 0.0).then(|| {
        let turn_rad = libm::atan2(dy_m, dx_m) + libm::atan2(radius_m, libm::sqrt(square));
        wrap_angle_rad(from.yaw_rad + side * turn_rad)
    })
}

/// The lengths of a word's parts from the origin to `goal` (in turning radii), if it leads there.
fn word(turns: [Turn; 3], goal: &Pose2) -> Option<Word> {
    let [first, middle, last] = turns;
    // Centres of the first and the last circle, to the left or right of the poses.
    let start = (0.0, first.sign());
    let (sin, cos) = libm::sincos(goal.yaw_rad);
    let end = (goal.x_m - last.sign() * sin, goal.y_m + last.sign() * cos);
    let (dx, dy) = (end.0 - start.0, end.1 - start.1);
    let distance = libm::hypot(dx, dy);
    let direction = libm::atan2(dy, dx);
    let (heading, middle_length) = if middle == Straight {
        if first == last {
            (direction, distance)
        } else {
            let square = distance * distance - 4.0;
            if square < 0.0 {
                return None;
            }
            let straight = libm::sqrt(square);
            (
                direction + first.sign() * libm::atan2(2.0, straight),
                straight,
            )
        }
    } else {
        if distance > 4.0 {
            return None;
        }
        // The middle circle touches both; the car runs along it the long way round.
        let half = libm::acos(distance / 4.0);
        let heading = direction + first.sign() * (std::f64::consts::FRAC_PI_2 + half);
        (heading, std::f64::consts::PI + 2.0 * half)
    };
    let after_middle = heading + middle.sign() * middle_length;
    Some(Word {
        turns,
        lengths: [
            positive_turn(first.sign() * heading),
            middle_length,
            positive_turn(last.sign() * (goal.yaw_rad - after_middle)),
        ],
    })
}

/// The same angle in [0, 2π); what is short of a full turn by rounding only is 0.
fn positive_turn(angle_rad: f64) -> f64 {
    const ROUNDING: f64 = 1e-9;
    let wrapped = wrap_angle_rad(angle_rad);
    if wrapped < -ROUNDING {
        wrapped + std::f64::consts::TAU
    } else {
        wrapped.max(0.0)
    }
}

fn sample(from: &Pose2, word: &Word, radius_m: f64, step_m: f64) -> Vec<Pose2> {
    let mut poses = vec![*from];
    let mut begin = *from;
    for (turn, length) in word.turns.iter().zip(word.lengths) {
        let length_m = length * radius_m;
        let steps = (length_m / step_m).ceil().max(1.0);
        let mut done = 0.0;
        while done < steps {
            done += 1.0;
            poses.push(begin.then(&along(*turn, length * done / steps, radius_m)));
        }
        begin = begin.then(&along(*turn, length, radius_m));
    }
    poses
}

/// The pose after `length` (in turning radii) of one part from the origin.
fn along(turn: Turn, length: f64, radius_m: f64) -> Pose2 {
    if turn == Straight {
        return Pose2::new(length * radius_m, 0.0, 0.0);
    }
    let (sin, cos) = libm::sincos(length);
    Pose2::new(
        radius_m * sin,
        turn.sign() * radius_m * (1.0 - cos),
        wrap_angle_rad(turn.sign() * length),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    const STEP_M: f64 = 0.2;

    fn length_m(path: &[Pose2]) -> f64 {
        path.windows(2)
            .map(|pair| pair[0].distance_m(&pair[1]))
            .sum()
    }

    fn length_of(turns: [Turn; 3], goal: &Pose2) -> Option<f64> {
        word(turns, goal).map(|word| word.length())
    }

    #[test]
    fn known_paths_have_their_known_lengths() {
        let origin = Pose2::default();
        let straight = shortest_path(&origin, &Pose2::new(20.0, 0.0, 0.0), 5.5, STEP_M);
        assert!((length_m(&straight) - 20.0).abs() < 1e-9);
        assert!(straight.iter().all(|pose| pose.y_m.abs() < 1e-9));
        let quarter = shortest_path(&origin, &Pose2::new(5.0, 5.0, FRAC_PI_2), 5.0, STEP_M);
        assert!((length_m(&quarter) - 5.0 * FRAC_PI_2).abs() < 0.01);
        let turn_round = shortest_path(&origin, &Pose2::new(0.0, 10.0, PI), 5.0, STEP_M);
        assert!((length_m(&turn_round) - 5.0 * PI).abs() < 0.02);
    }

    #[test]
    fn a_turn_on_the_spot_takes_three_arcs() {
        let about = Pose2::new(0.0, 0.0, PI);
        let three_arcs = length_of([Right, Left, Right], &about).unwrap();
        assert!((three_arcs - 7.0 * PI / 3.0).abs() < 1e-9);
        let path = shortest_path(&Pose2::default(), &about, 1.0, STEP_M);
        assert!((length_m(&path) - 7.0 * PI / 3.0).abs() < 0.1);
    }

    #[test]
    fn senseless_arguments_give_no_path() {
        let origin = Pose2::default();
        assert!(shortest_path(&origin, &Pose2::new(f64::NAN, 0.0, 0.0), 5.0, STEP_M).is_empty());
        assert!(shortest_path(&origin, &Pose2::new(1.0, 0.0, 0.0), 0.0, STEP_M).is_empty());
        assert!(shortest_path(&origin, &Pose2::new(1e12, 0.0, 0.0), 5.0, STEP_M).is_empty());
        assert!(shortest_path(&origin, &Pose2::new(1.0, 0.0, 0.0), 5.0, 0.0).is_empty());
    }

    proptest! {
        #[test]
        fn every_word_that_exists_leads_to_the_goal(
            x in -6.0..6.0f64, y in -6.0..6.0f64, yaw in -3.1..3.1f64, index in 0usize..6,
        ) {
            let goal = Pose2::new(x, y, yaw);
            if let Some(word) = word(WORDS[index], &goal) {
                let end = *sample(&Pose2::default(), &word, 1.0, STEP_M).last().unwrap();
                prop_assert!(end.distance_m(&goal) < 1e-6, "{word:?}");
                prop_assert!(wrap_angle_rad(end.yaw_rad - goal.yaw_rad).abs() < 1e-6);
            }
        }

        #[test]
        fn an_arc_and_a_straight_line_lead_to_a_point_with_the_arrival_heading(
            x in -40.0..40.0f64, y in -40.0..40.0f64, yaw in -3.1..3.1f64, radius in 2.0..12.0f64,
        ) {
            let from = Pose2::new(1.0, -2.0, yaw);
            if let Some(arrival) = arrival_yaw_rad(&from, (x, y), radius) {
                let to = Pose2::new(x, y, arrival);
                let drive = cheapest(&from, &to, radius).unwrap();
                let bends = drive.iter().filter(|part| {
                    part.curvature_per_m != 0.0 && part.length_m > 1e-6
                });
                prop_assert!(bends.count() <= 1, "{drive:?}");
            }
        }

        #[test]
        fn the_cheapest_drive_arrives_and_costs_no_more_than_the_shortest(
            x in -40.0..40.0f64, y in -40.0..40.0f64, yaw in -3.1..3.1f64, radius in 2.0..12.0f64,
        ) {
            let (from, to) = (Pose2::new(1.0, -2.0, 0.3), Pose2::new(x, y, yaw));
            let drive = cheapest(&from, &to, radius).unwrap();
            let end = drive.iter().fold(from, |pose, segment| segment.end(&pose));
            prop_assert!(end.distance_m(&to) < 1e-6);
            prop_assert!(wrap_angle_rad(end.yaw_rad - to.yaw_rad).abs() < 1e-6);
            let shortest = shortest_path(&from, &to, radius, 0.05);
            let turned: f64 = shortest
                .windows(2)
                .map(|pair| wrap_angle_rad(pair[1].yaw_rad - pair[0].yaw_rad).abs())
                .sum();
            prop_assert!(cost_of(&drive) <= length_m(&shortest) + turned + 0.02);
        }

        #[test]
        fn the_path_joins_both_poses_bends_no_more_than_allowed_and_has_no_shortcut(
            x in -40.0..40.0f64, y in -40.0..40.0f64, yaw in -3.1..3.1f64,
            from_yaw in -3.1..3.1f64, radius in 2.0..12.0f64,
        ) {
            let (from, to) = (Pose2::new(1.0, -2.0, from_yaw), Pose2::new(x, y, yaw));
            let path = shortest_path(&from, &to, radius, STEP_M);
            prop_assert_eq!(path[0], from);
            prop_assert!(path.last().unwrap().distance_m(&to) < 1e-6);
            for pair in path.windows(2) {
                let step = pair[0].distance_m(&pair[1]);
                prop_assert!(step <= STEP_M + 1e-9);
                let turn = wrap_angle_rad(pair[1].yaw_rad - pair[0].yaw_rad).abs();
                prop_assert!(turn <= 2.0 * libm::asin((step / (2.0 * radius)).min(1.0)) + 1e-6);
            }
            // Backwards in a mirror the same way is as long.
            let flipped = |pose: &Pose2| Pose2::new(pose.x_m, pose.y_m, wrap_angle_rad(pose.yaw_rad + PI));
            let back = shortest_path(&flipped(&to), &flipped(&from), radius, STEP_M);
            prop_assert!((length_m(&path) - length_m(&back)).abs() < 0.02 * length_m(&path) + 0.01);
            prop_assert!(length_m(&path) >= from.distance_m(&to) - 1e-9);
        }
    }
}
