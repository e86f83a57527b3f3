//! `sensor_msgs`.

use serde::{Deserialize, Serialize};

use super::Message;
use super::header::Header;

/// One sweep of a 2D lidar.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct LaserScan {
    /// Header.
    pub header: Header,
    /// Angle min.
    pub angle_min: f32,
    /// Angle max.
    pub angle_max: f32,
    /// Angle increment.
    pub angle_increment: f32,
    /// Time increment.
    pub time_increment: f32,
    /// Scan time.
    pub scan_time: f32,
    /// Range min.
    pub range_min: f32,
    /// Range max.
    pub range_max: f32,
    /// Ranges.
    pub ranges: Vec<f32>,
    /// Intensities.
    pub intensities: Vec<f32>,
}

impl Message for LaserScan {
    const TYPE_NAME: &'static str = "sensor_msgs/msg/LaserScan";
}

/// Points of a 3D lidar, with fields as declared.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PointCloud2 {
    /// Header.
    pub header: Header,
    /// Height.
    pub height: u32,
    /// Width.
    pub width: u32,
    /// Fields.
    pub fields: Vec<PointField>,
    /// Is bigendian.
    pub is_bigendian: bool,
    /// Point step.
    pub point_step: u32,
    /// Row step.
    pub row_step: u32,
    /// Data.
    #[serde(with = "serde_bytes")]
    pub data: Vec<u8>,
    /// Is dense.
    pub is_dense: bool,
}

impl Message for PointCloud2 {
    const TYPE_NAME: &'static str = "sensor_msgs/msg/PointCloud2";
}

/// Where a field of a point lies in its bytes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PointField {
    /// Name.
    pub name: String,
    /// Offset.
    pub offset: u32,
    /// Datatype.
    pub datatype: u8,
    /// Count.
    pub count: u32,
}

impl Message for PointField {
    const TYPE_NAME: &'static str = "sensor_msgs/msg/PointField";
}

impl PointField {
    /// Value of `datatype` for this type of number.
    pub const INT8: u8 = 1;
    /// Value of `datatype` for this type of number.
    pub const UINT8: u8 = 2;
    /// Value of `datatype` for this type of number.
    pub const INT16: u8 = 3;
    /// Value of `datatype` for this type of number.
    pub const UINT16: u8 = 4;
    /// Value of `datatype` for this type of number.
    pub const INT32: u8 = 5;
    /// Value of `datatype` for this type of number.
    pub const UINT32: u8 = 6;
    /// Value of `datatype` for this type of number.
    pub const FLOAT32: u8 = 7;
    /// Value of `datatype` for this type of number.
    pub const FLOAT64: u8 = 8;
}
