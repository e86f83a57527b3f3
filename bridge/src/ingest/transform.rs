//! Where sensors are mounted: the tree of frames that `/tf` and `/tf_static` describe.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

use crate::msg::geometry::{self, TransformStamped};
use crate::msg::tf2::TFMessage;

/// Most frames of a tree; those that come later are passed over.
pub const MAX_FRAMES: usize = 10_000;
/// Most steps from a frame to the tree's root.
pub const MAX_DEPTH: usize = 64;

/// The newest transform of each frame from its parent.
#[derive(Debug, Clone, Default)]
pub struct TransformTree {
    /// By child: the parent, and parent from child.
    links: BTreeMap<String, (String, Isometry3<f64>)>,
}

impl TransformTree {
    /// Takes every transform of a message; those that are no rigid transform are passed over.
    ///
    /// Returns the number that were passed over.
    pub fn insert(&mut self, message: &TFMessage) -> usize {
        message
            .transforms
            .iter()
            .filter(|transform| !self.insert_one(transform))
            .count()
    }

    fn insert_one(&mut self, stamped: &TransformStamped) -> bool {
        let child = normalised(&stamped.child_frame_id);
        let parent = normalised(&stamped.header.frame_id);
        let Some(transform) = isometry_of(&stamped.transform) else {
            return false;
        };
        let is_full = self.links.len() >= MAX_FRAMES && !self.links.contains_key(child);
        if is_full || child.is_empty() || child == parent {
            return false;
        }
        self.links
            .insert(child.to_owned(), (parent.to_owned(), transform));
        true
    }

    /// Whether a message says of a frame below the vehicle something else than what is known. What is
    /// said of the vehicle itself is left to the odometry.
    pub(crate) fn is_changed_by(&self, message: &TFMessage) -> bool {
        const ABOVE: [&str; 4] = ["odom", "map", "world", "earth"];
        message.transforms.iter().any(|stamped| {
            let parent = normalised(&stamped.header.frame_id);
            let known = self.links.get(normalised(&stamped.child_frame_id));
            let is_known = known.is_some_and(|(before, transform)| {
                before == parent && isometry_of(&stamped.transform).as_ref() == Some(transform)
            });
            !is_known && !ABOVE.contains(&parent)
        })
    }

    /// `target_from_source`, or `None` if the two frames are not in one tree.
    pub fn lookup(&self, target: &str, source: &str) -> Option<Isometry3<f64>> {
        let (target, source) = (normalised(target), normalised(source));
        let from_target = self.to_root(target);
        for (ancestor, ancestor_from_source) in self.to_root(source) {
            if let Some((_, ancestor_from_target)) =
                from_target.iter().find(|(name, _)| *name == ancestor)
            {
                return Some(ancestor_from_target.inverse() * ancestor_from_source);
            }
        }
        None
    }

    /// The names of all frames that have a parent, in alphabetical order.
    pub fn frames(&self) -> impl Iterator<Item = &str> {
        self.links.keys().map(String::as_str)
    }

    /// The frame itself and its ancestors, each with `ancestor_from_frame`. A loop of frames ends at
    /// the greatest depth.
    fn to_root<'a>(&'a self, frame: &'a str) -> Vec<(&'a str, Isometry3<f64>)> {
        let mut chain = vec![(frame, Isometry3::identity())];
        let (mut name, mut ancestor_from_frame) = (frame, Isometry3::identity());
        while let Some((parent, parent_from_name)) = self.links.get(name) {
            if chain.len() > MAX_DEPTH {
                break;
            }
            ancestor_from_frame = parent_from_name * ancestor_from_frame;
            name = parent;
            chain.push((name, ancestor_from_frame));
        }
        chain
    }
}

/// The rotation of a quaternion, or `None` if it is none. All zeros, which many publishers leave
/// there, count as no rotation.
pub(crate) fn rotation_of(rotation: &geometry::Quaternion) -> Option<UnitQuaternion<f64>> {
    let quaternion = Quaternion::new(rotation.w, rotation.x, rotation.y, rotation.z);
    let norm = quaternion.norm();
    if norm == 0.0 {
        return Some(UnitQuaternion::identity());
    }
    (norm.is_finite() && norm > 0.1).then(|| UnitQuaternion::new_normalize(quaternion))
}

/// The rigid transform of a message, or `None` if it is none.
pub(crate) fn isometry_of(transform: &geometry::Transform) -> Option<Isometry3<f64>> {
    let rotation = rotation_of(&transform.rotation)?;
    let geometry::Vector3 { x, y, z } = transform.translation;
    let is_finite = x.is_finite() && y.is_finite() && z.is_finite();
    is_finite.then(|| Isometry3::from_parts(Translation3::new(x, y, z), rotation))
}

/// Frame names without the leading slash that older systems wrote.
pub(crate) fn normalised(frame: &str) -> &str {
    frame.strip_prefix('/').unwrap_or(frame)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::header::Header;
    use nalgebra::{Point3, Vector3};

    fn link(parent: &str, child: &str, xyz: [f64; 3], rpy: [f64; 3]) -> TransformStamped {
        let q = UnitQuaternion::from_euler_angles(rpy[0], rpy[1], rpy[2]);
        TransformStamped {
            header: Header::at(0, parent),
            child_frame_id: child.to_owned(),
            transform: geometry::Transform {
                translation: geometry::Vector3 {
                    x: xyz[0],
                    y: xyz[1],
                    z: xyz[2],
                },
                rotation: geometry::Quaternion {
                    x: q.i,
                    y: q.j,
                    z: q.k,
                    w: q.w,
                },
            },
        }
    }

    fn tree(transforms: Vec<TransformStamped>) -> TransformTree {
        let mut tree = TransformTree::default();
        assert_eq!(tree.insert(&TFMessage { transforms }), 0);
        tree
    }

    #[test]
    fn a_chain_is_followed_through_a_common_ancestor() {
        let tree = tree(vec![
            link("base_footprint", "base_link", [0.0, 0.0, 0.3], [0.0; 3]),
            link("base_footprint", "/mast", [1.0, 0.0, 1.5], [0.0, 0.0, 0.0]),
            link(
                "mast",
                "lidar",
                [0.0, 0.2, 0.0],
                [std::f64::consts::PI, 0.0, 0.0],
            ),
        ]);
        let base_from_lidar = tree.lookup("base_link", "lidar").unwrap();
        let point = base_from_lidar * Point3::new(2.0, 1.0, 0.5);
        assert!((point - Point3::new(3.0, -0.8, 0.7)).norm() < 1e-12);
        let back = tree.lookup("lidar", "base_link").unwrap();
        assert!((back * point - Point3::new(2.0, 1.0, 0.5)).norm() < 1e-12);
        assert_eq!(tree.lookup("base_link", "camera"), None);
    }

    #[test]
    fn a_frame_is_itself_even_where_nothing_is_known_of_it() {
        let same = TransformTree::default().lookup("lidar", "/lidar").unwrap();
        assert_eq!(same, Isometry3::identity());
    }

    #[test]
    fn loops_and_what_is_no_transform_do_no_harm() {
        let mut tree = tree(vec![
            link("a", "b", [1.0, 0.0, 0.0], [0.0; 3]),
            link("b", "a", [1.0, 0.0, 0.0], [0.0; 3]),
        ]);
        assert_eq!(tree.lookup("c", "a"), None);
        let mut bad = link("a", "c", [f64::NAN, 0.0, 0.0], [0.0; 3]);
        assert_eq!(
            tree.insert(&TFMessage {
                transforms: vec![bad.clone()]
            }),
            1
        );
        bad = link("c", "c", [0.0; 3], [0.0; 3]);
        assert_eq!(
            tree.insert(&TFMessage {
                transforms: vec![bad.clone()]
            }),
            1
        );
        bad = link("a", "c", [0.0; 3], [0.0; 3]);
        bad.transform.rotation.w = f64::INFINITY;
        assert_eq!(
            tree.insert(&TFMessage {
                transforms: vec![bad]
            }),
            1
        );
    }

    #[test]
    fn a_newer_transform_replaces_the_older() {
        let mut tree = tree(vec![link("base", "lidar", [1.0, 0.0, 0.0], [0.0; 3])]);
        tree.insert(&TFMessage {
            transforms: vec![link("base", "lidar", [2.0, 0.0, 0.0], [0.0; 3])],
        });
        let moved = tree.lookup("base", "lidar").unwrap();
        assert_eq!(moved.translation.vector, Vector3::new(2.0, 0.0, 0.0));
    }
}
