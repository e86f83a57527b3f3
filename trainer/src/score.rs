//! How well regions match labels, as counts that can be added up.

use std::collections::BTreeMap;

use swath_planner::Plane;

use crate::Example;

/// Upper ends of the distance groups, metres; the last group is open.
pub const DISTANCE_GROUPS_M: [f64; 5] = [10.0, 20.0, 30.0, 44.0, f64::INFINITY];

/// Counts of cells over any number of samples.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Samples.
    pub samples: u64,
    /// Cells in both region and label.
    pub intersection_path: u64,
    /// Cells in either.
    pub union_path: u64,
    /// Cells in neither.
    pub intersection_background: u64,
    /// Cells not in both.
    pub union_background: u64,
    /// Regions that join the vehicle with the target.
    pub joined: u64,
}

impl Counts {
    /// The counts of one region.
    ///
    /// Planes of different sizes count as far as the smaller one goes.
    pub fn of(region: &Plane, label: &Plane) -> Self {
        let (mut both, mut either) = (0, 0);
        for (&region, &label) in region.packed().iter().zip(label.packed()) {
            both += u64::from((region & label).count_ones());
            either += u64::from((region | label).count_ones());
        }
        let cells = region.len().min(label.len()) as u64;
        Self {
            samples: 1,
            intersection_path: both,
            union_path: either,
            intersection_background: cells - either,
            union_background: cells - both,
            joined: 0,
        }
    }

    /// Adds other counts.
    pub const fn add(&mut self, other: &Self) {
        self.samples += other.samples;
        self.intersection_path += other.intersection_path;
        self.union_path += other.union_path;
        self.intersection_background += other.intersection_background;
        self.union_background += other.union_background;
        self.joined += other.joined;
    }

    /// Intersection over union of the path's cells; NaN without samples.
    pub fn iou_path(&self) -> f64 {
        self.intersection_path as f64 / self.union_path as f64
    }

    /// Intersection over union of the other cells; NaN without samples.
    pub fn iou_background(&self) -> f64 {
        self.intersection_background as f64 / self.union_background as f64
    }

    /// The mean of both.
    pub fn miou(&self) -> f64 {
        f64::midpoint(self.iou_path(), self.iou_background())
    }

    /// Share of regions that join the vehicle with the target.
    pub fn joined_share(&self) -> f64 {
        self.joined as f64 / self.samples as f64
    }
}

/// Counts over samples, and over groups of them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scores {
    /// All samples.
    pub total: Counts,
    /// By kind of scene.
    pub by_scene: BTreeMap<String, Counts>,
    /// By distance of the goal, as [`DISTANCE_GROUPS_M`].
    pub by_distance: [Counts; DISTANCE_GROUPS_M.len()],
}

impl Scores {
    /// Adds one sample's region.
    pub fn add(&mut self, example: &Example, region: &Plane, label: &Plane) {
        let mut counts = Counts::of(region, label);
        counts.joined = u64::from(joins(example, region));
        self.total.add(&counts);
        self.by_scene
            .entry(example.scene.clone())
            .or_default()
            .add(&counts);
        let distance_m = example.distance_m();
        let group = DISTANCE_GROUPS_M
            .iter()
            .position(|&end_m| distance_m < end_m);
        self.by_distance[group.unwrap_or(DISTANCE_GROUPS_M.len() - 1)].add(&counts);
    }
}

/// Whether one can walk from the vehicle's cell to the target's disc within the region.
fn joins(example: &Example, region: &Plane) -> bool {
    let (rows, cols) = (region.rows() as usize, region.cols() as usize);
    let Some(start) = example.spec.index_of(example.spec.ego()) else {
        return false;
    };
    if region.len() != example.target.len() || !region.get_index(start) {
        return false;
    }
    let mut seen = Plane::empty(region.rows(), region.cols());
    seen.set_index(start);
    let mut open = vec![start];
    while let Some(cell) = open.pop() {
        if example.target.get_index(cell) {
            return true;
        }
        let (row, col) = (cell / cols, cell % cols);
        let neighbours = [
            (row > 0).then(|| cell - cols),
            (row + 1 < rows).then(|| cell + cols),
            (col > 0).then(|| cell - 1),
            (col + 1 < cols).then(|| cell + 1),
        ];
        for next in neighbours.into_iter().flatten() {
            if region.get_index(next) && !seen.get_index(next) {
                seen.set_index(next);
                open.push(next);
            }
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::example::tests::examples;
    use proptest::prelude::*;

    #[test]
    fn the_label_itself_scores_fully_and_joins_vehicle_and_target() {
        let mut scores = Scores::default();
        for example in &examples(6) {
            scores.add(example, &example.label, &example.label);
        }
        assert_eq!(scores.total.miou(), 1.0);
        assert_eq!(scores.total.joined_share(), 1.0);
        let samples: u64 = scores.by_scene.values().map(|counts| counts.samples).sum();
        assert_eq!(samples, 6);
        let samples: u64 = scores.by_distance.iter().map(|counts| counts.samples).sum();
        assert_eq!(samples, 6);
    }

    #[test]
    fn a_region_with_a_gap_does_not_join() {
        let example = &examples(1)[0];
        let mut cut = Plane::empty(example.spec.rows, example.spec.cols);
        for index in 0..cut.len() {
            let cell = example.spec.cell_of_index(index);
            if example.label.get_index(index) && cell.row != 45 {
                cut.set_index(index);
            }
        }
        assert!(joins(example, &example.label));
        assert!(!joins(example, &cut));
        assert!(!joins(
            example,
            &Plane::empty(example.spec.rows, example.spec.cols)
        ));
    }

    proptest! {
        #[test]
        fn counts_are_those_of_cell_by_cell_comparison(
            a in proptest::collection::vec(any::<bool>(), 35), b in proptest::collection::vec(any::<bool>(), 35),
        ) {
            let plane = |cells: &[bool]| {
                let mut plane = Plane::empty(5, 7);
                for (index, _) in cells.iter().enumerate().filter(|(_, set)| **set) {
                    plane.set_index(index);
                }
                plane
            };
            let counts = Counts::of(&plane(&a), &plane(&b));
            let count = |keep: fn(bool, bool) -> bool| {
                a.iter().zip(&b).filter(|&(&a, &b)| keep(a, b)).count() as u64
            };
            prop_assert_eq!(counts.intersection_path, count(|a, b| a && b));
            prop_assert_eq!(counts.union_path, count(|a, b| a || b));
            prop_assert_eq!(counts.intersection_background, count(|a, b| !a && !b));
            prop_assert_eq!(counts.union_background, count(|a, b| !(a && b)));
        }
    }
}
