//! Kerbs, and the walls, hedges, houses, trees and bushes behind them.

use swath_bridge::Pose2;

use super::site::Site;
use crate::config::Span;
use crate::course::Course;
use crate::shape::{Footprint, Height, Segment};

/// On which side of an edge the ground is that is not driven on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Side {
    Left,
    Right,
}

impl Side {
    const fn sign(self) -> f64 {
        match self {
            Self::Left => 1.0,
            Self::Right => -1.0,
        }
    }
}

/// Notes an edge of ground that is driven on. All edges are noted before anything is put behind
/// any of them.
pub(super) fn add_edge(site: &mut Site<'_>, points: &[[f64; 2]]) {
    site.edges.extend(points.windows(2).map(|pair| Segment {
        from: pair[0],
        to: pair[1],
        one_sided: false,
    }));
}

/// A kerb along points, with the gaps of driveways; now and then a guard rail, which is tall.
pub(super) fn add_kerb(site: &mut Site<'_>, points: &[[f64; 2]]) {
    let line = Course::through(points);
    let (mut along_m, end_m) = line.span_m();
    let road = &site.config.road;
    let height = if site.dice.chance(0.15) {
        Height::Tall
    } else {
        Height::Low
    };
    while along_m < end_m {
        let until_m = (along_m + site.dice.within(road.kerb_gap_every_m)).min(end_m);
        let piece = line.parallel(Span(along_m, until_m), 0.0);
        site.add_line(piece, 0.1, height);
        along_m = until_m + site.dice.within(road.kerb_gap_m).max(0.5);
    }
}

/// What stands behind a kerb: nothing, a wall or hedge, houses, or both, and perhaps trees and
/// bushes.
pub(super) fn dress(site: &mut Site<'_>, points: &[[f64; 2]], side: Side) {
    let line = Course::through(points);
    let style = site.dice.below(5);
    if matches!(style, 1 | 3) {
        add_wall(site, &line, side);
    }
    if matches!(style, 2..=4) {
        add_houses(site, &line, side);
    }
    if site.dice.chance(site.config.roadside.tree_share) {
        add_trees(site, &line, side);
    }
    if site.dice.chance(site.config.roadside.bush_share) {
        add_bushes(site, &line, side);
    }
}

/// Distance of a point from the nearest edge, metres.
fn edge_distance_m(site: &Site<'_>, point: [f64; 2]) -> f64 {
    site.edges
        .iter()
        .map(|edge| edge.distance_m(point))
        .fold(f64::INFINITY, f64::min)
}

fn add_wall(site: &mut Site<'_>, line: &Course, side: Side) {
    const STEP_M: f64 = 2.0;
    let roadside = &site.config.roadside;
    let setback_m = site.dice.within(roadside.wall_setback_m);
    let thickness_m = site.dice.within(roadside.wall_thickness_m);
    let is_hedge = site.dice.chance(0.5);
    let (mut along_m, end_m) = line.span_m();
    let mut run_end_m = along_m + site.dice.within(Span(8.0, 50.0));
    let mut run = Vec::new();
    while along_m <= end_m {
        let rough_m = if is_hedge {
            0.15 * site.dice.bell()
        } else {
            0.0
        };
        let pose = line.beside(along_m, side.sign() * (setback_m + rough_m.abs()));
        let point = [pose.x_m, pose.y_m];
        if edge_distance_m(site, point) >= 0.8 * setback_m {
            run.push(point);
        } else {
            site.add_line(std::mem::take(&mut run), thickness_m, Height::Tall);
        }
        along_m += STEP_M;
        if along_m > run_end_m {
            site.add_line(std::mem::take(&mut run), thickness_m, Height::Tall);
            along_m += site.dice.within(site.config.road.kerb_gap_m);
            run_end_m = along_m + site.dice.within(Span(8.0, 50.0));
        }
    }
    site.add_line(run, thickness_m, Height::Tall);
}

fn add_houses(site: &mut Site<'_>, line: &Course, side: Side) {
    let roadside = &site.config.roadside;
    let setback_m = site.dice.within(roadside.house_setback_m);
    let (mut along_m, end_m) = line.span_m();
    along_m += site.dice.within(roadside.house_gap_m);
    while along_m < end_m {
        let front_m = site.dice.within(roadside.house_front_m);
        let depth_m = site.dice.within(roadside.house_depth_m);
        let back_m = setback_m + site.dice.within(Span(0.0, 0.6));
        let centre = line.beside(
            along_m + 0.5 * front_m,
            side.sign() * (back_m + 0.5 * depth_m),
        );
        let house = Footprint {
            pose: centre,
            front_m: 0.5 * front_m,
            rear_m: 0.5 * front_m,
            half_width_m: 0.5 * depth_m,
        }
        .grown(0.6);
        if !site.edges.iter().any(|edge| house.cuts(edge)) {
            site.add_box(centre, front_m, depth_m);
        }
        along_m += front_m + site.dice.within(roadside.house_gap_m).max(0.0);
    }
}

fn add_trees(site: &mut Site<'_>, line: &Course, side: Side) {
    let roadside = &site.config.roadside;
    let setback_m = site.dice.within(Span(0.4, 1.0));
    let (mut along_m, end_m) = line.span_m();
    while along_m < end_m {
        along_m += site.dice.within(roadside.tree_every_m).max(0.5);
        let radius_m = site.dice.within(roadside.tree_radius_m);
        let pose: Pose2 = line.beside(along_m, side.sign() * (setback_m + radius_m));
        if edge_distance_m(site, [pose.x_m, pose.y_m]) >= 0.3 + radius_m {
            site.add_disc(pose, radius_m);
        }
    }
}

/// Patches of small things without order, as a lidar sees bushes.
fn add_bushes(site: &mut Site<'_>, line: &Course, side: Side) {
    let roadside = &site.config.roadside;
    let (begin_m, end_m) = line.span_m();
    for _ in 0..site.dice.count(roadside.bush_patches) {
        let along_m = site.dice.within(Span(begin_m, end_m));
        let setback_m = site.dice.within(roadside.bush_setback_m);
        let (long_m, deep_m) = (
            site.dice.within(Span(1.0, 4.0)),
            site.dice.within(Span(0.5, 2.0)),
        );
        for _ in 0..site.dice.count(Span(4.0, 18.0)) {
            let back_m = setback_m + deep_m * site.dice.unit();
            let mut centre = line.beside(
                along_m + long_m * (site.dice.unit() - 0.5),
                side.sign() * back_m,
            );
            centre.yaw_rad = site.dice.within(Span(0.0, 3.0));
            let size_m = site.dice.within(Span(0.15, 0.5));
            if edge_distance_m(site, [centre.x_m, centre.y_m]) >= 0.3 + size_m {
                site.add_box(centre, size_m, 0.6 * size_m);
            }
        }
    }
}
