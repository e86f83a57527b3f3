//! Samples a second: scenes alone, what a vehicle sees of them, and labelled samples on one core and
//! on all.
//!
//! `cargo bench -p swath-generator`

use std::sync::Arc;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use swath_generator::{Generator, GeneratorConfig, Run, SampleStream, Scene, Scenes};
use swath_planner::search::SearchMemory;

/// Samples of one measurement: every kind of scene with all samples of a target, four times.
const SAMPLES: u64 = 140;

fn generator() -> Arc<Generator> {
    let generator = Generator::new(GeneratorConfig::default(), Scenes::Procedural);
    Arc::new(generator.expect("the default configuration is valid"))
}

fn scenes(criterion: &mut Criterion) {
    let config = GeneratorConfig::default();
    let mut index = 0;
    criterion.bench_function("scene", |bencher| {
        bencher.iter(|| {
            index += 1;
            Scene::procedural(1, index, &config)
        });
    });
    let generator = generator();
    criterion.bench_function("frame", |bencher| {
        bencher.iter(|| {
            index += 1;
            generator.frame(1, index)
        });
    });
}

fn samples(criterion: &mut Criterion) {
    let generator = generator();
    let mut group = criterion.benchmark_group("samples");
    group
        .sample_size(10)
        .throughput(Throughput::Elements(SAMPLES));
    let mut memory = SearchMemory::new();
    group.bench_function("one core", |bencher| {
        bencher.iter(|| {
            for index in 0..SAMPLES {
                let sample = generator.sample(1, index, &mut memory);
                std::hint::black_box(sample.expect("the configuration is valid"));
            }
        });
    });
    group.bench_function("all cores", |bencher| {
        bencher.iter(|| {
            let run = Run {
                seed: 1,
                first: 0,
                count: Some(SAMPLES),
            };
            SampleStream::start(&generator, run, 0)
                .expect("threads can be had")
                .count()
        });
    });
    group.finish();
}

criterion_group!(benches, scenes, samples);
criterion_main!(benches);
