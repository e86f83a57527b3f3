//! `nav_msgs`.

use serde::{Deserialize, Serialize};

use super::Message;
use super::geometry::{Pose, PoseStamped, PoseWithCovariance, TwistWithCovariance};
use super::header::{Header, Time};

/// Size and place of an occupancy grid.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MapMetaData {
    /// Map load time.
    pub map_load_time: Time,
    /// Resolution.
    pub resolution: f32,
    /// Width.
    pub width: u32,
    /// Height.
    pub height: u32,
    /// Origin.
    pub origin: Pose,
}

impl Message for MapMetaData {
    const TYPE_NAME: &'static str = "nav_msgs/msg/MapMetaData";
}

/// Occupancy by cell; the index runs along x first.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct OccupancyGrid {
    /// Header.
    pub header: Header,
    /// Info.
    pub info: MapMetaData,
    /// Data.
    #[serde(with = "super::signed_bytes")]
    pub data: Vec<i8>,
}

impl Message for OccupancyGrid {
    const TYPE_NAME: &'static str = "nav_msgs/msg/OccupancyGrid";
}

/// Pose in `header.frame_id`, velocity in `child_frame_id`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Odometry {
    /// Header.
    pub header: Header,
    /// Child frame id.
    pub child_frame_id: String,
    /// Pose.
    pub pose: PoseWithCovariance,
    /// Twist.
    pub twist: TwistWithCovariance,
}

impl Message for Odometry {
    const TYPE_NAME: &'static str = "nav_msgs/msg/Odometry";
}

/// Poses to be driven through.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Path {
    /// Header.
    pub header: Header,
    /// Poses.
    pub poses: Vec<PoseStamped>,
}

impl Message for Path {
    const TYPE_NAME: &'static str = "nav_msgs/msg/Path";
}
