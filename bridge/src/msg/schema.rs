//! The `.msg` definitions, and the form in which MCAP wants them: a type's own definition followed by
//! those of all types that it uses.

use std::fmt::Write as _;

/// Separates definitions inside a `ros2msg` schema.
const SEPARATOR: &str =
    "================================================================================";

/// `(package/Type, definition)`.
const DEFINITIONS: &[(&str, &str)] = &[
    (
        "builtin_interfaces/Duration",
        include_str!("../../msg/builtin_interfaces/Duration.msg"),
    ),
    (
        "builtin_interfaces/Time",
        include_str!("../../msg/builtin_interfaces/Time.msg"),
    ),
    (
        "geometry_msgs/Point",
        include_str!("../../msg/geometry_msgs/Point.msg"),
    ),
    (
        "geometry_msgs/Pose",
        include_str!("../../msg/geometry_msgs/Pose.msg"),
    ),
    (
        "geometry_msgs/PoseArray",
        include_str!("../../msg/geometry_msgs/PoseArray.msg"),
    ),
    (
        "geometry_msgs/PoseStamped",
        include_str!("../../msg/geometry_msgs/PoseStamped.msg"),
    ),
    (
        "geometry_msgs/PoseWithCovariance",
        include_str!("../../msg/geometry_msgs/PoseWithCovariance.msg"),
    ),
    (
        "geometry_msgs/Quaternion",
        include_str!("../../msg/geometry_msgs/Quaternion.msg"),
    ),
    (
        "geometry_msgs/Transform",
        include_str!("../../msg/geometry_msgs/Transform.msg"),
    ),
    (
        "geometry_msgs/TransformStamped",
        include_str!("../../msg/geometry_msgs/TransformStamped.msg"),
    ),
    (
        "geometry_msgs/Twist",
        include_str!("../../msg/geometry_msgs/Twist.msg"),
    ),
    (
        "geometry_msgs/TwistWithCovariance",
        include_str!("../../msg/geometry_msgs/TwistWithCovariance.msg"),
    ),
    (
        "geometry_msgs/Vector3",
        include_str!("../../msg/geometry_msgs/Vector3.msg"),
    ),
    (
        "nav_msgs/MapMetaData",
        include_str!("../../msg/nav_msgs/MapMetaData.msg"),
    ),
    (
        "nav_msgs/OccupancyGrid",
        include_str!("../../msg/nav_msgs/OccupancyGrid.msg"),
    ),
    (
        "nav_msgs/Odometry",
        include_str!("../../msg/nav_msgs/Odometry.msg"),
    ),
    ("nav_msgs/Path", include_str!("../../msg/nav_msgs/Path.msg")),
    (
        "sensor_msgs/LaserScan",
        include_str!("../../msg/sensor_msgs/LaserScan.msg"),
    ),
    (
        "sensor_msgs/PointCloud2",
        include_str!("../../msg/sensor_msgs/PointCloud2.msg"),
    ),
    (
        "sensor_msgs/PointField",
        include_str!("../../msg/sensor_msgs/PointField.msg"),
    ),
    (
        "std_msgs/Header",
        include_str!("../../msg/std_msgs/Header.msg"),
    ),
    (
        "swath_msgs/Evaluation",
        include_str!("../../msg/swath_msgs/Evaluation.msg"),
    ),
    (
        "swath_msgs/PlanReport",
        include_str!("../../msg/swath_msgs/PlanReport.msg"),
    ),
    (
        "swath_msgs/PlanarPose",
        include_str!("../../msg/swath_msgs/PlanarPose.msg"),
    ),
    (
        "swath_msgs/Rejection",
        include_str!("../../msg/swath_msgs/Rejection.msg"),
    ),
    (
        "swath_msgs/Sample",
        include_str!("../../msg/swath_msgs/Sample.msg"),
    ),
    (
        "swath_msgs/TargetPlan",
        include_str!("../../msg/swath_msgs/TargetPlan.msg"),
    ),
    (
        "swath_msgs/TrainStatus",
        include_str!("../../msg/swath_msgs/TrainStatus.msg"),
    ),
    (
        "swath_msgs/Weights",
        include_str!("../../msg/swath_msgs/Weights.msg"),
    ),
    (
        "tf2_msgs/TFMessage",
        include_str!("../../msg/tf2_msgs/TFMessage.msg"),
    ),
];

/// The definition of a type alone, by either of its names (`nav_msgs/Path`, `nav_msgs/msg/Path`).
pub fn definition_of(type_name: &str) -> Option<&'static str> {
    let short_name = type_name.replacen("/msg/", "/", 1);
    DEFINITIONS
        .iter()
        .find(|(name, _)| *name == short_name)
        .map(|(_, definition)| *definition)
}

/// The `ros2msg` schema of a type: its definition and those of every type it uses, each once.
pub fn schema_of(type_name: &str) -> Option<String> {
    let mut schema = definition_of(type_name)?.to_owned();
    let mut queue = used_types(&schema);
    let mut done = Vec::new();
    while let Some(used) = queue.pop() {
        if done.contains(&used) {
            continue;
        }
        let definition = definition_of(used)?;
        // Writing to a String cannot fail.
        let _ = write!(schema, "{SEPARATOR}\nMSG: {used}\n{definition}");
        queue.extend(used_types(definition));
        done.push(used);
    }
    Some(schema)
}

/// Types with a package in their name that a definition's fields have.
fn used_types(definition: &str) -> Vec<&'static str> {
    definition
        .lines()
        .filter_map(|line| line.split('#').next()?.split_whitespace().next())
        .filter_map(|field_type| {
            let name = field_type.split('[').next()?;
            DEFINITIONS
                .iter()
                .map(|(known, _)| *known)
                .find(|known| *known == name)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_schema_holds_every_type_it_uses_once() {
        for (name, _) in DEFINITIONS {
            let schema = schema_of(name).unwrap();
            for line in schema.lines() {
                let Some(field_type) = line.split('#').next().unwrap().split_whitespace().next()
                else {
                    continue;
                };
                let used = field_type.split('[').next().unwrap();
                if used.contains('/') && !field_type.starts_with("MSG:") {
                    let marker = format!("MSG: {used}\n");
                    assert_eq!(schema.matches(&marker).count(), 1, "{used} in {name}");
                }
            }
        }
    }

    #[test]
    fn both_forms_of_a_name_are_known() {
        assert!(definition_of("nav_msgs/msg/Path").is_some());
        assert_eq!(
            definition_of("nav_msgs/msg/Path"),
            definition_of("nav_msgs/Path")
        );
        assert_eq!(schema_of("nav_msgs/msg/Nonsense"), None);
    }
}
