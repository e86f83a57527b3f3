//! Samples as a step takes them in: mirrored, relabelled and encoded, apart from the network's work
//! so that a thread of its own can prepare the next ones meanwhile.

use rayon::prelude::*;
use swath_bridge::Pose2;
use swath_planner::Plane;
use swath_planner::network::{Encoding, Surroundings};

use crate::example::{mirrored, mirrored_pose};
use crate::reach::Reached;
use crate::source::Shown;
use crate::{Error, TrainConfig};

/// Samples of one step.
#[derive(Debug)]
pub struct Batch {
    pub(crate) parts: Vec<Part>,
    pub(crate) samples: usize,
}

/// Samples that go through the network together.
#[derive(Debug)]
pub(crate) struct Part {
    /// Encoded inputs, one after the other.
    pub(crate) input: Vec<f32>,
    pub(crate) labels: Vec<Plane>,
    pub(crate) reached: Vec<Option<Reached>>,
}

/// How batches are made. Clones serve other threads.
#[derive(Debug, Clone)]
pub struct Preparation {
    encoding: Encoding,
    micro_batch: usize,
    label_dilation_m: Option<f64>,
}

impl Preparation {
    pub(crate) const fn new(config: &TrainConfig, encoding: &Encoding) -> Self {
        Self {
            encoding: *encoding,
            micro_batch: config.micro_batch,
            label_dilation_m: config.label_dilation_m,
        }
    }

    /// Makes a batch of these samples.
    ///
    /// # Errors
    /// The planner's if a sample is of another grid.
    pub fn batch(&self, shown: &[Shown]) -> Result<Batch, Error> {
        let parts = shown.chunks(self.micro_batch).map(|part| self.part(part));
        Ok(Batch {
            parts: parts.collect::<Result<_, _>>()?,
            samples: shown.len(),
        })
    }

    fn part(&self, shown: &[Shown]) -> Result<Part, Error> {
        let input_len = self.encoding.input_len();
        let mut input = vec![0.0; shown.len() * input_len];
        let labels = input
            .par_chunks_exact_mut(input_len)
            .zip(shown)
            .map(|(input, shown)| self.encode(shown, input))
            .collect::<Result<_, _>>()?;
        let reached = shown.iter().map(|shown| Reached::of(&shown.example));
        Ok(Part {
            reached: reached.collect(),
            labels,
            input,
        })
    }

    /// Writes the input of a sample and gives its label.
    fn encode(&self, shown: &Shown, input: &mut [f32]) -> Result<Plane, Error> {
        let example = &*shown.example;
        let about = example.spec.ego_col;
        let turned = |plane: &Plane| {
            if shown.mirrored {
                mirrored(plane, about)
            } else {
                plane.clone()
            }
        };
        let redrawn = self
            .label_dilation_m
            .map(|dilation_m| example.label_at(dilation_m));
        let label = turned(redrawn.as_ref().unwrap_or(&example.label));
        self.encoding.check(&label)?;
        let (obstacles, reference) = (turned(&example.obstacles), turned(&example.reference));
        let goal: Pose2 = if shown.mirrored {
            mirrored_pose(&example.goal)
        } else {
            example.goal
        };
        let surroundings = Surroundings {
            obstacles: &obstacles,
            reference: &reference,
            speed_m_per_s: example.speed_m_per_s,
        };
        self.encoding.encode(&surroundings, &goal, input)?;
        Ok(label)
    }
}
