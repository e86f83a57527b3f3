//! The samples of recordings, in memory.

use std::path::Path;

use swath_bridge::msg::Message;
use swath_bridge::msg::swath::Sample;
use swath_bridge::recording::Reader;

use crate::{Error, Example, Reached};

/// Most samples that are kept in memory, about 30 kB each.
pub const MAX_EXAMPLES: usize = 400_000;

/// Samples that were read, those that can be learnt from first of all.
#[derive(Debug, Clone, Default)]
pub struct Dataset {
    /// Samples with a path.
    pub solved: Vec<Example>,
    /// Samples without one.
    pub unsolved: Vec<Example>,
    /// Messages that were not samples one can use, with the first one's fault.
    pub rejected: u64,
    /// What was wrong with the first of them.
    pub first_fault: Option<String>,
}

impl Dataset {
    /// Reads every sample of some recordings, in their order.
    ///
    /// Samples that contradict themselves, and those whose grid differs from the first one's, are
    /// counted and left out.
    ///
    /// # Errors
    /// [`Error::Bridge`] if a recording cannot be read, [`Error::NoSamples`] if none holds a solved
    /// sample, [`Error::TooManySamples`].
    pub fn open<P: AsRef<Path>>(paths: impl IntoIterator<Item = P>) -> Result<Self, Error> {
        let mut dataset = Self::default();
        let mut names = Vec::new();
        for path in paths {
            names.push(path.as_ref().display().to_string());
            let reader =
                Reader::open(&path)?.with_topics(|topic| topic.starts_with("/swath/sample/"));
            for message in reader {
                let message = message?;
                if &*message.type_name != Sample::TYPE_NAME {
                    continue;
                }
                match message.decode::<Sample>() {
                    Ok(sample) => dataset.add(sample),
                    Err(error) => dataset.reject(&error),
                }
                if dataset.solved.len() + dataset.unsolved.len() > MAX_EXAMPLES {
                    return Err(Error::TooManySamples { most: MAX_EXAMPLES });
                }
            }
        }
        if dataset.solved.is_empty() {
            return Err(Error::NoSamples {
                read: dataset.unsolved.len() as u64 + dataset.rejected,
                from: names.join(", "),
            });
        }
        Ok(dataset)
    }

    /// Checks a sample and adds it.
    pub fn add(&mut self, sample: Sample) {
        match Example::from_sample(sample) {
            Ok(example) if self.first_spec().is_some_and(|spec| spec != example.spec) => {
                let spec = example.spec;
                self.reject(&format!(
                    "{} x {} cells unlike the first",
                    spec.rows, spec.cols
                ));
            }
            Ok(example) if example.is_solved() => self.solved.push(example),
            Ok(example) => self.unsolved.push(example),
            Err(error) => self.reject(&error),
        }
    }

    /// The samples to learn from: those with a path, and those of which it is known that there is none.
    pub fn into_examples(self) -> Vec<Example> {
        let known = |example: &Example| Reached::of(example).is_some();
        let unsolved = self.unsolved.into_iter().filter(known);
        self.solved.into_iter().chain(unsolved).collect()
    }

    fn first_spec(&self) -> Option<swath_bridge::GridSpec> {
        let first = self.solved.first().or(self.unsolved.first());
        first.map(|example| example.spec)
    }

    fn reject(&mut self, fault: &dyn std::fmt::Display) {
        self.rejected += 1;
        self.first_fault.get_or_insert_with(|| fault.to_string());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::example::tests::sample;
    use swath_bridge::keys;
    use swath_bridge::recording::Writer;

    #[test]
    fn a_recording_of_samples_is_read_back_and_bad_ones_are_counted() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("samples.mcap");
        let mut writer = Writer::create(&path).unwrap();
        let topic = keys::sample("test");
        for index in 0..6 {
            let mut sample = sample(index);
            match index {
                2 => sample.label.clear(),
                4 => {
                    sample.outcome = 1;
                    sample.label.fill(0);
                    sample.path.clear();
                }
                _ => {}
            }
            writer.write(&topic, &sample, index, index).unwrap();
        }
        writer.finish().unwrap();
        let dataset = Dataset::open([&path]).unwrap();
        assert_eq!((dataset.solved.len(), dataset.unsolved.len()), (4, 1));
        assert_eq!(dataset.rejected, 1);
        assert!(dataset.first_fault.unwrap().contains("label"));
        assert_eq!(dataset.solved[0], Example::from_sample(sample(0)).unwrap());
    }

    #[test]
    fn a_recording_without_samples_is_an_error_that_names_it() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("empty.mcap");
        Writer::create(&path).unwrap().finish().unwrap();
        let error = Dataset::open([&path]).unwrap_err().to_string();
        assert!(error.contains("empty.mcap"), "{error}");
    }
}
