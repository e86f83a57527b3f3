//! Roads with several lanes, kerbs and what stands beside them.

use super::roadside::{self, Side};
use super::site::{Layout, Site};
use super::{REACH, traffic};
use crate::config::Span;
use crate::course::{Course, between_knots};
use crate::shape::Height;

/// A lane beside the reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lane {
    /// Metres to the left of the reference.
    pub left_m: f64,
    /// Whether it is driven in the reference's direction.
    pub forward: bool,
}

/// The cross section of a road.
pub(super) struct Section {
    pub lanes: Vec<Lane>,
    pub lane_m: f64,
    /// Outer edge of the outermost lane, to the left of the reference.
    left_lane_edge_m: f64,
    /// The same to the right, negative.
    right_lane_edge_m: f64,
    /// Kerb to the left.
    pub left_kerb_m: f64,
    /// Kerb to the right, negative.
    pub right_kerb_m: f64,
    left_has_strip: bool,
    right_has_strip: bool,
}

impl Section {
    /// A cross section as the configuration has them.
    pub(super) fn draw(site: &mut Site<'_>) -> Self {
        let road = &site.config.road;
        let dice = &mut site.dice;
        let lane_m = dice.within(road.lane_m);
        let (left, right) = (dice.count(road.lanes_left), dice.count(road.lanes_right));
        let is_two_way = dice.chance(0.75);
        let mut lanes = vec![Lane {
            left_m: 0.0,
            forward: true,
        }];
        lanes.extend((1..=left).map(|lane| Lane {
            left_m: lane as f64 * lane_m,
            forward: !is_two_way,
        }));
        lanes.extend((1..=right).map(|lane| Lane {
            left_m: -(lane as f64) * lane_m,
            forward: true,
        }));
        let mut border_m = || {
            let has_strip = dice.chance(road.strip_share);
            let width = dice.within(if has_strip {
                road.strip_m
            } else {
                road.shoulder_m
            });
            (has_strip, width)
        };
        let ((left_has_strip, left_border_m), (right_has_strip, right_border_m)) =
            (border_m(), border_m());
        let left_lane_edge_m = (left as f64 + 0.5) * lane_m;
        let right_lane_edge_m = -(right as f64 + 0.5) * lane_m;
        Self {
            lanes,
            lane_m,
            left_lane_edge_m,
            right_lane_edge_m,
            left_kerb_m: left_lane_edge_m + left_border_m,
            right_kerb_m: right_lane_edge_m - right_border_m,
            left_has_strip,
            right_has_strip,
        }
    }

    /// The sharpest bend whose inner kerb is still a curve, 1/m.
    fn sharpest_per_m(&self) -> f64 {
        0.7 / self.left_kerb_m.max(-self.right_kerb_m)
    }
}

/// A road that is as straight as roads are.
pub(super) fn straight(site: &mut Site<'_>) -> Layout {
    let section = Section::draw(site);
    let curvature = site.dice.either(site.config.road.straight_per_m);
    let swing_m = site.dice.within(Span(25.0, 80.0));
    let phase = site.dice.within(Span(0.0, 6.0));
    let course = Course::with_curvature(REACH, |along| {
        curvature * libm::sin(along / swing_m + phase)
    });
    build(site, course, &section)
}

/// A road with one bend: clothoid, arc, clothoid.
pub(super) fn curved(site: &mut Site<'_>) -> Layout {
    let section = Section::draw(site);
    let road = &site.config.road;
    let curvature = site
        .dice
        .within(road.bend_per_m)
        .min(section.sharpest_per_m());
    let signed = if site.dice.chance(0.5) {
        curvature
    } else {
        -curvature
    };
    let mut knots = Vec::new();
    let begin_m = site.dice.within(road.bend_at_m);
    let (angle_rad, ease_m) = (
        site.dice.within(road.bend_rad),
        site.dice.within(road.ease_m),
    );
    add_bend(&mut knots, begin_m, (signed, angle_rad), ease_m);
    let course = Course::with_curvature(REACH, |along| between_knots(&knots, along));
    build(site, course, &section)
}

/// A road whose bends follow one another to either side.
pub(super) fn s_shaped(site: &mut Site<'_>) -> Layout {
    let section = Section::draw(site);
    let road = &site.config.road;
    let sharpest = section.sharpest_per_m();
    let mut sign = if site.dice.chance(0.5) { 1.0 } else { -1.0 };
    let mut knots = Vec::new();
    let mut along_m = site.dice.within(road.bend_at_m);
    let mut turned_rad = 0.0;
    while along_m < REACH.1 {
        let curvature = site.dice.within(road.s_per_m).min(sharpest);
        // Each bend turns back what the one before has turned, and as much to the other side.
        let angle_rad = site.dice.within(road.s_rad) + turned_rad;
        let ease_m = site.dice.within(road.ease_m).min(angle_rad / curvature);
        along_m = add_bend(&mut knots, along_m, (sign * curvature, angle_rad), ease_m);
        along_m += site.dice.within(road.s_gap_m);
        turned_rad = angle_rad - turned_rad;
        sign = -sign;
    }
    let course = Course::with_curvature(REACH, |along| between_knots(&knots, along));
    build(site, course, &section)
}

/// Appends a bend of a curvature (signed, 1/m) and a heading change (radians) that begins at
/// `begin_m`; gives where it ends.
fn add_bend(
    knots: &mut Vec<(f64, f64)>,
    begin_m: f64,
    (curvature_per_m, angle_rad): (f64, f64),
    ease_m: f64,
) -> f64 {
    let size = curvature_per_m.abs().max(1e-6);
    // A short bend never reaches its full curvature.
    let ease_m = ease_m.clamp(0.5, (angle_rad / size).max(0.5));
    let hold_m = (angle_rad / size - ease_m).max(0.0);
    let knots_of_bend = [
        (begin_m, 0.0),
        (begin_m + ease_m, curvature_per_m),
        (begin_m + ease_m + hold_m + 1e-3, curvature_per_m),
        (begin_m + 2.0 * ease_m + hold_m + 2e-3, 0.0),
    ];
    knots.extend(knots_of_bend);
    begin_m + 2.0 * ease_m + hold_m + 1e-2
}

/// Kerbs, strips of parked cars, traffic and the roadside along a course.
pub(super) fn build(site: &mut Site<'_>, course: Course, section: &Section) -> Layout {
    for (side, kerb_m) in [
        (Side::Left, section.left_kerb_m),
        (Side::Right, section.right_kerb_m),
    ] {
        let points = course.parallel(REACH, kerb_m);
        roadside::add_edge(site, &points);
        roadside::add_kerb(site, &points);
        roadside::dress(site, &points, side);
    }
    for (has_strip, kerb_m, lane_edge_m) in [
        (
            section.left_has_strip,
            section.left_kerb_m,
            section.left_lane_edge_m,
        ),
        (
            section.right_has_strip,
            section.right_kerb_m,
            section.right_lane_edge_m,
        ),
    ] {
        if has_strip {
            traffic::park_along(site, &course, 0.5 * (kerb_m + lane_edge_m));
        }
    }
    let has_left_lanes = section.lanes.iter().any(|lane| lane.left_m > 0.0);
    if has_left_lanes && site.dice.chance(site.config.road.median_share) {
        add_median(site, &course, 0.5 * section.lane_m);
    }
    traffic::add(site, &course, &section.lanes, REACH);
    let margin_m = site.config.vehicle.half_width_m + 0.2;
    Layout {
        reference: course,
        lanes_m: section.lanes.iter().map(|lane| lane.left_m).collect(),
        band_m: Span(
            section.right_kerb_m + margin_m,
            section.left_kerb_m - margin_m,
        ),
        curvature_per_m: 0.03,
        ego_freedom: 1.0,
    }
}

/// A low wall between the directions, with openings.
fn add_median(site: &mut Site<'_>, course: &Course, left_m: f64) {
    let mut along_m = REACH.0 + site.dice.within(Span(0.0, 20.0));
    while along_m < REACH.1 {
        let end_m = (along_m + site.dice.within(Span(10.0, 50.0))).min(REACH.1);
        let points = course.parallel(Span(along_m, end_m), left_m);
        let height = if site.dice.chance(0.5) {
            Height::Tall
        } else {
            Height::Low
        };
        site.add_line(points, 0.2, height);
        along_m = end_m + site.dice.within(Span(6.0, 14.0));
    }
}
