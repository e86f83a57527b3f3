//! Parked, standing and moving vehicles, and people.

use std::f64::consts::PI;

use swath_bridge::Pose2;

use super::Mover;
use super::road::Lane;
use super::site::Site;
use crate::config::Span;
use crate::course::Course;

/// Cars parked one behind the other along a line beside a course.
pub(super) fn park_along(site: &mut Site<'_>, course: &Course, left_m: f64) {
    let taken = site.dice.within(site.config.traffic.strip_taken);
    let (begin_m, end_m) = course.span_m();
    let mut along_m = begin_m;
    while along_m < end_m {
        let (length_m, width_m) = site.vehicle_size_m();
        let length_m = length_m.min(6.0);
        if site.dice.chance(taken) {
            let aside_m = left_m + 0.08 * site.dice.bell();
            let mut centre = course.beside(along_m + 0.5 * length_m, aside_m);
            centre.yaw_rad += 0.02 * site.dice.bell();
            site.add_box(centre, length_m, width_m.min(2.0));
        }
        along_m += length_m + site.dice.within(site.config.traffic.strip_gap_m).max(0.1);
    }
}

/// Standing and moving vehicles on lanes of a course, and people beside them.
pub(super) fn add(site: &mut Site<'_>, course: &Course, lanes: &[Lane], span: Span) {
    let traffic = &site.config.traffic;
    let ahead = Span(9.0, span.1.min(75.0));
    for _ in 0..site.dice.count(traffic.standing) {
        let size_m = site.vehicle_size_m();
        let lane = lanes[site.dice.below(lanes.len())];
        let along_m = site.dice.within(ahead);
        let mut centre = course.beside(along_m, lane.left_m + 0.35 * site.dice.bell());
        centre.yaw_rad += 0.05 * site.dice.bell();
        if site.has_room_for(&centre, size_m, 0.4) {
            site.add_box(centre, size_m.0, size_m.1);
        }
    }
    for _ in 0..site.dice.count(traffic.moving) {
        let size_m = site.vehicle_size_m();
        let lane = lanes[site.dice.below(lanes.len())];
        let along_m = site.dice.within(Span(-20.0, ahead.1));
        let speed_m_per_s = site.dice.within(traffic.speed_m_per_s);
        let centre = lane_pose(course, lane, along_m);
        let curvature = course.curvature_per_m(along_m);
        let turn = if lane.forward { curvature } else { -curvature };
        if site.has_room_for(&centre, size_m, 0.8) {
            site.movers.push(Mover {
                pose: centre,
                speed_m_per_s,
                turn_rad_per_s: turn * speed_m_per_s,
                length_m: size_m.0,
                width_m: size_m.1,
            });
        }
    }
    for _ in 0..site.dice.count(traffic.people) {
        let lane = lanes[site.dice.below(lanes.len())];
        let along_m = site.dice.within(ahead);
        let aside_m = lane.left_m + site.dice.either(Span(1.2, 2.2));
        let heading_rad = site.dice.either(Span(0.0, PI));
        let pose = course.beside(along_m, aside_m);
        site.movers.push(Mover {
            pose: Pose2::new(pose.x_m, pose.y_m, heading_rad),
            speed_m_per_s: site.dice.within(Span(0.0, 1.6)),
            turn_rad_per_s: 0.0,
            length_m: 0.4,
            width_m: 0.5,
        });
    }
}

/// The pose of a vehicle that drives on a lane.
fn lane_pose(course: &Course, lane: Lane, along_m: f64) -> Pose2 {
    let pose = course.beside(along_m, lane.left_m);
    if lane.forward {
        pose
    } else {
        pose.then(&Pose2::new(0.0, 0.0, PI))
    }
}
