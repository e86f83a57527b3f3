//! Parking lots: rows of slots, aisles between them and crossings of aisles.
//!
//! A lot is drawn in a frame of its own: aisles run along x, one of them on y = 0; crossings run
//! along y, one of them on x = 0. The vehicle drives along either, or turns from one into another.

use std::f64::consts::{FRAC_PI_2, PI};

use swath_bridge::Pose2;

use super::intersection::rounded;
use super::site::{Layout, Site};
use super::{Mover, REACH};
use crate::config::Span;
use crate::course::Course;
use crate::shape::Height;

/// How far from the vehicle a lot is filled, metres.
const FAR_M: f64 = 90.0;
/// Most slots along one row or rows of a lot.
const MAX_SLOTS: u32 = 200;

/// The measures of a lot.
struct Lot {
    aisle_m: f64,
    slot_m: (f64, f64),
    /// Angle between a slot and its aisle, a right one if the slots are not angled.
    angle_rad: f64,
    taken: f64,
    block_m: f64,
    /// Depth of one row, across the aisle.
    depth_m: f64,
    planter_m: f64,
}

impl Lot {
    fn draw(site: &mut Site<'_>) -> Self {
        let parking = &site.config.parking;
        let dice = &mut site.dice;
        let slot_m = (
            dice.within(parking.slot_length_m),
            dice.within(parking.slot_width_m),
        );
        let angle_rad = if dice.chance(parking.angled_share) {
            dice.within(parking.angle_rad)
        } else {
            FRAC_PI_2
        };
        let (sin, cos) = libm::sincos(angle_rad);
        Self {
            aisle_m: dice.within(parking.aisle_m),
            slot_m,
            angle_rad,
            taken: dice.within(parking.taken),
            block_m: dice.within(parking.block_m),
            depth_m: slot_m.0 * sin + 0.5 * slot_m.1 * cos.abs(),
            planter_m: if dice.chance(0.4) {
                dice.within(Span(0.4, 2.0))
            } else {
                0.0
            },
        }
    }

    /// Distance between two aisles.
    fn aisle_pitch_m(&self) -> f64 {
        self.aisle_m + 2.0 * self.depth_m + self.planter_m
    }

    /// Distance between two crossings.
    fn crossing_pitch_m(&self) -> f64 {
        self.block_m + self.aisle_m
    }
}

/// A parking lot and a way through it.
pub(super) fn parking(site: &mut Site<'_>) -> Layout {
    let lot = Lot::draw(site);
    let (course, lot_from_road) = way(site, &lot);
    let road_from_lot = lot_from_road.inverse();
    fill(site, &lot, &road_from_lot, &lot_from_road);
    add_border(site, &road_from_lot);
    add_movers(site, &course);
    Layout {
        reference: course,
        lanes_m: vec![0.0, 1.4, -1.4],
        band_m: Span(-5.0, 5.0),
        curvature_per_m: 0.1,
        ego_freedom: 1.0,
    }
}

/// The vehicle's way, in a frame that heads along it, and that frame's pose in the lot's.
fn way(site: &mut Site<'_>, lot: &Lot) -> (Course, Pose2) {
    let aside_m = 0.12 * lot.aisle_m * site.dice.bell();
    let corner_m = site.dice.within(Span(10.0, 34.0));
    let radius_m = site.dice.within(site.config.parking.radius_m);
    let angle_rad = if site.dice.chance(0.5) {
        FRAC_PI_2
    } else {
        -FRAC_PI_2
    };
    let turns = site.dice.chance(0.45);
    let heading_rad = if site.dice.chance(0.5) {
        0.0
    } else {
        FRAC_PI_2
    };
    // Both an aisle and a crossing pass through the lot's origin, so the corner lies there.
    let (sin, cos) = libm::sincos(heading_rad);
    let lot_from_road = Pose2::new(
        -corner_m * cos - aside_m * sin,
        -corner_m * sin + aside_m * cos,
        heading_rad,
    );
    let course = if turns {
        rounded(REACH, corner_m, angle_rad, radius_m)
    } else {
        Course::through(&[[REACH.0, 0.0], [0.0, 0.0], [REACH.1, 0.0]])
    };
    (course.starting_at(REACH.0), lot_from_road)
}

/// Parks cars in the slots, as far as the vehicle may see.
fn fill(site: &mut Site<'_>, lot: &Lot, road_from_lot: &Pose2, lot_from_road: &Pose2) {
    let pitch_m = lot.slot_m.1 / libm::sin(lot.angle_rad);
    // A whole number of slots is centred in its block.
    let slots = libm::floor(lot.block_m / pitch_m).max(1.0);
    let spare_m = lot.block_m - slots * pitch_m;
    let rows = count_of(FAR_M / lot.aisle_pitch_m());
    let blocks = count_of(FAR_M / lot.crossing_pitch_m());
    for aisle in -rows..=rows {
        for side in [1.0, -1.0] {
            let y_m =
                f64::from(aisle) * lot.aisle_pitch_m() + side * 0.5 * (lot.aisle_m + lot.depth_m);
            let row_taken = (lot.taken + 0.1 * site.dice.bell()).clamp(0.0, 1.0);
            for block in -blocks..=blocks {
                let begin_m = f64::from(block) * lot.crossing_pitch_m() + 0.5 * lot.aisle_m;
                for slot in 0..count_of(slots) {
                    let x_m = begin_m + 0.5 * spare_m + (f64::from(slot) + 0.5) * pitch_m;
                    let yaw_rad = side * lot.angle_rad;
                    let slot = road_from_lot.then(&Pose2::new(x_m, y_m, yaw_rad));
                    let is_taken = site.dice.chance(row_taken);
                    if is_taken && is_near(&slot) {
                        park(site, &slot, lot.slot_m);
                    }
                }
            }
            if site.dice.chance(0.3) {
                add_planter(
                    site,
                    lot,
                    y_m + side * 0.5 * lot.depth_m,
                    (road_from_lot, lot_from_road),
                );
            }
        }
    }
}

/// Whether a pose in the road's frame may come into view.
fn is_near(pose: &Pose2) -> bool {
    pose.x_m > REACH.0 && pose.x_m < FAR_M && pose.y_m.abs() < 40.0
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "float to integer casts saturate and the count is limited"
)]
fn count_of(count: f64) -> i32 {
    count.clamp(1.0, f64::from(MAX_SLOTS)) as i32
}

/// A car in a slot, not quite in its middle.
fn park(site: &mut Site<'_>, slot: &Pose2, slot_m: (f64, f64)) {
    let (length_m, width_m) = site.vehicle_size_m();
    let offset = Pose2::new(
        0.18 * site.dice.bell(),
        0.07 * site.dice.bell(),
        0.025 * site.dice.bell(),
    );
    let size_m = (length_m.min(slot_m.0 - 0.05), width_m.min(slot_m.1 - 0.5));
    site.add_box(slot.then(&offset), size_m.0, size_m.1);
}

/// A kerb with lamp posts between two rows that stand back to back.
fn add_planter(
    site: &mut Site<'_>,
    lot: &Lot,
    y_m: f64,
    (road_from_lot, lot_from_road): (&Pose2, &Pose2),
) {
    let blocks = count_of(FAR_M / lot.crossing_pitch_m());
    if (y_m - lot_from_road.y_m).abs() > 45.0 {
        return;
    }
    for block in -blocks..=blocks {
        let begin_m = f64::from(block) * lot.crossing_pitch_m() + 0.5 * lot.aisle_m;
        let ends = [begin_m, begin_m + lot.block_m]
            .map(|x_m| road_from_lot.then(&Pose2::new(x_m, y_m, 0.0)));
        site.add_line(ends.map(|p| [p.x_m, p.y_m]).to_vec(), 0.1, Height::Low);
        site.add_disc(ends[0], 0.15);
    }
}

/// Hedges or walls around the lot, on some of its sides.
fn add_border(site: &mut Site<'_>, road_from_lot: &Pose2) {
    for heading_rad in [0.0, FRAC_PI_2, PI, -FRAC_PI_2] {
        if !site.dice.chance(0.4) {
            continue;
        }
        let away_m = site.dice.within(Span(22.0, 70.0));
        let middle = road_from_lot.then(&Pose2::new(0.0, 0.0, heading_rad));
        let ends = [-60.0, 60.0].map(|left_m| middle.then(&Pose2::new(away_m, left_m, 0.0)));
        let thickness_m = site.dice.within(site.config.roadside.wall_thickness_m);
        let line = Course::through(&ends.map(|p| [p.x_m, p.y_m]));
        // Openings keep every way out of the lot possible.
        let mut along_m = 0.0;
        while along_m < 120.0 {
            let until_m = along_m + site.dice.within(Span(15.0, 40.0));
            site.add_line(
                line.parallel(Span(along_m, until_m), 0.0),
                thickness_m,
                Height::Tall,
            );
            along_m = until_m + site.dice.within(Span(5.0, 8.0));
        }
    }
}

/// Cars that look for a slot, and people.
fn add_movers(site: &mut Site<'_>, course: &Course) {
    for _ in 0..site.dice.below(3) {
        let (length_m, width_m) = site.vehicle_size_m();
        let along_m = site.dice.within(Span(12.0, 60.0));
        let forward = site.dice.chance(0.5);
        let left_m = if forward { -0.6 } else { 1.4 };
        let turned = Pose2::new(0.0, 0.0, if forward { 0.0 } else { PI });
        let pose = course.beside(along_m, left_m).then(&turned);
        if site.has_room_for(&pose, (length_m, width_m), 0.2) {
            site.movers.push(Mover {
                pose,
                speed_m_per_s: site.dice.within(Span(0.0, 3.0)),
                turn_rad_per_s: 0.0,
                length_m,
                width_m,
            });
        }
    }
    for _ in 0..site.dice.count(site.config.traffic.people) {
        let along_m = site.dice.within(Span(8.0, 50.0));
        let left_m = site.dice.either(Span(0.5, 12.0));
        let heading_rad = site.dice.either(Span(0.0, PI));
        let pose = course.beside(along_m, left_m);
        site.movers.push(Mover {
            pose: Pose2::new(pose.x_m, pose.y_m, heading_rad),
            speed_m_per_s: site.dice.within(Span(0.0, 1.6)),
            turn_rad_per_s: 0.0,
            length_m: 0.4,
            width_m: 0.5,
        });
    }
}
