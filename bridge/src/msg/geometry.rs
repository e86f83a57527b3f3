//! `geometry_msgs`.

use serde::{Deserialize, Serialize};

use super::Message;
use super::header::Header;

/// A point, metres.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// X.
    pub x: f64,
    /// Y.
    pub y: f64,
    /// Z.
    pub z: f64,
}

impl Message for Point {
    const TYPE_NAME: &'static str = "geometry_msgs/msg/Point";
}

/// Position and orientation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Position.
    pub position: Point,
    /// Orientation.
    pub orientation: Quaternion,
}

impl Message for Pose {
    const TYPE_NAME: &'static str = "geometry_msgs/msg/Pose";
}

/// Poses that share a header.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PoseArray {
    /// Header.
    pub header: Header,
    /// Poses.
    pub poses: Vec<Pose>,
}

impl Message for PoseArray {
    const TYPE_NAME: &'static str = "geometry_msgs/msg/PoseArray";
}

/// A pose with its header.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PoseStamped {
    /// Header.
    pub header: Header,
    /// Pose.
    pub pose: Pose,
}

impl Message for PoseStamped {
    const TYPE_NAME: &'static str = "geometry_msgs/msg/PoseStamped";
}

/// A pose and its row-major 6 × 6 covariance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PoseWithCovariance {
    /// Pose.
    pub pose: Pose,
    /// Covariance.
    #[serde(with = "super::fixed_array")]
    pub covariance: [f64; 36],
}

impl Message for PoseWithCovariance {
    const TYPE_NAME: &'static str = "geometry_msgs/msg/PoseWithCovariance";
}

/// A rotation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Quaternion {
    /// X.
    pub x: f64,
    /// Y.
    pub y: f64,
    /// Z.
    pub z: f64,
    /// W.
    pub w: f64,
}

impl Message for Quaternion {
    const TYPE_NAME: &'static str = "geometry_msgs/msg/Quaternion";
}

/// A rigid transform.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Transform {
    /// Translation.
    pub translation: Vector3,
    /// Rotation.
    pub rotation: Quaternion,
}

impl Message for Transform {
    const TYPE_NAME: &'static str = "geometry_msgs/msg/Transform";
}

/// `frame_id` from `child_frame_id`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TransformStamped {
    /// Header.
    pub header: Header,
    /// Child frame id.
    pub child_frame_id: String,
    /// Transform.
    pub transform: Transform,
}

impl Message for TransformStamped {
    const TYPE_NAME: &'static str = "geometry_msgs/msg/TransformStamped";
}

/// Linear and angular velocity, m/s and rad/s.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Twist {
    /// Linear.
    pub linear: Vector3,
    /// Angular.
    pub angular: Vector3,
}

impl Message for Twist {
    const TYPE_NAME: &'static str = "geometry_msgs/msg/Twist";
}

/// A twist and its row-major 6 × 6 covariance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TwistWithCovariance {
    /// Twist.
    pub twist: Twist,
    /// Covariance.
    #[serde(with = "super::fixed_array")]
    pub covariance: [f64; 36],
}

impl Message for TwistWithCovariance {
    const TYPE_NAME: &'static str = "geometry_msgs/msg/TwistWithCovariance";
}

/// A vector.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Vector3 {
    /// X.
    pub x: f64,
    /// Y.
    pub y: f64,
    /// Z.
    pub z: f64,
}

impl Message for Vector3 {
    const TYPE_NAME: &'static str = "geometry_msgs/msg/Vector3";
}
