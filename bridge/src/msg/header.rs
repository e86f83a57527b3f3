//! `std_msgs` and `builtin_interfaces`.

use serde::{Deserialize, Serialize};

use super::Message;

/// A span of time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Duration {
    /// Sec.
    pub sec: i32,
    /// Nanosec.
    pub nanosec: u32,
}

impl Message for Duration {
    const TYPE_NAME: &'static str = "builtin_interfaces/msg/Duration";
}

/// A point in time: seconds and nanoseconds since the Unix epoch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Time {
    /// Sec.
    pub sec: i32,
    /// Nanosec.
    pub nanosec: u32,
}

impl Message for Time {
    const TYPE_NAME: &'static str = "builtin_interfaces/msg/Time";
}

/// When and in which frame the data of a message are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Stamp.
    pub stamp: Time,
    /// Frame id.
    pub frame_id: String,
}

impl Message for Header {
    const TYPE_NAME: &'static str = "std_msgs/msg/Header";
}

impl Time {
    /// The stamp of a count of nanoseconds since the Unix epoch.
    ///
    /// Beyond the year 2038 the seconds of this message type saturate.
    pub fn from_nanos(nanos: u64) -> Self {
        const NANOS_PER_S: u64 = 1_000_000_000;
        Self {
            sec: i32::try_from(nanos / NANOS_PER_S).unwrap_or(i32::MAX),
            nanosec: u32::try_from(nanos % NANOS_PER_S).unwrap_or(0),
        }
    }

    /// Nanoseconds since the Unix epoch; stamps before it count as 0.
    pub fn nanos(&self) -> u64 {
        u64::try_from(self.sec).unwrap_or(0) * 1_000_000_000 + u64::from(self.nanosec)
    }
}

impl Header {
    /// A header in a frame at a count of nanoseconds since the Unix epoch.
    pub fn at(stamp_nanos: u64, frame_id: &str) -> Self {
        Self {
            stamp: Time::from_nanos(stamp_nanos),
            frame_id: frame_id.to_owned(),
        }
    }
}
