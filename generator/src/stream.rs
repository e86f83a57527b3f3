//! Samples in the order of their indices, made on all cores.
//!
//! Worker k of n makes every n-th sample and keeps a few of them ready; the stream takes from the
//! workers in turn. The order and the bytes do not depend on the number of workers, and none of them
//! runs ahead by more than [`LOOK_AHEAD`] samples.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use swath_bridge::msg::swath::Sample;
use swath_planner::search::SearchMemory;

use crate::{Error, Generator};

/// Samples that each worker keeps ready.
const LOOK_AHEAD: usize = 8;
/// Most workers.
pub const MAX_WORKERS: usize = 256;

/// Which samples of a seed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Run {
    /// The seed.
    pub seed: u64,
    /// Index of the first sample.
    pub first: u64,
    /// How many, or `None` for no end.
    pub count: Option<u64>,
}

/// An iterator over samples. Workers stop when it is dropped.
#[derive(Debug)]
pub struct SampleStream {
    workers: Vec<Receiver<Result<Sample, Error>>>,
    given: u64,
    count: u64,
}

impl SampleStream {
    /// Starts `workers` threads (0 for as many as there are cores).
    ///
    /// # Errors
    /// [`Error::Thread`] if the system gives no thread.
    pub fn start(generator: &Arc<Generator>, run: Run, workers: usize) -> Result<Self, Error> {
        let workers = match workers {
            0 => std::thread::available_parallelism().map_or(1, std::num::NonZero::get),
            some => some,
        }
        .min(MAX_WORKERS);
        let receivers = (0..workers)
            .map(|worker| {
                let (sender, receiver) = sync_channel(LOOK_AHEAD);
                let generator = Arc::clone(generator);
                let (worker, workers) = (worker as u64, workers as u64);
                std::thread::Builder::new()
                    .name(format!("generate-{worker}"))
                    .spawn(move || work(&generator, run, (worker, workers), &sender))
                    .map_err(|source| Error::Thread { source })?;
                Ok(receiver)
            })
            .collect::<Result<Vec<_>, Error>>()?;
        Ok(Self {
            workers: receivers,
            given: 0,
            count: run.count.unwrap_or(u64::MAX),
        })
    }
}

/// Makes every `workers`-th sample until nobody takes them.
fn work(
    generator: &Generator,
    run: Run,
    (worker, workers): (u64, u64),
    sender: &SyncSender<Result<Sample, Error>>,
) {
    let mut memory = SearchMemory::new();
    let mut offset = worker;
    while offset < run.count.unwrap_or(u64::MAX) {
        let sample = generator.sample(run.seed, run.first.wrapping_add(offset), &mut memory);
        if sender.send(sample).is_err() {
            return;
        }
        offset = offset.saturating_add(workers);
    }
}

impl Iterator for SampleStream {
    type Item = Result<Sample, Error>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.given >= self.count {
            return None;
        }
        let worker = usize::try_from(self.given % self.workers.len() as u64).unwrap_or(0);
        self.given += 1;
        // A worker that panicked has closed its channel; the stream ends there.
        self.workers[worker].recv().ok()
    }
}
