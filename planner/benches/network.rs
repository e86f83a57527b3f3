//! How long predictions and training steps take, beside the plain model on candle.
//!
//! `cargo bench -p swath-planner --bench network`

use std::hint::black_box;
use std::time::Duration;

use candle_core::{DType, Device, Tensor};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use swath_planner::Plane;
use swath_planner::network::{
    Dropout, INPUT_PLANES, InputSize, Network, NetworkInfo, Parameters, Reference, Training,
};

const SIZES: [InputSize; 2] = [InputSize::Half, InputSize::Full];

fn info(size: InputSize) -> NetworkInfo {
    NetworkInfo {
        size,
        ..NetworkInfo::default()
    }
}

fn plane(info: &NetworkInfo) -> Plane {
    let mut plane = Plane::empty(info.rows, info.cols);
    (0..plane.len())
        .step_by(13)
        .for_each(|index| plane.set_index(index));
    plane
}

fn predictions(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("predict");
    group
        .sample_size(10)
        .measurement_time(Duration::from_secs(3));
    for size in SIZES {
        let info = info(size);
        let network = Network::new(info.clone(), &Parameters::initial(1));
        let plane = plane(&info);
        for count in [1, 10, 50] {
            let targets = vec![plane.clone(); count];
            group.bench_function(BenchmarkId::new(size.name(), count), |bencher| {
                bencher.iter(|| black_box(network.predict(&plane, &plane, &targets)));
            });
        }
        let (rows, cols) = info.encoding().input_size();
        let reference = Reference::new(&Parameters::initial(1), &Device::Cpu, DType::F32);
        let input = Tensor::ones((1, INPUT_PLANES, rows, cols), DType::F32, &Device::Cpu);
        if let (Ok(reference), Ok(input)) = (reference, input) {
            group.bench_function(BenchmarkId::new(size.name(), "candle_1"), |bencher| {
                bencher.iter(|| black_box(reference.forward(&input, false)));
            });
        }
    }
    group.finish();
}

fn training_steps(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("training_step");
    group
        .sample_size(10)
        .measurement_time(Duration::from_secs(5));
    let parameters = Parameters::initial(1);
    for size in SIZES {
        let (rows, cols) = info(size).encoding().input_size();
        let Some(mut training) = Training::new(rows, cols) else {
            continue;
        };
        let mut gradient = vec![0.0; parameters.values().len()];
        for batch in [8, 16] {
            let input = vec![0.5; batch * training.input_len()];
            let slope = vec![1e-6; batch * training.output_len()];
            let dropout = Some(Dropout { seed: 1, pass: 1 });
            group.bench_function(BenchmarkId::new(size.name(), batch), |bencher| {
                bencher.iter(|| {
                    training.forward(&parameters, &input, dropout);
                    training.backward(&parameters, &slope, &mut gradient);
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, predictions, training_steps);
criterion_main!(benches);
