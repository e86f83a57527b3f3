//! Recordings with known numbers, written message by message.

use std::path::{Path, PathBuf};

use swath_bridge::Outcome;
use swath_bridge::keys;
use swath_bridge::msg::header::Header;
use swath_bridge::msg::swath::{
    Evaluation, PlanReport, PlanarPose, Sample, TargetPlan, TrainStatus, Weights,
};
use swath_bridge::recording::Writer;

/// When everything begins: a second is added for each step of a recording.
pub(crate) const START_NANOS: u64 = 1_700_000_000_000_000_000;

/// Nanoseconds since the epoch, some milliseconds after the start.
pub(crate) fn after_ms(ms: u64) -> u64 {
    START_NANOS + ms * 1_000_000
}

/// A goal for each index, and what became of it.
pub(crate) fn target(
    index: u8,
    outcome: Outcome,
    (cost, steps, time_ms): (f64, u64, f32),
) -> TargetPlan {
    let solved = outcome == Outcome::Solved;
    TargetPlan {
        goal: PlanarPose {
            x_m: f32::from(index),
            y_m: 0.0,
            yaw_rad: 0.0,
        },
        status: outcome.code(),
        cost: if solved { cost } else { f64::NAN },
        bound: f32::NAN,
        length_m: if solved { cost } else { f64::NAN },
        steps,
        time_ms,
        drivability: 0,
        path: Vec::new(),
        curvature_per_m: Vec::new(),
    }
}

/// A plan of a benchmark: no latency, no weights.
pub(crate) fn plan(
    frame: u64,
    method: &str,
    search_ms: f32,
    targets: Vec<TargetPlan>,
) -> PlanReport {
    PlanReport {
        header: Header::at(after_ms(frame * 1000), "base_link"),
        vehicle: "bench".to_owned(),
        frame,
        method: method.to_owned(),
        scene: "road".to_owned(),
        speed_m_per_s: 1.5,
        weights_run: String::new(),
        weights_version: 0,
        weights_age_s: f32::NAN,
        consulted: "without".to_owned(),
        network_ms: if method == "tiev" { 0.0 } else { 2.0 },
        search_ms,
        cpu_ms: 2.0 * search_ms,
        total_ms: search_ms + 2.0,
        smooth_ms: 0.0,
        deadline_ms: 0.0,
        latency_ms: 0.0,
        grids_skipped: 0,
        start: PlanarPose {
            x_m: 0.0,
            y_m: 0.0,
            yaw_rad: 0.0,
        },
        chosen: -1,
        targets,
        reason: String::new(),
        detail: String::new(),
        rejected: Vec::new(),
    }
}

/// A sample of a generator; every third one has no path.
pub(crate) fn sample(generator: &str, sequence: u64) -> Sample {
    let outcome = if sequence % 3 == 2 {
        Outcome::Unreachable
    } else {
        Outcome::Solved
    };
    Sample {
        header: Header::at(sequence, "base_link"),
        generator: generator.to_owned(),
        sequence,
        seed: 7,
        index: sequence,
        scene: if sequence.is_multiple_of(2) {
            "road"
        } else {
            "parking"
        }
        .to_owned(),
        scene_id: sequence / 4,
        speed_m_per_s: 1.5,
        goal: PlanarPose {
            x_m: 10.0,
            y_m: 0.0,
            yaw_rad: 0.0,
        },
        outcome: outcome.code(),
        rows: 2,
        cols: 4,
        resolution_m: 0.2,
        ego_row: 1,
        ego_col: 2,
        obstacles: vec![0],
        reference: vec![0],
        target: vec![0],
        label: vec![0],
        path: Vec::new(),
        cost: 10.0,
        steps: 100,
    }
}

/// Weights of run `r1`.
pub(crate) fn weights(version: u64) -> Weights {
    Weights {
        header: Header::at(after_ms(version * 1000), ""),
        run: "r1".to_owned(),
        version,
        step: version * 10,
        epoch: version,
        architecture: "enet".to_owned(),
        input_rows: 408,
        input_cols: 152,
        vehicle: "v".to_owned(),
        loss: 0.5,
        miou: 0.75,
        iou_path: 0.6,
        iou_background: 0.9,
        digest: [0; 32],
        public_key: vec![0; 32],
        signature: vec![0; 64],
        safetensors: vec![1, 2, 3],
    }
}

/// The status of run `r1` at a step.
pub(crate) fn status(step: u16) -> TrainStatus {
    TrainStatus {
        header: Header::at(after_ms(u64::from(step) * 100), ""),
        run: "r1".to_owned(),
        step: u64::from(step),
        epoch: 1,
        epochs: 2,
        samples: u64::from(step) * 4,
        samples_per_s: 20.0,
        received: 40,
        gaps: 3,
        duplicates: 1,
        rejected: 2,
        buffered: 9,
        learning_rate: 5e-4,
        loss: 1.0 / f32::from(step),
        miou: if step == 20 { 0.8 } else { f32::NAN },
        weights_version: 1,
        eta_s: f32::NAN,
    }
}

/// An evaluation on the split `test`: intersection and union of the path, then of the background.
pub(crate) fn evaluation(predictor: &str, version: u64, cells: [u64; 4]) -> Evaluation {
    Evaluation {
        header: Header::at(after_ms(version * 1000 + cells[0]), ""),
        run: if version == 0 { "" } else { "r1" }.to_owned(),
        weights_version: version,
        predictor: predictor.to_owned(),
        split: "test".to_owned(),
        group: String::new(),
        dilation_m: 1.4,
        samples: 10,
        intersection_path: cells[0],
        union_path: cells[1],
        intersection_background: cells[2],
        union_background: cells[3],
        joined: 9,
        ms_per_sample: 4.0,
    }
}

/// A file of a directory that messages are written into.
pub(crate) fn write(directory: &Path, name: &str, fill: impl FnOnce(&mut Writer)) -> PathBuf {
    let path = directory.join(name);
    let mut writer = Writer::create(&path).unwrap();
    fill(&mut writer);
    writer.finish().unwrap();
    path
}

fn write_plan(writer: &mut Writer, plan: &PlanReport) {
    let nanos = plan.header.stamp.nanos();
    writer
        .write(&keys::plan(&plan.vehicle), plan, nanos, nanos)
        .unwrap();
}

/// Plans of both methods to one target on four frames, the last of which has none that can be
/// reached; to three targets on one frame; and plans that are no pairs.
pub(crate) fn bench(writer: &mut Writer) {
    let one = |outcome, steps| vec![target(1, outcome, (10.0, steps, 1.0))];
    let solved = |steps| one(Outcome::Solved, steps);
    write_plan(writer, &plan(0, "tiev", 10.0, solved(100)));
    write_plan(writer, &plan(0, "tiev-fcn", 5.0, solved(50)));
    write_plan(writer, &plan(1, "tiev", 20.0, solved(200)));
    write_plan(writer, &plan(1, "tiev-fcn", 4.0, solved(100)));
    write_plan(writer, &plan(2, "tiev-fcn", 15.0, solved(60)));
    write_plan(writer, &plan(2, "tiev", 30.0, solved(300)));
    let unreachable = |steps| one(Outcome::Unreachable, steps);
    write_plan(writer, &plan(3, "tiev", 40.0, unreachable(400)));
    write_plan(writer, &plan(3, "tiev-fcn", 100.0, unreachable(800)));
    let three = |cost: f64, outcomes: [Outcome; 3]| {
        let targets = (1..).zip(outcomes);
        targets
            .map(|(index, outcome)| target(index, outcome, (cost, 10, 2.0)))
            .collect()
    };
    let [solved, missed] = [Outcome::Solved, Outcome::BudgetExhausted];
    write_plan(
        writer,
        &plan(0, "tiev", 60.0, three(10.0, [solved, solved, missed])),
    );
    write_plan(
        writer,
        &plan(0, "tiev-fcn", 30.0, three(12.0, [solved, solved, solved])),
    );
    // Alone on its frame, and on a frame of the other method but with another goal.
    write_plan(writer, &plan(4, "tiev", 1000.0, one(Outcome::Solved, 9)));
    write_plan(writer, &plan(5, "tiev", 1000.0, one(Outcome::Solved, 9)));
    let elsewhere = vec![target(2, Outcome::Solved, (10.0, 9, 1.0))];
    write_plan(writer, &plan(5, "tiev-fcn", 1000.0, elsewhere));
}

/// A live run: two generators, a trainer, evaluations, two versions of weights and ten plans.
pub(crate) fn run(writer: &mut Writer) {
    // g0 sends 0 to 20 at ten a second, but for 5 and 6, and 7 twice; g1 sends 100 to 110 at five.
    let sequences = (0..=20).filter(|number| ![5, 6].contains(number));
    for number in sequences.chain([7]) {
        let log = after_ms(number * 100);
        writer
            .write(&keys::sample("g0"), &sample("g0", number), log, log)
            .unwrap();
    }
    for number in 100..=110 {
        let log = after_ms((number - 100) * 200);
        writer
            .write(&keys::sample("g1"), &sample("g1", number), log, log)
            .unwrap();
    }
    for step in [10, 20, 30] {
        let log = after_ms(u64::from(step) * 100);
        writer
            .write(&keys::train_status("r1"), &status(step), log, log)
            .unwrap();
    }
    for version in 1..=3 {
        let log = after_ms(version * 1000);
        writer
            .write(&keys::weights("r1"), &weights(version), log, log)
            .unwrap();
    }
    let evaluations = [
        evaluation("enet", 1, [1, 10, 9, 10]),
        evaluation("enet", 2, [30, 40, 90, 100]),
        // The same again, as when weights are evaluated twice, and another part of the same split.
        Evaluation {
            header: Header::at(after_ms(9000), ""),
            ..evaluation("enet", 2, [30, 40, 90, 100])
        },
        evaluation("enet", 2, [50, 60, 90, 100]),
        evaluation("dilated reference", 0, [20, 80, 50, 100]),
        Evaluation {
            group: "scene/clutter".to_owned(),
            ..evaluation("enet", 2, [31, 60, 90, 100])
        },
        Evaluation {
            group: "distance/10-20 m".to_owned(),
            ..evaluation("enet", 2, [32, 40, 90, 100])
        },
        Evaluation {
            group: "distance/44 m on".to_owned(),
            ..evaluation("enet", 2, [33, 60, 90, 100])
        },
    ];
    for message in &evaluations {
        let log = after_ms(4000);
        writer
            .write(&keys::evaluation("r1"), message, log, log)
            .unwrap();
    }
    live_plans(writer);
    writer
        .write_raw(
            &keys::topic_of_key(keys::plan("v0").key()),
            "swath_msgs/msg/PlanReport",
            &[0, 1, 0, 0, 9, 9],
            swath_bridge::recording::Stamps {
                log_nanos: after_ms(5000),
                publish_nanos: after_ms(5000),
            },
        )
        .unwrap();
}

/// Ten plans of `v0`: two without weights, four with version 1, four with version 2.
fn live_plans(writer: &mut Writer) {
    for number in 0..10u8 {
        let version = u64::from(number + 2) / 4;
        let outcome = if number == 9 {
            Outcome::GoalOccupied
        } else {
            Outcome::Solved
        };
        let method = if version == 0 { "tiev" } else { "tiev-fcn" };
        let targets = vec![target(number, outcome, (5.0, 10, 1.0))];
        let report = PlanReport {
            vehicle: "v0".to_owned(),
            frame: u64::from(number) + 1,
            reason: if number == 9 { "blocked" } else { "no time" }.to_owned(),
            scene: String::new(),
            weights_run: if version == 0 { "" } else { "r1" }.to_owned(),
            weights_version: version,
            weights_age_s: if version == 0 {
                f32::NAN
            } else {
                f32::from(number)
            },
            latency_ms: 10.0 + f32::from(number),
            // The planner's own count, which began anew when it was restarted after six plans.
            grids_skipped: u64::from(if number < 6 { number / 2 } else { number - 6 }),
            ..plan(u64::from(number), method, 3.0, targets)
        };
        let log = after_ms(2000 + u64::from(number) * 100);
        writer.write(&keys::plan("v0"), &report, log, log).unwrap();
    }
}
