//! ENet as a list of operations over buffers and a list of named parameters.
//!
//! After A. Paszke et al., "ENet: A Deep Neural Network Architecture for Real-Time Semantic
//! Segmentation" (2016), with the two changes of the paper: average pooling in the downsampling
//! bottleneck, bilinear upsampling in the upsampling one. `PReLU` has a slope for each channel in the
//! encoder, the decoder uses plain rectifiers, convolutions have no bias but the last. With three
//! input planes and one logit this has exactly [`PARAMETER_COUNT`] parameters.
//!
//! Everything else (the plain candle model, the training engine, the inference engine, the weights
//! file) is derived from this one description.

/// Trainable parameters of ENet with three input planes and one logit.
pub const PARAMETER_COUNT: usize = 362_832;
/// Sides of the network's input are multiples of this.
pub const SIDE_MULTIPLE: usize = 8;
/// Input planes: obstacles, reference, target.
pub const INPUT_PLANES: usize = 3;

/// Added to a variance before its root is taken.
pub(crate) const NORM_EPSILON: f32 = 1e-3;
/// Channels of the initial block that are convolved; the other three are pooled.
pub(crate) const INITIAL_CONVOLVED: usize = 13;

const DROPOUT_EARLY: f32 = 0.01;
const DROPOUT_LATE: f32 = 0.1;
const REDUCTION: usize = 4;

/// What a named tensor is, which decides how it begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Kernel of a convolution or transposed convolution.
    Kernel {
        /// Values that flow into one output.
        fan_in: usize,
    },
    /// Begins at 1.
    Scale,
    /// Begins at 0.
    Shift,
    /// Begins at 0.25.
    Slope,
    /// Running mean, not trained.
    RunningMean,
    /// Running variance, not trained.
    RunningVariance,
}

impl Kind {
    pub(crate) const fn is_trained(self) -> bool {
        !matches!(self, Self::RunningMean | Self::RunningVariance)
    }
}

/// A named tensor and where it lies in the flat vector of its sort.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct TensorSpec {
    pub(crate) name: String,
    pub(crate) shape: Vec<usize>,
    pub(crate) kind: Kind,
    pub(crate) start: usize,
}

impl TensorSpec {
    pub(crate) fn len(&self) -> usize {
        self.shape.iter().product()
    }
}

/// Index of a buffer of activations.
pub(crate) type BufferId = usize;

/// Size of one image in a buffer, which is stored row by row with the channels innermost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Extent {
    pub(crate) rows: usize,
    pub(crate) cols: usize,
    pub(crate) channels: usize,
}

impl Extent {
    pub(crate) const fn pixels(self) -> usize {
        self.rows * self.cols
    }

    pub(crate) const fn len(self) -> usize {
        self.pixels() * self.channels
    }
}

/// The geometry of a convolution.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(crate) struct Window {
    pub(crate) kernel: (usize, usize),
    pub(crate) padding: (usize, usize),
    pub(crate) stride: usize,
    pub(crate) dilation: usize,
    /// Whether this is the transpose of such a convolution, to twice the size.
    pub(crate) transposed: bool,
}

impl Window {
    const fn square(side: usize, stride: usize, padding: usize) -> Self {
        Self {
            kernel: (side, side),
            padding: (padding, padding),
            stride,
            dilation: 1,
            transposed: false,
        }
    }

    const POINT: Self = Self::square(1, 1, 0);
    const NEIGHBOURS: Self = Self::square(3, 1, 1);
    const HALVING_NEIGHBOURS: Self = Self::square(3, 2, 1);
    const HALVING: Self = Self::square(2, 2, 0);
    const DOUBLING: Self = Self {
        transposed: true,
        ..Self::HALVING_NEIGHBOURS
    };

    const fn dilated(dilation: usize) -> Self {
        Self {
            padding: (dilation, dilation),
            dilation,
            ..Self::NEIGHBOURS
        }
    }

    const fn line(kernel: (usize, usize)) -> Self {
        Self {
            kernel,
            padding: (kernel.0 / 2, kernel.1 / 2),
            stride: 1,
            dilation: 1,
            transposed: false,
        }
    }

    pub(crate) const fn taps(&self) -> usize {
        self.kernel.0 * self.kernel.1
    }

    const fn output(&self, input: Extent, channels: usize) -> Extent {
        let (rows, cols) = if self.transposed {
            (input.rows * 2, input.cols * 2)
        } else {
            (input.rows / self.stride, input.cols / self.stride)
        };
        Extent {
            rows,
            cols,
            channels,
        }
    }
}

/// What follows a normalisation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Activation {
    Identity,
    Relu,
    /// Slopes below zero, one a channel, from this place of the trained vector.
    Prelu(usize),
}

/// A convolution without bias.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Conv {
    pub(crate) x: BufferId,
    /// May have more channels than are convolved, as in the initial block.
    pub(crate) y: BufferId,
    pub(crate) window: Window,
    /// Start of the kernel in the trained vector.
    pub(crate) kernel: usize,
    pub(crate) inputs: usize,
    pub(crate) outputs: usize,
}

/// `y = activation(dropout(normalise(x)) + residual)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Norm {
    pub(crate) x: BufferId,
    pub(crate) y: BufferId,
    pub(crate) residual: Option<BufferId>,
    /// Start of scale in the trained vector; shift follows it.
    pub(crate) scale: usize,
    /// Start of the running mean in the other vector; the running variance follows it.
    pub(crate) running: usize,
    pub(crate) channels: usize,
    pub(crate) activation: Activation,
    /// Share of channels that training drops.
    pub(crate) dropout: f32,
}

/// One step of the network.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Op {
    Conv(Conv),
    Norm(Norm),
    /// 2×2 maximum of the input into the channels of `y` from `offset`; has no gradient.
    PoolInput {
        x: BufferId,
        y: BufferId,
        offset: usize,
    },
    /// 2×2 mean; channels of `y` that `x` lacks are 0.
    Pool {
        x: BufferId,
        y: BufferId,
    },
    /// Bilinear to twice the size, edges clamped, corners not aligned.
    Upsample {
        x: BufferId,
        y: BufferId,
    },
    /// Full transposed convolution 2×2 with bias to one logit at twice the size.
    Head {
        x: BufferId,
        y: BufferId,
        kernel: usize,
        bias: usize,
    },
}

/// The network for one size of input.
#[derive(Debug, Clone)]
pub(crate) struct Graph {
    pub(crate) tensors: Vec<TensorSpec>,
    pub(crate) buffers: Vec<Extent>,
    pub(crate) ops: Vec<Op>,
    pub(crate) trained_len: usize,
    pub(crate) running_len: usize,
}

impl Graph {
    /// The buffer that holds the input.
    pub(crate) const INPUT: BufferId = 0;

    /// The buffer that holds the logits.
    pub(crate) fn output(&self) -> BufferId {
        self.buffers.len() - 1
    }

    /// ENet for inputs of `rows` × `cols`, both multiples of [`SIDE_MULTIPLE`].
    pub(crate) fn enet(rows: usize, cols: usize) -> Self {
        debug_assert!(rows.is_multiple_of(SIDE_MULTIPLE) && cols.is_multiple_of(SIDE_MULTIPLE));
        let mut builder = Builder::new(Extent {
            rows,
            cols,
            channels: INPUT_PLANES,
        });
        let mut x = builder.initial();
        x = builder.downsampling("stage1.0", x, 64, DROPOUT_EARLY);
        for index in 1..=4 {
            let plain = Style::encoder(DROPOUT_EARLY);
            x = builder.bottleneck(&format!("stage1.{index}"), x, Middle::Plain, plain);
        }
        x = builder.downsampling("stage2.0", x, 128, DROPOUT_LATE);
        for stage in [2, 3] {
            for (index, middle) in (1..).zip(Middle::STAGE) {
                let style = Style::encoder(DROPOUT_LATE);
                x = builder.bottleneck(&format!("stage{stage}.{index}"), x, middle, style);
            }
        }
        x = builder.upsampling("stage4.0", x, 64);
        for index in 1..=2 {
            let name = format!("stage4.{index}");
            x = builder.bottleneck(&name, x, Middle::Plain, Style::DECODER);
        }
        x = builder.upsampling("stage5.0", x, 16);
        x = builder.bottleneck("stage5.1", x, Middle::Plain, Style::DECODER);
        builder.head(x);
        builder.graph
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
    fn new(input: Extent) -> Self {
        Self {
            graph: Graph {
                tensors: Vec::new(),
                buffers: vec![input],
                ops: Vec::new(),
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn enet_has_the_parameters_of_the_paper() {
        let graph = Graph::enet(408, 152);
        assert_eq!(graph.trained_len, PARAMETER_COUNT);
        let sum: usize = graph
            .tensors
            .iter()
            .filter(|tensor| tensor.kind.is_trained())
            .map(TensorSpec::len)
            .sum();
        assert_eq!(sum, PARAMETER_COUNT);
        let names: BTreeSet<_> = graph.tensors.iter().map(|tensor| &tensor.name).collect();
        assert_eq!(names.len(), graph.tensors.len());
    }

    #[test]
    fn resolution_halves_three_times_and_comes_back() {
        let graph = Graph::enet(208, 80);
        assert!(graph.buffers.contains(&Extent {
            rows: 26,
            cols: 10,
            channels: 128
        }));
        let output = graph.buffers[graph.output()];
        assert_eq!((output.rows, output.cols, output.channels), (208, 80, 1));
    }

    #[test]
    fn every_convolution_is_followed_by_its_normalisation() {
        let graph = Graph::enet(16, 8);
        for pair in graph.ops.windows(2) {
            if let (Op::Conv(conv), Op::Norm(norm)) = (pair[0], pair[1]) {
                assert_eq!(norm.x, conv.y);
            } else if let Op::Conv(conv) = pair[0] {
                assert!(matches!(pair[1], Op::PoolInput { y, .. } if y == conv.y));
            }
        }
    }
}
