//! The network on candle's own operations: slow, plain, and what the fast path is compared with.
//!
//! It runs wherever candle does and keeps candle's gradients where candle has them (its bilinear
//! upsampling has none, so that is written here as products with two constant matrices).

use std::collections::BTreeMap;

use candle_core::{DType, Device, Result, Tensor, Var};

use super::engine::spatial::{FAR, NEAR, bilinear_lines};
use super::graph::{
    Activation, Architecture, BufferId, Conv, Graph, INPUT_PLANES, NEAR_GOAL, NORM_EPSILON, Norm,
    Op,
};
use super::parameters::Parameters;

/// The network with its parameters as candle variables.
#[derive(Debug)]
pub struct Reference {
    architecture: Architecture,
    tensors: BTreeMap<(bool, usize), Var>,
    device: Device,
    precision: DType,
}

impl Reference {
    /// The network on `device` in single or double precision.
    ///
    /// # Errors
    /// Candle's, if the device has no memory for it.
    pub fn new(parameters: &Parameters, device: &Device, precision: DType) -> Result<Self> {
        let architecture = parameters.architecture();
        let graph = Graph::new(architecture, (8, 8));
        let mut tensors = BTreeMap::new();
        for (tensor, (_, shape, values)) in graph.tensors.iter().zip(parameters.tensors()) {
            let value = Tensor::from_slice(values, shape, device)?.to_dtype(precision)?;
            let key = (tensor.kind.is_trained(), tensor.start);
            tensors.insert(key, Var::from_tensor(&value)?);
        }
        Ok(Self {
            architecture,
            tensors,
            device: device.clone(),
            precision,
        })
    }

    /// The variables that are trained, with their place in the flat vector.
    pub fn trained(&self) -> impl Iterator<Item = (usize, &Var)> {
        let trained = self.tensors.iter().filter(|((trained, _), _)| *trained);
        trained.map(|((_, start), var)| (*start, var))
    }

    /// The logits of a batch. With `training` the batch's own statistics normalise, without dropout.
    ///
    /// # Shapes
    /// `input`: batch × 3 × rows × cols, sides multiples of 8; `features`: batch × 20 × rows / 8 ×
    /// cols / 8, for `enet-shared` only; result: batch × 1 × rows × cols.
    ///
    /// # Errors
    /// Candle's, if the shape does not fit.
    pub fn forward(
        &self,
        input: &Tensor,
        features: Option<&Tensor>,
        training: bool,
    ) -> Result<Tensor> {
        Ok(self.forward_all(input, features, training)?.0)
    }

    /// The logits of a batch, and what is said of its goals: batch × 3, for `enet-shared` only.
    ///
    /// # Errors
    /// As [`Self::forward`].
    pub fn forward_all(
        &self,
        input: &Tensor,
        features: Option<&Tensor>,
        training: bool,
    ) -> Result<(Tensor, Option<Tensor>)> {
        let (_, planes, rows, cols) = input.dims4()?;
        if planes != INPUT_PLANES || !rows.is_multiple_of(8) || !cols.is_multiple_of(8) {
            candle_core::bail!("input is {:?}, expected batch x 3 x 8n x 8m", input.shape());
        }
        let input = input.to_dtype(self.precision)?;
        let graph = Graph::new(self.architecture, (rows, cols));
        let mut buffers: Vec<Option<Tensor>> = vec![None; graph.buffers.len()];
        buffers[Graph::INPUT] = Some(input);
        if let (Some(goal), Some(features)) = (graph.goal, features) {
            buffers[goal] = Some(features.to_dtype(self.precision)?);
        }
        for op in &graph.ops {
            self.op(&graph, op, &mut buffers, training)?;
        }
        let scores = graph.scores.and_then(|scores| buffers[scores].clone());
        Ok((get(&buffers, graph.output())?.clone(), scores))
    }

    fn op(
        &self,
        graph: &Graph,
        op: &Op,
        buffers: &mut [Option<Tensor>],
        training: bool,
    ) -> Result<()> {
        let (to, value) = match *op {
            Op::Conv(conv) => {
                let raw = self.conv(&conv, get(buffers, conv.x)?)?;
                (conv.y, raw)
            }
            Op::PoolInput { x, y, .. } => {
                let pooled = get(buffers, x)?.max_pool2d(2)?;
                (y, Tensor::cat(&[get(buffers, y)?, &pooled], 1)?)
            }
            Op::Norm(norm) => {
                let residual = norm
                    .residual
                    .map(|buffer| get(buffers, buffer))
                    .transpose()?;
                let value = self.norm(&norm, get(buffers, norm.x)?, residual, training)?;
                (norm.y, value)
            }
            Op::Pool { x, y } => {
                let missing = graph.buffers[y].channels - graph.buffers[x].channels;
                let pooled = get(buffers, x)?.avg_pool2d(2)?;
                (y, pooled.pad_with_zeros(1, 0, missing)?)
            }
            Op::Upsample { x, y } => {
                let small = graph.buffers[x];
                let rows = self.doubling(small.rows)?;
                let cols = self.doubling(small.cols)?.t()?;
                let value = get(buffers, x)?.broadcast_matmul(&cols)?;
                (y, rows.broadcast_matmul(&value)?)
            }
            Op::Add { a, b, y } => (y, (get(buffers, a)? + get(buffers, b)?)?),
            Op::Score {
                x,
                goal,
                y,
                kernel,
                bias,
            } => {
                let near = get(buffers, goal)?.narrow(1, NEAR_GOAL, 1)?.relu()?;
                let sum = near.sum_keepdim((2, 3))?.maximum(1e-6)?;
                let x = get(buffers, x)?;
                let plain = x.mean((2, 3))?;
                let weighted = x.broadcast_mul(&near.broadcast_div(&sum)?)?.sum((2, 3))?;
                let means = Tensor::cat(&[&plain, &weighted], 1)?;
                let scores = means.matmul(&self.trained_at(kernel)?.t()?)?;
                (y, scores.broadcast_add(self.trained_at(bias)?)?)
            }
            Op::Head { x, y, kernel, bias } => {
                let raw = get(buffers, x)?;
                let raw = raw.conv_transpose2d(self.trained_at(kernel)?, 0, 0, 2, 1)?;
                (y, raw.broadcast_add(self.trained_at(bias)?)?)
            }
        };
        buffers[to] = Some(value);
        Ok(())
    }

    fn conv(&self, conv: &Conv, x: &Tensor) -> Result<Tensor> {
        let (window, kernel) = (conv.window, self.trained_at(conv.kernel)?);
        if window.transposed {
            return x.conv_transpose2d(kernel, window.padding.0, 1, window.stride, 1);
        }
        // Candle has one padding for both sides, so the zeros are put there by hand.
        let x = x.pad_with_zeros(2, window.padding.0, window.padding.0)?;
        let x = x.pad_with_zeros(3, window.padding.1, window.padding.1)?;
        x.conv2d(kernel, 0, window.stride, window.dilation, 1)
    }

    fn norm(
        &self,
        norm: &Norm,
        x: &Tensor,
        residual: Option<&Tensor>,
        training: bool,
    ) -> Result<Tensor> {
        let each = |tensor: &Tensor| tensor.reshape((1, norm.channels, 1, 1));
        let (mean, variance) = if training {
            let mean = x.mean_keepdim((0, 2, 3))?;
            let variance = x.broadcast_sub(&mean)?.sqr()?.mean_keepdim((0, 2, 3))?;
            (mean, variance)
        } else {
            let after = norm.running + norm.channels;
            (
                each(self.at(false, norm.running)?)?,
                each(self.at(false, after)?)?,
            )
        };
        let scale = each(self.trained_at(norm.scale)?)?;
        let shift = each(self.trained_at(norm.scale + norm.channels)?)?;
        let deviation = (variance + f64::from(NORM_EPSILON))?.sqrt()?;
        let z = x.broadcast_sub(&mean)?.broadcast_div(&deviation)?;
        let z = z.broadcast_mul(&scale)?.broadcast_add(&shift)?;
        let z = residual.map_or_else(|| Ok(z.clone()), |residual| &z + residual)?;
        match norm.activation {
            Activation::Identity => Ok(z),
            Activation::Relu => z.relu(),
            Activation::Prelu(start) => {
                let below = z
                    .neg()?
                    .relu()?
                    .broadcast_mul(&each(self.trained_at(start)?)?)?;
                z.relu()? - below
            }
        }
    }

    /// The matrix that doubles a line of `inputs` bilinearly.
    fn doubling(&self, inputs: usize) -> Result<Tensor> {
        let mut matrix = vec![0.0; 2 * inputs * inputs];
        for output in 0..2 * inputs {
            let (near, far) = bilinear_lines(output, inputs);
            matrix[output * inputs + near] += NEAR;
            matrix[output * inputs + far] += FAR;
        }
        Tensor::from_vec(matrix, (2 * inputs, inputs), &self.device)?.to_dtype(self.precision)
    }

    fn trained_at(&self, start: usize) -> Result<&Tensor> {
        self.at(true, start)
    }

    fn at(&self, trained: bool, start: usize) -> Result<&Tensor> {
        match self.tensors.get(&(trained, start)) {
            Some(var) => Ok(var.as_tensor()),
            None => candle_core::bail!("no tensor begins at {start}"),
        }
    }
}

fn get(buffers: &[Option<Tensor>], buffer: BufferId) -> Result<&Tensor> {
    match &buffers[buffer] {
        Some(tensor) => Ok(tensor),
        None => candle_core::bail!("buffer {buffer} is read before it is written"),
    }
}
