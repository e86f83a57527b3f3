//! Distributions of the scenes.

use serde::{Deserialize, Serialize};

use super::Span;

/// Lists the spans of a configuration and the values that they may hold, from one table.
macro_rules! spans_of {
    ($config:ty, $section:literal: $($field:ident $low:literal $high:literal),+ $(,)?) => {
        impl $config {
            /// Every span, with the name of its field and the values that it may hold.
            pub(super) fn spans(&self) -> Vec<(&'static str, Span, Span)> {
                vec![$((
                    concat!($section, ".", stringify!($field)),
                    self.$field,
                    Span($low, $high),
                )),+]
            }
        }
    };
}

/// Roads.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RoadConfig {
    /// Width of a lane, metres.
    pub lane_m: Span,
    /// Lanes to the left of the vehicle's own.
    pub lanes_left: Span,
    /// Lanes to the right of the vehicle's own.
    pub lanes_right: Span,
    /// From the outermost lane to the kerb, metres.
    pub shoulder_m: Span,
    /// Width of a strip of parked cars between lane and kerb, metres.
    pub strip_m: Span,
    /// Share of road sides with such a strip.
    pub strip_share: f64,
    /// Largest curvature of a road that is meant to be straight, 1/m.
    pub straight_per_m: Span,
    /// Curvature of a bend, 1/m.
    pub bend_per_m: Span,
    /// Heading change of a bend, radians.
    pub bend_rad: Span,
    /// Where a bend begins, metres ahead of the vehicle.
    pub bend_at_m: Span,
    /// Length of the clothoid before and behind a bend, metres.
    pub ease_m: Span,
    /// Curvature of the bends of an S, 1/m.
    pub s_per_m: Span,
    /// Heading change of each bend of an S, radians.
    pub s_rad: Span,
    /// Straight between the bends of an S, metres.
    pub s_gap_m: Span,
    /// Distance between two gaps of a kerb, metres.
    pub kerb_gap_every_m: Span,
    /// Length of a gap of a kerb, metres.
    pub kerb_gap_m: Span,
    /// Share of roads whose directions are divided by a median.
    pub median_share: f64,
}

impl Default for RoadConfig {
    fn default() -> Self {
        Self {
            lane_m: Span(2.9, 3.8),
            lanes_left: Span(0.0, 2.0),
            lanes_right: Span(0.0, 1.0),
            shoulder_m: Span(0.2, 1.6),
            strip_m: Span(2.0, 2.4),
            strip_share: 0.35,
            straight_per_m: Span(0.0, 0.003),
            bend_per_m: Span(0.012, 0.09),
            bend_rad: Span(0.35, 1.5),
            bend_at_m: Span(-12.0, 25.0),
            ease_m: Span(4.0, 14.0),
            s_per_m: Span(0.02, 0.09),
            s_rad: Span(0.3, 0.95),
            s_gap_m: Span(0.0, 12.0),
            kerb_gap_every_m: Span(10.0, 60.0),
            kerb_gap_m: Span(2.5, 7.0),
            median_share: 0.15,
        }
    }
}

spans_of!(RoadConfig, "road":
    lane_m 1.0 20.0,
    lanes_left 0.0 8.0,
    lanes_right 0.0 8.0,
    shoulder_m 0.0 20.0,
    strip_m 0.0 20.0,
    straight_per_m 0.0 0.02,
    bend_per_m 0.001 0.5,
    bend_rad 0.01 3.0,
    bend_at_m -25.0 100.0,
    ease_m 0.5 100.0,
    s_per_m 0.001 0.5,
    s_rad 0.01 1.5,
    s_gap_m 0.0 100.0,
    kerb_gap_every_m 1.0 500.0,
    kerb_gap_m 0.0 100.0,
);

/// What stands beside roads.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RoadsideConfig {
    /// From the kerb to a wall or hedge, metres.
    pub wall_setback_m: Span,
    /// Thickness of a wall or hedge, metres.
    pub wall_thickness_m: Span,
    /// From the kerb to houses, metres.
    pub house_setback_m: Span,
    /// Front of a house, metres.
    pub house_front_m: Span,
    /// Depth of a house, metres.
    pub house_depth_m: Span,
    /// Gap between two houses, metres.
    pub house_gap_m: Span,
    /// Distance between two trees or poles, metres.
    pub tree_every_m: Span,
    /// Radius of a trunk or pole, metres.
    pub tree_radius_m: Span,
    /// Share of road sides with trees or poles.
    pub tree_share: f64,
    /// Share of road sides with bushes.
    pub bush_share: f64,
    /// Patches of bushes along a side that has them.
    pub bush_patches: Span,
    /// From the kerb to bushes, metres.
    pub bush_setback_m: Span,
}

impl Default for RoadsideConfig {
    fn default() -> Self {
        Self {
            wall_setback_m: Span(0.4, 3.0),
            wall_thickness_m: Span(0.1, 0.9),
            house_setback_m: Span(1.8, 6.0),
            house_front_m: Span(7.0, 22.0),
            house_depth_m: Span(6.0, 12.0),
            house_gap_m: Span(0.0, 9.0),
            tree_every_m: Span(5.0, 18.0),
            tree_radius_m: Span(0.1, 0.4),
            tree_share: 0.5,
            bush_share: 0.3,
            bush_patches: Span(1.0, 6.0),
            bush_setback_m: Span(0.5, 6.0),
        }
    }
}

spans_of!(RoadsideConfig, "roadside":
    wall_setback_m 0.0 50.0,
    wall_thickness_m 0.0 5.0,
    house_setback_m 0.0 50.0,
    house_front_m 1.0 100.0,
    house_depth_m 1.0 100.0,
    house_gap_m 0.0 100.0,
    tree_every_m 0.5 100.0,
    tree_radius_m 0.01 5.0,
    bush_patches 0.0 100.0,
    bush_setback_m 0.0 50.0,
);

/// Parked and moving vehicles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrafficConfig {
    /// Share of places in a strip that are taken.
    pub strip_taken: Span,
    /// Gap between two places of a strip, metres.
    pub strip_gap_m: Span,
    /// Vehicles standing on lanes.
    pub standing: Span,
    /// Vehicles moving on lanes.
    pub moving: Span,
    /// Their speed, m/s.
    pub speed_m_per_s: Span,
    /// Pedestrians and posts at the sides of the lanes.
    pub people: Span,
}

impl Default for TrafficConfig {
    fn default() -> Self {
        Self {
            strip_taken: Span(0.3, 1.0),
            strip_gap_m: Span(0.5, 1.6),
            standing: Span(0.0, 3.0),
            moving: Span(0.0, 4.0),
            speed_m_per_s: Span(0.5, 9.0),
            people: Span(0.0, 3.0),
        }
    }
}

spans_of!(TrafficConfig, "traffic":
    strip_taken 0.0 1.0,
    strip_gap_m 0.1 100.0,
    standing 0.0 100.0,
    moving 0.0 100.0,
    speed_m_per_s 0.0 50.0,
    people 0.0 100.0,
);

/// Intersections.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TurnConfig {
    /// Where the turn begins, metres ahead of the vehicle.
    pub begin_m: Span,
    /// Radius of a left turn, metres.
    pub left_radius_m: Span,
    /// Radius of a right turn, metres.
    pub right_radius_m: Span,
    /// Heading change of a turn, radians.
    pub turn_rad: Span,
    /// Share of scenes that go straight through.
    pub through_share: f64,
    /// Share of intersections with three arms.
    pub three_arm_share: f64,
    /// Lanes of a direction.
    pub lanes: Span,
    /// Radius of a kerb at a corner, metres.
    pub corner_radius_m: Span,
}

impl Default for TurnConfig {
    fn default() -> Self {
        Self {
            begin_m: Span(4.0, 26.0),
            left_radius_m: Span(8.5, 15.0),
            right_radius_m: Span(7.0, 11.0),
            turn_rad: Span(1.3, 1.8),
            through_share: 0.2,
            three_arm_share: 0.4,
            lanes: Span(1.0, 2.0),
            corner_radius_m: Span(2.5, 6.5),
        }
    }
}

spans_of!(TurnConfig, "turn":
    begin_m 0.0 80.0,
    left_radius_m 1.0 50.0,
    right_radius_m 1.0 50.0,
    turn_rad 0.3 2.6,
    lanes 1.0 6.0,
    corner_radius_m 0.0 30.0,
);

/// Narrow passages.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NarrowConfig {
    /// Width of an alley, metres.
    pub alley_m: Span,
    /// Curvature of an alley, 1/m.
    pub alley_per_m: Span,
    /// Opening of a gate, metres.
    pub gate_m: Span,
    /// Distance between two gates, metres.
    pub gate_every_m: Span,
    /// A gate's distance from the reference to either side, metres.
    pub gate_offset_m: Span,
    /// Width of the ground between the outer walls of gates, metres.
    pub ground_m: Span,
    /// Opening in a wall that lies across, as in a slalom, metres.
    pub detour_gap_m: Span,
    /// Distance between two such walls, metres.
    pub detour_every_m: Span,
    /// Lane that roadworks leave, metres.
    pub works_m: Span,
    /// Distance between two beacons of roadworks, metres.
    pub beacon_every_m: Span,
}

impl Default for NarrowConfig {
    fn default() -> Self {
        Self {
            alley_m: Span(2.7, 4.6),
            alley_per_m: Span(0.0, 0.05),
            gate_m: Span(2.5, 4.2),
            gate_every_m: Span(10.0, 22.0),
            gate_offset_m: Span(0.0, 2.2),
            ground_m: Span(9.0, 24.0),
            detour_gap_m: Span(4.0, 8.0),
            detour_every_m: Span(12.0, 22.0),
            works_m: Span(2.7, 3.6),
            beacon_every_m: Span(1.5, 4.0),
        }
    }
}

spans_of!(NarrowConfig, "narrow":
    alley_m 0.5 30.0,
    alley_per_m 0.0 0.2,
    gate_m 0.0 30.0,
    gate_every_m 1.0 100.0,
    gate_offset_m 0.0 20.0,
    ground_m 1.0 60.0,
    detour_gap_m 0.0 30.0,
    detour_every_m 1.0 100.0,
    works_m 0.0 20.0,
    beacon_every_m 0.5 100.0,
);

/// Parking lots.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ParkingConfig {
    /// Width of an aisle, metres.
    pub aisle_m: Span,
    /// Width of a slot, metres.
    pub slot_width_m: Span,
    /// Length of a slot, metres.
    pub slot_length_m: Span,
    /// Share of slots that are taken.
    pub taken: Span,
    /// Share of lots with slots at an angle to the aisle.
    pub angled_share: f64,
    /// That angle, radians.
    pub angle_rad: Span,
    /// Radius of the way from one aisle into another, metres.
    pub radius_m: Span,
    /// Length of a block of slots along the aisle, metres.
    pub block_m: Span,
}

impl Default for ParkingConfig {
    fn default() -> Self {
        Self {
            aisle_m: Span(5.2, 7.5),
            slot_width_m: Span(2.4, 2.8),
            slot_length_m: Span(4.8, 5.4),
            taken: Span(0.4, 0.95),
            angled_share: 0.3,
            angle_rad: Span(0.8, 1.2),
            radius_m: Span(6.5, 8.5),
            block_m: Span(18.0, 45.0),
        }
    }
}

spans_of!(ParkingConfig, "parking":
    aisle_m 2.0 30.0,
    slot_width_m 1.5 10.0,
    slot_length_m 2.0 20.0,
    taken 0.0 1.0,
    angle_rad 0.3 1.571,
    radius_m 1.0 30.0,
    block_m 3.0 200.0,
);

/// Open ground with things on it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ClutterConfig {
    /// Things on the ground.
    pub things: Span,
    /// Length of a box, metres.
    pub box_m: Span,
    /// Radius of a disc, metres.
    pub disc_m: Span,
    /// Length of a piece of wall, metres.
    pub wall_m: Span,
    /// Curvature of the reference, 1/m.
    pub curvature_per_m: Span,
    /// Share of scenes with walls at the sides of the ground.
    pub walled_share: f64,
}

impl Default for ClutterConfig {
    fn default() -> Self {
        Self {
            things: Span(8.0, 60.0),
            box_m: Span(0.5, 3.5),
            disc_m: Span(0.12, 0.9),
            wall_m: Span(2.0, 8.0),
            curvature_per_m: Span(0.0, 0.02),
            walled_share: 0.4,
        }
    }
}

spans_of!(ClutterConfig, "clutter":
    things 0.0 2000.0,
    box_m 0.05 20.0,
    disc_m 0.05 20.0,
    wall_m 0.1 50.0,
    curvature_per_m 0.0 0.2,
);
