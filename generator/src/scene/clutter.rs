//! Open ground with boxes, discs, pieces of wall and cars that stand anyhow.

use std::f64::consts::PI;

use swath_bridge::Pose2;

use super::REACH;
use super::site::{Layout, Site};
use crate::config::Span;
use crate::course::Course;
use crate::shape::Height;

/// Open ground with things on it.
pub(super) fn clutter(site: &mut Site<'_>) -> Layout {
    let clutter = &site.config.clutter;
    let curvature = site.dice.either(clutter.curvature_per_m);
    let swing_m = site.dice.within(Span(10.0, 40.0));
    let phase = site.dice.within(Span(0.0, 6.0));
    let course = Course::with_curvature(REACH, |along| {
        curvature * libm::sin(along / swing_m + phase)
    });
    // One scene is made of a few sorts of things, in shares of its own.
    let shares: Vec<f64> = (0..4).map(|_| site.dice.unit()).collect();
    let total: f64 = shares.iter().sum::<f64>().max(1e-9);
    for _ in 0..site.dice.count(clutter.things) {
        let along_m = site.dice.within(Span(-20.0, 75.0));
        let left_m = site.dice.within(Span(-17.0, 17.0));
        let heading_rad = site.dice.within(Span(-PI, PI));
        let at = course.beside(along_m, left_m);
        let centre = Pose2::new(at.x_m, at.y_m, heading_rad);
        let mut pick = site.dice.unit() * total;
        let sort = shares.iter().position(|share| {
            pick -= share;
            pick < 0.0
        });
        add_thing(site, &centre, sort.unwrap_or(0));
    }
    if site.dice.chance(clutter.walled_share) {
        for side in [1.0, -1.0] {
            let left_m = side * site.dice.within(Span(8.0, 15.0));
            let points = course.parallel(REACH, left_m);
            site.add_line(points, 0.3, Height::Tall);
        }
    }
    Layout {
        reference: course,
        lanes_m: vec![0.0, 3.0, -3.0],
        band_m: Span(-7.0, 7.0),
        curvature_per_m: 0.06,
        ego_freedom: 1.5,
    }
}

fn add_thing(site: &mut Site<'_>, centre: &Pose2, sort: usize) {
    let clutter = &site.config.clutter;
    match sort {
        0 => {
            let length_m = site.dice.within(clutter.box_m);
            let width_m = site.dice.within(clutter.box_m).min(length_m);
            site.add_box(*centre, length_m, width_m);
        }
        1 => {
            let radius_m = site.dice.within(clutter.disc_m);
            site.add_disc(*centre, radius_m);
        }
        2 => {
            let half_m = 0.5 * site.dice.within(clutter.wall_m);
            let ends = [-half_m, half_m].map(|x_m| centre.then(&Pose2::new(x_m, 0.0, 0.0)));
            let points = ends.map(|pose| [pose.x_m, pose.y_m]).to_vec();
            site.add_line(points, 0.3, Height::Tall);
        }
        _ => {
            let (length_m, width_m) = site.vehicle_size_m();
            if site.has_room_for(centre, (length_m, width_m), 0.3) {
                site.add_box(*centre, length_m, width_m);
            }
        }
    }
}
