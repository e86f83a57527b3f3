//! `tf2_msgs`.

use serde::{Deserialize, Serialize};

use super::Message;
use super::geometry::TransformStamped;

/// Transforms between frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TFMessage {
    /// Transforms.
    pub transforms: Vec<TransformStamped>,
}

impl Message for TFMessage {
    const TYPE_NAME: &'static str = "tf2_msgs/msg/TFMessage";
}
