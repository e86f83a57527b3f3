//! A bounded buffer of the newest samples of the live stream, each counted once.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use swath_bridge::GridSpec;
use swath_bridge::msg::swath::Sample;

use crate::{Example, Reached};

/// Sequence numbers of a generator that are remembered to recognise duplicates.
const WINDOW: usize = 4096;
/// Most generators (by id and seed) whose sequence is followed.
const MAX_GENERATORS: usize = 1024;

/// What came in from the stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Samples, duplicates and rejected ones included.
    pub received: u64,
    /// Sequence numbers that never came.
    pub gaps: u64,
    /// Samples that had come before, or too late to tell.
    pub duplicates: u64,
    /// Samples that one cannot learn from because they contradict themselves or the buffer.
    pub rejected: u64,
    /// Samples without a path.
    pub unsolved: u64,
}

/// The newest solved samples.
#[derive(Debug)]
pub struct Replay {
    capacity: usize,
    /// Grid of the samples; that of the first one if none was given.
    spec: Option<GridSpec>,
    examples: Vec<Arc<Example>>,
    oldest: usize,
    generators: BTreeMap<(String, u64), Sequence>,
    counts: Counts,
}

/// Sequence numbers of one generator.
#[derive(Debug, Default)]
struct Sequence {
    seen: BTreeSet<u64>,
    /// Numbers below this are no longer remembered.
    floor: u64,
}

#[derive(Debug, PartialEq, Eq)]
enum Arrival {
    /// New, and so many numbers were skipped before it.
    Next(u64),
    /// Fills a gap that had been counted.
    Late,
    Duplicate,
}

impl Sequence {
    fn arrive(&mut self, number: u64) -> Arrival {
        let Some(&newest) = self.seen.last() else {
            // A trainer may join late, so what came before its first sample is no gap.
            self.floor = number;
            self.seen.insert(number);
            return Arrival::Next(0);
        };
        if number < self.floor || !self.seen.insert(number) {
            return Arrival::Duplicate;
        }
        while self.seen.len() > WINDOW {
            self.floor = self.seen.pop_first().map_or(self.floor, |first| first + 1);
        }
        if number > newest {
            Arrival::Next(number - newest - 1)
        } else {
            Arrival::Late
        }
    }
}

impl Replay {
    /// An empty buffer of at most `capacity` samples.
    pub fn new(capacity: usize) -> Self {
        Self {
            capacity: capacity.max(1),
            spec: None,
            examples: Vec::new(),
            oldest: 0,
            generators: BTreeMap::new(),
            counts: Counts::default(),
        }
    }

    /// An empty buffer of at most `capacity` samples on one grid only.
    pub fn on_grid(capacity: usize, spec: GridSpec) -> Self {
        Self {
            spec: Some(spec),
            ..Self::new(capacity)
        }
    }

    /// Takes a sample in, in place of the oldest when full. A sample that came before, whose target
    /// stands on an obstacle or that cannot be used is only counted.
    pub fn add(&mut self, sample: Sample) {
        if let Some(example) = self.admit(sample) {
            self.push(example);
        }
    }

    /// Counts a sample, and gives it back checked if it is new and can be learnt from.
    pub(crate) fn admit(&mut self, sample: Sample) -> Option<Example> {
        self.counts.received += 1;
        let key = (sample.generator.clone(), sample.seed);
        if !self.generators.contains_key(&key) && self.generators.len() >= MAX_GENERATORS {
            self.counts.rejected += 1;
            return None;
        }
        let sequence = self.generators.entry(key).or_default();
        match sequence.arrive(sample.sequence) {
            Arrival::Duplicate => {
                self.counts.duplicates += 1;
                return None;
            }
            Arrival::Next(skipped) => self.counts.gaps = self.counts.gaps.saturating_add(skipped),
            Arrival::Late => self.counts.gaps = self.counts.gaps.saturating_sub(1),
        }
        match Example::from_sample(sample) {
            Ok(example) if *self.spec.get_or_insert(example.spec) == example.spec => {
                self.counts.unsolved += u64::from(!example.is_solved());
                Some(example).filter(|example| Reached::of(example).is_some())
            }
            Ok(_) | Err(_) => {
                self.counts.rejected += 1;
                None
            }
        }
    }

    /// The samples held, in no particular order.
    pub fn examples(&self) -> &[Arc<Example>] {
        &self.examples
    }

    /// What came in so far.
    pub const fn counts(&self) -> Counts {
        self.counts
    }

    /// Holds a sample, in place of the oldest when full.
    pub(crate) fn push(&mut self, example: Example) {
        let example = Arc::new(example);
        if self.examples.len() < self.capacity {
            self.examples.push(example);
        } else {
            self.examples[self.oldest] = example;
            self.oldest = (self.oldest + 1) % self.capacity;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::example::tests::sample;
    use proptest::prelude::*;
    use swath_bridge::Outcome;

    #[test]
    fn the_newest_samples_are_kept() {
        let mut replay = Replay::new(3);
        (0..5).for_each(|index| replay.add(sample(index)));
        let expected: Vec<_> = [3, 4, 2]
            .map(|index| Example::from_sample(sample(index)).unwrap())
            .into();
        let held: Vec<Example> = replay
            .examples()
            .iter()
            .map(|held| (**held).clone())
            .collect();
        assert_eq!(held, expected);
    }

    #[test]
    fn a_generator_that_starts_again_with_another_seed_is_another_generator() {
        let mut replay = Replay::new(10);
        replay.add(sample(0));
        replay.add(Sample {
            seed: 2,
            ..sample(0)
        });
        assert_eq!(replay.examples().len(), 2);
        assert_eq!(replay.counts().duplicates, 0);
    }

    #[test]
    fn samples_with_an_occupied_goal_and_of_another_grid_are_counted_only() {
        let mut replay = Replay::new(10);
        replay.add(sample(0));
        let mut unsolved = sample(1);
        unsolved.outcome = Outcome::GoalOccupied.code();
        unsolved.label.fill(0);
        replay.add(unsolved.clone());
        unsolved.outcome = Outcome::Unreachable.code();
        unsolved.sequence = 3;
        replay.add(unsolved);
        replay.add(Sample {
            resolution_m: 0.2,
            ..sample(2)
        });
        let counts = replay.counts();
        assert_eq!(
            (counts.unsolved, counts.rejected, counts.received),
            (2, 1, 4)
        );
        assert_eq!(replay.examples().len(), 2);
    }

    proptest! {
        #[test]
        fn gaps_and_duplicates_add_up_in_any_order_of_arrival(
            numbers in proptest::collection::vec(0u64..40, 1..60)
        ) {
            let mut replay = Replay::new(100);
            // The first is the lowest, since what precedes it would not count as a gap.
            let numbers: Vec<u64> = std::iter::once(0).chain(numbers).collect();
            for &number in &numbers {
                replay.add(Sample { sequence: number, ..sample(0) });
            }
            let distinct: BTreeSet<u64> = numbers.iter().copied().collect();
            let counts = replay.counts();
            prop_assert_eq!(counts.received, numbers.len() as u64);
            prop_assert_eq!(counts.duplicates, (numbers.len() - distinct.len()) as u64);
            prop_assert_eq!(counts.gaps, distinct.last().unwrap() + 1 - distinct.len() as u64);
        }
    }
}
