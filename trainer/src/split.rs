//! Setting samples aside for testing, at random or by scene.

use std::collections::BTreeSet;

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

/// Sets at least `count` samples aside; the rest comes first. Which ones depends on `seed` only.
pub fn split(
    examples: Vec<Example>,
    by: Split,
    count: usize,
    seed: u64,
) -> (Vec<Example>, Vec<Example>) {
    let mut random = stream(seed, SPLIT_STREAM);
    let mut aside = vec![false; examples.len()];
    match by {
        Split::Random => {
            let mut order: Vec<usize> = (0..examples.len()).collect();
            shuffle(&mut random, &mut order);
            for index in order.into_iter().take(count) {
                aside[index] = true;
            }
        }
        Split::Scene => {
            let scenes: BTreeSet<_> = examples.iter().map(scene_key).collect();
            let mut scenes: Vec<_> = scenes.into_iter().collect();
            shuffle(&mut random, &mut scenes);
            let mut chosen = BTreeSet::new();
            let mut found = 0;
            for scene in scenes {
                if found >= count {
                    break;
                }
                found += examples
                    .iter()
                    .filter(|example| scene_key(example) == scene)
                    .count();
                chosen.insert(scene);
            }
            for (aside, example) in aside.iter_mut().zip(&examples) {
                *aside = chosen.contains(&scene_key(example));
            }
        }
    }
    let (mut rest, mut chosen) = (Vec::new(), Vec::new());
    for (example, aside) in examples.into_iter().zip(aside) {
        if aside {
            chosen.push(example);
        } else {
            rest.push(example);
        }
    }
    (rest, chosen)
}

const fn scene_key(example: &Example) -> u64 {
    example.scene_id
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
