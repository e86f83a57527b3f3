//! Data sets: recordings of samples that depend on the seed alone.

#![expect(clippy::unwrap_used, reason = "helpers of tests")]

use std::path::Path;
use std::sync::Arc;

use swath_bridge::msg::swath::Sample;
use swath_bridge::recording::{Reader, Writer};
use swath_bridge::{Outcome, cdr};
use swath_generator::{Generator, GeneratorConfig, Run, Scenes, Written, write_dataset};
use swath_planner::search::SearchMemory;

fn generator() -> Arc<Generator> {
    Arc::new(Generator::new(GeneratorConfig::default(), Scenes::Procedural).unwrap())
}

fn write(path: &Path, seed: u64, count: u64) -> (Written, Vec<(u64, u64)>) {
    let mut progress = Vec::new();
    let run = Run {
        seed,
        first: 0,
        count: Some(count),
    };
    let writer = Writer::create(path).unwrap();
    let written = write_dataset(&generator(), run, writer, &mut |done, of| {
        progress.push((done, of));
    })
    .unwrap();
    (written, progress)
}

#[test]
fn the_same_seed_gives_the_same_file_and_another_seed_another() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name);
    write(&path("a.mcap"), 3, 12);
    write(&path("b.mcap"), 3, 12);
    write(&path("c.mcap"), 4, 12);
    let bytes = |name: &str| std::fs::read(path(name)).unwrap();
    assert!(bytes("a.mcap") == bytes("b.mcap"));
    assert!(bytes("a.mcap") != bytes("c.mcap"));
}

#[test]
fn a_data_set_holds_every_sample_in_order_and_counts_the_outcomes() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("samples.mcap");
    let (written, progress) = write(&path, 5, 15);
    let samples: Vec<Sample> = Reader::open(&path)
        .unwrap()
        .map(|message| message.unwrap().decode().unwrap())
        .collect();
    let (generator, mut memory) = (generator(), SearchMemory::new());
    assert_eq!(samples.len(), 15);
    for (index, sample) in (0..).zip(&samples) {
        let again = generator.sample(5, index, &mut memory).unwrap();
        assert!(cdr::to_vec(sample).unwrap() == cdr::to_vec(&again).unwrap());
        assert_eq!((sample.index, sample.sequence), (index, index));
        assert_eq!(sample.generator, "seed-5");
    }
    let solved = Outcome::Solved.code();
    let expected = samples.iter().filter(|sample| sample.outcome == solved);
    assert_eq!(written.with(Outcome::Solved), expected.count() as u64);
    assert_eq!((written.samples, progress.last()), (15, Some(&(15, 15))));
}
