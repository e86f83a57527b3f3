//! Poses, paths and motion in the plane, to and from ROS messages.

use crate::frame::Frame;
use crate::geometry::Pose2;
use crate::msg::geometry::{
    Point, Pose, PoseStamped, PoseWithCovariance, Quaternion, Twist, TwistWithCovariance, Vector3,
};
use crate::msg::header::Header;
use crate::msg::nav::{Odometry, Path};

/// The frame that odometry is in.
const ODOM_FRAME: &str = "odom";

/// A plane pose as a ROS pose.
pub fn ros_pose(pose: &Pose2) -> Pose {
    let (z, w) = libm::sincos(pose.yaw_rad / 2.0);
    Pose {
        position: Point {
            x: pose.x_m,
            y: pose.y_m,
            z: 0.0,
        },
        orientation: Quaternion {
            x: 0.0,
            y: 0.0,
            z,
            w,
        },
    }
}

/// The pose in the plane of a ROS pose: its position, and the heading of its x axis, whatever the length
/// of its quaternion.
pub fn pose_of_ros(pose: &Pose) -> Pose2 {
    let q = &pose.orientation;
    let sin = 2.0 * (q.w * q.z + q.x * q.y);
    let cos = q.w * q.w + q.x * q.x - q.y * q.y - q.z * q.z;
    Pose2::new(pose.position.x, pose.position.y, libm::atan2(sin, cos))
}

/// Poses as a path.
pub fn path_message(header: &Header, poses: &[Pose2]) -> Path {
    let stamped = |pose: &Pose2| PoseStamped {
        header: header.clone(),
        pose: ros_pose(pose),
    };
    Path {
        header: header.clone(),
        poses: poses.iter().map(stamped).collect(),
    }
}

/// The poses of a path; those that are not finite are left out.
pub fn poses_of_path(path: &Path) -> Vec<Pose2> {
    let poses = path.poses.iter().map(|stamped| pose_of_ros(&stamped.pose));
    poses.filter(Pose2::is_finite).collect()
}

/// A frame's pose and motion as odometry; the header's frame is the child of `odom`.
pub fn odometry_message(header: &Header, frame: &Frame) -> Odometry {
    const UNKNOWN: [f64; 36] = [0.0; 36];
    let still = Vector3 {
        x: 0.0,
        y: 0.0,
        z: 0.0,
    };
    Odometry {
        header: Header {
            frame_id: ODOM_FRAME.to_owned(),
            ..header.clone()
        },
        child_frame_id: header.frame_id.clone(),
        pose: PoseWithCovariance {
            pose: ros_pose(&frame.odom_from_vehicle),
            covariance: UNKNOWN,
        },
        twist: TwistWithCovariance {
            twist: Twist {
                linear: Vector3 {
                    x: frame.speed_m_per_s,
                    ..still.clone()
                },
                angular: Vector3 {
                    z: frame.turn_rad_per_s,
                    ..still
                },
            },
            covariance: UNKNOWN,
        },
    }
}
