//! One image's way through a stretch of operations, forward and backward.

use std::ops::Range;

use super::Plan;
use super::norm::{Moments, Statistics, combination, image_affine, image_moments};
use crate::network::engine::kernel::channelwise::{
    BackwardSums, Before, apply, backward_input, backward_sums, pattern,
};
use crate::network::engine::kernel::{
    Epilogue, Gather, KernelGradient, compiled_for, gather, kernel_gradient,
};
use crate::network::engine::spatial;
use crate::network::graph::{BufferId, Conv, Graph, Norm, Op};

/// What all images share during a stretch.
#[derive(Debug, Clone, Copy)]
pub(super) struct Context<'a> {
    pub(super) plan: &'a Plan,
    /// The trained parameters.
    pub(super) values: &'a [f32],
    pub(super) statistics: &'a [Statistics],
    /// Packed kernels of every convolution, for the direction that is run.
    pub(super) kernels: &'a [Vec<f32>],
    /// Number of images.
    pub(super) batch: usize,
}

/// The memory of one image.
#[derive(Debug, Default)]
pub(super) struct Image {
    activations: Vec<Vec<f32>>,
    /// Gradients of activations, by slot.
    gradients: Vec<Vec<f32>>,
    /// Whether a buffer's gradient holds anything yet.
    written: Vec<bool>,
    /// Of what the normalisation after the last stretch takes in.
    moments: Moments,
    /// Of the normalisation at the beginning of the last stretch.
    sums: BackwardSums,
    /// Of the kernel in the last stretch, as it is packed.
    parameter_gradient: Vec<f32>,
    /// At the scores of the goal.
    score_gradient: Vec<f32>,
    /// Of the parameters of the scores.
    score_parameter_gradient: Vec<f32>,
}

impl Image {
    pub(super) fn new(graph: &Graph) -> Self {
        Self {
            activations: graph
                .buffers
                .iter()
                .map(|extent| vec![0.0; extent.len()])
                .collect(),
            ..Self::default()
        }
    }

    pub(super) const fn moments(&self) -> &Moments {
        &self.moments
    }

    pub(super) const fn sums(&self) -> &BackwardSums {
        &self.sums
    }

    pub(super) fn parameter_gradient(&self) -> &[f32] {
        &self.parameter_gradient
    }

    pub(super) fn score_parameter_gradient(&self) -> &[f32] {
        &self.score_parameter_gradient
    }

    pub(super) fn activation(&self, buffer: BufferId) -> &[f32] {
        &self.activations[buffer]
    }

    pub(super) fn set_input(&mut self, plan: &Plan, input: &[f32]) {
        let (planes, features) = input.split_at(self.activations[Graph::INPUT].len());
        self.activations[Graph::INPUT].copy_from_slice(planes);
        if let Some(goal) = plan.graph.goal {
            self.activations[goal].copy_from_slice(features);
        }
    }

    /// The operations of a stretch, and the moments that the next one needs.
    pub(super) fn forward(&mut self, context: &Context<'_>, index: usize, stretch: Range<usize>) {
        let Plan { graph, isa, .. } = context.plan;
        for at in stretch.clone() {
            let op = &graph.ops[at];
            let (_, y) = op.buffers();
            let mut output = std::mem::take(&mut self.activations[y]);
            match op {
                Op::Conv(conv) => self.conv(context, (conv, at), &mut output),
                Op::Norm(norm) => {
                    let statistics = &context.statistics[context.plan.numbers[at]];
                    let affine = image_affine(norm, statistics, context.values, index);
                    let residual = norm.residual.map(|residual| self.activation(residual));
                    apply(
                        *isa,
                        &affine,
                        self.activation(norm.x),
                        residual,
                        &mut output,
                    );
                }
                other => self.spatial(context, other, &mut output),
            }
            self.activations[y] = output;
        }
        if let Some(Op::Norm(norm)) = graph.ops.get(stretch.end) {
            let x = &self.activations[norm.x];
            image_moments(*isa, x, norm.channels, &mut self.moments);
        }
    }

    fn conv(&self, context: &Context<'_>, (conv, at): (&Conv, usize), y: &mut [f32]) {
        let number = context.plan.numbers[at];
        let job = Gather {
            table: &context.plan.tables[number].forward,
            first: 0,
            x: self.activation(conv.x),
            x_channels: conv.inputs,
            y_channels: context.plan.graph.buffers[conv.y].channels,
            kernel: &context.kernels[number],
            epilogue: Epilogue::Store,
        };
        gather(context.plan.isa, &job, y);
    }

    fn spatial(&self, context: &Context<'_>, op: &Op, y: &mut [f32]) {
        let Plan { graph, isa, .. } = context.plan;
        match *op {
            Op::PoolInput { x, y: to, offset } => {
                let channels = graph.buffers[to].channels;
                spatial::pool_input(self.activation(x), graph.buffers[x], y, (channels, offset));
            }
            Op::Pool { x, y: to } => {
                let (from, channels) = (graph.buffers[x], graph.buffers[to].channels);
                compiled_for(*isa, || {
                    spatial::pool(self.activation(x), from, y, channels);
                });
            }
            Op::Upsample { x, .. } => {
                let from = graph.buffers[x];
                compiled_for(*isa, || spatial::upsample(self.activation(x), from, y));
            }
            Op::Add { a, b, .. } => {
                let (a, b) = (self.activation(a), self.activation(b));
                for ((y, a), b) in y.iter_mut().zip(a).zip(b) {
                    *y = a + b;
                }
            }
            Op::Head {
                x, kernel, bias, ..
            } => {
                let from = graph.buffers[x];
                let weights = &context.values[kernel..][..from.channels * 4];
                let head = (weights, context.values[bias]);
                compiled_for(*isa, || spatial::head(self.activation(x), from, head, y));
            }
            Op::Score {
                x,
                goal,
                kernel,
                bias,
                ..
            } => {
                let channels = graph.buffers[x].channels;
                let x = (self.activation(x), channels);
                let parameters = (
                    &context.values[kernel..][..y.len() * 2 * channels],
                    &context.values[bias..][..y.len()],
                );
                spatial::scores(x, self.activation(goal), parameters, y);
            }
            Op::Conv(_) | Op::Norm(_) => {}
        }
    }

    pub(super) fn begin_backward(
        &mut self,
        plan: &Plan,
        (logit_gradient, score_gradient): (&[f32], &[f32]),
    ) {
        self.gradients
            .resize_with(plan.gradient_slots.lens.len(), Vec::new);
        self.written.clear();
        self.written.resize(plan.graph.buffers.len(), false);
        let output = plan.graph.output();
        let mut top = self.take_gradient(plan, output);
        top.copy_from_slice(logit_gradient);
        self.give_gradient(plan, output, top);
        self.score_gradient.clear();
        self.score_gradient.extend_from_slice(score_gradient);
    }

    /// The gradients of a stretch, from the inside of the normalisation behind it to the sums over
    /// the one that it begins with.
    pub(super) fn backward(&mut self, context: &Context<'_>, index: usize, stretch: Range<usize>) {
        let ops = &context.plan.graph.ops;
        if let Some(Op::Norm(norm)) = ops.get(stretch.end) {
            self.norm_input(context, (norm, stretch.end), index);
        }
        for at in stretch.rev() {
            match &ops[at] {
                Op::Conv(conv) => self.conv_backward(context, (conv, at)),
                Op::Norm(norm) => self.norm_sums(context, (norm, at), index),
                Op::Add { a, b, y } => self.add_backward(context.plan, [*a, *b], *y),
                Op::Score { .. } => self.score_backward(context, &ops[at]),
                other => self.spatial_backward(context, other),
            }
        }
    }

    fn conv_backward(&mut self, context: &Context<'_>, (conv, at): (&Conv, usize)) {
        let Plan { graph, isa, .. } = context.plan;
        let number = context.plan.numbers[at];
        let tables = &context.plan.tables[number];
        let y_channels = graph.buffers[conv.y].channels;
        let dy = self.take_gradient(context.plan, conv.y);
        let mut gradient = std::mem::take(&mut self.parameter_gradient);
        gradient.clear();
        gradient.resize(conv.window.taps() * conv.inputs * y_channels, 0.0);
        let job = KernelGradient {
            table: &tables.forward,
            x: self.activation(conv.x),
            x_channels: conv.inputs,
            dy: &dy,
            y_channels,
        };
        kernel_gradient(*isa, &job, &mut gradient);
        self.parameter_gradient = gradient;
        if !graph.is_input(conv.x) {
            let mut dx = self.take_gradient(context.plan, conv.x);
            let job = Gather {
                table: &tables.backward,
                first: 0,
                x: &dy,
                x_channels: conv.outputs,
                y_channels: conv.inputs,
                kernel: &context.kernels[number],
                epilogue: if std::mem::replace(&mut self.written[conv.x], true) {
                    Epilogue::Add
                } else {
                    Epilogue::Store
                },
            };
            gather(*isa, &job, &mut dx);
            self.give_gradient(context.plan, conv.x, dx);
        }
        self.give_gradient(context.plan, conv.y, dy);
    }

    /// Takes the gradient back through activation, residual and dropout, and sums it up.
    fn norm_sums(&mut self, context: &Context<'_>, (norm, at): (&Norm, usize), index: usize) {
        let plan = context.plan;
        let statistics = &context.statistics[plan.numbers[at]];
        let mut dz = self.take_gradient(plan, norm.y);
        let mut sums = std::mem::take(&mut self.sums);
        sums.clear(norm.channels);
        let before = Before {
            affine: &image_affine(norm, statistics, context.values, index),
            mean: &pattern(&statistics.mean),
            x: self.activation(norm.x),
            residual: norm.residual.map(|residual| self.activation(residual)),
        };
        backward_sums(plan.isa, &before, &mut dz, &mut sums);
        self.sums = sums;
        if let Some(residual) = norm.residual {
            let mut to = self.take_gradient(plan, residual);
            self.add_or_copy(residual, &dz, &mut to);
            self.give_gradient(plan, residual, to);
        }
        self.give_gradient(plan, norm.y, dz);
    }

    /// The gradient at what a normalisation takes in, once the sums over the batch are known.
    fn norm_input(&mut self, context: &Context<'_>, (norm, at): (&Norm, usize), index: usize) {
        let plan = context.plan;
        let statistics = &context.statistics[plan.numbers[at]];
        let count = context.batch * plan.graph.buffers[norm.x].pixels();
        let combination = combination((norm, context.values), statistics, (count, index));
        let dz = self.take_gradient(plan, norm.y);
        let mut dx = self.take_gradient(plan, norm.x);
        backward_input(
            plan.isa,
            &combination,
            self.activation(norm.x),
            &dz,
            &mut dx,
        );
        self.written[norm.x] = true;
        self.give_gradient(plan, norm.x, dx);
        self.give_gradient(plan, norm.y, dz);
    }

    fn spatial_backward(&mut self, context: &Context<'_>, op: &Op) {
        let (Op::Pool { x, y } | Op::Upsample { x, y } | Op::Head { x, y, .. }) = *op else {
            return;
        };
        let Plan { graph, isa, .. } = context.plan;
        let (from, channels) = (graph.buffers[x], graph.buffers[y].channels);
        let dy = self.take_gradient(context.plan, y);
        let mut dx = self.take_gradient(context.plan, x);
        if !std::mem::replace(&mut self.written[x], true) {
            dx.fill(0.0);
        }
        match *op {
            Op::Upsample { .. } => {
                compiled_for(*isa, || spatial::upsample_backward(&dy, &mut dx, from));
            }
            Op::Head { kernel, .. } => {
                let kernel = &context.values[kernel..][..from.channels * 4];
                let mut gradient = std::mem::take(&mut self.parameter_gradient);
                gradient.clear();
                gradient.resize(kernel.len() + 1, 0.0);
                let x = (self.activation(x), from);
                spatial::head_backward(x, kernel, &dy, &mut dx, &mut gradient);
                self.parameter_gradient = gradient;
            }
            _ => compiled_for(*isa, || {
                spatial::pool_backward(&dy, channels, &mut dx, from);
            }),
        }
        self.give_gradient(context.plan, x, dx);
        self.give_gradient(context.plan, y, dy);
    }

    fn score_backward(&mut self, context: &Context<'_>, op: &Op) {
        let Op::Score {
            x, goal, kernel, ..
        } = *op
        else {
            return;
        };
        let channels = context.plan.graph.buffers[x].channels;
        let mut dx = self.take_gradient(context.plan, x);
        if !std::mem::replace(&mut self.written[x], true) {
            dx.fill(0.0);
        }
        let dy = &self.score_gradient;
        let kernel = &context.values[kernel..][..dy.len() * 2 * channels];
        let mut gradient = std::mem::take(&mut self.score_parameter_gradient);
        gradient.clear();
        gradient.resize(kernel.len() + dy.len(), 0.0);
        let input = (self.activation(x), channels);
        let features = self.activation(goal);
        spatial::scores_backward(input, features, (kernel, dy), &mut dx, &mut gradient);
        self.score_parameter_gradient = gradient;
        self.give_gradient(context.plan, x, dx);
    }

    fn add_backward(&mut self, plan: &Plan, terms: [BufferId; 2], y: BufferId) {
        let dy = self.take_gradient(plan, y);
        for x in terms {
            let mut dx = self.take_gradient(plan, x);
            self.add_or_copy(x, &dy, &mut dx);
            self.give_gradient(plan, x, dx);
        }
        self.give_gradient(plan, y, dy);
    }

    /// Adds to a buffer's gradient, or is the first to set it.
    fn add_or_copy(&mut self, buffer: BufferId, from: &[f32], to: &mut [f32]) {
        if std::mem::replace(&mut self.written[buffer], true) {
            to.iter_mut().zip(from).for_each(|(to, from)| *to += from);
        } else {
            to.copy_from_slice(from);
        }
    }

    fn take_gradient(&mut self, plan: &Plan, buffer: BufferId) -> Vec<f32> {
        let slot = plan.gradient_slots.of_buffer[buffer].expect("only inputs have no gradient");
        let mut memory = std::mem::take(&mut self.gradients[slot]);
        memory.resize(plan.graph.buffers[buffer].len(), 0.0);
        memory
    }

    fn give_gradient(&mut self, plan: &Plan, buffer: BufferId, memory: Vec<f32>) {
        let slot = plan.gradient_slots.of_buffer[buffer].expect("only inputs have no gradient");
        self.gradients[slot] = memory;
    }
}
