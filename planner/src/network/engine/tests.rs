//! The fast path against candle's own operations and against finite differences.

use candle_core::{DType, Device, Tensor};
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::{Dropout, Inference, Isa, Training, Workspace};
use crate::network::graph::INPUT_PLANES;
use crate::network::{Parameters, Reference};

fn noise(seed: u64, len: usize, scale: f32) -> Vec<f32> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    (0..len)
        .map(|_| scale * ((random.next_u32() >> 8) as f32 / (1 << 23) as f32 - 1.0))
        .collect()
}

/// Parameters in which nothing is at its neutral initial value.
fn varied(seed: u64) -> Parameters {
    let mut parameters = Parameters::initial(seed);
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

/// batch × 3 × rows × cols from channels innermost.
fn planes_first(input: &[f32], rows: usize, cols: usize) -> Tensor {
    let batch = input.len() / (rows * cols * INPUT_PLANES);
    Tensor::from_slice(input, (batch, rows, cols, INPUT_PLANES), &Device::Cpu)
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

fn infer(isa: Isa, size: (usize, usize), parameters: &Parameters, image: &[f32]) -> Vec<f32> {
    let network = Inference::new(isa, size, parameters);
    let mut workspace = Workspace::default();
    network
        .run(&mut workspace, |input| input.copy_from_slice(image))
        .to_vec()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn inference_agrees_with_plain_candle_on_every_processor_path(
        rows in 1usize..8, cols in 1usize..6, seed in 0u64..1000,
    ) {
        let (rows, cols) = (rows * 8, cols * 8);
        let parameters = varied(seed);
        let image = noise(seed + 2, rows * cols * INPUT_PLANES, 1.0);
        let reference = Reference::new(&parameters, &Device::Cpu, DType::F64).unwrap();
        let expected = flat(&reference.forward(&planes_first(&image, rows, cols), false).unwrap());
        for &isa in Isa::available() {
            let logits = infer(isa, (rows, cols), &parameters, &image);
            prop_assert!(farthest(&logits, &expected) <= 1e-4 * largest(&expected), "{:?}", isa);
        }
    }

    #[test]
    fn the_training_pass_and_its_gradients_agree_with_plain_candle(
        rows in 3usize..6, cols in 3usize..5, batch in 2usize..8, seed in 0u64..1000,
    ) {
        let (rows, cols) = (rows * 8, cols * 8);
        let parameters = decided(seed);
        let input = noise(seed + 2, batch * rows * cols * INPUT_PLANES, 1.0);
        let weights = noise(seed + 3, batch * rows * cols, 1.0);
        let reference = Reference::new(&parameters, &Device::Cpu, DType::F64).unwrap();
        let logits = reference.forward(&planes_first(&input, rows, cols), true).unwrap();
        let shape = logits.dims().to_vec();
        let weights_tensor = Tensor::from_slice(&weights, shape, &Device::Cpu).unwrap();
        let weights_tensor = weights_tensor.to_dtype(DType::F64).unwrap();
        let loss = (&logits * weights_tensor).unwrap().sum_all().unwrap();
        let gradients = loss.backward().unwrap();
        let expected = flat(&logits);
        for &isa in Isa::available() {
            let mut network = Training::with_isa(rows, cols, isa).unwrap();
            let logits = network.forward(&parameters, &input, None).to_vec();
            prop_assert!(farthest(&logits, &expected) <= 2e-3 * largest(&expected), "{isa:?}");
            let mut gradient = vec![0.0; parameters.values().len()];
            network.backward(&parameters, &weights, &mut gradient);
            let whole = norm(&gradient);
            for (start, var) in reference.trained() {
                let expected = flat(gradients.get(var).unwrap());
                let ours = &gradient[start..start + expected.len()];
                let off: Vec<f32> = ours.iter().zip(&expected).map(|(a, b)| a - b).collect();
                let most = 1e-2 * norm(&expected) + 1e-3 * whole;
                prop_assert!(norm(&off) <= most, "{isa:?} at {start}: {} > {most}", norm(&off));
            }
        }
    }
}

/// Parameters whose normalisations shift each channel well to one side of its activation's kink, so
/// that rounding does not decide which slope counts; both slopes occur.
fn decided(seed: u64) -> Parameters {
    let mut parameters = varied(seed);
    let shifts: Vec<usize> = crate::network::graph::Graph::enet(8, 8)
        .tensors
        .iter()
        .filter(|tensor| tensor.name.ends_with("norm.bias"))
        .flat_map(|tensor| tensor.start..tensor.start + tensor.len())
        .collect();
    let sides = noise(seed + 9, shifts.len(), 1.0);
    for (shift, side) in shifts.into_iter().zip(sides) {
        parameters.values_mut()[shift] = if side > -0.2 { 30.0 } else { -30.0 };
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
    const STEP: f32 = 2e-3;
    let (rows, cols, batch) = (32, 24, 3);
    let parameters = decided(5);
    let dropout = Some(Dropout { seed: 1, pass: 2 });
    let input = noise(6, batch * rows * cols * INPUT_PLANES, 1.0);
    let weights = noise(7, batch * rows * cols, 1.0);
    let mut network = Training::new(rows, cols).unwrap();
    let mut gradient = vec![0.0; parameters.values().len()];
    network.forward(&parameters, &input, dropout);
    network.backward(&parameters, &weights, &mut gradient);
    let graph = crate::network::graph::Graph::enet(8, 8);
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
            weighted_sum(network.forward(&moved, &input, dropout), &weights)
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
    let (rows, cols) = (16, 16);
    let parameters = varied(1);
    let input = noise(2, 4 * rows * cols * INPUT_PLANES, 1.0);
    let mut network = Training::new(rows, cols).unwrap();
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
    let (rows, cols) = (24, 16);
    let parameters = varied(4);
    let input = noise(5, 5 * rows * cols * INPUT_PLANES, 1.0);
    let weights = noise(6, 5 * rows * cols, 1.0);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let mut network = Training::new(rows, cols).unwrap();
            let mut gradient = vec![0.0; parameters.values().len()];
            let logits = network.forward(&parameters, &input, None).to_vec();
            network.backward(&parameters, &weights, &mut gradient);
            (logits, gradient)
        })
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn running_statistics_approach_those_of_the_batches() {
    let (rows, cols) = (64, 48);
    let mut parameters = varied(8);
    let input = noise(9, 4 * rows * cols * INPUT_PLANES, 1.0);
    let mut network = Training::new(rows, cols).unwrap();
    let trained = network.forward(&parameters, &input, None).to_vec();
    for _ in 0..100 {
        network.forward(&parameters, &input, None);
        network.update_running(&mut parameters);
    }
    let image = rows * cols;
    let logits = infer(
        Isa::detect(),
        (rows, cols),
        &parameters,
        &input[..image * INPUT_PLANES],
    );
    let most = 1e-2 * largest(&trained);
    let off = farthest(&logits, &trained[..image]);
    assert!(off <= most, "{off} > {most}");
}
