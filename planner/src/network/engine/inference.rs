//! The forward pass for planning: normalisation folded into the convolutions, one image at a time in
//! memory that is reused.

use super::kernel::channelwise::{Affine, apply, pattern};
use super::kernel::{
    Assistant, Epilogue, Gather, Isa, Table, compiled_for, gather, with_assistant,
};
use super::slots::{self, Slots};
use super::spatial;
use super::tables::{Tables, pack_forward, tables};
use super::training::{inverse_deviation, slopes};
use crate::network::graph::{BufferId, Conv, Extent, Graph, Norm, Op};
use crate::network::parameters::Parameters;
use std::sync::Arc;

/// Multiplications from which on a convolution is split between two cores.
const WORTH_SPLITTING: usize = 150_000;
/// A convolution is split at a multiple of so many pixels.
const SPLIT_AT: usize = 20;

/// A network with its parameters, ready to run. It is shared between threads, each of which has its
/// own [`Workspace`].
///
/// What does not depend on a goal is computed once a map, see [`Self::see_map`]; for `enet` that is
/// nothing, and its input planes belong to the goal.
#[derive(Debug)]
pub(crate) struct Inference {
    isa: Isa,
    buffers: Vec<Extent>,
    /// The input of the goal's part.
    goal: BufferId,
    /// What is said of the goal as a whole.
    scores: Option<BufferId>,
    map_part: Part,
    goal_part: Part,
}

/// Steps that run one after the other, and where they keep their buffers.
#[derive(Debug, Default)]
struct Part {
    steps: Vec<Step>,
    slots: Slots,
}

/// The memory of one pass.
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
    Add {
        a: BufferId,
        b: BufferId,
        y: BufferId,
    },
    Score {
        x: BufferId,
        goal: BufferId,
        y: BufferId,
        kernel: Vec<f32>,
        bias: Vec<f32>,
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
    can_be_split: bool,
}

impl Inference {
    /// A network for inputs of `rows` × `cols`, both multiples of
    /// [`SIDE_MULTIPLE`](crate::network::SIDE_MULTIPLE).
    pub(crate) fn new(isa: Isa, size: (usize, usize), parameters: &Parameters) -> Self {
        let graph = Graph::new(parameters.architecture(), size);
        let mut tables = tables(&graph).into_iter();
        let (of_map, of_goal) = graph.ops.split_at(graph.map_ops);
        let mut steps =
            |ops: &[Op]| -> Vec<Step> { steps(isa, ops, &graph, &mut tables, parameters) };
        let (of_map, of_goal) = (steps(of_map), steps(of_goal));
        let is_map = |buffer: BufferId| {
            let written = of_map.iter().any(|step| step.buffers().2 == buffer);
            written || (buffer == Graph::INPUT && !of_map.is_empty())
        };
        let is_kept = |buffer: BufferId| read_by(&of_goal, buffer);
        let map_slots = slots_of(&graph.buffers, &of_map, is_map, is_kept);
        let is_scores = |buffer: BufferId| Some(buffer) == graph.scores;
        let goal_slots = slots_of(
            &graph.buffers,
            &of_goal,
            |buffer| !is_map(buffer),
            is_scores,
        );
        Self {
            isa,
            goal: graph.goal.unwrap_or(Graph::INPUT),
            scores: graph.scores,
            map_part: Part {
                slots: map_slots,
                steps: of_map,
            },
            goal_part: Part {
                slots: goal_slots,
                steps: of_goal,
            },
            buffers: graph.buffers,
        }
    }

    /// Where the planes of a map are written before [`Self::see_map`].
    ///
    /// # Shapes
    /// rows × cols × 3, channels innermost; empty if the network looks at no map without a goal.
    pub(crate) fn planes<'a>(&self, map: &'a mut Workspace) -> &'a mut [f32] {
        self.input(&self.map_part, Graph::INPUT, map)
    }

    /// Computes all that does not depend on a goal.
    pub(crate) fn see_map(&self, map: &mut Workspace) {
        if !self.map_part.steps.is_empty() {
            with_assistant(|assistant| self.run(&self.map_part, None, (map, Some(assistant))));
        }
    }

    /// Where the input of a goal is written before [`Self::see_goal`].
    ///
    /// # Shapes
    /// rows × cols × 3 for `enet`, an eighth of them × features for `enet-shared`.
    pub(crate) fn goal_input<'a>(&self, goal: &'a mut Workspace) -> &'a mut [f32] {
        self.input(&self.goal_part, self.goal, goal)
    }

    /// Computes what depends on a goal, on the map that was seen. `together`: all cores work on it.
    pub(crate) fn see_goal(&self, map: &Workspace, goal: &mut Workspace, together: bool) {
        if together {
            with_assistant(|assistant| {
                self.run(&self.goal_part, Some(map), (goal, Some(assistant)));
            });
        } else {
            self.run(&self.goal_part, Some(map), (goal, None));
        }
    }

    /// The logits of the goal that was seen last.
    ///
    /// # Shapes
    /// rows × cols.
    pub(crate) fn logits<'a>(&self, goal: &'a Workspace) -> &'a [f32] {
        let last = self.buffers.len() - 1;
        &goal.memory[slot(&self.goal_part, last)][..self.buffers[last].len()]
    }

    /// What is said of the goal that was seen last, if the network says anything.
    pub(crate) fn scores<'a>(&self, goal: &'a Workspace) -> Option<&'a [f32]> {
        let scores = self.scores?;
        Some(&goal.memory[slot(&self.goal_part, scores)][..self.buffers[scores].len()])
    }

    fn input<'a>(
        &self,
        part: &Part,
        buffer: BufferId,
        workspace: &'a mut Workspace,
    ) -> &'a mut [f32] {
        let memory = &mut workspace.memory;
        memory.resize_with(part.slots.lens.len(), Vec::new);
        for (slot, &len) in memory.iter_mut().zip(&part.slots.lens) {
            slot.resize(len.max(slot.len()), 0.0);
        }
        match part.slots.of_buffer.get(buffer).copied().flatten() {
            Some(slot) => &mut memory[slot][..self.buffers[buffer].len()],
            None => &mut [],
        }
    }

    /// Runs a part, with an assistant if the other cores have nothing else to do.
    fn run(
        &self,
        part: &Part,
        map: Option<&Workspace>,
        (workspace, assistant): (&mut Workspace, Option<&Assistant>),
    ) {
        for step in &part.steps {
            let (_, _, y) = step.buffers();
            let mut output = std::mem::take(&mut workspace.memory[slot(part, y)]);
            let read = |buffer: BufferId| {
                let memory = match (part.slots.of_buffer[buffer], map) {
                    (Some(slot), _) => &workspace.memory[slot],
                    (None, Some(map)) => &map.memory[slot(&self.map_part, buffer)],
                    (None, None) => unreachable!("a map's steps read what they wrote"),
                };
                &memory[..self.buffers[buffer].len()]
            };
            let to = &mut output[..self.buffers[y].len()];
            self.step(step, read, (to, assistant));
            workspace.memory[slot(part, y)] = output;
        }
    }

    fn step<'a>(
        &self,
        step: &Step,
        read: impl Fn(BufferId) -> &'a [f32],
        (y, assistant): (&mut [f32], Option<&Assistant>),
    ) {
        let (x_id, residual, y_id) = step.buffers();
        let (x, from, channels) = (read(x_id), self.buffers[x_id], self.buffers[y_id].channels);
        match step {
            Step::Conv(fused) => {
                let epilogue = if fused.finish {
                    Epilogue::Finish {
                        bias: &fused.bias,
                        slope: &fused.slope,
                        residual: residual.map(&read),
                    }
                } else {
                    Epilogue::Store
                };
                let job = Gather {
                    table: &fused.table,
                    first: 0,
                    x,
                    x_channels: fused.x_channels,
                    y_channels: channels,
                    kernel: &fused.kernel,
                    epilogue,
                };
                let work = fused.kernel.len() * self.buffers[y_id].pixels();
                match assistant {
                    Some(assistant) if work >= WORTH_SPLITTING && fused.can_be_split => {
                        let pixels = self.buffers[y_id].pixels();
                        let half = (pixels / 2).next_multiple_of(SPLIT_AT).min(pixels);
                        let (top, bottom) = y.split_at_mut(half * channels);
                        assistant.join(
                            || gather(self.isa, &job, top),
                            || gather(self.isa, &job.from(half), bottom),
                        );
                    }
                    _ => gather(self.isa, &job, y),
                }
            }
            Step::Affine { affine, .. } => apply(self.isa, affine, x, None, y),
            Step::PoolInput { offset, .. } => {
                spatial::pool_input(x, from, y, (channels, *offset));
            }
            Step::Pool { .. } => {
                compiled_for(self.isa, || spatial::pool(x, from, y, channels));
            }
            Step::Upsample { .. } => compiled_for(self.isa, || spatial::upsample(x, from, y)),
            Step::Add { b, .. } => {
                let b = read(*b);
                compiled_for(self.isa, || {
                    for ((y, &a), &b) in y.iter_mut().zip(x).zip(b) {
                        *y = a + b;
                    }
                });
            }
            Step::Score {
                goal, kernel, bias, ..
            } => spatial::scores((x, from.channels), read(*goal), (kernel, bias), y),
            Step::Head { kernel, bias, .. } => {
                let parameters = (kernel.as_slice(), *bias);
                compiled_for(self.isa, || spatial::head(x, from, parameters, y));
            }
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
            Self::Add { a, b, y } => (*a, Some(*b), *y),
            Self::Score { x, goal, y, .. } => (*x, Some(*goal), *y),
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
            can_be_split: !conv.window.transposed,
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

fn slot(part: &Part, buffer: BufferId) -> usize {
    part.slots.of_buffer[buffer].expect("a buffer in use has a slot")
}

/// Operations as steps, with normalisations folded into convolutions.
fn steps(
    isa: Isa,
    ops: &[Op],
    graph: &Graph,
    tables: &mut dyn Iterator<Item = Tables>,
    parameters: &Parameters,
) -> Vec<Step> {
    let mut steps = Vec::new();
    let mut ops = ops.iter().peekable();
    while let Some(op) = ops.next() {
        steps.push(match *op {
            Op::Conv(conv) => {
                let norm = ops.next_if_map(|next| match next {
                    Op::Norm(norm) if norm.x == conv.y => Ok(*norm),
                    other => Err(other),
                });
                let table = tables.next().expect("one for each convolution").forward;
                let fused = Fused::new(isa, (&conv, norm), (graph, table), parameters);
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
            Op::Add { a, b, y } => Step::Add { a, b, y },
            Op::Score {
                x,
                goal,
                y,
                kernel,
                bias,
            } => {
                let scores = graph.buffers[y].channels;
                let len = scores * 2 * graph.buffers[x].channels;
                Step::Score {
                    x,
                    goal,
                    y,
                    kernel: parameters.values()[kernel..][..len].to_vec(),
                    bias: parameters.values()[bias..][..scores].to_vec(),
                }
            }
            Op::Head { x, y, kernel, bias } => Step::Head {
                x,
                y,
                kernel: parameters.values()[kernel..][..graph.buffers[x].channels * 4].to_vec(),
                bias: parameters.values()[bias],
            },
        });
    }
    steps
}

/// Whether some step reads a buffer.
fn read_by(steps: &[Step], buffer: BufferId) -> bool {
    steps.iter().any(|step| {
        let (x, other, _) = step.buffers();
        x == buffer || other == Some(buffer)
    })
}

/// Slots of a part's buffers. Those of another part have none; those that are to be kept keep theirs
/// to the end.
fn slots_of(
    buffers: &[Extent],
    steps: &[Step],
    is_ours: impl Fn(BufferId) -> bool,
    is_kept: impl Fn(BufferId) -> bool,
) -> Slots {
    let mut uses: Vec<Option<(usize, usize)>> = vec![None; buffers.len()];
    let mut touch = |buffer: BufferId, at: usize| {
        if is_ours(buffer) {
            let (first, last) = uses[buffer].unwrap_or((at, at));
            let end = if is_kept(buffer) { steps.len() } else { at };
            uses[buffer] = Some((first.min(at), last.max(end)));
        }
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
