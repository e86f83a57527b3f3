//! The fast path against candle's own operations and against finite differences.

use candle_core::{DType, Device, Tensor};
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::{Dropout, Inference, Isa, Training, Workspace};
use crate::network::autograd::one_image;
use crate::network::graph::{
    Activation, Architecture, GOAL_FEATURES, Graph, INPUT_PLANES, Op, SCORES,
};
use crate::network::{Parameters, Reference};

fn noise(seed: u64, len: usize, scale: f32) -> Vec<f32> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    (0..len)
        .map(|_| scale * ((random.next_u32() >> 8) as f32 / (1 << 23) as f32 - 1.0))
        .collect()
}

/// Parameters in which nothing is at its neutral initial value.
fn varied(architecture: Architecture, seed: u64) -> Parameters {
    let mut parameters = Parameters::initial(architecture, seed);
    let len = parameters.values().len();
    for (value, noise) in parameters
        .values_mut()
        .iter_mut()
        .zip(noise(seed, len, 0.1))
    {
        *value += noise;
    }
    let len = parameters.running().len();
    let offsets = noise(seed + 1, len, 0.2);
    for (value, noise) in parameters.running_mut().iter_mut().zip(offsets) {
        *value += noise;
    }
    parameters
}

/// Inputs of a batch, as the engine takes them and as candle does.
struct Batch {
    inputs: Vec<f32>,
    planes: Tensor,
    features: Option<Tensor>,
}

impl Batch {
    fn new(
        architecture: Architecture,
        (rows, cols): (usize, usize),
        (images, seed): (usize, u64),
    ) -> Self {
        let len = Graph::new(architecture, (rows, cols)).input_len();
        let inputs = noise(seed, images * len, 1.0);
        let planes_len = rows * cols * INPUT_PLANES;
        let part = |from: usize, to: usize| -> Vec<f32> {
            let images = inputs.chunks_exact(len);
            images.flat_map(|input| input[from..to].to_vec()).collect()
        };
        let planes = part(0, planes_len);
        let shape = (images, rows, cols, INPUT_PLANES);
        let features = (len > planes_len).then(|| {
            let shape = (images, rows / 8, cols / 8, GOAL_FEATURES);
            channels_first(&part(planes_len, len), shape)
        });
        Self {
            planes: channels_first(&planes, shape),
            features,
            inputs,
        }
    }

    /// The plain model, its logits and its scores.
    fn reference(
        &self,
        parameters: &Parameters,
        training: bool,
    ) -> (Reference, Tensor, Option<Tensor>) {
        let reference = Reference::new(parameters, &Device::Cpu, DType::F64).unwrap();
        let features = self.features.as_ref();
        let all = reference.forward_all(&self.planes, features, training);
        let (logits, scores) = all.unwrap();
        (reference, logits, scores)
    }
}

/// batch × channels × rows × cols from channels innermost.
fn channels_first(values: &[f32], shape: (usize, usize, usize, usize)) -> Tensor {
    Tensor::from_slice(values, shape, &Device::Cpu)
        .unwrap()
        .permute((0, 3, 1, 2))
        .unwrap()
        .contiguous()
        .unwrap()
}

fn flat(tensor: &Tensor) -> Vec<f32> {
    let single = tensor.to_dtype(DType::F32).unwrap();
    single.flatten_all().unwrap().to_vec1().unwrap()
}

fn largest(values: &[f32]) -> f32 {
    values.iter().fold(0.0, |most, value| most.max(value.abs()))
}

fn farthest(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter()
        .zip(b)
        .fold(0.0, |most, (a, b)| most.max((a - b).abs()))
}

/// Logits and scores of one image.
fn infer(
    isa: Isa,
    size: (usize, usize),
    parameters: &Parameters,
    image: &[f32],
) -> (Vec<f32>, Vec<f32>) {
    let network = Inference::new(isa, size, parameters);
    let (mut map, mut goal) = (Workspace::default(), Workspace::default());
    let logits = one_image(&network, (&mut map, &mut goal), image);
    let scores = network.scores(&goal).unwrap_or_default().to_vec();
    (logits, scores)
}

fn architectures() -> impl Strategy<Value = Architecture> {
    proptest::sample::select(Architecture::ALL.to_vec())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn inference_agrees_with_plain_candle_on_every_processor_path(
        architecture in architectures(), rows in 1usize..8, cols in 1usize..6, seed in 0u64..1000,
    ) {
        let size = (rows * 8, cols * 8);
        let parameters = varied(architecture, seed);
        let batch = Batch::new(architecture, size, (1, seed + 2));
        let (_, expected, expected_scores) = batch.reference(&parameters, false);
        let expected = flat(&expected);
        for &isa in Isa::available() {
            let (logits, scores) = infer(isa, size, &parameters, &batch.inputs);
            prop_assert!(farthest(&logits, &expected) <= 1e-4 * largest(&expected), "{:?}", isa);
            if let Some(expected) = &expected_scores {
                let expected = flat(expected);
                let most = 1e-4 * largest(&expected).max(1.0);
                prop_assert!(farthest(&scores, &expected) <= most, "{:?}: {:?} {:?}", isa, scores, expected);
            }
        }
    }

    #[test]
    fn the_training_pass_and_its_gradients_agree_with_plain_candle(
        architecture in architectures(),
        rows in 3usize..6, cols in 3usize..5, images in 2usize..8, seed in 0u64..1000,
    ) {
        let size = (rows * 8, cols * 8);
        let parameters = decided(architecture, seed);
        let batch = Batch::new(architecture, size, (images, seed + 2));
        let weights = noise(seed + 3, images * size.0 * size.1, 1.0);
        let (reference, logits, scores) = batch.reference(&parameters, true);
        let score_weights = noise(seed + 4, scores.as_ref().map_or(0, |_| images * SCORES), 30.0);
        let shape = logits.dims().to_vec();
        let weights_tensor = Tensor::from_slice(&weights, shape, &Device::Cpu).unwrap();
        let weights_tensor = weights_tensor.to_dtype(DType::F64).unwrap();
        let mut loss = (&logits * weights_tensor).unwrap().sum_all().unwrap();
        if let Some(scores) = &scores {
            let weights = Tensor::from_slice(&score_weights, (images, SCORES), &Device::Cpu);
            let weights = weights.unwrap().to_dtype(DType::F64).unwrap();
            let of_scores = (scores * weights).unwrap().sum_all().unwrap();
            loss = (loss + of_scores).unwrap();
        }
        let gradients = loss.backward().unwrap();
        let expected = flat(&logits);
        for &isa in Isa::available() {
            let mut network = Training::with_isa(architecture, size, isa).unwrap();
            let logits = network.forward(&parameters, &batch.inputs, None).to_vec();
            prop_assert!(farthest(&logits, &expected) <= 2e-3 * largest(&expected), "{isa:?}");
            let mut gradient = vec![0.0; parameters.values().len()];
            network.backward(&parameters, (&weights, &score_weights), &mut gradient);
            let whole = norm(&gradient);
            for (start, var) in reference.trained() {
                let expected = flat(gradients.get(var).unwrap());
                let ours = &gradient[start..start + expected.len()];
                let off: Vec<f32> = ours.iter().zip(&expected).map(|(a, b)| a - b).collect();
                let most = 1e-3 * norm(&expected) + 1e-4 * whole;
                prop_assert!(norm(&off) <= most, "{isa:?} at {start}: {} > {most}", norm(&off));
            }
        }
    }
}

/// Parameters whose normalisations shift each channel well to one side of its activation's kink, so
/// that rounding does not decide which slope counts; both slopes occur. Where a residual is added, the
/// shift takes its side, so that the two never cancel out.
fn decided(architecture: Architecture, seed: u64) -> Parameters {
    const SHIFT: f32 = 30.0;
    let mut parameters = varied(architecture, seed);
    let graph = Graph::new(architecture, (8, 8));
    let mut sides: Vec<Vec<f32>> = graph
        .buffers
        .iter()
        .map(|extent| vec![0.0; extent.channels])
        .collect();
    for (index, op) in graph.ops.iter().enumerate() {
        match op {
            Op::Norm(norm) => {
                let chance = noise(seed + 100 + index as u64, norm.channels, 1.0);
                for (channel, chance) in chance.into_iter().enumerate() {
                    let residual = norm.residual.map_or(0.0, |buffer| sides[buffer][channel]);
                    let is_plain = norm.activation == Activation::Identity;
                    let side = match residual {
                        0.0 if is_plain || chance > -0.2 => 1.0,
                        0.0 => -1.0,
                        residual => residual,
                    };
                    parameters.values_mut()[norm.scale + norm.channels + channel] = SHIFT * side;
                    let is_cut = norm.activation == Activation::Relu && side < 0.0;
                    sides[norm.y][channel] = if is_cut { 0.0 } else { side };
                }
            }
            Op::Pool { x, y } | Op::Upsample { x, y } | Op::Add { b: x, y, .. } => {
                let from = sides[*x].clone();
                sides[*y][..from.len()].copy_from_slice(&from);
            }
            _ => {}
        }
    }
    parameters
}

fn norm(values: &[f32]) -> f32 {
    values.iter().map(|value| value * value).sum::<f32>().sqrt()
}

fn weighted_sum(logits: &[f32], weights: &[f32]) -> f64 {
    let products = logits.iter().zip(weights);
    products.map(|(&a, &b)| f64::from(a) * f64::from(b)).sum()
}

#[test]
fn every_parameter_tensor_has_the_gradient_of_finite_differences() {
    for architecture in Architecture::ALL {
        gradients_are_finite_differences(architecture);
    }
}

fn gradients_are_finite_differences(architecture: Architecture) {
    const STEP: f32 = 2e-3;
    let (size, images) = ((32, 24), 3);
    let parameters = decided(architecture, 5);
    let dropout = Some(Dropout { seed: 1, pass: 2 });
    let input = Batch::new(architecture, size, (images, 6)).inputs;
    let weights = noise(7, images * size.0 * size.1, 1.0);
    let mut network = Training::new(architecture, size).unwrap();
    let score_weights = noise(8, images * network.scores_len(), 30.0);
    let mut gradient = vec![0.0; parameters.values().len()];
    network.forward(&parameters, &input, dropout);
    network.backward(&parameters, (&weights, &score_weights), &mut gradient);
    let graph = Graph::new(architecture, (8, 8));
    for tensor in graph
        .tensors
        .iter()
        .filter(|tensor| tensor.kind.is_trained())
    {
        let range = tensor.start..tensor.start + tensor.len();
        let ours = &gradient[range.clone()];
        let random = noise(tensor.start as u64, tensor.len(), 1.0);
        let (size, random_size) = (norm(ours).max(1e-6), norm(&random));
        let direction: Vec<f32> = ours
            .iter()
            .zip(&random)
            .map(|(g, r)| g / size + r / random_size)
            .collect();
        let mut loss_at = |step: f32| {
            let mut moved = parameters.clone();
            for (value, along) in moved.values_mut()[range.clone()].iter_mut().zip(&direction) {
                *value += step * along;
            }
            let of_logits = weighted_sum(network.forward(&moved, &input, dropout), &weights);
            of_logits + weighted_sum(&network.scores(), &score_weights)
        };
        let slope = (loss_at(STEP) - loss_at(-STEP)) / f64::from(2.0 * STEP);
        let expected = weighted_sum(ours, &direction);
        let most = 0.02 * f64::from(size) + 1e-4 * f64::from(norm(&gradient));
        assert!(
            (slope - expected).abs() <= most,
            "{}: {slope} by differences, {expected} by the backward pass",
            tensor.name
        );
    }
}

#[test]
fn dropout_is_a_function_of_seed_and_pass_and_leaves_the_mean() {
    let (architecture, size) = (Architecture::EnetShared, (16, 16));
    let parameters = varied(architecture, 1);
    let input = Batch::new(architecture, size, (4, 2)).inputs;
    let mut network = Training::new(architecture, size).unwrap();
    let mut with = |seed, pass| {
        let dropout = Some(Dropout { seed, pass });
        network.forward(&parameters, &input, dropout).to_vec()
    };
    let first = with(1, 1);
    assert_ne!(first, with(1, 2));
    assert_ne!(first, with(2, 1));
    assert_eq!(first, with(1, 1));
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let (architecture, size) = (Architecture::EnetShared, (24, 16));
    let parameters = varied(architecture, 4);
    let input = Batch::new(architecture, size, (5, 5)).inputs;
    let weights = noise(6, 5 * size.0 * size.1, 1.0);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let mut network = Training::new(architecture, size).unwrap();
            let mut gradient = vec![0.0; parameters.values().len()];
            let logits = network.forward(&parameters, &input, None).to_vec();
            let scores = vec![1.0; network.scores().len()];
            network.backward(&parameters, (&weights, &scores), &mut gradient);
            (logits, gradient)
        })
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn running_statistics_approach_those_of_the_batches() {
    for architecture in Architecture::ALL {
        let size = (64, 48);
        let mut parameters = varied(architecture, 8);
        let input = Batch::new(architecture, size, (4, 9)).inputs;
        let mut network = Training::new(architecture, size).unwrap();
        let trained = network.forward(&parameters, &input, None).to_vec();
        for _ in 0..100 {
            network.forward(&parameters, &input, None);
            network.update_running(&mut parameters);
        }
        let image = &input[..network.input_len()];
        let (logits, _) = infer(Isa::detect(), size, &parameters, image);
        let most = 1e-2 * largest(&trained);
        let off = farthest(&logits, &trained[..size.0 * size.1]);
        assert!(off <= most, "{architecture:?}: {off} > {most}");
    }
}
