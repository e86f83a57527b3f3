//! The generator node: publishes samples for as long as somebody listens.

use std::future::Future;
use std::pin::pin;
use std::sync::Arc;

use swath_bridge::msg::swath::Sample;
use swath_bridge::{Publisher, Session, keys};
use tokio::sync::mpsc;
use tokio::task::spawn_blocking;

use crate::stream::{Run, SampleStream};
use crate::{Error, Generator};

/// Samples between the stream and the session.
const QUEUE: usize = 4;

/// What a generator node is told.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeConfig {
    /// Name of the generator in the keys and in its samples.
    pub id: String,
    /// Seed of the whole fleet: each generator makes samples of its own from it and its name.
    pub seed: u64,
    /// Index of the first sample, for a generator that goes on where it was.
    pub first: u64,
    /// How many samples, or `None` for no end.
    pub count: Option<u64>,
    /// Threads, 0 for as many as there are cores.
    pub workers: usize,
}

/// What a node did.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct NodeSummary {
    /// Samples that were handed to the session.
    pub published: u64,
}

/// Runs a generator node until `stop` is done or the last sample is published. `observe` sees every
/// sample that is.
///
/// Sequence numbers begin with 0. While nobody listens the node waits, so nothing is made to be
/// thrown away.
///
/// # Errors
/// [`Error::Bridge`] when the session fails, and those of [`SampleStream::start`] and
/// [`Generator::sample`].
pub async fn run(
    session: &Session,
    generator: Arc<Generator>,
    config: NodeConfig,
    stop: impl Future<Output = ()>,
    mut observe: impl FnMut(&Sample),
) -> Result<NodeSummary, Error> {
    let publisher = session.publisher(&keys::sample(&config.id)).await?;
    let token = session.declare_node("generator", &config.id).await?;
    let run = Run {
        seed: seed_of(config.seed, &config.id),
        first: config.first,
        count: config.count,
    };
    let stream = SampleStream::start(&generator, run, config.workers)?;
    let (sender, mut samples) = mpsc::channel(QUEUE);
    let feeder = spawn_blocking(move || {
        for sample in stream {
            if sender.blocking_send(sample).is_err() {
                return;
            }
        }
    });
    let mut stop = pin!(stop);
    let mut summary = NodeSummary::default();
    let ended = loop {
        let next = tokio::select! {
            biased;
            () = &mut stop => break Ok(()),
            sample = next_wanted(&publisher, &mut samples) => sample,
        };
        let published = match next {
            Ok(None) => break Ok(()),
            Ok(Some(sample)) => publish(&publisher, &config.id, summary.published, sample).await,
            Err(error) => Err(error),
        };
        match published {
            Ok(sample) => {
                summary.published += 1;
                observe(&sample);
            }
            Err(error) => break Err(error),
        }
    };
    // Without a receiver the feeder ends with its next sample, and the workers with theirs.
    drop(samples);
    if let Err(error) = feeder.await {
        tracing::error!("the thread that hands samples over was lost: {error}");
    }
    drop(token);
    ended.map(|()| summary)
}

/// The next sample, taken only when somebody listens; `None` behind the last one.
async fn next_wanted(
    publisher: &Publisher<Sample>,
    samples: &mut mpsc::Receiver<Result<Sample, Error>>,
) -> Result<Option<Sample>, Error> {
    if !publisher.has_subscribers().await? {
        publisher.wait_for_subscribers().await?;
    }
    samples.recv().await.transpose()
}

/// Publishes a sample under the generator's name and sequence number.
async fn publish(
    publisher: &Publisher<Sample>,
    id: &str,
    sequence: u64,
    sample: Sample,
) -> Result<Sample, Error> {
    let sample = Sample {
        generator: id.to_owned(),
        sequence,
        ..sample
    };
    publisher.put(&sample).await?;
    Ok(sample)
}

/// The seed of one generator of a fleet: the fleet's, stirred with the name (FNV-1a).
pub fn seed_of(fleet_seed: u64, id: &str) -> u64 {
    const OFFSET: u64 = 0xcbf2_9ce4_8422_2325;
    const PRIME: u64 = 0x0000_0100_0000_01b3;
    fleet_seed
        .to_le_bytes()
        .iter()
        .chain(id.as_bytes())
        .fold(OFFSET, |hash, byte| {
            (hash ^ u64::from(*byte)).wrapping_mul(PRIME)
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn generators_of_a_fleet_have_seeds_of_their_own() {
        assert_eq!(seed_of(1, "g0"), seed_of(1, "g0"));
        assert_ne!(seed_of(1, "g0"), seed_of(1, "g1"));
        assert_ne!(seed_of(1, "g0"), seed_of(2, "g0"));
    }
}
