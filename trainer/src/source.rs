//! Where the samples of each step come from: recordings, or the live stream.

use std::collections::BTreeSet;
use std::sync::Arc;

use rand_chacha::rand_core::Rng;

use crate::Example;
use crate::random::{below, shuffle, stream};

mod replay;

pub use replay::{Counts, Replay};

/// Random numbers for the order of an epoch are drawn from streams from here on.
const ORDER_STREAM: u64 = 2 << 40;
/// Random numbers for mirroring are drawn from streams from here on.
const MIRROR_STREAM: u64 = 3 << 40;
/// Random numbers for drawing from the replay buffer are drawn from streams from here on.
const DRAW_STREAM: u64 = 4 << 40;
/// Random numbers for drawing hard samples are drawn from streams from here on.
const HARD_STREAM: u64 = 5 << 40;
/// Random numbers for candidates for hard samples are drawn from streams from here on.
const CANDIDATE_STREAM: u64 = 6 << 40;

/// An example as one step shows it.
#[derive(Debug, Clone)]
pub struct Shown {
    /// The example.
    pub example: Arc<Example>,
    /// Whether left and right are swapped.
    pub mirrored: bool,
}

/// Gives every step its samples.
pub trait Source: std::fmt::Debug + Send {
    /// Steps that make an epoch, for batches of a size.
    fn steps_per_epoch(&self, batch: usize) -> u64;

    /// The samples of a step: `batch` of them, or fewer if there are not as many.
    fn draw(&mut self, step: u64, batch: usize) -> Vec<Shown>;

    /// Samples with a path, drawn at random for a step, and their numbers: those of which it is to be
    /// found out how hard they are. Fewer than `count` if there are not as many.
    fn candidates(&self, step: u64, count: usize) -> Vec<(u64, Arc<Example>)>;

    /// From now on a share of each batch are samples of these numbers.
    fn bring_back(&mut self, hard: &[u64], share: f64);
}

/// Samples that come back more often.
#[derive(Debug, Default)]
struct Hard {
    numbers: Vec<usize>,
    share: f64,
}

impl Hard {
    fn new(hard: &[u64], share: f64) -> Self {
        let numbers = hard
            .iter()
            .filter_map(|&number| usize::try_from(number).ok());
        Self {
            numbers: numbers.collect(),
            share,
        }
    }

    /// Puts hard samples in the place of the last ones of a batch.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a share of a batch is a smaller batch"
    )]
    fn put_into(&self, shown: &mut [Shown], held: &[Arc<Example>], (seed, step): (u64, u64)) {
        if self.numbers.is_empty() || self.share <= 0.0 {
            return;
        }
        let mut random = stream(seed, HARD_STREAM + step);
        let first = shown.len() - (shown.len() as f64 * self.share.min(1.0)) as usize;
        for place in &mut shown[first..] {
            let number = self.numbers[below(&mut random, self.numbers.len())];
            if let Some(example) = held.get(number) {
                place.example = Arc::clone(example);
            }
        }
    }
}

/// Draws samples with a path.
fn candidates(
    held: &[Arc<Example>],
    (seed, step): (u64, u64),
    count: usize,
) -> Vec<(u64, Arc<Example>)> {
    let mut random = stream(seed, CANDIDATE_STREAM + step);
    let drawn = (0..count.min(held.len())).map(|_| below(&mut random, held.len()));
    let drawn: BTreeSet<usize> = drawn.filter(|&index| held[index].is_solved()).collect();
    drawn
        .into_iter()
        .map(|index| (index as u64, Arc::clone(&held[index])))
        .collect()
}

/// Samples that are all there from the beginning: each is shown once an epoch, or as often as is
/// said, in an order that depends on the seed and the epoch only, so that training can be taken up
/// anywhere.
#[derive(Debug)]
pub struct Recorded {
    examples: Vec<Arc<Example>>,
    /// The examples of an epoch, some of them several times.
    showings: Vec<usize>,
    seed: u64,
    mirror: bool,
    epoch: u64,
    order: Vec<usize>,
    hard: Hard,
}

impl Recorded {
    /// A source of these examples. With `mirror`, every other showing is mirrored at random.
    pub fn new(examples: Vec<Example>, seed: u64, mirror: bool) -> Self {
        Self::mixed(vec![(examples, 1)], seed, mirror)
    }

    /// A source of several groups of examples, each with how often an epoch shows it.
    pub fn mixed(groups: Vec<(Vec<Example>, usize)>, seed: u64, mirror: bool) -> Self {
        let mut all = Vec::new();
        let mut showings = Vec::new();
        for (examples, times) in groups {
            let first = all.len();
            all.extend(examples.into_iter().map(Arc::new));
            for _ in 0..times {
                showings.extend(first..all.len());
            }
        }
        let mut source = Self {
            examples: all,
            order: Vec::new(),
            showings,
            seed,
            mirror,
            epoch: 0,
            hard: Hard::default(),
        };
        source.begin_epoch(0);
        source
    }

    fn begin_epoch(&mut self, epoch: u64) {
        self.epoch = epoch;
        self.order.clone_from(&self.showings);
        let random = &mut stream(self.seed, ORDER_STREAM + epoch);
        shuffle(random, &mut self.order);
    }
}

impl Source for Recorded {
    /// The last batch of an epoch is left out if it is not full, but there is at least one.
    fn steps_per_epoch(&self, batch: usize) -> u64 {
        (self.showings.len() / batch.max(1)).max(1) as u64
    }

    fn draw(&mut self, step: u64, batch: usize) -> Vec<Shown> {
        let steps = self.steps_per_epoch(batch);
        let epoch = step / steps;
        if epoch != self.epoch {
            self.begin_epoch(epoch);
        }
        let first = usize::try_from(step % steps).unwrap_or(0) * batch;
        let mut random = stream(self.seed, MIRROR_STREAM + step);
        let shown = self.order.iter().skip(first).take(batch);
        let mut shown: Vec<Shown> = shown
            .map(|&index| Shown {
                example: Arc::clone(&self.examples[index]),
                mirrored: self.mirror && random.next_u32() % 2 == 1,
            })
            .collect();
        self.hard
            .put_into(&mut shown, &self.examples, (self.seed, step));
        shown
    }

    fn candidates(&self, step: u64, count: usize) -> Vec<(u64, Arc<Example>)> {
        candidates(&self.examples, (self.seed, step), count)
    }

    fn bring_back(&mut self, hard: &[u64], share: f64) {
        self.hard = Hard::new(hard, share);
    }
}

/// The live stream as a source: each step draws at random from what the buffer holds.
#[derive(Debug)]
pub struct Live {
    /// The newest samples; whoever receives them adds to it between steps.
    pub replay: Replay,
    /// Steps that count as an epoch.
    pub steps_per_epoch: u64,
    seed: u64,
    mirror: bool,
    hard: Hard,
}

impl Live {
    /// A source that draws from `replay`.
    pub fn new(replay: Replay, steps_per_epoch: u64, (seed, mirror): (u64, bool)) -> Self {
        Self {
            replay,
            steps_per_epoch,
            seed,
            mirror,
            hard: Hard::default(),
        }
    }
}

impl Source for Live {
    fn steps_per_epoch(&self, _batch: usize) -> u64 {
        self.steps_per_epoch.max(1)
    }

    fn draw(&mut self, step: u64, batch: usize) -> Vec<Shown> {
        let held = self.replay.examples();
        if held.is_empty() {
            return Vec::new();
        }
        let mut random = stream(self.seed, DRAW_STREAM + step);
        let mut shown: Vec<Shown> = (0..batch)
            .map(|_| Shown {
                example: Arc::clone(&held[below(&mut random, held.len())]),
                mirrored: self.mirror && random.next_u32() % 2 == 1,
            })
            .collect();
        self.hard.put_into(&mut shown, held, (self.seed, step));
        shown
    }

    fn candidates(&self, step: u64, count: usize) -> Vec<(u64, Arc<Example>)> {
        candidates(self.replay.examples(), (self.seed, step), count)
    }

    fn bring_back(&mut self, hard: &[u64], share: f64) {
        self.hard = Hard::new(hard, share);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::example::tests::examples;
    use std::collections::BTreeMap;

    #[test]
    fn every_epoch_shows_each_sample_once_in_another_order() {
        let mut source = Recorded::new(examples(12), 7, false);
        assert_eq!(source.steps_per_epoch(4), 3);
        let mut epoch = |number: u64| {
            let steps = number * 3..number * 3 + 3;
            let shown = steps.flat_map(|step| source.draw(step, 4));
            shown
                .map(|shown| shown.example.path.clone())
                .collect::<Vec<_>>()
        };
        let (first, second) = (epoch(0), epoch(1));
        assert_ne!(first, second);
        assert_eq!(first, epoch(0));
        let key = |path: &Vec<swath_bridge::Pose2>| format!("{path:?}");
        let count = |epoch: &[Vec<_>]| {
            let mut counts = BTreeMap::new();
            for path in epoch {
                *counts.entry(key(path)).or_insert(0) += 1;
            }
            counts
        };
        assert_eq!(count(&first), count(&second));
        assert_eq!(first.len(), 12);
    }

    #[test]
    fn a_group_is_shown_as_often_as_is_said() {
        let mut examples = examples(6);
        let rest = examples.split_off(2);
        let often = examples[0].path.clone();
        let mut source = Recorded::mixed(vec![(examples, 3), (rest, 1)], 7, false);
        assert_eq!(source.steps_per_epoch(5), 2);
        let shown = [source.draw(0, 5), source.draw(1, 5)].concat();
        let is_often = |shown: &&Shown| shown.example.path == often;
        assert_eq!(
            (shown.len(), shown.iter().filter(is_often).count()),
            (10, 3)
        );
    }

    #[test]
    fn hard_samples_come_back_in_their_share_of_each_batch() {
        let mut source = Recorded::new(examples(12), 7, false);
        let candidates = source.candidates(3, 6);
        assert!(!candidates.is_empty() && candidates.len() <= 6);
        let (number, hard) = candidates[0].clone();
        let before = source.draw(2, 4);
        source.bring_back(&[number], 0.5);
        let shown = source.draw(2, 4);
        assert!(
            shown[..2]
                .iter()
                .zip(&before)
                .all(|(a, b)| a.example == b.example)
        );
        assert!(shown[2..].iter().all(|shown| shown.example == hard));
    }

    #[test]
    fn a_live_source_shows_nothing_until_something_came() {
        let mut source = Live::new(Replay::new(8), 10, (1, true));
        assert!(source.draw(0, 4).is_empty());
        source.replay.add(crate::example::tests::sample(0));
        assert_eq!(source.draw(1, 4).len(), 4);
    }
}
