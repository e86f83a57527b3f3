//! Setting samples aside for testing, at random or by scene.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};

use crate::Example;
use crate::random::{shuffle, stream};

/// Random numbers for splits are drawn from this stream.
const SPLIT_STREAM: u64 = 1 << 40;

/// How samples are set aside.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Split {
    /// Any sample, as the paper does: samples of one scene fall on both sides.
    Random,
    /// Whole scenes, so that what is tested was never seen.
    Scene,
}

/// Sets samples aside until at least `count` of them have a path; the rest comes first. Which ones
/// depends on `seed` only.
pub fn split(
    examples: Vec<Example>,
    by: Split,
    count: usize,
    seed: u64,
) -> (Vec<Example>, Vec<Example>) {
    let mut random = stream(seed, SPLIT_STREAM);
    let unit = |index: usize, example: &Example| match by {
        Split::Random => index as u64,
        Split::Scene => example.scene_id,
    };
    let mut solved_in = BTreeMap::new();
    for (index, example) in examples.iter().enumerate() {
        *solved_in.entry(unit(index, example)).or_insert(0) += usize::from(example.is_solved());
    }
    let mut units: Vec<u64> = solved_in.keys().copied().collect();
    shuffle(&mut random, &mut units);
    let mut chosen = BTreeSet::new();
    let mut found = 0;
    for unit in units {
        if found >= count {
            break;
        }
        found += solved_in[&unit];
        chosen.insert(unit);
    }
    let (mut rest, mut aside) = (Vec::new(), Vec::new());
    for (index, example) in examples.into_iter().enumerate() {
        if chosen.contains(&unit(index, &example)) {
            aside.push(example);
        } else {
            rest.push(example);
        }
    }
    (rest, aside)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::example::tests::examples;

    #[test]
    fn a_split_by_scene_never_divides_a_scene() {
        let (train, test) = split(examples(40), Split::Scene, 9, 3);
        assert_eq!(train.len() + test.len(), 40);
        assert_eq!(test.len(), 10);
        let ids = |examples: &[Example]| {
            let ids: BTreeSet<u64> = examples.iter().map(|example| example.scene_id).collect();
            ids
        };
        assert!(ids(&train).is_disjoint(&ids(&test)));
    }

    #[test]
    fn a_random_split_is_of_the_wanted_size_and_the_same_for_the_same_seed() {
        let (train, test) = split(examples(40), Split::Random, 9, 3);
        assert_eq!((train.len(), test.len()), (31, 9));
        assert_eq!(test, split(examples(40), Split::Random, 9, 3).1);
        assert_ne!(test, split(examples(40), Split::Random, 9, 4).1);
        assert_eq!(split(examples(4), Split::Random, 9, 3).1.len(), 4);
    }
}
