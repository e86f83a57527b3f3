//! The forward pass for planning: normalisation folded into the convolutions, one image at a time in
//! memory that is reused.

use super::kernel::channelwise::{Affine, apply, pattern};
use super::kernel::{Epilogue, Gather, Isa, Table, gather};
use super::slots::{self, Slots};
use super::spatial;
use super::tables::{pack_forward, tables};
use super::training::{inverse_deviation, slopes};
use crate::network::graph::{BufferId, Conv, Extent, Graph, Norm, Op};
use crate::network::parameters::Parameters;
use std::sync::Arc;

/// A network with its parameters, ready to run. It is shared between threads, each of which has its
/// own [`Workspace`].
#[derive(Debug)]
pub(crate) struct Inference {
    isa: Isa,
    buffers: Vec<Extent>,
    steps: Vec<Step>,
    slots: Slots,
}

/// The memory of one image's pass.
#[derive(Debug, Default)]
pub(crate) struct Workspace {
    memory: Vec<Vec<f32>>,
}

#[derive(Debug)]
enum Step {
    Conv(Box<Fused>),
    /// A normalisation that could not be folded.
    Affine {
        x: BufferId,
        y: BufferId,
        affine: Box<Affine>,
    },
    PoolInput {
        x: BufferId,
        y: BufferId,
        offset: usize,
    },
    Pool {
        x: BufferId,
        y: BufferId,
    },
    Upsample {
        x: BufferId,
        y: BufferId,
    },
    Head {
        x: BufferId,
        y: BufferId,
        kernel: Vec<f32>,
        bias: f32,
    },
}

/// Convolution, normalisation, residual and activation in one pass.
#[derive(Debug)]
struct Fused {
    x: BufferId,
    y: BufferId,
    residual: Option<BufferId>,
    table: Arc<Table>,
    x_channels: usize,
    kernel: Vec<f32>,
    bias: Vec<f32>,
    slope: Vec<f32>,
    finish: bool,
}

impl Inference {
    /// A network for inputs of `rows` × `cols`, both multiples of
    /// [`SIDE_MULTIPLE`](crate::network::SIDE_MULTIPLE).
    pub(crate) fn new(isa: Isa, (rows, cols): (usize, usize), parameters: &Parameters) -> Self {
        let graph = Graph::enet(rows, cols);
        let mut steps = Vec::new();
        let mut tables = tables(&graph).into_iter();
        let mut ops = graph.ops.iter().peekable();
        while let Some(op) = ops.next() {
            steps.push(match *op {
                Op::Conv(conv) => {
                    let norm = ops.next_if_map(|next| match next {
                        Op::Norm(norm) if norm.x == conv.y => Ok(*norm),
                        other => Err(other),
                    });
                    let table = tables.next().expect("one for each convolution").forward;
                    let fused = Fused::new(isa, (&conv, norm), (&graph, table), parameters);
                    Step::Conv(Box::new(fused))
                }
                Op::Norm(norm) => Step::Affine {
                    x: norm.x,
                    y: norm.y,
                    affine: Box::new(affine(&norm, parameters)),
                },
                Op::PoolInput { x, y, offset } => Step::PoolInput { x, y, offset },
                Op::Pool { x, y } => Step::Pool { x, y },
                Op::Upsample { x, y } => Step::Upsample { x, y },
                Op::Head { x, y, kernel, bias } => Step::Head {
                    x,
                    y,
                    kernel: parameters.values()[kernel..][..graph.buffers[x].channels * 4].to_vec(),
                    bias: parameters.values()[bias],
                },
            });
        }
        Self {
            isa,
            slots: activation_slots(&graph.buffers, &steps),
            buffers: graph.buffers,
            steps,
        }
    }

    /// Number of floats of the input: rows × cols × 3.
    pub(crate) fn input_len(&self) -> usize {
        self.buffers[Graph::INPUT].len()
    }

    /// The logits of one image, whose input `fill` writes.
    ///
    /// # Shapes
    /// Input: rows × cols × 3, channels innermost; result: rows × cols.
    pub(crate) fn run<'a>(
        &self,
        workspace: &'a mut Workspace,
        fill: impl FnOnce(&mut [f32]),
    ) -> &'a [f32] {
        let memory = &mut workspace.memory;
        memory.resize_with(self.slots.lens.len(), Vec::new);
        for (slot, &len) in memory.iter_mut().zip(&self.slots.lens) {
            slot.resize(len.max(slot.len()), 0.0);
        }
        fill(&mut memory[self.slot(Graph::INPUT)][..self.input_len()]);
        for step in &self.steps {
            let (_, _, y) = step.buffers();
            let mut output = std::mem::take(&mut memory[self.slot(y)]);
            self.step(step, memory, &mut output[..self.buffers[y].len()]);
            memory[self.slot(y)] = output;
        }
        let last = self.buffers.len() - 1;
        &memory[self.slot(last)][..self.buffers[last].len()]
    }

    fn slot(&self, buffer: BufferId) -> usize {
        self.slots.of_buffer[buffer].expect("a buffer in use has a slot")
    }

    fn step(&self, step: &Step, memory: &[Vec<f32>], y: &mut [f32]) {
        let read = |buffer: BufferId| &memory[self.slot(buffer)][..self.buffers[buffer].len()];
        let (x_id, residual, y_id) = step.buffers();
        let (x, from, channels) = (read(x_id), self.buffers[x_id], self.buffers[y_id].channels);
        match step {
            Step::Conv(fused) => {
                let epilogue = if fused.finish {
                    Epilogue::Finish {
                        bias: &fused.bias,
                        slope: &fused.slope,
                        residual: residual.map(read),
                    }
                } else {
                    Epilogue::Store
                };
                let job = Gather {
                    table: &fused.table,
                    x,
                    x_channels: fused.x_channels,
                    y_channels: channels,
                    kernel: &fused.kernel,
                    epilogue,
                };
                gather(self.isa, &job, y);
            }
            Step::Affine { affine, .. } => apply(self.isa, affine, x, None, y),
            Step::PoolInput { offset, .. } => {
                spatial::pool_input(x, from, y, (channels, *offset));
            }
            Step::Pool { .. } => spatial::pool(x, from, y, channels),
            Step::Upsample { .. } => spatial::upsample(x, from, y),
            Step::Head { kernel, bias, .. } => spatial::head(x, from, (kernel, *bias), y),
        }
    }
}

impl Step {
    /// What is read, what is added, what is written.
    fn buffers(&self) -> (BufferId, Option<BufferId>, BufferId) {
        match self {
            Self::Conv(fused) => (fused.x, fused.residual, fused.y),
            Self::Affine { x, y, .. }
            | Self::PoolInput { x, y, .. }
            | Self::Pool { x, y }
            | Self::Upsample { x, y }
            | Self::Head { x, y, .. } => (*x, None, *y),
        }
    }
}

impl Fused {
    fn new(
        isa: Isa,
        (conv, norm): (&Conv, Option<Norm>),
        (graph, table): (&Graph, Arc<Table>),
        parameters: &Parameters,
    ) -> Self {
        let channels = graph.buffers[conv.y].channels;
        let (gain, bias) = norm.map_or_else(
            || (vec![1.0; channels], vec![0.0; channels]),
            |norm| gain_and_offset(&norm, parameters),
        );
        let values = parameters.values();
        let mut kernel = Vec::new();
        pack_forward(isa, (conv, channels), values, Some(&gain), &mut kernel);
        Self {
            x: conv.x,
            y: norm.map_or(conv.y, |norm| norm.y),
            residual: norm.and_then(|norm| norm.residual),
            table,
            x_channels: conv.inputs,
            kernel,
            bias,
            slope: norm.map_or_else(Vec::new, |norm| slopes(&norm, values)),
            finish: norm.is_some(),
        }
    }
}

/// What a normalisation by the running statistics multiplies by and adds.
fn gain_and_offset(norm: &Norm, parameters: &Parameters) -> (Vec<f32>, Vec<f32>) {
    let channels = norm.channels;
    let (scale, shift) = parameters.values()[norm.scale..][..2 * channels].split_at(channels);
    let (mean, variance) = parameters.running()[norm.running..][..2 * channels].split_at(channels);
    let gain: Vec<f32> = (0..channels)
        .map(|channel| scale[channel] * inverse_deviation(variance[channel]))
        .collect();
    let offset = (0..channels)
        .map(|channel| shift[channel] - gain[channel] * mean[channel])
        .collect();
    (gain, offset)
}

fn affine(norm: &Norm, parameters: &Parameters) -> Affine {
    let (gain, offset) = gain_and_offset(norm, parameters);
    Affine {
        gain: pattern(&gain),
        offset: pattern(&offset),
        slope: pattern(&slopes(norm, parameters.values())),
    }
}

fn activation_slots(buffers: &[Extent], steps: &[Step]) -> Slots {
    let mut uses: Vec<Option<(usize, usize)>> = vec![None; buffers.len()];
    let mut touch = |buffer: BufferId, at: usize| {
        let (first, last) = uses[buffer].unwrap_or((at, at));
        uses[buffer] = Some((first.min(at), last.max(at)));
    };
    for (at, step) in steps.iter().enumerate() {
        let (x, residual, y) = step.buffers();
        touch(x, at);
        touch(y, at);
        if let Some(residual) = residual {
            touch(residual, at);
        }
    }
    let sizes = buffers.iter().map(|extent| extent.len());
    slots::assign(&sizes.zip(uses).collect::<Vec<_>>())
}
