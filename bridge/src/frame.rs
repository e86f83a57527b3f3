//! What a planner is given at one moment, wherever it came from.

use crate::geometry::Pose2;
use crate::occupancy::Occupancy;

/// Obstacles, motion and reference at one moment, from a log or a simulated drive.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// When, nanoseconds since the Unix epoch in the source's clock.
    pub stamp_nanos: u64,
    /// Obstacles in the vehicle frame.
    pub occupancy: Occupancy,
    /// The vehicle's pose in the odometry frame.
    pub odom_from_vehicle: Pose2,
    /// Forward speed, m/s.
    pub speed_m_per_s: f64,
    /// How fast the heading turns to the left, rad/s.
    pub turn_rad_per_s: f64,
    /// The rough path ahead, in the vehicle frame; may be empty.
    pub reference: Vec<Pose2>,
}
