//! The training pass: forward with the statistics of the batch, backward to every parameter.
//!
//! Images of a batch are spread over the cores; what is summed over them is summed in their order,
//! so results do not depend on the number of threads.

mod norm;
mod spatial;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;

use super::kernel::{Epilogue, Gather, Isa, KernelGradient, gather, kernel_gradient};
use super::slots::{self, Slots};
use super::tables::{Tables, pack_backward, pack_forward, tables, unpack_gradient};
use crate::network::graph::{Architecture, BufferId, Conv, Graph, Op};
use crate::network::parameters::Parameters;
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
    graph: Graph,
    isa: Isa,
    tables: Vec<Tables>,
    activations: Vec<Vec<f32>>,
    gradient_slots: Slots,
    gradients: Vec<Vec<f32>>,
    statistics: Vec<Statistics>,
    packed: Vec<f32>,
    partial: Vec<f32>,
    batch: usize,
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
        let graph = Graph::new(architecture, (rows, cols));
        let norms = graph.ops.iter().filter(|op| matches!(op, Op::Norm(_)));
        Some(Self {
            statistics: vec![Statistics::default(); norms.count()],
            tables: tables(&graph),
            activations: vec![Vec::new(); graph.buffers.len()],
            gradient_slots: gradient_slots(&graph),
            gradients: vec![Vec::new(); graph.buffers.len()],
            packed: Vec::new(),
            partial: Vec::new(),
            batch: 0,
            isa,
            graph,
        })
    }

    /// Number of floats of one image's input: rows × cols × 3, and the features of its goal.
    pub fn input_len(&self) -> usize {
        self.graph.input_len()
    }

    /// Number of logits of one image.
    pub fn output_len(&self) -> usize {
        self.graph.buffers[self.graph.output()].len()
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
        for (buffer, extent) in self.activations.iter_mut().zip(&self.graph.buffers) {
            buffer.resize(self.batch * extent.len(), 0.0);
        }
        let planes_len = self.len(Graph::INPUT);
        for (image, input) in input.chunks_exact(self.input_len()).enumerate() {
            let (planes, features) = input.split_at(planes_len);
            self.activations[Graph::INPUT][image * planes_len..][..planes_len]
                .copy_from_slice(planes);
            if let Some(goal) = self.graph.goal {
                self.activations[goal][image * features.len()..][..features.len()]
                    .copy_from_slice(features);
            }
        }
        let mut random = dropout.map(|dropout| {
            let mut random = ChaCha8Rng::seed_from_u64(dropout.seed);
            random.set_stream(dropout.pass);
            random
        });
        let ops = std::mem::take(&mut self.graph.ops);
        let (mut convs, mut norms) = (0, 0);
        for op in &ops {
            match op {
                Op::Conv(conv) => {
                    self.conv(conv, convs, parameters);
                    convs += 1;
                }
                Op::Norm(norm) => {
                    self.norm(norm, norms, parameters, random.as_mut());
                    norms += 1;
                }
                other => self.spatial(other, parameters),
            }
        }
        self.graph.ops = ops;
        &self.activations[self.graph.output()]
    }

    /// Adds the gradient of every parameter to `gradient`, given that of the logits of the last
    /// forward pass, which must have been with the same parameters.
    ///
    /// # Shapes
    /// `logit_gradient`: batch × rows × cols; `gradient`: as the trained values.
    pub fn backward(
        &mut self,
        parameters: &Parameters,
        logit_gradient: &[f32],
        gradient: &mut [f32],
    ) {
        debug_assert_eq!(logit_gradient.len(), self.batch * self.output_len());
        let ops = std::mem::take(&mut self.graph.ops);
        let mut written = vec![false; self.graph.buffers.len()];
        let output = self.graph.buffers.len() - 1;
        let mut top = self.take_gradient(output);
        top.copy_from_slice(logit_gradient);
        self.give_gradient(output, top);
        let (mut convs, mut norms) = (self.tables.len(), self.statistics.len());
        for op in ops.iter().rev() {
            match op {
                Op::Conv(conv) => {
                    convs -= 1;
                    self.conv_backward((conv, convs), parameters, &mut written, gradient);
                }
                Op::Norm(norm) => {
                    norms -= 1;
                    self.norm_backward((norm, norms), parameters, &mut written, gradient);
                }
                other => self.spatial_backward(other, parameters, &mut written, gradient),
            }
        }
        self.graph.ops = ops;
    }

    /// Moves the running statistics towards those of the last forward pass.
    ///
    /// The variance is that of the batch itself, not the unbiased estimate that `PyTorch` keeps, so
    /// that inference computes just what training has seen.
    pub fn update_running(&self, parameters: &mut Parameters) {
        let norms = self.graph.ops.iter().filter_map(|op| match op {
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

    fn len(&self, buffer: BufferId) -> usize {
        self.graph.buffers[buffer].len()
    }

    fn conv(&mut self, conv: &Conv, index: usize, parameters: &Parameters) {
        let y_channels = self.graph.buffers[conv.y].channels;
        let values = parameters.values();
        pack_forward(self.isa, (conv, y_channels), values, None, &mut self.packed);
        let mut y = std::mem::take(&mut self.activations[conv.y]);
        let (x_len, y_len) = (self.len(conv.x), self.len(conv.y));
        let images = self.activations[conv.x].par_chunks_exact(x_len);
        images
            .zip(y.par_chunks_exact_mut(y_len))
            .for_each(|(x, y)| {
                let job = Gather {
                    table: &self.tables[index].forward,
                    first: 0,
                    x,
                    x_channels: conv.inputs,
                    y_channels,
                    kernel: &self.packed,
                    epilogue: Epilogue::Store,
                };
                gather(self.isa, &job, y);
            });
        self.activations[conv.y] = y;
    }

    fn conv_backward(
        &mut self,
        (conv, index): (&Conv, usize),
        parameters: &Parameters,
        written: &mut [bool],
        gradient: &mut [f32],
    ) {
        let isa = self.isa;
        let y_channels = self.graph.buffers[conv.y].channels;
        let (x_len, y_len) = (self.len(conv.x), self.len(conv.y));
        let dy = self.take_gradient(conv.y);
        let len = conv.window.taps() * conv.inputs * y_channels;
        let mut partial = std::mem::take(&mut self.partial);
        partial.clear();
        partial.resize(self.batch * len, 0.0);
        let images = self.activations[conv.x].par_chunks_exact(x_len);
        images
            .zip(dy.par_chunks_exact(y_len))
            .zip(partial.par_chunks_exact_mut(len))
            .for_each(|((x, dy), partial)| {
                let job = KernelGradient {
                    table: &self.tables[index].forward,
                    x,
                    x_channels: conv.inputs,
                    dy,
                    y_channels,
                };
                kernel_gradient(isa, &job, partial);
            });
        for image in partial.chunks_exact(len) {
            unpack_gradient(isa, (conv, y_channels), image, gradient);
        }
        self.partial = partial;
        if !self.graph.is_input(conv.x) {
            pack_backward(isa, conv, parameters.values(), &mut self.packed);
            let mut dx = self.take_gradient(conv.x);
            let epilogue = if std::mem::replace(&mut written[conv.x], true) {
                Epilogue::Add
            } else {
                Epilogue::Store
            };
            let images = dy.par_chunks_exact(y_len);
            images
                .zip(dx.par_chunks_exact_mut(x_len))
                .for_each(|(dy, dx)| {
                    let job = Gather {
                        table: &self.tables[index].backward,
                        first: 0,
                        x: dy,
                        x_channels: conv.outputs,
                        y_channels: conv.inputs,
                        kernel: &self.packed,
                        epilogue,
                    };
                    gather(isa, &job, dx);
                });
            self.give_gradient(conv.x, dx);
        }
        self.give_gradient(conv.y, dy);
    }

    fn take_gradient(&mut self, buffer: BufferId) -> Vec<f32> {
        let slot = self.gradient_slots.of_buffer[buffer].expect("only the input has no gradient");
        let mut memory = std::mem::take(&mut self.gradients[slot]);
        memory.resize(self.batch * self.len(buffer), 0.0);
        memory
    }

    fn give_gradient(&mut self, buffer: BufferId, memory: Vec<f32>) {
        let slot = self.gradient_slots.of_buffer[buffer].expect("only the input has no gradient");
        self.gradients[slot] = memory;
    }
}

/// Slots for the gradients of buffers: from their last reader's turn in the backward pass to their
/// writer's.
fn gradient_slots(graph: &Graph) -> Slots {
    let steps = graph.ops.len();
    let mut uses: Vec<Option<(usize, usize)>> = vec![None; graph.buffers.len()];
    let mut touch = |buffer: BufferId, step: usize| {
        let (first, last) = uses[buffer].unwrap_or((step, step));
        uses[buffer] = Some((first.min(step), last.max(step)));
    };
    for (index, op) in graph.ops.iter().enumerate() {
        let step = steps - 1 - index;
        let (reads, writes) = op.buffers();
        for buffer in reads.into_iter().chain([writes]) {
            if !graph.is_input(buffer) {
                touch(buffer, step);
            }
        }
    }
    let buffers = graph.buffers.iter().map(|extent| extent.len());
    slots::assign(&buffers.zip(uses).collect::<Vec<_>>())
}
