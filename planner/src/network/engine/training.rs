//! The training pass: forward with the statistics of the batch, backward to every parameter.
//!
//! Images of a batch are spread over the cores; what is summed over them is summed in their order,
//! so results do not depend on the number of threads.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rayon::prelude::*;

use super::kernel::channelwise::{
    Affine, BackwardSums, Before, Combination, apply, backward_input, backward_sums, moments,
    pattern,
};
use super::kernel::{Epilogue, Gather, Isa, KernelGradient, gather, kernel_gradient};
use super::slots::{self, Slots};
use super::spatial;
use super::tables::{Tables, pack_backward, pack_forward, tables, unpack_gradient};
use crate::network::graph::{Activation, BufferId, Conv, Graph, NORM_EPSILON, Norm, Op};
use crate::network::parameters::Parameters;

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

/// What a normalisation remembers between forward and backward.
#[derive(Debug, Clone, Default)]
struct Statistics {
    mean: Vec<f32>,
    variance: Vec<f32>,
    /// Factor of each image and channel; empty without dropout.
    keep: Vec<f32>,
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
    pub fn new(rows: usize, cols: usize) -> Option<Self> {
        Self::with_isa(rows, cols, Isa::detect())
    }

    pub(super) fn with_isa(rows: usize, cols: usize, isa: Isa) -> Option<Self> {
        let multiple = crate::network::SIDE_MULTIPLE;
        let fits = |side: usize| side > 0 && side <= 4096 && side.is_multiple_of(multiple);
        if !fits(rows) || !fits(cols) {
            return None;
        }
        let graph = Graph::enet(rows, cols);
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

    /// Number of floats of one image's input: rows × cols × 3.
    pub fn input_len(&self) -> usize {
        self.graph.buffers[Graph::INPUT].len()
    }

    /// Number of logits of one image.
    pub fn output_len(&self) -> usize {
        self.graph.buffers[self.graph.output()].len()
    }

    /// The logits of a batch, normalised by the batch's own statistics.
    ///
    /// # Shapes
    /// `input`: batch × rows × cols × 3 (channels innermost, a whole number of images);
    /// result: batch × rows × cols.
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
        let input_len = self.batch * self.input_len();
        self.activations[Graph::INPUT].copy_from_slice(&input[..input_len]);
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
        if conv.x != Graph::INPUT {
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

    fn norm(
        &mut self,
        norm: &Norm,
        index: usize,
        parameters: &Parameters,
        random: Option<&mut ChaCha8Rng>,
    ) {
        let (isa, len, channels) = (self.isa, self.len(norm.x), norm.channels);
        let mut statistics = std::mem::take(&mut self.statistics[index]);
        let images = self.activations[norm.x].par_chunks_exact(len);
        let moments: Vec<_> = images.map(|x| image_moments(isa, x, channels)).collect();
        let images = moments.len() as f64;
        statistics.mean.resize(channels, 0.0);
        statistics.variance.resize(channels, 0.0);
        for channel in 0..channels {
            let of_image = || moments.iter().map(|moments| moments[channel]);
            let mean = of_image().map(|(mean, _)| mean).sum::<f64>() / images;
            let spread = |(of_image, variance): (f64, f64)| variance + (of_image - mean).powi(2);
            let variance = of_image().map(spread).sum::<f64>() / images;
            statistics.mean[channel] = narrow(mean);
            statistics.variance[channel] = narrow(variance);
        }
        statistics.keep.clear();
        if let Some(random) = random.filter(|_| norm.dropout > 0.0) {
            let keep = || draw_keep(random, norm.dropout);
            statistics
                .keep
                .extend(std::iter::repeat_with(keep).take(self.batch * channels));
        }
        let mut y = std::mem::take(&mut self.activations[norm.y]);
        let images = self.activations[norm.x].par_chunks_exact(len);
        let images = images.zip(y.par_chunks_exact_mut(len)).enumerate();
        images.for_each(|(image, (x, y))| {
            let coefficients = affine(norm, &statistics, parameters.values(), image);
            let residual = norm
                .residual
                .map(|buffer| &self.activations[buffer][image * len..(image + 1) * len]);
            apply(isa, &coefficients, x, residual, y);
        });
        self.activations[norm.y] = y;
        self.statistics[index] = statistics;
    }

    fn norm_backward(
        &mut self,
        (norm, index): (&Norm, usize),
        parameters: &Parameters,
        written: &mut [bool],
        gradient: &mut [f32],
    ) {
        let (isa, len, values) = (self.isa, self.len(norm.x), parameters.values());
        let mut dz = self.take_gradient(norm.y);
        let statistics = &self.statistics[index];
        let images = self.activations[norm.x].par_chunks_exact(len);
        let images = images.zip(dz.par_chunks_exact_mut(len)).enumerate();
        let sums: Vec<BackwardSums> = images
            .map(|(image, (x, dy))| {
                let before = Before {
                    affine: &affine(norm, statistics, values, image),
                    mean: &pattern(&statistics.mean),
                    x,
                    residual: norm
                        .residual
                        .map(|buffer| &self.activations[buffer][image * len..(image + 1) * len]),
                };
                let mut sums = BackwardSums::new(norm.channels);
                backward_sums(isa, &before, dy, &mut sums);
                sums
            })
            .collect();
        let totals = totals(norm, statistics, &sums);
        add_gradients(norm, statistics, &totals, gradient);
        let mut dx = self.take_gradient(norm.x);
        let count = (self.batch * self.graph.buffers[norm.x].pixels()) as f64;
        let statistics = &self.statistics[index];
        let images = self.activations[norm.x].par_chunks_exact(len);
        images
            .zip(dz.par_chunks_exact(len))
            .zip(dx.par_chunks_exact_mut(len))
            .enumerate()
            .for_each(|(image, ((x, dz), dx))| {
                let combination = combination((norm, values), statistics, (&totals, count), image);
                backward_input(isa, &combination, x, dz, dx);
            });
        written[norm.x] = true;
        self.give_gradient(norm.x, dx);
        if let Some(residual) = norm.residual {
            let mut to = self.take_gradient(residual);
            let add = std::mem::replace(&mut written[residual], true);
            let images = to.par_chunks_exact_mut(len).zip(dz.par_chunks_exact(len));
            images.for_each(|(to, dz)| {
                if add {
                    to.iter_mut().zip(dz).for_each(|(to, dz)| *to += dz);
                } else {
                    to.copy_from_slice(dz);
                }
            });
            self.give_gradient(residual, to);
        }
        self.give_gradient(norm.y, dz);
    }

    fn spatial(&mut self, op: &Op, parameters: &Parameters) {
        let (Op::PoolInput { x, y, .. }
        | Op::Pool { x, y }
        | Op::Upsample { x, y }
        | Op::Head { x, y, .. }) = *op
        else {
            return;
        };
        let (from, channels) = (self.graph.buffers[x], self.graph.buffers[y].channels);
        let (x_len, y_len) = (self.len(x), self.len(y));
        let mut output = std::mem::take(&mut self.activations[y]);
        let images = self.activations[x].par_chunks_exact(x_len);
        let images = images.zip(output.par_chunks_exact_mut(y_len));
        images.for_each(|(x, y)| match *op {
            Op::PoolInput { offset, .. } => spatial::pool_input(x, from, y, (channels, offset)),
            Op::Pool { .. } => spatial::pool(x, from, y, channels),
            Op::Upsample { .. } => spatial::upsample(x, from, y),
            Op::Head { kernel, bias, .. } => {
                let values = parameters.values();
                let kernel = &values[kernel..][..from.channels * 4];
                spatial::head(x, from, (kernel, values[bias]), y);
            }
            Op::Conv(_) | Op::Norm(_) => {}
        });
        self.activations[y] = output;
    }

    fn spatial_backward(
        &mut self,
        op: &Op,
        parameters: &Parameters,
        written: &mut [bool],
        gradient: &mut [f32],
    ) {
        let (Op::Pool { x, y } | Op::Upsample { x, y } | Op::Head { x, y, .. }) = *op else {
            return;
        };
        let (from, channels) = (self.graph.buffers[x], self.graph.buffers[y].channels);
        let (x_len, y_len) = (self.len(x), self.len(y));
        let dy = self.take_gradient(y);
        let mut dx = self.take_gradient(x);
        if !std::mem::replace(&mut written[x], true) {
            dx.fill(0.0);
        }
        let images = dy.par_chunks_exact(y_len);
        let images = images.zip(dx.par_chunks_exact_mut(x_len)).enumerate();
        let head = images.map(|(image, (dy, dx))| match *op {
            Op::Upsample { .. } => {
                spatial::upsample_backward(dy, dx, from);
                Vec::new()
            }
            Op::Head { kernel, .. } => {
                let x = &self.activations[x][image * x_len..(image + 1) * x_len];
                let kernel = &parameters.values()[kernel..][..from.channels * 4];
                let mut gradient = vec![0.0; kernel.len() + 1];
                spatial::head_backward((x, from), kernel, dy, dx, &mut gradient);
                gradient
            }
            _ => {
                spatial::pool_backward(dy, channels, dx, from);
                Vec::new()
            }
        });
        let head: Vec<Vec<f32>> = head.collect();
        if let Op::Head { kernel, .. } = *op {
            // The bias lies right behind the kernel, here and there.
            for image in &head {
                for (to, value) in gradient[kernel..].iter_mut().zip(image) {
                    *to += value;
                }
            }
        }
        self.give_gradient(x, dx);
        self.give_gradient(y, dy);
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
        match *op {
            Op::Conv(Conv { x, y, .. })
            | Op::PoolInput { x, y, .. }
            | Op::Pool { x, y }
            | Op::Upsample { x, y }
            | Op::Head { x, y, .. } => {
                touch(x, step);
                touch(y, step);
            }
            Op::Norm(norm) => {
                touch(norm.x, step);
                touch(norm.y, step);
                if let Some(residual) = norm.residual {
                    touch(residual, step);
                }
            }
        }
    }
    uses[Graph::INPUT] = None;
    let buffers = graph.buffers.iter().map(|extent| extent.len());
    slots::assign(&buffers.zip(uses).collect::<Vec<_>>())
}

/// The coefficients of one image.
fn affine(norm: &Norm, statistics: &Statistics, values: &[f32], image: usize) -> Affine {
    let channels = norm.channels;
    let (scale, shift) = values[norm.scale..][..2 * channels].split_at(channels);
    let keep = |channel: usize| {
        let keep = statistics.keep.get(image * channels + channel);
        keep.copied().unwrap_or(1.0)
    };
    let gain: Vec<f32> = (0..channels)
        .map(|c| keep(c) * scale[c] * inverse_deviation(statistics.variance[c]))
        .collect();
    let offset: Vec<f32> = (0..channels)
        .map(|c| keep(c) * shift[c] - gain[c] * statistics.mean[c])
        .collect();
    Affine {
        gain: pattern(&gain),
        offset: pattern(&offset),
        slope: pattern(&slopes(norm, values)),
    }
}

/// `1 / sqrt(variance + ε)`.
pub(super) fn inverse_deviation(variance: f32) -> f32 {
    1.0 / (variance + NORM_EPSILON).sqrt()
}

/// Slope below zero of each channel.
pub(super) fn slopes(norm: &Norm, values: &[f32]) -> Vec<f32> {
    match norm.activation {
        Activation::Identity => vec![1.0; norm.channels],
        Activation::Relu => vec![0.0; norm.channels],
        Activation::Prelu(start) => values[start..][..norm.channels].to_vec(),
    }
}

/// Mean and variance of each channel of one image. Squares are taken above the first pixel, so that a
/// mean far from 0 does not drown the variance.
fn image_moments(isa: Isa, x: &[f32], channels: usize) -> Vec<(f64, f64)> {
    let floor = &x[..channels];
    let (mut sums, mut squares) = (vec![0.0; channels], vec![0.0; channels]);
    moments(isa, x, &pattern(floor), &mut sums, &mut squares);
    let count = (x.len() / channels) as f64;
    let of_channel = |channel: usize| {
        let mean = sums[channel] / count;
        let variance = (squares[channel] / count - mean * mean).max(0.0);
        (f64::from(floor[channel]) + mean, variance)
    };
    (0..channels).map(of_channel).collect()
}

/// Sums over the batch: gradient of shift, gradient of scale over the inverse deviation, slope.
fn totals(norm: &Norm, statistics: &Statistics, sums: &[BackwardSums]) -> BackwardSums {
    let mut totals = BackwardSums::new(norm.channels);
    for (image, sums) in sums.iter().enumerate() {
        for channel in 0..norm.channels {
            let keep = statistics.keep.get(image * norm.channels + channel);
            let keep = f64::from(keep.copied().unwrap_or(1.0));
            totals.gradient[channel] += keep * sums.gradient[channel];
            totals.centred[channel] += keep * sums.centred[channel];
            totals.slope[channel] += sums.slope[channel];
        }
    }
    totals
}

fn add_gradients(
    norm: &Norm,
    statistics: &Statistics,
    totals: &BackwardSums,
    gradient: &mut [f32],
) {
    for channel in 0..norm.channels {
        let inverse = f64::from(inverse_deviation(statistics.variance[channel]));
        gradient[norm.scale + channel] += narrow(totals.centred[channel] * inverse);
        gradient[norm.scale + norm.channels + channel] += narrow(totals.gradient[channel]);
        if let Activation::Prelu(start) = norm.activation {
            gradient[start + channel] += narrow(totals.slope[channel]);
        }
    }
}

/// The coefficients of the gradient at the input: with u = keep · dz and x̂ the normalised input,
/// dx = scale / deviation · (u − mean(u) − x̂ · mean(u · x̂)).
fn combination(
    (norm, values): (&Norm, &[f32]),
    statistics: &Statistics,
    (totals, count): (&BackwardSums, f64),
    image: usize,
) -> Combination {
    let channels = norm.channels;
    let mut outer = vec![0.0; channels];
    let mut inner = vec![0.0; channels];
    let mut constant = vec![0.0; channels];
    for channel in 0..channels {
        let inverse = f64::from(inverse_deviation(statistics.variance[channel]));
        let gain = f64::from(values[norm.scale + channel]) * inverse;
        let keep = statistics.keep.get(image * channels + channel);
        let slope = -gain * inverse * inverse * totals.centred[channel] / count;
        outer[channel] = narrow(gain * f64::from(keep.copied().unwrap_or(1.0)));
        inner[channel] = narrow(slope);
        let mean = f64::from(statistics.mean[channel]);
        constant[channel] = narrow(-gain * totals.gradient[channel] / count - slope * mean);
    }
    Combination {
        outer: pattern(&outer),
        inner: pattern(&inner),
        constant: pattern(&constant),
    }
}

fn draw_keep(random: &mut ChaCha8Rng, dropout: f32) -> f32 {
    let unit = (random.next_u32() >> 8) as f32 / (1_u32 << 24) as f32;
    if unit < dropout {
        0.0
    } else {
        1.0 / (1.0 - dropout)
    }
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "sums are kept in double precision, parameters in single"
)]
fn narrow(value: f64) -> f32 {
    value as f32
}
