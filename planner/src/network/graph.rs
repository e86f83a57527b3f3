//! The two architectures as lists of operations over buffers and of named parameters.
//!
//! `enet` is the paper's: after A. Paszke et al., "ENet: A Deep Neural Network Architecture for Real-Time Semantic
//! Segmentation" (2016), with the two changes of the paper: average pooling in the downsampling
//! bottleneck, bilinear upsampling in the upsampling one. `PReLU` has a slope for each channel in the
//! encoder, the decoder uses plain rectifiers, convolutions have no bias but the last. With three
//! input planes and one logit this has exactly [`PARAMETER_COUNT`] parameters.
//!
//! `enet-shared` looks at the map once for all goals: up to bottleneck 3.4 nothing depends on a goal.
//! There features of the goal (`goal_features`) are added, and only the rest runs for each goal. What
//! the encoder saw at higher resolutions is added again in the decoder, computed once as well.
//!
//! Everything else (the plain candle model, the training engine, the inference engine, the weights
//! file) is derived from this one description.

use serde::{Deserialize, Serialize};

/// Trainable parameters of ENet with three input planes and one logit.
pub const PARAMETER_COUNT: usize = 362_832;
/// Sides of the network's input are multiples of this.
pub const SIDE_MULTIPLE: usize = 8;
/// Input planes: obstacles, reference, and the target or the vehicle.
pub const INPUT_PLANES: usize = 3;
/// What `enet-shared` says of a goal as a whole: whether there is a path, its cost, the steps to it.
pub(crate) const SCORES: usize = 3;
/// Feature of a goal by which pixels count towards its scores: a bell of 8 m.
pub(crate) const NEAR_GOAL: usize = 4;
/// Features of a goal at each pixel of an eighth of the resolution, for `enet-shared`.
pub(crate) const GOAL_FEATURES: usize = 27;

/// Added to a variance before its root is taken.
pub(crate) const NORM_EPSILON: f32 = 1e-3;
/// Channels of the initial block that are convolved; the other three are pooled.
pub(crate) const INITIAL_CONVOLVED: usize = 13;

mod builder;

/// Which network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Architecture {
    /// The paper's: one pass a target.
    Enet,
    /// One pass a map and a short one a target.
    #[default]
    EnetShared,
}

impl Architecture {
    /// All there are.
    pub const ALL: [Self; 2] = [Self::Enet, Self::EnetShared];

    /// The name in files, messages and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Enet => "enet",
            Self::EnetShared => "enet-shared",
        }
    }

    /// The architecture of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL
            .into_iter()
            .find(|architecture| architecture.name() == name)
    }
}

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
    /// `y = a + b`.
    Add {
        a: BufferId,
        b: BufferId,
        y: BufferId,
    },
    /// Linear in two means of each channel over the pixels: all alike, and weighted by the feature
    /// [`NEAR_GOAL`] of `goal`.
    Score {
        x: BufferId,
        goal: BufferId,
        y: BufferId,
        kernel: usize,
        bias: usize,
    },
    /// Full transposed convolution 2×2 with bias to one logit at twice the size.
    Head {
        x: BufferId,
        y: BufferId,
        kernel: usize,
        bias: usize,
    },
}

impl Op {
    /// The buffers that are read, and the one that is written.
    pub(crate) fn buffers(&self) -> (Vec<BufferId>, BufferId) {
        match *self {
            Self::Conv(Conv { x, y, .. })
            | Self::PoolInput { x, y, .. }
            | Self::Pool { x, y }
            | Self::Upsample { x, y }
            | Self::Head { x, y, .. } => (vec![x], y),
            Self::Norm(norm) => ([norm.x].into_iter().chain(norm.residual).collect(), norm.y),
            Self::Add { a, b, y } => (vec![a, b], y),
            Self::Score { x, goal, y, .. } => (vec![x, goal], y),
        }
    }
}

/// The network for one size of input.
#[derive(Debug, Clone)]
pub(crate) struct Graph {
    pub(crate) tensors: Vec<TensorSpec>,
    pub(crate) buffers: Vec<Extent>,
    pub(crate) ops: Vec<Op>,
    /// So many operations at the beginning do not depend on the goal.
    pub(crate) map_ops: usize,
    /// The buffer that holds features of the goal.
    pub(crate) goal: Option<BufferId>,
    /// The buffer that holds what is said of the goal as a whole.
    pub(crate) scores: Option<BufferId>,
    pub(crate) trained_len: usize,
    pub(crate) running_len: usize,
}

impl Graph {
    /// The buffer that holds the input planes.
    pub(crate) const INPUT: BufferId = 0;

    /// An architecture for inputs of `rows` × `cols`, both multiples of [`SIDE_MULTIPLE`].
    pub(crate) fn new(architecture: Architecture, (rows, cols): (usize, usize)) -> Self {
        match architecture {
            Architecture::Enet => Self::enet(rows, cols),
            Architecture::EnetShared => Self::enet_shared(rows, cols),
        }
    }

    /// Whether a buffer is filled from outside.
    pub(crate) fn is_input(&self, buffer: BufferId) -> bool {
        buffer == Self::INPUT || Some(buffer) == self.goal
    }

    /// Floats of one image's input: the planes, then the features of the goal.
    pub(crate) fn input_len(&self) -> usize {
        let goal = self.goal.map_or(0, |goal| self.buffers[goal].len());
        self.buffers[Self::INPUT].len() + goal
    }

    /// The buffer that holds the logits.
    pub(crate) fn output(&self) -> BufferId {
        self.buffers.len() - 1
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
    fn what_the_map_decides_does_not_depend_on_the_goal() {
        let graph = Graph::enet_shared(408, 152);
        let mut of_goal = BTreeSet::from([graph.goal.unwrap()]);
        for (index, op) in graph.ops.iter().enumerate() {
            let (reads, writes) = op.buffers();
            if reads.iter().any(|buffer| of_goal.contains(buffer)) {
                of_goal.insert(writes);
            }
            assert_eq!(of_goal.contains(&writes), index >= graph.map_ops, "{op:?}");
        }
        assert!(of_goal.contains(&graph.output()));
        assert_eq!(graph.input_len(), 408 * 152 * 3 + 51 * 19 * GOAL_FEATURES);
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
