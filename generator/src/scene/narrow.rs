//! Narrow passages: alleys, gates, walls across with an opening, roadworks.

use swath_bridge::Pose2;

use super::site::{Layout, Site};
use super::{REACH, road, roadside};
use crate::config::Span;
use crate::course::Course;
use crate::shape::Height;

/// One of the four kinds of narrow passages.
pub(super) fn narrow(site: &mut Site<'_>) -> Layout {
    match site.dice.below(4) {
        0 => alley(site),
        1 => gates(site),
        2 => detour(site),
        _ => roadworks(site),
    }
}

/// A course that swings gently.
fn swinging(site: &mut Site<'_>, curvature: Span) -> Course {
    let curvature_per_m = site.dice.either(curvature);
    let swing_m = site.dice.within(Span(6.0, 20.0));
    let phase = site.dice.within(Span(0.0, 6.0));
    Course::with_curvature(REACH, |along| {
        curvature_per_m * libm::sin(along / swing_m + phase)
    })
}

fn layout(reference: Course, half_width_m: f64, ego_freedom: f64) -> Layout {
    Layout {
        reference,
        lanes_m: vec![0.0],
        band_m: Span(-half_width_m, half_width_m),
        curvature_per_m: 0.1,
        ego_freedom,
    }
}

/// Walls close to both sides, with fronts that step in and out, and things along them.
fn alley(site: &mut Site<'_>) -> Layout {
    let narrow = &site.config.narrow;
    let course = swinging(site, narrow.alley_per_m);
    let width_m = site.dice.within(narrow.alley_m);
    let begin_m = site.dice.within(Span(REACH.0, 14.0));
    let end_m = site.dice.within(Span(30.0, REACH.1));
    for side in [1.0, -1.0] {
        let mut along_m = begin_m;
        while along_m < end_m {
            let until_m = (along_m + site.dice.within(Span(5.0, 20.0))).min(end_m);
            let half_m = 0.5 * width_m + site.dice.within(Span(0.0, 0.8));
            let points = course.parallel(Span(along_m, until_m), side * (half_m + 0.2));
            if !site.dice.chance(0.12) {
                site.add_line(points, 0.4, Height::Tall);
            }
            if site.dice.chance(0.25) {
                let thing_m = site.dice.within(Span(0.3, 0.6));
                let centre = course.beside(along_m + 2.0, side * (half_m - 0.5 * thing_m));
                site.add_box(centre, 2.0 * thing_m, thing_m);
            }
            along_m = until_m;
        }
    }
    layout(course, 0.5 * width_m, 0.4)
}

/// Openings between walls, cars or posts, each a little to the side of the last.
fn gates(site: &mut Site<'_>) -> Layout {
    let narrow = &site.config.narrow;
    let course = swinging(site, Span(0.0, 0.01));
    let half_m = 0.5 * site.dice.within(narrow.ground_m);
    add_outer_walls(site, &course, half_m);
    let style = site.dice.below(3);
    let mut along_m = site.dice.within(Span(9.0, 18.0));
    while along_m < REACH.1 {
        let middle_m = site.dice.either(narrow.gate_offset_m);
        let opening_m = site.dice.within(narrow.gate_m);
        for side in [1.0, -1.0] {
            let edge_m = middle_m + side * 0.5 * opening_m;
            match style {
                0 => {
                    let outer_m = side * half_m;
                    let ends = [edge_m, outer_m].map(|left_m| course.beside(along_m, left_m));
                    let points = ends.map(|pose| [pose.x_m, pose.y_m]).to_vec();
                    if (outer_m - edge_m) * side > 0.5 {
                        site.add_line(points, 0.4, Height::Tall);
                    }
                }
                1 => {
                    let (length_m, width_m) = site.vehicle_size_m();
                    let left_m = edge_m + side * 0.5 * width_m;
                    let centre = course.beside(along_m, left_m);
                    site.add_box(centre, length_m, width_m);
                }
                _ => {
                    let radius_m = site.dice.within(Span(0.1, 0.5));
                    site.add_disc(course.beside(along_m, edge_m + side * radius_m), radius_m);
                }
            }
        }
        along_m += site.dice.within(narrow.gate_every_m).max(1.0);
    }
    layout(course, half_m.min(5.0), 0.8)
}

/// Walls that lie across the way, each with one opening to a side: the reference goes through
/// them, the vehicle has to go around.
fn detour(site: &mut Site<'_>) -> Layout {
    let narrow = &site.config.narrow;
    let course = swinging(site, Span(0.0, 0.006));
    let half_m = (0.5 * site.dice.within(narrow.ground_m)).max(7.0);
    add_outer_walls(site, &course, half_m);
    let walls = 1 + site.dice.below(4);
    let mut along_m = site.dice.within(Span(9.0, 20.0));
    let mut side = if site.dice.chance(0.5) { 1.0 } else { -1.0 };
    let thickness_m = site.dice.within(Span(0.2, 0.8));
    for _ in 0..walls {
        let gap_m = site.dice.within(narrow.detour_gap_m);
        let inner_m = side * site.dice.within(Span(0.0, (half_m - gap_m).max(0.1)));
        for (from_m, to_m) in [
            (-side * half_m, inner_m),
            (inner_m + side * gap_m, side * half_m),
        ] {
            if (to_m - from_m) * side > 0.4 {
                let ends = [from_m, to_m].map(|left_m| course.beside(along_m, left_m));
                let points = ends.map(|pose| [pose.x_m, pose.y_m]).to_vec();
                site.add_line(points, thickness_m, Height::Tall);
            }
        }
        along_m += site.dice.within(narrow.detour_every_m).max(1.0);
        side = if site.dice.chance(0.75) { -side } else { side };
    }
    layout(course, half_m.min(7.0), 1.0)
}

/// Walls at the sides of the ground; now and then one is missing.
fn add_outer_walls(site: &mut Site<'_>, course: &Course, half_m: f64) {
    for side in [1.0, -1.0] {
        if site.dice.chance(0.8) {
            let points = course.parallel(REACH, side * (half_m + 0.2));
            site.add_line(points, 0.4, Height::Tall);
        }
    }
}

/// A road of which beacons leave one narrow lane.
fn roadworks(site: &mut Site<'_>) -> Layout {
    let section = road::Section::draw(site);
    let course = swinging(site, Span(0.0, 0.008));
    let narrow = &site.config.narrow;
    let half_m = 0.5 * site.dice.within(narrow.works_m);
    let begin_m = site.dice.within(Span(10.0, 30.0));
    let end_m = begin_m + site.dice.within(Span(15.0, 60.0));
    let every_m = site.dice.within(narrow.beacon_every_m).max(0.5);
    let taper_m = site.dice.within(Span(6.0, 16.0));
    for (side, kerb_m) in [(1.0, section.left_kerb_m), (-1.0, section.right_kerb_m)] {
        let mut along_m = begin_m - taper_m;
        while along_m < end_m {
            let open = ((begin_m - along_m) / taper_m).clamp(0.0, 1.0);
            let inner_m = half_m + open * (kerb_m.abs() - half_m).max(0.0);
            let left_m = side * (inner_m + 0.15 + 0.08 * site.dice.bell().abs());
            site.add_disc(course.beside(along_m, left_m), 0.15);
            along_m += every_m;
        }
        if site.dice.chance(0.5) {
            // The site behind the beacons: a trench's fence, a machine.
            let left_m = side * (half_m + 1.6);
            let centre: Pose2 = course.beside(0.5 * (begin_m + end_m), left_m);
            site.add_box(centre, 6.0, 1.8);
        }
    }
    for (side, kerb_m) in [
        (roadside::Side::Left, section.left_kerb_m),
        (roadside::Side::Right, section.right_kerb_m),
    ] {
        let points = course.parallel(REACH, kerb_m);
        roadside::add_edge(site, &points);
        roadside::add_kerb(site, &points);
        roadside::dress(site, &points, side);
    }
    let margin_m = site.config.vehicle.half_width_m + 0.2;
    let band = Span(
        section.right_kerb_m + margin_m,
        section.left_kerb_m - margin_m,
    );
    Layout {
        band_m: band,
        lanes_m: section.lanes.iter().map(|lane| lane.left_m).collect(),
        ..layout(course, half_m, 0.7)
    }
}
