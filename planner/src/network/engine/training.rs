//! The training pass: forward with the statistics of the batch, backward to every parameter.
//!
//! The operations fall into stretches between two normalisations, which are where the images of a
//! batch need to know of each other. Each image goes through a stretch on one core, in memory of its
//! own; what is summed over images is summed in their order, so results do not depend on the number
//! of threads.

mod image;
mod norm;

use std::ops::Range;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;

use super::kernel::Isa;
use super::slots::{self, Slots};
use super::tables::{Tables, pack_backward, pack_forward, tables, unpack_gradient};
use crate::network::graph::{Architecture, Graph, Op};
use crate::network::parameters::Parameters;
use image::{Context, Image};
use norm::Statistics;
pub(super) use norm::{inverse_deviation, slopes};

/// Share of the batch's statistics that goes into the running ones at each step.
const MOMENTUM: f32 = 0.1;

/// Which channels a forward pass drops: a function of these two numbers only.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Dropout {
    /// Seed of the run.
    pub seed: u64,
    /// Number of the forward pass within the run.
    pub pass: u64,
}

/// A network in training at one size of input, with all its memory.
#[derive(Debug)]
pub struct Training {
    plan: Plan,
    images: Vec<Image>,
    /// Images of the last forward pass.
    batch: usize,
    statistics: Vec<Statistics>,
    /// Kernels as the forward pass wants them, one for each convolution.
    forward_kernels: Vec<Vec<f32>>,
    /// Kernels as the backward pass wants them.
    backward_kernels: Vec<Vec<f32>>,
    logits: Vec<f32>,
    /// The gradient of one kernel, summed over the images.
    kernel_gradient: Vec<f32>,
}

/// What does not change from pass to pass.
#[derive(Debug)]
struct Plan {
    graph: Graph,
    isa: Isa,
    /// For each operation the number of its convolution or normalisation among its kind.
    numbers: Vec<usize>,
    /// Operations from one normalisation up to the next.
    stretches: Vec<Range<usize>>,
    tables: Vec<Tables>,
    gradient_slots: Slots,
}

impl Training {
    /// A network for inputs of `rows` × `cols`, both multiples of
    /// [`SIDE_MULTIPLE`](crate::network::SIDE_MULTIPLE), else `None`.
    pub fn new(architecture: Architecture, size: (usize, usize)) -> Option<Self> {
        Self::with_isa(architecture, size, Isa::detect())
    }

    pub(super) fn with_isa(
        architecture: Architecture,
        (rows, cols): (usize, usize),
        isa: Isa,
    ) -> Option<Self> {
        let multiple = crate::network::SIDE_MULTIPLE;
        let fits = |side: usize| side > 0 && side <= 4096 && side.is_multiple_of(multiple);
        if !fits(rows) || !fits(cols) {
            return None;
        }
        let plan = Plan::new(Graph::new(architecture, (rows, cols)), isa);
        let norms = plan.graph.ops.iter().filter(|op| matches!(op, Op::Norm(_)));
        Some(Self {
            statistics: vec![Statistics::default(); norms.count()],
            forward_kernels: vec![Vec::new(); plan.tables.len()],
            backward_kernels: vec![Vec::new(); plan.tables.len()],
            images: Vec::new(),
            batch: 0,
            logits: Vec::new(),
            kernel_gradient: Vec::new(),
            plan,
        })
    }

    /// Number of floats of one image's input: rows × cols × 3, and the features of its goal.
    pub fn input_len(&self) -> usize {
        self.plan.graph.input_len()
    }

    /// Number of logits of one image.
    pub fn output_len(&self) -> usize {
        self.plan.graph.buffers[self.plan.graph.output()].len()
    }

    /// Number of scores of one image: 3, or none for `enet`.
    pub fn scores_len(&self) -> usize {
        let scores = self.plan.graph.scores;
        scores.map_or(0, |scores| self.plan.graph.buffers[scores].len())
    }

    /// The scores of the goals of the last forward pass.
    ///
    /// # Shapes
    /// batch × [`Self::scores_len`].
    pub fn scores(&self) -> Vec<f32> {
        let Some(scores) = self.plan.graph.scores else {
            return Vec::new();
        };
        let images = self.images[..self.batch].iter();
        images
            .flat_map(|image| image.activation(scores).iter().copied())
            .collect()
    }

    /// The logits of a batch, normalised by the batch's own statistics.
    ///
    /// # Shapes
    /// `input`: batch × [`Self::input_len`], channels innermost, a whole number of images; result:
    /// batch × rows × cols.
    pub fn forward(
        &mut self,
        parameters: &Parameters,
        input: &[f32],
        dropout: Option<Dropout>,
    ) -> &[f32] {
        self.batch = input.len() / self.input_len();
        if self.images.len() < self.batch {
            let graph = &self.plan.graph;
            self.images.resize_with(self.batch, || Image::new(graph));
        }
        self.pack(parameters);
        let mut random = dropout.map(|dropout| {
            let mut random = ChaCha8Rng::seed_from_u64(dropout.seed);
            random.set_stream(dropout.pass);
            random
        });
        let input_len = self.input_len();
        for stretch in self.plan.stretches.clone() {
            if let Op::Norm(norm) = &self.plan.graph.ops[stretch.start] {
                let statistics = &mut self.statistics[self.plan.numbers[stretch.start]];
                let images = self.images[..self.batch].iter();
                statistics.collect(&images.map(Image::moments).collect::<Vec<_>>());
                statistics.drop_channels(norm, self.batch, random.as_mut());
            }
            let context = Context {
                plan: &self.plan,
                values: parameters.values(),
                statistics: &self.statistics,
                kernels: &self.forward_kernels,
                batch: self.batch,
            };
            let images = self.images[..self.batch].par_iter_mut();
            images.enumerate().for_each(|(index, image)| {
                if stretch.start == 0 {
                    image.set_input(context.plan, &input[index * input_len..][..input_len]);
                }
                image.forward(&context, index, stretch.clone());
            });
        }
        let (output, len) = (self.plan.graph.output(), self.output_len());
        self.logits.resize(self.batch * len, 0.0);
        let logits = self.logits.par_chunks_exact_mut(len);
        logits
            .zip(&self.images)
            .for_each(|(logits, image)| logits.copy_from_slice(image.activation(output)));
        &self.logits
    }

    /// Adds the gradient of every parameter to `gradient`, given those of the logits and of the scores
    /// of the last forward pass, which must have been with the same parameters.
    ///
    /// # Shapes
    /// `logit_gradient`: batch × rows × cols; `score_gradient`: batch × [`Self::scores_len`];
    /// `gradient`: as the trained values.
    pub fn backward(
        &mut self,
        parameters: &Parameters,
        (logit_gradient, score_gradient): (&[f32], &[f32]),
        gradient: &mut [f32],
    ) {
        let scores_len = self.scores_len();
        debug_assert_eq!(score_gradient.len(), self.batch * scores_len);
        let len = self.output_len();
        debug_assert_eq!(logit_gradient.len(), self.batch * len);
        for stretch in self.plan.stretches.clone().into_iter().rev() {
            let context = Context {
                plan: &self.plan,
                values: parameters.values(),
                statistics: &self.statistics,
                kernels: &self.backward_kernels,
                batch: self.batch,
            };
            let images = self.images[..self.batch].par_iter_mut();
            images.enumerate().for_each(|(index, image)| {
                if stretch.end == context.plan.graph.ops.len() {
                    let logits = &logit_gradient[index * len..][..len];
                    let scores = &score_gradient[index * scores_len..][..scores_len];
                    image.begin_backward(context.plan, (logits, scores));
                }
                image.backward(&context, index, stretch.clone());
            });
            self.add_gradients(stretch, gradient);
        }
    }

    /// Adds what the images found for the parameters of a stretch.
    fn add_gradients(&mut self, stretch: Range<usize>, gradient: &mut [f32]) {
        let images = &self.images[..self.batch];
        for (index, op) in self.plan.graph.ops[stretch.clone()].iter().enumerate() {
            match op {
                Op::Conv(conv) => {
                    let of_images = images.iter().map(Image::parameter_gradient);
                    sum_up(of_images, &mut self.kernel_gradient);
                    let channels = self.plan.graph.buffers[conv.y].channels;
                    let sum = &self.kernel_gradient;
                    unpack_gradient(self.plan.isa, (conv, channels), sum, gradient);
                }
                Op::Head { kernel, .. } | Op::Score { kernel, .. } => {
                    let of_images = images.iter().map(|image| match op {
                        Op::Head { .. } => image.parameter_gradient(),
                        _ => image.score_parameter_gradient(),
                    });
                    sum_up(of_images, &mut self.kernel_gradient);
                    // The bias lies right behind the kernel, here and there.
                    let to = gradient[*kernel..].iter_mut();
                    to.zip(&self.kernel_gradient)
                        .for_each(|(to, sum)| *to += sum);
                }
                Op::Norm(norm) => {
                    let number = self.plan.numbers[stretch.start + index];
                    let statistics = &mut self.statistics[number];
                    statistics.sum_up(norm, images.iter().map(Image::sums));
                    statistics.add_gradients(norm, gradient);
                }
                _ => {}
            }
        }
    }

    /// Moves the running statistics towards those of the last forward pass.
    ///
    /// The variance is that of the batch itself, not the unbiased estimate that `PyTorch` keeps, so
    /// that inference computes just what training has seen.
    pub fn update_running(&self, parameters: &mut Parameters) {
        let norms = self.plan.graph.ops.iter().filter_map(|op| match op {
            Op::Norm(norm) => Some(norm),
            _ => None,
        });
        for (norm, statistics) in norms.zip(&self.statistics) {
            let running = &mut parameters.running_mut()[norm.running..][..2 * norm.channels];
            let (mean, variance) = running.split_at_mut(norm.channels);
            for channel in 0..norm.channels {
                mean[channel] += MOMENTUM * (statistics.mean[channel] - mean[channel]);
                variance[channel] += MOMENTUM * (statistics.variance[channel] - variance[channel]);
            }
        }
    }

    /// Packs every kernel for both directions.
    fn pack(&mut self, parameters: &Parameters) {
        let Plan { graph, isa, .. } = &self.plan;
        let convs: Vec<_> = graph
            .ops
            .iter()
            .filter_map(|op| match op {
                Op::Conv(conv) => Some(conv),
                _ => None,
            })
            .collect();
        let kernels = self.forward_kernels.par_iter_mut();
        let kernels = kernels.zip(&mut self.backward_kernels).zip(convs);
        kernels.for_each(|((forward, backward), conv)| {
            let channels = graph.buffers[conv.y].channels;
            let values = parameters.values();
            pack_forward(*isa, (conv, channels), values, None, forward);
            if !graph.is_input(conv.x) {
                pack_backward(*isa, conv, values, backward);
            }
        });
    }
}

impl Plan {
    fn new(graph: Graph, isa: Isa) -> Self {
        let (mut convs, mut norms) = (0, 0);
        let mut numbers = Vec::new();
        let mut stretches = Vec::new();
        let mut start = 0;
        for (index, op) in graph.ops.iter().enumerate() {
            let count = match op {
                Op::Conv(_) => &mut convs,
                Op::Norm(_) => {
                    stretches.push(start..index);
                    start = index;
                    &mut norms
                }
                _ => &mut 0,
            };
            numbers.push(*count);
            *count += 1;
        }
        stretches.push(start..graph.ops.len());
        Self {
            numbers,
            stretches,
            tables: tables(&graph),
            gradient_slots: gradient_slots(&graph),
            graph,
            isa,
        }
    }
}

/// The sum of gradients of the same parameters.
fn sum_up<'a>(of_images: impl Iterator<Item = &'a [f32]>, sum: &mut Vec<f32>) {
    sum.clear();
    for more in of_images {
        if sum.is_empty() {
            sum.extend_from_slice(more);
        } else {
            let sums = sum.iter_mut().zip(more);
            sums.for_each(|(sum, more)| *sum += more);
        }
    }
}

/// Slots for the gradients of buffers: from their last reader's turn in the backward pass to their
/// writer's.
fn gradient_slots(graph: &Graph) -> Slots {
    let steps = graph.ops.len();
    let mut uses: Vec<Option<(usize, usize)>> = vec![None; graph.buffers.len()];
    for (index, op) in graph.ops.iter().enumerate() {
        let step = steps - 1 - index;
        let (reads, writes) = op.buffers();
        for buffer in reads.into_iter().chain([writes]) {
            if !graph.is_input(buffer) && Some(buffer) != graph.scores {
                let (first, last) = uses[buffer].unwrap_or((step, step));
                uses[buffer] = Some((first.min(step), last.max(step)));
            }
        }
    }
    let buffers = graph.buffers.iter().map(|extent| extent.len());
    slots::assign(&buffers.zip(uses).collect::<Vec<_>>())
}
