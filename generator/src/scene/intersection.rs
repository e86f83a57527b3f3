//! Intersections with three or four arms: left turns, right turns and straight through.

use std::f64::consts::{PI, TAU};

use super::road::Lane;
use super::roadside::{self, Side};
use super::site::{Layout, Site};
use super::{REACH, traffic};
use crate::config::Span;
use crate::course::Course;

/// How far the arms go from the middle, metres.
const ARM_M: f64 = 80.0;

/// Where the arms meet, and how wide they are.
struct Crossing {
    centre: [f64; 2],
    /// Outward directions, counter-clockwise from the smallest.
    arms_rad: Vec<f64>,
    lane_m: f64,
    lanes: usize,
    half_width_m: f64,
}

/// An intersection and a way over it.
pub(super) fn turn(site: &mut Site<'_>) -> Layout {
    let (turn, road) = (&site.config.turn, &site.config.road);
    let begin_m = site.dice.within(turn.begin_m);
    let goes_through = site.dice.chance(turn.through_share);
    let goes_left = site.dice.chance(0.5);
    let lane_m = site.dice.within(road.lane_m);
    let lanes = site.dice.count(turn.lanes).max(1);
    let angle_rad = site.dice.within(turn.turn_rad) * if goes_left { 1.0 } else { -1.0 };
    let radius_m = site.dice.within(if goes_left {
        turn.left_radius_m
    } else {
        turn.right_radius_m
    });
    let lane_of = |site: &mut Site<'_>| {
        if goes_through {
            site.dice.below(lanes)
        } else if goes_left {
            0
        } else {
            lanes - 1
        }
    };
    let approach_m = (lane_of(site) as f64 + 0.5) * lane_m;
    let exit_m = (lane_of(site) as f64 + 0.5) * lane_m;
    let corner_x_m = begin_m + radius_m * libm::tan(0.5 * angle_rad.abs());
    let (sin, cos) = libm::sincos(angle_rad);
    // The axes of both roads lie to the left of the lanes; they meet in the middle.
    let along_exit_m = (approach_m - exit_m * cos) / sin;
    let centre = if goes_through {
        [begin_m + 8.0, approach_m]
    } else {
        [
            corner_x_m - exit_m * sin + along_exit_m * cos,
            exit_m * cos + along_exit_m * sin,
        ]
    };
    let crossing = Crossing {
        centre,
        arms_rad: arms(site, angle_rad, goes_through),
        lane_m,
        lanes,
        half_width_m: lanes as f64 * lane_m + site.dice.within(road.shoulder_m),
    };
    build(site, &crossing);
    let reference = if goes_through {
        Course::through(&[[REACH.0, 0.0], [0.0, 0.0], [REACH.1, 0.0]])
    } else {
        rounded(REACH, corner_x_m, angle_rad, radius_m)
    };
    Layout {
        reference: reference.starting_at(REACH.0),
        lanes_m: if lanes > 1 {
            vec![0.0, lane_m]
        } else {
            vec![0.0]
        },
        band_m: Span(-lane_m * 0.5, lanes as f64 * lane_m),
        curvature_per_m: 0.05,
        ego_freedom: 1.0,
    }
}

/// Points along x over a reach, then around a corner at `corner_x_m` with a radius, then on.
pub(super) fn rounded(reach: Span, corner_x_m: f64, angle_rad: f64, radius_m: f64) -> Course {
    const STEPS: u32 = 32;
    let tangent_m = radius_m * libm::tan(0.5 * angle_rad.abs());
    let begin_m = corner_x_m - tangent_m;
    let side = if angle_rad < 0.0 { -1.0 } else { 1.0 };
    let mut points = vec![[reach.0.min(begin_m - 1.0), 0.0]];
    if begin_m > 1.0 {
        points.push([0.0, 0.0]);
        points.push([begin_m - 0.5, 0.0]);
    }
    for step in 0..=STEPS {
        let turned = angle_rad.abs() * f64::from(step) / f64::from(STEPS);
        let (sin, cos) = libm::sincos(turned);
        points.push([begin_m + radius_m * sin, side * radius_m * (1.0 - cos)]);
    }
    let (sin, cos) = libm::sincos(angle_rad);
    let [x, y] = points[points.len() - 1];
    for on_m in [0.5, reach.1] {
        points.push([x + on_m * cos, y + on_m * sin]);
    }
    Course::through(&points)
}

/// The outward directions of the arms, counter-clockwise. The one that the vehicle comes from and
/// the one that it leaves by are always there.
fn arms(site: &mut Site<'_>, angle_rad: f64, goes_through: bool) -> Vec<f64> {
    let optional = if goes_through {
        [angle_rad, angle_rad + PI]
    } else {
        [0.0, angle_rad + PI]
    };
    let mut arms = vec![PI, if goes_through { 0.0 } else { angle_rad }];
    if site.dice.chance(site.config.turn.three_arm_share) {
        arms.push(optional[site.dice.below(2)]);
    } else {
        arms.extend(optional);
    }
    for arm in &mut arms {
        *arm -= TAU * libm::floor(*arm / TAU);
    }
    arms.sort_by(f64::total_cmp);
    arms
}

fn build(site: &mut Site<'_>, crossing: &Crossing) {
    let count = crossing.arms_rad.len();
    let edges: Vec<Vec<[f64; 2]>> = (0..count)
        .map(|arm| {
            let (from, to) = (crossing.arms_rad[arm], crossing.arms_rad[(arm + 1) % count]);
            let radius_m = site.dice.within(site.config.turn.corner_radius_m);
            edge(crossing, from, to, radius_m)
        })
        .collect();
    for points in &edges {
        roadside::add_edge(site, points);
    }
    for points in &edges {
        roadside::add_kerb(site, points);
        // From one arm inwards and out along the next, the ground between them is on the right.
        roadside::dress(site, points, Side::Right);
    }
    for &arm_rad in &crossing.arms_rad {
        let (sin, cos) = libm::sincos(arm_rad);
        let [x, y] = crossing.centre;
        let axis = Course::through(&[[x, y], [x + ARM_M * cos, y + ARM_M * sin]]);
        let lanes: Vec<Lane> = (0..crossing.lanes)
            .flat_map(|lane| {
                let off_m = (lane as f64 + 0.5) * crossing.lane_m;
                [(-off_m, true), (off_m, false)]
            })
            .map(|(left_m, forward)| Lane { left_m, forward })
            .collect();
        traffic::add(site, &axis, &lanes, Span(0.0, ARM_M));
    }
}

/// The kerb from the far end of an arm's left side around to the far end of the next one's right.
fn edge(crossing: &Crossing, from_rad: f64, to_rad: f64, radius_m: f64) -> Vec<[f64; 2]> {
    const STEPS: u32 = 8;
    let [x, y] = crossing.centre;
    let half = crossing.half_width_m;
    let (from_sin, from_cos) = libm::sincos(from_rad);
    let (to_sin, to_cos) = libm::sincos(to_rad);
    let on_from = |m: f64| {
        [
            x - half * from_sin + m * from_cos,
            y + half * from_cos + m * from_sin,
        ]
    };
    let on_to = |m: f64| {
        [
            x + half * to_sin + m * to_cos,
            y - half * to_cos + m * to_sin,
        ]
    };
    let between_rad = (to_rad - from_rad) - TAU * libm::floor((to_rad - from_rad) / TAU);
    // Wide open pairs of arms have a straight kerb between them, not a corner.
    if between_rad > 0.85 * PI {
        return vec![on_from(ARM_M), on_from(0.0), on_to(0.0), on_to(ARM_M)];
    }
    let tan = libm::tan(0.5 * between_rad);
    let corner_m = half / tan;
    let tangent_m = radius_m / tan;
    let mut points = vec![on_from(ARM_M)];
    let (begin, end) = (on_from(corner_m + tangent_m), on_to(corner_m + tangent_m));
    let corner = on_from(corner_m);
    let bisector_rad = from_rad + 0.5 * between_rad;
    let (sin, cos) = libm::sincos(bisector_rad);
    let reach_m = radius_m / libm::sin(0.5 * between_rad);
    let middle = [corner[0] + reach_m * cos, corner[1] + reach_m * sin];
    let begin_rad = libm::atan2(begin[1] - middle[1], begin[0] - middle[0]);
    let sweep_rad = PI - between_rad;
    for step in 0..=STEPS {
        let angle = begin_rad + sweep_rad * f64::from(step) / f64::from(STEPS);
        let (sin, cos) = libm::sincos(angle);
        points.push([middle[0] + radius_m * cos, middle[1] + radius_m * sin]);
    }
    points.push(end);
    points.push(on_to(ARM_M));
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rounded_corner_leaves_in_its_direction_after_its_radius() {
        for angle in [1.4, -1.4] {
            let course = rounded(REACH, 20.0, angle, 8.0).starting_at(REACH.0);
            assert!(course.at(0.0).distance_m(&swath_bridge::Pose2::default()) < 1e-9);
            let (_, end) = course.span_m();
            assert!((course.at(end).yaw_rad - angle).abs() < 1e-6);
            let begin = 20.0 - 8.0 * libm::tan(0.7);
            let bend = course.curvature_per_m(begin + 5.6);
            assert!((bend.abs() - 1.0 / 8.0).abs() < 0.01, "{bend}");
        }
    }

    #[test]
    fn kerbs_keep_the_half_width_from_the_axes_of_their_arms() {
        let crossing = Crossing {
            centre: [10.0, 2.0],
            arms_rad: vec![0.1, 1.7],
            lane_m: 3.0,
            lanes: 1,
            half_width_m: 4.0,
        };
        let points = edge(&crossing, 0.1, 1.7, 3.0);
        for point in points {
            for arm in [0.1, 1.7] {
                let (sin, cos) = libm::sincos(arm);
                let across = (point[1] - 2.0) * cos - (point[0] - 10.0) * sin;
                assert!(
                    across.abs() > 4.0 - 1e-9,
                    "{point:?} is {across} m off the axis of {arm}"
                );
            }
        }
    }
}
