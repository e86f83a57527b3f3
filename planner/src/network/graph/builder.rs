//! Writes down ENet: blocks, bottlenecks, names of parameters.

use std::ops::Range;

use super::{
    Activation, BufferId, Conv, Extent, GOAL_FEATURES, Graph, INITIAL_CONVOLVED, INPUT_PLANES,
    Kind, Norm, Op, SCORES, SIDE_MULTIPLE, TensorSpec, Window,
};

/// Share of channels that the first stage drops in training.
const DROPOUT_EARLY: f32 = 0.01;
/// Share of channels that the later stages drop in training.
const DROPOUT_LATE: f32 = 0.1;
/// Channels of a block for one of its middle convolution.
const REDUCTION: usize = 4;

/// Channels that the features of a goal become before they are added to those of the map.
const GOAL_HIDDEN: usize = 64;
/// Channels that the scores of a goal are made from.
const SCORE_HIDDEN: usize = 32;
/// Bottlenecks of stage 3 that come before the goal.
const MAP_BOTTLENECKS: usize = 4;

impl Graph {
    /// ENet for inputs of `rows` × `cols`, both multiples of [`SIDE_MULTIPLE`].
    pub(crate) fn enet(rows: usize, cols: usize) -> Self {
        let mut builder = Builder::new(rows, cols);
        let mut x = builder.initial();
        x = builder.stage1(x);
        x = builder.downsampling("stage2.0", x, 128, DROPOUT_LATE);
        x = builder.dilated_stage(2, x, 0..8);
        x = builder.dilated_stage(3, x, 0..8);
        x = builder.upsampling("stage4.0", x, 64);
        x = builder.stage4(x);
        x = builder.upsampling("stage5.0", x, 16);
        builder.finish(x)
    }

    /// ENet with the goal in its middle, for inputs of the same sizes.
    pub(crate) fn enet_shared(rows: usize, cols: usize) -> Self {
        let mut builder = Builder::new(rows, cols);
        let goal = builder.buffer(Extent {
            rows: rows / SIDE_MULTIPLE,
            cols: cols / SIDE_MULTIPLE,
            channels: GOAL_FEATURES,
        });
        builder.graph.goal = Some(goal);
        let half = builder.initial();
        let quarter = builder.stage1(half);
        let mut x = builder.downsampling("stage2.0", quarter, 128, DROPOUT_LATE);
        x = builder.dilated_stage(2, x, 0..8);
        x = builder.dilated_stage(3, x, 0..MAP_BOTTLENECKS);
        let quarter = builder.projection("stage4.map", quarter);
        let half = builder.projection("stage5.map", half);
        builder.graph.map_ops = builder.graph.ops.len();
        let hidden = (GOAL_HIDDEN, Window::POINT);
        let hidden = builder.unit("goal.hidden", goal, hidden, true);
        x = builder.merge("goal", hidden, (128, x), Style::encoder(0.0));
        x = builder.dilated_stage(3, x, MAP_BOTTLENECKS..8);
        builder.scores(x, goal);
        x = builder.upsampling("stage4.0", x, 64);
        x = builder.add(x, quarter);
        x = builder.stage4(x);
        x = builder.upsampling("stage5.0", x, 16);
        x = builder.add(x, half);
        builder.finish(x)
    }
}

#[derive(Debug, Clone, Copy)]
enum Middle {
    Plain,
    Dilated(usize),
    /// 5×1 and 1×5.
    Asymmetric,
}

impl Middle {
    /// Bottlenecks 2.1 to 2.8 and 3.1 to 3.8.
    const STAGE: [Self; 8] = [
        Self::Plain,
        Self::Dilated(2),
        Self::Asymmetric,
        Self::Dilated(4),
        Self::Plain,
        Self::Dilated(8),
        Self::Asymmetric,
        Self::Dilated(16),
    ];
}

/// Where encoder and decoder differ.
#[derive(Debug, Clone, Copy)]
struct Style {
    prelu: bool,
    dropout: f32,
}

impl Style {
    const DECODER: Self = Self {
        prelu: false,
        dropout: 0.0,
    };

    const fn encoder(dropout: f32) -> Self {
        Self {
            prelu: true,
            dropout,
        }
    }
}

struct Builder {
    graph: Graph,
}

impl Builder {
    fn new(rows: usize, cols: usize) -> Self {
        debug_assert!(rows.is_multiple_of(SIDE_MULTIPLE) && cols.is_multiple_of(SIDE_MULTIPLE));
        let input = Extent {
            rows,
            cols,
            channels: INPUT_PLANES,
        };
        Self {
            graph: Graph {
                tensors: Vec::new(),
                buffers: vec![input],
                ops: Vec::new(),
                map_ops: 0,
                goal: None,
                scores: None,
                trained_len: 0,
                running_len: 0,
            },
        }
    }

    fn tensor(&mut self, name: String, shape: Vec<usize>, kind: Kind) -> usize {
        let graph = &mut self.graph;
        let len = if kind.is_trained() {
            &mut graph.trained_len
        } else {
            &mut graph.running_len
        };
        let start = *len;
        *len += shape.iter().product::<usize>();
        graph.tensors.push(TensorSpec {
            name,
            shape,
            kind,
            start,
        });
        start
    }

    fn buffer(&mut self, extent: Extent) -> BufferId {
        self.graph.buffers.push(extent);
        self.graph.buffers.len() - 1
    }

    fn conv(&mut self, name: &str, x: BufferId, outputs: usize, window: Window) -> BufferId {
        let input = self.graph.buffers[x];
        let y = self.buffer(window.output(input, outputs));
        self.conv_into(name, (x, y), outputs, window);
        y
    }

    fn conv_into(
        &mut self,
        name: &str,
        (x, y): (BufferId, BufferId),
        outputs: usize,
        window: Window,
    ) {
        let inputs = self.graph.buffers[x].channels;
        let (rows, cols) = window.kernel;
        let shape = if window.transposed {
            vec![inputs, outputs, rows, cols]
        } else {
            vec![outputs, inputs, rows, cols]
        };
        let fan_in = inputs * window.taps() / if window.transposed { 4 } else { 1 };
        let kind = Kind::Kernel { fan_in };
        let kernel = self.tensor(format!("{name}.weight"), shape, kind);
        self.graph.ops.push(Op::Conv(Conv {
            x,
            y,
            window,
            kernel,
            inputs,
            outputs,
        }));
    }

    fn norm(
        &mut self,
        name: &str,
        x: BufferId,
        residual: Option<BufferId>,
        (activation, dropout): (Activation, f32),
    ) -> BufferId {
        let extent = self.graph.buffers[x];
        let shape = || vec![extent.channels];
        let scale = self.tensor(format!("{name}.weight"), shape(), Kind::Scale);
        self.tensor(format!("{name}.bias"), shape(), Kind::Shift);
        let running = self.tensor(format!("{name}.running_mean"), shape(), Kind::RunningMean);
        let kind = Kind::RunningVariance;
        self.tensor(format!("{name}.running_var"), shape(), kind);
        let y = self.buffer(extent);
        self.graph.ops.push(Op::Norm(Norm {
            x,
            y,
            residual,
            scale,
            running,
            channels: extent.channels,
            activation,
            dropout,
        }));
        y
    }

    fn activation(&mut self, name: &str, channels: usize, prelu: bool) -> Activation {
        if prelu {
            let name = format!("{name}.weight");
            Activation::Prelu(self.tensor(name, vec![channels], Kind::Slope))
        } else {
            Activation::Relu
        }
    }

    /// Convolution, normalisation, activation.
    fn unit(
        &mut self,
        name: &str,
        x: BufferId,
        (outputs, window): (usize, Window),
        prelu: bool,
    ) -> BufferId {
        let raw = self.conv(&format!("{name}.conv"), x, outputs, window);
        let activation = self.activation(&format!("{name}.prelu"), outputs, prelu);
        self.norm(&format!("{name}.norm"), raw, None, (activation, 0.0))
    }

    fn stage1(&mut self, x: BufferId) -> BufferId {
        let x = self.downsampling("stage1.0", x, 64, DROPOUT_EARLY);
        (1..=4).fold(x, |x, index| {
            let style = Style::encoder(DROPOUT_EARLY);
            self.bottleneck(&format!("stage1.{index}"), x, Middle::Plain, style)
        })
    }

    /// Those bottlenecks of stage 2 or 3, counted from 0.
    fn dilated_stage(&mut self, stage: usize, x: BufferId, part: Range<usize>) -> BufferId {
        part.fold(x, |x, index| {
            let name = format!("stage{stage}.{}", index + 1);
            self.bottleneck(&name, x, Middle::STAGE[index], Style::encoder(DROPOUT_LATE))
        })
    }

    fn stage4(&mut self, x: BufferId) -> BufferId {
        (1..=2).fold(x, |x, index| {
            let name = format!("stage4.{index}");
            self.bottleneck(&name, x, Middle::Plain, Style::DECODER)
        })
    }

    fn finish(mut self, x: BufferId) -> Graph {
        let x = self.bottleneck("stage5.1", x, Middle::Plain, Style::DECODER);
        self.head(x);
        self.graph
    }

    /// As many channels as before, mixed and normalised.
    fn projection(&mut self, name: &str, x: BufferId) -> BufferId {
        let channels = self.graph.buffers[x].channels;
        let raw = self.conv(&format!("{name}.conv"), x, channels, Window::POINT);
        let plain = (Activation::Identity, 0.0);
        self.norm(&format!("{name}.norm"), raw, None, plain)
    }

    fn add(&mut self, a: BufferId, b: BufferId) -> BufferId {
        let y = self.buffer(self.graph.buffers[a]);
        self.graph.ops.push(Op::Add { a, b, y });
        y
    }

    fn initial(&mut self) -> BufferId {
        let x = Graph::INPUT;
        let window = Window::HALVING_NEIGHBOURS;
        let channels = INITIAL_CONVOLVED + INPUT_PLANES;
        let y = self.buffer(window.output(self.graph.buffers[x], channels));
        self.conv_into("initial.conv", (x, y), INITIAL_CONVOLVED, window);
        self.graph.ops.push(Op::PoolInput {
            x,
            y,
            offset: INITIAL_CONVOLVED,
        });
        let activation = self.activation("initial.prelu", channels, true);
        self.norm("initial.norm", y, None, (activation, 0.0))
    }

    /// The last projection, its normalisation, the sum with the other branch, the activation.
    fn merge(
        &mut self,
        name: &str,
        x: BufferId,
        (outputs, residual): (usize, BufferId),
        style: Style,
    ) -> BufferId {
        let raw = self.conv(&format!("{name}.expand.conv"), x, outputs, Window::POINT);
        let activation = self.activation(&format!("{name}.out.prelu"), outputs, style.prelu);
        let norm = format!("{name}.expand.norm");
        self.norm(&norm, raw, Some(residual), (activation, style.dropout))
    }

    fn bottleneck(&mut self, name: &str, x: BufferId, middle: Middle, style: Style) -> BufferId {
        let outputs = self.graph.buffers[x].channels;
        let inner = outputs / REDUCTION;
        let part = |part: &str| format!("{name}.{part}");
        let mut y = self.unit(&part("reduce"), x, (inner, Window::POINT), style.prelu);
        let windows: &[(&str, Window)] = match middle {
            Middle::Plain => &[("middle", Window::NEIGHBOURS)],
            Middle::Dilated(dilation) => &[("middle", Window::dilated(dilation))],
            Middle::Asymmetric => &[
                ("middle.0", Window::line((5, 1))),
                ("middle.1", Window::line((1, 5))),
            ],
        };
        for (suffix, window) in windows {
            y = self.unit(&part(suffix), y, (inner, *window), style.prelu);
        }
        self.merge(name, y, (outputs, x), style)
    }

    fn downsampling(&mut self, name: &str, x: BufferId, outputs: usize, dropout: f32) -> BufferId {
        let inner = outputs / REDUCTION;
        let input = self.graph.buffers[x];
        let main = self.buffer(Window::HALVING.output(input, outputs));
        self.graph.ops.push(Op::Pool { x, y: main });
        let reduced = self.unit(&format!("{name}.reduce"), x, (inner, Window::HALVING), true);
        let window = (inner, Window::NEIGHBOURS);
        let y = self.unit(&format!("{name}.middle"), reduced, window, true);
        self.merge(name, y, (outputs, main), Style::encoder(dropout))
    }

    fn upsampling(&mut self, name: &str, x: BufferId, outputs: usize) -> BufferId {
        let inner = outputs / REDUCTION;
        let skip = self.conv(&format!("{name}.skip.conv"), x, outputs, Window::POINT);
        let plain = (Activation::Identity, 0.0);
        let skip = self.norm(&format!("{name}.skip.norm"), skip, None, plain);
        let small = self.graph.buffers[skip];
        let main = self.buffer(Extent {
            rows: small.rows * 2,
            cols: small.cols * 2,
            ..small
        });
        self.graph.ops.push(Op::Upsample { x: skip, y: main });
        let point = (inner, Window::POINT);
        let y = self.unit(&format!("{name}.reduce"), x, point, false);
        let doubling = (inner, Window::DOUBLING);
        let y = self.unit(&format!("{name}.middle"), y, doubling, false);
        self.merge(name, y, (outputs, main), Style::DECODER)
    }

    /// What is said of the goal as a whole.
    fn scores(&mut self, x: BufferId, goal: BufferId) {
        let x = self.unit("score.hidden", x, (SCORE_HIDDEN, Window::POINT), true);
        let y = self.buffer(Extent {
            rows: 1,
            cols: 1,
            channels: SCORES,
        });
        let inputs = 2 * SCORE_HIDDEN;
        let kind = Kind::Kernel { fan_in: inputs };
        let kernel = self.tensor("score.weight".to_owned(), vec![SCORES, inputs], kind);
        let bias = self.tensor("score.bias".to_owned(), vec![SCORES], Kind::Shift);
        self.graph.scores = Some(y);
        self.graph.ops.push(Op::Score {
            x,
            goal,
            y,
            kernel,
            bias,
        });
    }

    fn head(&mut self, x: BufferId) {
        let input = self.graph.buffers[x];
        let y = self.buffer(Extent {
            rows: input.rows * 2,
            cols: input.cols * 2,
            channels: 1,
        });
        let kind = Kind::Kernel {
            fan_in: input.channels,
        };
        let shape = vec![input.channels, 1, 2, 2];
        let kernel = self.tensor("head.weight".to_owned(), shape, kind);
        let bias = self.tensor("head.bias".to_owned(), vec![1], Kind::Shift);
        self.graph.ops.push(Op::Head { x, y, kernel, bias });
    }
}
