//! What a recording says about a topic: its type, schema and quality of service.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::keys::{self, Qos};
use crate::msg;

/// Key under which rosbag2 keeps the publishers' quality of service.
const QOS_KEY: &str = "offered_qos_profiles";
/// The encoding of messages in recordings of ROS 2.
pub(super) const CDR: &str = "cdr";
/// The encoding of schemas that are written as `.msg` files.
pub(super) const ROS2_MSG: &str = "ros2msg";

/// A topic of a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    /// Topic, with the slash in front that ROS gives it.
    pub topic: Arc<str>,
    /// Type as ROS 2 writes it, for example `nav_msgs/msg/Path`; empty if the file does not say.
    pub type_name: Arc<str>,
    /// Encoding of the messages: `cdr` in everything that can be decoded.
    pub encoding: String,
    /// Encoding of the schema, for example `ros2msg`; empty if there is none.
    pub schema_encoding: String,
    /// The schema.
    pub schema: Vec<u8>,
    /// Whatever else the recording says.
    pub metadata: BTreeMap<String, String>,
}

impl Channel {
    /// A topic with CDR messages of a type and the schema that swath has of it, if it has one.
    pub fn cdr(topic: &str, type_name: &str) -> Self {
        let schema = msg::schema_of(type_name);
        let mut metadata = BTreeMap::new();
        if let Some((_, qos)) = keys::classify(keys::key_of_topic(topic)) {
            metadata.insert(QOS_KEY.to_owned(), qos_profile(qos));
        }
        Self {
            topic: topic.into(),
            type_name: type_name.into(),
            encoding: CDR.to_owned(),
            schema_encoding: ROS2_MSG.to_owned(),
            schema: schema.unwrap_or_default().into_bytes(),
            metadata,
        }
    }
}

/// The name of a type with its middle part, which some writers leave out.
pub(super) fn full_type_name(name: &str) -> String {
    match name.split_once('/') {
        Some((package, rest)) if !rest.contains('/') => format!("{package}/msg/{rest}"),
        _ => name.to_owned(),
    }
}

/// The list that rosbag2 writes as YAML, with what corresponds in ROS 2 to a quality of service.
fn qos_profile(qos: Qos) -> String {
    let (depth, reliability, durability) = match qos {
        Qos::Durable | Qos::Latched => (1, "reliable", "transient_local"),
        Qos::Kept => (100, "reliable", "transient_local"),
        Qos::Newest => (1, "best_effort", "volatile"),
        Qos::Block => (100, "reliable", "volatile"),
        Qos::Interactive | Qos::Lossy => (10, "best_effort", "volatile"),
    };
    // The longest time that ROS 2 has, which stands for none.
    let infinite = "\n    sec: 9223372036\n    nsec: 854775807";
    format!(
        "- history: keep_last\n  depth: {depth}\n  reliability: {reliability}\n  \
         durability: {durability}\n  deadline:{infinite}\n  lifespan:{infinite}\n  \
         liveliness: automatic\n  liveliness_lease_duration:{infinite}\n  \
         avoid_ros_namespace_conventions: false\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn type_names_get_their_middle_part() {
        assert_eq!(full_type_name("nav_msgs/Path"), "nav_msgs/msg/Path");
        assert_eq!(full_type_name("nav_msgs/msg/Path"), "nav_msgs/msg/Path");
        assert_eq!(full_type_name("Path"), "Path");
    }
}
