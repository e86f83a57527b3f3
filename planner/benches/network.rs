//! How long predictions and training steps take, beside the plain model on candle.
//!
//! `cargo bench -p swath-planner --bench network`

use std::hint::black_box;
use std::time::Duration;

use candle_core::{DType, Device, Tensor};
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use swath_bridge::Pose2;
use swath_planner::Plane;
use swath_planner::network::{
    Architecture, Dropout, INPUT_PLANES, InputSize, Network, NetworkInfo, Parameters, Reference,
    Surroundings, Training,
};

const SIZES: [InputSize; 2] = [InputSize::Half, InputSize::Full];

fn info(architecture: Architecture, size: InputSize) -> NetworkInfo {
    NetworkInfo {
        architecture,
        size,
        ..NetworkInfo::default()
    }
}

fn plane(info: &NetworkInfo) -> Plane {
    let mut plane = Plane::empty(info.spec.rows, info.spec.cols);
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
    for (architecture, size) in variants() {
        let info = info(architecture, size);
        let name = format!("{}_{}", architecture.name(), size.name());
        let network = Network::new(info.clone(), &Parameters::initial(architecture, 1));
        let plane = plane(&info);
        let surroundings = Surroundings {
            obstacles: &plane,
            reference: &plane,
            speed_m_per_s: 1.4,
        };
        for count in [1, 10, 50] {
            let goals = vec![Pose2::new(30.0, 3.0, 0.1); count];
            group.bench_function(BenchmarkId::new(&name, count), |bencher| {
                bencher.iter(|| black_box(network.predict(&surroundings, &goals)));
            });
        }
        if architecture == Architecture::Enet {
            let (rows, cols) = info.encoding().input_size();
            let parameters = Parameters::initial(architecture, 1);
            let reference = Reference::new(&parameters, &Device::Cpu, DType::F32);
            let input = Tensor::ones((1, INPUT_PLANES, rows, cols), DType::F32, &Device::Cpu);
            if let (Ok(reference), Ok(input)) = (reference, input) {
                group.bench_function(BenchmarkId::new(&name, "candle_1"), |bencher| {
                    bencher.iter(|| black_box(reference.forward(&input, None, false)));
                });
            }
        }
    }
    group.finish();
}

fn variants() -> impl Iterator<Item = (Architecture, InputSize)> {
    let architectures = Architecture::ALL.into_iter();
    architectures.flat_map(|architecture| SIZES.map(|size| (architecture, size)))
}

fn training_steps(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("training_step");
    group
        .sample_size(10)
        .measurement_time(Duration::from_secs(5));
    for (architecture, size) in variants() {
        let parameters = Parameters::initial(architecture, 1);
        let input_size = info(architecture, size).encoding().input_size();
        let Some(mut training) = Training::new(architecture, input_size) else {
            continue;
        };
        let name = format!("{}_{}", architecture.name(), size.name());
        let mut gradient = vec![0.0; parameters.values().len()];
        for batch in [8, 16] {
            let input = vec![0.5; batch * training.input_len()];
            let slope = vec![1e-6; batch * training.output_len()];
            let scores = vec![1e-3; batch * training.scores_len()];
            let dropout = Some(Dropout { seed: 1, pass: 1 });
            group.bench_function(BenchmarkId::new(&name, batch), |bencher| {
                bencher.iter(|| {
                    training.forward(&parameters, &input, dropout);
                    training.backward(&parameters, (&slope, &scores), &mut gradient);
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, predictions, training_steps);
criterion_main!(benches);
