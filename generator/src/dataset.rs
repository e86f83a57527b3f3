//! A data set: a recording of samples, the same bytes for the same seed.

use std::sync::Arc;

use swath_bridge::msg::swath::Sample;
use swath_bridge::recording::Writer;
use swath_bridge::{Outcome, keys};

use crate::sample::stamp_nanos;
use crate::stream::{Run, SampleStream};
use crate::{Error, Generator};

/// What a data set holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Written {
    /// Samples in all.
    pub samples: u64,
    /// How many of them have each outcome, by its code.
    pub outcomes: [u64; Outcome::ALL.len()],
}

impl Written {
    fn count(&mut self, sample: &Sample) {
        self.samples += 1;
        if let Some(count) = self.outcomes.get_mut(usize::from(sample.outcome)) {
            *count += 1;
        }
    }

    /// How many samples have an outcome.
    pub const fn with(&self, outcome: Outcome) -> u64 {
        self.outcomes[outcome.code() as usize]
    }
}

/// Writes the samples of a run into a recording and tells `progress` how many are done, of how many.
///
/// Log times are made from the index. A run without a count writes nothing.
///
/// # Errors
/// Those of [`SampleStream::start`], [`Generator::sample`] and [`Writer`], and
/// [`Error::Incomplete`] if a worker died.
pub fn write_dataset(
    generator: &Arc<Generator>,
    run: Run,
    mut writer: Writer,
    progress: &mut dyn FnMut(u64, u64),
) -> Result<Written, Error> {
    let count = run.count.unwrap_or(0);
    let run = Run {
        count: Some(count),
        ..run
    };
    let topic = keys::sample(&format!("seed-{}", run.seed));
    let mut written = Written::default();
    for sample in SampleStream::start(generator, run, 0)? {
        let sample = sample?;
        let nanos = stamp_nanos(sample.index);
        writer.write(&topic, &sample, nanos, nanos)?;
        written.count(&sample);
        progress(written.samples, count);
    }
    if written.samples != count {
        return Err(Error::Incomplete {
            wanted: count,
            got: written.samples,
        });
    }
    writer.finish()?;
    Ok(written)
}
