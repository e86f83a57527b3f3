//! The engine as operations of candle, so that candle's gradients, optimisers, variables and files
//! work with it.
//!
//! All trained parameters are one flat variable, which an optimiser of `candle_nn` may own. The plain
//! model on candle's own operations is [`Reference`](super::Reference).

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use candle_core::{CpuStorage, CustomOp2, DType, Device, Layout, Result, Shape, Tensor, Var, bail};
use candle_nn::VarBuilder;
use rayon::prelude::*;

use super::engine::{Dropout, Inference, Isa, Training, Workspace};
use super::graph::{Architecture, Graph, INPUT_PLANES, SIDE_MULTIPLE};
use super::parameters::Parameters;

/// A network whose trained parameters are one candle variable and whose passes are the engine's.
#[derive(Debug)]
pub struct Differentiable {
    flat: Var,
    size: (usize, usize),
    state: Arc<Mutex<State>>,
}

#[derive(Debug)]
struct State {
    training: Training,
    parameters: Parameters,
    /// Number of the forward pass whose activations are held.
    pass: u64,
}

impl Differentiable {
    /// A network for inputs of `rows` × `cols`, both multiples of [`SIDE_MULTIPLE`].
    ///
    /// # Errors
    /// Candle's, or that the size does not fit.
    pub fn new(parameters: Parameters, (rows, cols): (usize, usize)) -> Result<Self> {
        let Some(training) = Training::new(parameters.architecture(), (rows, cols)) else {
            bail!("the input is {rows} x {cols}, expected multiples of {SIDE_MULTIPLE} up to 4096");
        };
        let flat =
            Tensor::from_slice(parameters.values(), parameters.values().len(), &Device::Cpu)?;
        Ok(Self {
            flat: Var::from_tensor(&flat)?,
            size: (rows, cols),
            state: Arc::new(Mutex::new(State {
                training,
                parameters,
                pass: 0,
            })),
        })
    }

    /// A network whose parameters come from a builder of variables, under the names of a weights
    /// file, for example `VarBuilder::from_buffered_safetensors`.
    ///
    /// # Errors
    /// Candle's, if a tensor is missing or of another shape.
    pub fn load(
        builder: &VarBuilder<'_>,
        architecture: Architecture,
        size: (usize, usize),
    ) -> Result<Self> {
        let mut parameters = Parameters::initial(architecture, 0);
        for tensor in Graph::new(architecture, (SIDE_MULTIPLE, SIDE_MULTIPLE)).tensors {
            let found = builder.get(tensor.shape.as_slice(), &tensor.name)?;
            let values = found.to_dtype(DType::F32)?.flatten_all()?.to_vec1()?;
            let to = if tensor.kind.is_trained() {
                parameters.values_mut()
            } else {
                parameters.running_mut()
            };
            to[tensor.start..][..tensor.len()].copy_from_slice(&values);
        }
        Self::new(parameters, size)
    }

    /// The variable that holds all trained parameters, for an optimiser.
    pub const fn variable(&self) -> &Var {
        &self.flat
    }

    /// The parameters as they are now.
    ///
    /// # Errors
    /// Candle's, if the variable cannot be read.
    pub fn parameters(&self) -> Result<Parameters> {
        let mut parameters = lock(&self.state).parameters.clone();
        let values: Vec<f32> = self.flat.as_tensor().to_vec1()?;
        parameters.values_mut().copy_from_slice(&values);
        Ok(parameters)
    }

    /// The logits of a batch, normalised by its own statistics, which move the running ones. The
    /// result has gradients with respect to [`Self::variable`].
    ///
    /// # Shapes
    /// `planes`: batch × 3 × rows × cols; `features`: batch × 27 × rows / 8 × cols / 8, for
    /// `enet-shared` only; result: batch × 1 × rows × cols.
    ///
    /// # Errors
    /// Candle's, if a shape does not fit.
    pub fn forward_train(
        &self,
        planes: &Tensor,
        features: Option<&Tensor>,
        dropout: Option<Dropout>,
    ) -> Result<Tensor> {
        let input = self.input(planes, features)?;
        let pass = {
            let mut state = lock(&self.state);
            state.pass += 1;
            state.pass
        };
        let op = TrainingPass {
            state: Arc::clone(&self.state),
            size: self.size,
            dropout,
            pass,
        };
        self.flat.as_tensor().apply_op2(&input, op)
    }

    /// The logits of a batch, normalised by the running statistics. They have no gradients.
    ///
    /// # Shapes
    /// As [`Self::forward_train`].
    ///
    /// # Errors
    /// Candle's, if a shape does not fit.
    pub fn forward(&self, planes: &Tensor, features: Option<&Tensor>) -> Result<Tensor> {
        let input = self.input(planes, features)?;
        let op = InferencePass {
            running: lock(&self.state).parameters.clone(),
            size: self.size,
        };
        self.flat.as_tensor().apply_op2_no_bwd(&input, &op)
    }

    /// One row an image: its planes and features, channels innermost.
    fn input(&self, planes: &Tensor, features: Option<&Tensor>) -> Result<Tensor> {
        let rows = |tensor: &Tensor| {
            let innermost = tensor.to_dtype(DType::F32)?.permute((0, 2, 3, 1))?;
            innermost.contiguous()?.flatten_from(1)
        };
        let wanted = (INPUT_PLANES, self.size.0, self.size.1);
        let (_, channels, height, width) = planes.dims4()?;
        let len = lock(&self.state).training.input_len();
        let mut input = rows(planes)?;
        if let Some(features) = features {
            input = Tensor::cat(&[&input, &rows(features)?], 1)?;
        }
        if (channels, height, width) != wanted || input.dim(1)? != len {
            bail!(
                "planes are {:?} and features {:?}, expected {wanted:?} and {len} values in all",
                planes.shape(),
                features.map(Tensor::shape)
            );
        }
        input.contiguous()
    }
}

fn lock(state: &Mutex<State>) -> MutexGuard<'_, State> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The values of a contiguous tensor of single precision.
fn values<'a>(storage: &'a CpuStorage, layout: &Layout) -> Result<&'a [f32]> {
    let all: &[f32] = storage.as_slice()?;
    match layout.contiguous_offsets() {
        Some((start, end)) => Ok(&all[start..end]),
        None => bail!("expected contiguous values"),
    }
}

struct TrainingPass {
    state: Arc<Mutex<State>>,
    size: (usize, usize),
    dropout: Option<Dropout>,
    pass: u64,
}

impl CustomOp2 for TrainingPass {
    fn name(&self) -> &'static str {
        "swath-training"
    }

    fn cpu_fwd(
        &self,
        flat: &CpuStorage,
        flat_layout: &Layout,
        input: &CpuStorage,
        input_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let mut state = lock(&self.state);
        let State {
            training,
            parameters,
            ..
        } = &mut *state;
        parameters
            .values_mut()
            .copy_from_slice(values(flat, flat_layout)?);
        let input = values(input, input_layout)?;
        let images = input.len() / training.input_len();
        let logits = training.forward(parameters, input, self.dropout).to_vec();
        training.update_running(parameters);
        let shape = Shape::from((images, 1, self.size.0, self.size.1));
        Ok((CpuStorage::F32(logits), shape))
    }

    fn bwd(
        &self,
        flat: &Tensor,
        input: &Tensor,
        _logits: &Tensor,
        logit_gradient: &Tensor,
    ) -> Result<(Option<Tensor>, Option<Tensor>)> {
        let logit_gradient: Vec<f32> = logit_gradient.flatten_all()?.to_vec1()?;
        let mut state = lock(&self.state);
        let State {
            training,
            parameters,
            pass,
        } = &mut *state;
        parameters
            .values_mut()
            .copy_from_slice(&flat.to_vec1::<f32>()?);
        if *pass != self.pass {
            // Another pass has been made since, so the activations have to be computed again.
            let input: Vec<f32> = input.flatten_all()?.to_vec1()?;
            training.forward(parameters, &input, self.dropout);
            *pass = self.pass;
        }
        let mut gradient = vec![0.0; parameters.values().len()];
        let scores = vec![0.0; training.scores().len()];
        training.backward(parameters, (&logit_gradient, &scores), &mut gradient);
        let gradient = Tensor::from_vec(gradient, flat.shape(), &Device::Cpu)?;
        Ok((Some(gradient), None))
    }
}

struct InferencePass {
    running: Parameters,
    size: (usize, usize),
}

impl CustomOp2 for InferencePass {
    fn name(&self) -> &'static str {
        "swath-inference"
    }

    fn cpu_fwd(
        &self,
        flat: &CpuStorage,
        flat_layout: &Layout,
        input: &CpuStorage,
        input_layout: &Layout,
    ) -> Result<(CpuStorage, Shape)> {
        let mut parameters = self.running.clone();
        parameters
            .values_mut()
            .copy_from_slice(values(flat, flat_layout)?);
        let network = Inference::new(Isa::detect(), self.size, &parameters);
        let input = values(input, input_layout)?;
        let images = input_layout.dims()[0];
        let logits: Vec<Vec<f32>> = input
            .par_chunks_exact(input.len() / images.max(1))
            .map_init(Default::default, |(map, goal), image| {
                one_image(&network, (map, goal), image)
            })
            .collect();
        let shape = Shape::from((images, 1, self.size.0, self.size.1));
        Ok((CpuStorage::F32(logits.concat()), shape))
    }
}

/// The logits of one image that comes as in training: planes, then features.
pub(super) fn one_image(
    network: &Inference,
    (map, goal): (&mut Workspace, &mut Workspace),
    image: &[f32],
) -> Vec<f32> {
    let planes = network.planes(map);
    let (of_map, of_goal) = image.split_at(planes.len());
    planes.copy_from_slice(of_map);
    network.see_map(map);
    network.goal_input(goal).copy_from_slice(of_goal);
    network.see_goal(map, goal, false);
    network.logits(goal).to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::graph::GOAL_FEATURES;
    use crate::network::{Network, NetworkInfo, Reference};
    use candle_nn::{AdamW, Optimizer, ParamsAdamW};

    fn planes(images: usize) -> Tensor {
        let values: Vec<f32> = (0..images * INPUT_PLANES * 32 * 24)
            .map(|index| f32::from(u8::try_from(index * 31 % 7).unwrap()) / 7.0)
            .collect();
        Tensor::from_vec(values, (images, INPUT_PLANES, 32, 24), &Device::Cpu).unwrap()
    }

    fn features(images: usize) -> Tensor {
        let values: Vec<f32> = (0..images * GOAL_FEATURES * 4 * 3)
            .map(|index| f32::from(u8::try_from(index * 17 % 5).unwrap()) / 5.0)
            .collect();
        Tensor::from_vec(values, (images, GOAL_FEATURES, 4, 3), &Device::Cpu).unwrap()
    }

    fn flat(tensor: &Tensor) -> Vec<f32> {
        let single = tensor.to_dtype(DType::F32).unwrap();
        single.flatten_all().unwrap().to_vec1().unwrap()
    }

    #[test]
    fn a_loaded_network_gives_the_logits_of_the_plain_model() {
        let architecture = Architecture::EnetShared;
        let parameters = Parameters::initial(architecture, 3);
        let file = Network::save(&NetworkInfo::default(), &parameters);
        let builder =
            VarBuilder::from_buffered_safetensors(file, DType::F32, &Device::Cpu).unwrap();
        let network = Differentiable::load(&builder, architecture, (32, 24)).unwrap();
        assert_eq!(network.parameters().unwrap(), parameters);
        let (planes, features) = (planes(2), features(2));
        let ours = flat(&network.forward(&planes, Some(&features)).unwrap());
        let plain = Reference::new(&parameters, &Device::Cpu, DType::F64).unwrap();
        let plain = flat(&plain.forward(&planes, Some(&features), false).unwrap());
        let largest = plain.iter().fold(0.0_f32, |most, v| most.max(v.abs()));
        for (ours, plain) in ours.iter().zip(&plain) {
            assert!((ours - plain).abs() <= 1e-4 * largest);
        }
        assert!(network.forward(&planes, None).is_err());
    }

    #[test]
    fn an_optimiser_of_candle_learns_with_the_gradients_of_the_engine() {
        let parameters = Parameters::initial(Architecture::Enet, 5);
        let network = Differentiable::new(parameters, (32, 24)).unwrap();
        let settings = ParamsAdamW {
            lr: 5e-3,
            ..ParamsAdamW::default()
        };
        let mut optimiser = AdamW::new(vec![network.variable().clone()], settings).unwrap();
        let planes = planes(3);
        let wanted = planes.narrow(1, 0, 1).unwrap();
        let mut losses = Vec::new();
        for _ in 0..30 {
            let logits = network.forward_train(&planes, None, None).unwrap();
            let loss = (logits - &wanted)
                .unwrap()
                .sqr()
                .unwrap()
                .mean_all()
                .unwrap();
            losses.push(loss.to_scalar::<f32>().unwrap());
            optimiser.backward_step(&loss).unwrap();
        }
        assert!(losses[29] < 0.5 * losses[0], "{losses:?}");
    }

    #[test]
    fn gradients_are_those_of_their_own_forward_pass() {
        let parameters = Parameters::initial(Architecture::Enet, 5);
        let network = Differentiable::new(parameters, (32, 24)).unwrap();
        let gradient = |loss: &Tensor| {
            let gradients = loss.backward().unwrap();
            flat(gradients.get(network.variable()).unwrap())
        };
        let forward = |images: usize| {
            let logits = network.forward_train(&planes(images), None, None);
            logits.unwrap().sqr().unwrap().mean_all().unwrap()
        };
        let first = forward(2);
        let expected = gradient(&first);
        forward(3);
        assert_eq!(gradient(&first), expected);
    }
}
