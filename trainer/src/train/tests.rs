//! Training learns, and goes on after an interruption as if there had been none.

use super::*;
use crate::example::tests::{examples, examples_on, finer_spec, small_spec};
use crate::source::{Recorded, Source};
use crate::{
    BEST_FILE, CHECKPOINT_FILE, Observer, Run, ScoreReport, Summary, Unobserved, Validation,
    WEIGHTS_FILE,
};
use swath_planner::network::InputSize;

fn config() -> TrainConfig {
    TrainConfig {
        epochs: 4,
        batch: 4,
        micro_batch: 2,
        ..TrainConfig::default()
    }
}

fn learner(config: &TrainConfig) -> Learner {
    let info = network_info(config, &small_spec(), &Vehicle::default());
    Learner::new(config.clone(), info).unwrap()
}

fn run(learner: &mut Learner, directory: Option<&Path>, observer: &mut dyn Observer) -> Summary {
    let mut source = Recorded::new(examples(8), learner.config.seed, learner.config.mirror);
    let run = Run {
        source: &mut source,
        validation: &[],
        miner: None,
        directory: directory.map(Path::to_owned),
    };
    run.train(learner, observer).unwrap()
}

/// Stops before a step.
struct StopAt(u64, u64);

impl Observer for StopAt {
    fn should_stop(&mut self) -> bool {
        self.0 += 1;
        self.0 > self.1
    }
}

#[test]
fn a_training_that_was_stopped_and_resumed_equals_an_unbroken_one_bit_for_bit() {
    let mut unbroken = learner(&config());
    assert!(run(&mut unbroken, None, &mut Unobserved).complete);
    let directory = tempfile::tempdir().unwrap();
    let mut broken = learner(&config());
    // In the middle of the second epoch of two steps each.
    assert!(!run(&mut broken, Some(directory.path()), &mut StopAt(0, 3)).complete);
    drop(broken);
    let path = directory.path().join(CHECKPOINT_FILE);
    let checkpoint = Checkpoint::load(&path).unwrap();
    let info = network_info(&config(), &small_spec(), &Vehicle::default());
    let mut resumed = Learner::resume(checkpoint, &path, &config(), info).unwrap();
    assert_eq!(resumed.progress().step, 3);
    assert!(run(&mut resumed, Some(directory.path()), &mut Unobserved).complete);
    assert!(resumed.checkpoint() == unbroken.checkpoint());
    assert!(resumed.weights() == unbroken.weights());
}

/// Copies the checkpoint of an epoch away, as it would be found after a kill in a later one.
struct Killed<'a> {
    after_epoch: u64,
    directory: &'a Path,
}

impl Observer for Killed<'_> {
    fn scored(&mut self, report: &ScoreReport) {
        if report.epoch == self.after_epoch {
            let found = self.directory.join("found");
            std::fs::copy(self.directory.join(CHECKPOINT_FILE), found).unwrap();
        }
    }
}

#[test]
fn a_training_that_was_killed_goes_on_from_the_last_epoch_as_if_it_had_not_been() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path();
    let mut unbroken = learner(&config());
    let mut killed = Killed {
        after_epoch: 3,
        directory,
    };
    run(&mut unbroken, Some(directory), &mut killed);
    let path = directory.join("found");
    let info = unbroken.info().clone();
    let found = Checkpoint::load(&path).unwrap();
    let mut resumed = Learner::resume(found, &path, &config(), info).unwrap();
    assert_eq!(resumed.progress().step, 6);
    run(&mut resumed, None, &mut Unobserved);
    assert!(resumed.checkpoint() == unbroken.checkpoint());
}

#[test]
fn a_checkpoint_of_other_settings_or_other_data_is_refused() {
    let mut first = learner(&config());
    run(&mut first, None, &mut StopAt(0, 2));
    let info = first.info().clone();
    let other = TrainConfig {
        base_rate: 1e-3,
        ..config()
    };
    let path = Path::new("runs/checkpoint");
    let error = Learner::resume(first.checkpoint(), path, &other, info.clone()).unwrap_err();
    assert!(error.to_string().contains("runs/checkpoint"));
    let mut resumed = Learner::resume(first.checkpoint(), path, &config(), info).unwrap();
    let mut source = Recorded::new(examples(16), 1, true);
    let run = Run {
        source: &mut source,
        validation: &[],
        miner: None,
        directory: None,
    };
    let error = run.train(&mut resumed, &mut Unobserved).unwrap_err();
    assert!(error.to_string().contains("steps"), "{error}");
}

#[test]
fn parts_of_a_batch_add_up_to_its_gradient() {
    // Without normalisation over different parts there is no equality, so all samples are the same.
    let same = vec![examples(1).remove(0); 4];
    let train = |micro_batch: usize| {
        let config = TrainConfig {
            micro_batch,
            dropout: false,
            mirror: false,
            epochs: 1,
            ..config()
        };
        let mut learner = learner(&config);
        let mut source = Recorded::new(same.clone(), 1, false);
        let batch = learner.preparation().batch(&source.draw(0, 4)).unwrap();
        learner.step(&batch, 1e-3).unwrap();
        learner.memory.gradient
    };
    let (whole, parts) = (train(4), train(2));
    let norm = |values: &[f32]| values.iter().map(|value| value * value).sum::<f32>().sqrt();
    let off: Vec<f32> = whole.iter().zip(&parts).map(|(a, b)| a - b).collect();
    assert!(
        norm(&off) < 1e-2 * norm(&whole),
        "{} of {}",
        norm(&off),
        norm(&whole)
    );
}

#[test]
fn a_run_leaves_its_newest_and_its_best_weights_in_a_directory_of_its_own() {
    let directory = tempfile::tempdir().unwrap();
    let directory = directory.path().join("runs/first");
    let mut learner = learner(&config());
    let mut source = Recorded::new(examples(8), 1, true);
    let run = Run {
        source: &mut source,
        validation: &[Validation {
            name: "few".to_owned(),
            examples: examples(3),
        }],
        miner: None,
        directory: Some(directory.clone()),
    };
    let summary = run.train(&mut learner, &mut Unobserved).unwrap();
    let miou = summary.validation[0].1.scores.total.miou();
    assert!(learner.progress().best_miou.unwrap() >= miou);
    assert!(std::fs::read(directory.join(WEIGHTS_FILE)).unwrap() == learner.weights());
    let best = std::fs::read(directory.join(BEST_FILE)).unwrap();
    Network::load(&best).unwrap();
}

fn overfits(size: InputSize, spec: GridSpec) {
    let config = TrainConfig {
        size,
        epochs: 130,
        batch: 6,
        micro_batch: 6,
        base_rate: 5e-3,
        dropout: false,
        mirror: false,
        ..TrainConfig::default()
    };
    let info = network_info(&config, &spec, &Vehicle::default());
    let mut learner = Learner::new(config, info).unwrap();
    let few = examples_on(spec, 6);
    let mut source = Recorded::new(few.clone(), 1, false);
    let run = Run {
        source: &mut source,
        validation: &[],
        miner: None,
        directory: None,
    };
    run.train(&mut learner, &mut Unobserved).unwrap();
    let report = score(&learner, &few).unwrap().unwrap();
    let total = report.scores.total;
    assert!(total.miou() > 0.97, "mIoU {}", total.miou());
}

#[test]
fn a_few_samples_are_learnt_by_heart_at_full_size() {
    overfits(InputSize::Full, small_spec());
}

#[test]
fn a_few_samples_are_learnt_by_heart_at_half_size() {
    overfits(InputSize::Half, finer_spec());
}

#[test]
fn a_loss_that_is_no_number_stops_the_training_and_leaves_the_parameters() {
    let mut learner = learner(&config());
    let mut broken = learner.parameters.clone();
    broken.values_mut()[0] = f32::NAN;
    learner.start_from(broken);
    let before = format!("{:?}", learner.parameters.values()[1]);
    let shown = Recorded::new(examples(4), 1, false).draw(0, 4);
    let batch = learner.preparation().batch(&shown).unwrap();
    assert!(matches!(
        learner.step(&batch, 1e-3),
        Err(Error::Diverged { .. })
    ));
    assert_eq!(format!("{:?}", learner.parameters.values()[1]), before);
}

#[test]
fn a_run_ends_when_the_scores_have_not_improved_for_long() {
    let config = TrainConfig {
        epochs: 1000,
        base_rate: 1e-9,
        score_every_steps: 1,
        patience: 3,
        ..config()
    };
    let mut learner = learner(&config);
    let mut source = Recorded::new(examples(8), 1, true);
    let run = Run {
        source: &mut source,
        validation: &[Validation {
            name: "few".to_owned(),
            examples: examples(3),
        }],
        miner: None,
        directory: None,
    };
    assert!(run.train(&mut learner, &mut Unobserved).unwrap().complete);
    assert!(learner.progress().since_best == 3);
    assert!(learner.progress().step < 2000);
}
