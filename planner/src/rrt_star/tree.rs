//! Poses with the drives that lead to them; subtrees can be hung elsewhere.

use swath_bridge::Pose2;

use crate::segment::{Segment, cost_of};

/// Number of the root.
pub(super) const ROOT: u32 = 0;
/// Stands for no node.
const NONE: u32 = u32::MAX;

#[derive(Debug, Clone, Copy)]
struct Node {
    pose: Pose2,
    /// Metres plus radians from the root.
    cost: f64,
    parent: u32,
    first_child: u32,
    next_sibling: u32,
    /// From the parent.
    drive: [Segment; 3],
}

/// A tree of drives.
#[derive(Debug, Default)]
pub(super) struct Tree {
    nodes: Vec<Node>,
    /// Nodes whose costs are yet to be corrected.
    waiting: Vec<u32>,
}

impl Tree {
    /// Begins anew with a root.
    pub(super) fn plant(&mut self, pose: Pose2) {
        self.nodes.clear();
        self.nodes.push(Node {
            pose,
            cost: 0.0,
            parent: NONE,
            first_child: NONE,
            next_sibling: NONE,
            drive: [Segment::default(); 3],
        });
    }

    pub(super) fn pose(&self, node: u32) -> Pose2 {
        self.nodes[node as usize].pose
    }

    pub(super) fn cost(&self, node: u32) -> f64 {
        self.nodes[node as usize].cost
    }

    /// Writes the squared distances of all nodes to a point, in metres, with their numbers.
    pub(super) fn distances_to(&self, (x_m, y_m): (f64, f64), to: &mut Vec<(f64, u32)>) {
        to.clear();
        to.extend((0..).zip(&self.nodes).map(|(number, node)| {
            let (dx_m, dy_m) = (node.pose.x_m - x_m, node.pose.y_m - y_m);
            (dx_m * dx_m + dy_m * dy_m, number)
        }));
    }

    /// Adds a node below another one.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the number of iterations is limited"
    )]
    pub(super) fn add(&mut self, pose: Pose2, parent: u32, drive: [Segment; 3]) -> u32 {
        let number = self.nodes.len() as u32;
        let above = &mut self.nodes[parent as usize];
        let node = Node {
            pose,
            cost: above.cost + cost_of(&drive),
            parent,
            first_child: NONE,
            next_sibling: above.first_child,
            drive,
        };
        above.first_child = number;
        self.nodes.push(node);
        number
    }

    /// Hangs a node with all below it below another one, which must not be below it.
    pub(super) fn hang(&mut self, node: u32, parent: u32, drive: [Segment; 3]) {
        self.unhang(node);
        let above = &mut self.nodes[parent as usize];
        let cost = above.cost + cost_of(&drive);
        let sibling = std::mem::replace(&mut above.first_child, node);
        let hung = &mut self.nodes[node as usize];
        let change = cost - hung.cost;
        (hung.parent, hung.next_sibling, hung.drive) = (parent, sibling, drive);
        self.waiting.push(node);
        while let Some(node) = self.waiting.pop() {
            let below = &mut self.nodes[node as usize];
            below.cost += change;
            let mut child = below.first_child;
            while child != NONE {
                self.waiting.push(child);
                child = self.nodes[child as usize].next_sibling;
            }
        }
    }

    /// Takes a node out of its parent's children.
    fn unhang(&mut self, node: u32) {
        let Node {
            parent,
            next_sibling,
            ..
        } = self.nodes[node as usize];
        let above = &mut self.nodes[parent as usize];
        if above.first_child == node {
            above.first_child = next_sibling;
            return;
        }
        let mut sibling = above.first_child;
        while sibling != NONE {
            let other = &mut self.nodes[sibling as usize];
            if other.next_sibling == node {
                other.next_sibling = next_sibling;
                return;
            }
            sibling = other.next_sibling;
        }
    }

    /// The segments from the root to a node.
    pub(super) fn drive_to(&self, node: u32) -> Vec<Segment> {
        let mut segments = Vec::new();
        let mut node = &self.nodes[node as usize];
        while node.parent != NONE {
            segments.extend(node.drive.into_iter().rev());
            node = &self.nodes[node.parent as usize];
        }
        segments.reverse();
        segments
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn straight(length_m: f64) -> [Segment; 3] {
        let segment = Segment {
            curvature_per_m: 0.0,
            length_m,
        };
        [segment, Segment::default(), Segment::default()]
    }

    proptest! {
        #[test]
        fn costs_are_those_of_the_drives_however_often_nodes_are_hung_elsewhere(
            lengths in proptest::collection::vec((0.1..5.0f64, any::<u16>()), 2..40),
            moves in proptest::collection::vec((any::<u16>(), any::<u16>(), 0.1..5.0f64), 0..60),
        ) {
            let mut tree = Tree::default();
            tree.plant(Pose2::default());
            for (index, &(length_m, parent)) in lengths.iter().enumerate() {
                let parent = u32::from(parent) % u32::try_from(index + 1).unwrap();
                tree.add(Pose2::default(), parent, straight(length_m));
            }
            let count = u32::try_from(tree.nodes.len()).unwrap();
            for (node, parent, length_m) in moves {
                let (node, parent) = (1 + u32::from(node) % (count - 1), u32::from(parent) % count);
                let mut above = parent;
                while above != NONE && above != node {
                    above = tree.nodes[above as usize].parent;
                }
                if above == NONE {
                    tree.hang(node, parent, straight(length_m));
                }
            }
            for node in 0..count {
                let driven = cost_of(&tree.drive_to(node));
                prop_assert!((tree.cost(node) - driven).abs() < 1e-9);
                let of_parent = tree.nodes[node as usize].parent;
                let siblings = (0..count).filter(|&other| {
                    other > 0 && tree.nodes[other as usize].parent == of_parent
                });
                if of_parent != NONE {
                    let mut listed = Vec::new();
                    let mut child = tree.nodes[of_parent as usize].first_child;
                    while child != NONE {
                        listed.push(child);
                        child = tree.nodes[child as usize].next_sibling;
                    }
                    listed.sort_unstable();
                    prop_assert_eq!(listed, siblings.collect::<Vec<_>>());
                }
            }
        }
    }
}
