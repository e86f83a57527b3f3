//! Long training with generator and trainer as processes: a trainer that is killed at any moment goes
//! on from its last checkpoint, no file is ever broken, and memory does not grow.
//!
//! `SWATH_SOAK_S` lengthens the part that watches memory, in seconds.

#![expect(
    clippy::unwrap_used,
    clippy::print_stderr,
    reason = "helpers of tests, and what a soak measured"
)]

use std::path::Path;
use std::time::{Duration, Instant};

use nodes::{Node, System};
use soak::NOISE;
use swath_bridge::msg::swath::{TrainStatus, Weights};
use swath_bridge::{Session, Subscriber, clock, keys};
use swath_planner::network::Network;
use swath_trainer::{CHECKPOINT_FILE, Checkpoint, WEIGHTS_FILE};

mod nodes;
mod soak;

/// Longer than anything but the soak takes, so that a test that would hang fails.
const PATIENCE: Duration = Duration::from_mins(20);
/// Longest time without a step.
const STANDSTILL: Duration = Duration::from_mins(5);
/// Rounds of killing.
const KILLS: u64 = 6;
/// Steps from one checkpoint to the next.
const PUBLISH_EVERY: u64 = 2;
/// Samples that the trainer keeps: so few that the buffer is full before memory is watched.
const KEPT: &str = "200";

/// Starts the trainer, or goes on with what it left.
fn train(system: &System, out: &Path) -> Node {
    let publish_every = PUBLISH_EVERY.to_string();
    let out = out.to_str().unwrap();
    system.start(&[
        "train",
        "--scratch",
        "--batch",
        "4",
        "--keep",
        KEPT,
        "--publish-every",
        &publish_every,
        "--out",
        out,
    ])
}

/// The next step of a trainer that was started at a time; what one before it sent may come later.
async fn next_step(status: &mut Subscriber<TrainStatus>, started_nanos: u64) -> u64 {
    loop {
        let status = status.recv().await.unwrap().message;
        if status.header.stamp.nanos() >= started_nanos {
            return status.step;
        }
    }
}

/// Kills the trainer at moments that have nothing to do with what it does.
async fn kill_again_and_again(session: &Session, system: &System, out: &Path) {
    let mut status = session
        .subscriber(&keys::train_status("*"), 64)
        .await
        .unwrap();
    let mut weights: Subscriber<Weights> =
        session.subscriber(&keys::weights("*"), 64).await.unwrap();
    let mut newest = 0;
    for round in 0..KILLS {
        let started_nanos = clock::now_nanos();
        let mut trainer = train(system, out);
        let mut seen = next_step(&mut status, started_nanos).await;
        assert!(seen >= newest, "went back from step {newest} to {seen}");
        let enough = seen + PUBLISH_EVERY + 1;
        while seen < enough {
            seen = next_step(&mut status, started_nanos).await;
        }
        tokio::time::sleep(Duration::from_millis(37 * round)).await;
        trainer.0.kill().unwrap();
        trainer.0.wait().unwrap();
        let checkpoint = Checkpoint::load(&out.join(CHECKPOINT_FILE)).unwrap();
        newest = checkpoint.progress.step;
        assert!(
            newest + PUBLISH_EVERY >= seen,
            "step {newest} is kept, {seen} were taken"
        );
        Network::load(&std::fs::read(out.join(WEIGHTS_FILE)).unwrap()).unwrap();
    }
    let mut last = 0;
    while let Some(published) = weights.try_recv() {
        // A version that was published but not kept before a kill comes again, an older one never.
        let version = published.message.version;
        assert!(version >= last, "version {version} after {last}");
        Network::load(&published.message.safetensors).unwrap();
        last = version;
    }
    assert!(last >= KILLS);
}

async fn memory_stays_flat(session: &Session, nodes: &[(&str, &Node)], length: Duration) {
    let mut status = session
        .subscriber(&keys::train_status("*"), 64)
        .await
        .unwrap();
    let kept: u32 = KEPT.parse().unwrap();
    while status.recv().await.unwrap().message.buffered < kept {}
    let mut peaks = vec![[0_u64; 3]; nodes.len()];
    for third in 0..3 {
        let end = Instant::now() + length / 3;
        while Instant::now() < end {
            for (peaks, (_, node)) in peaks.iter_mut().zip(nodes) {
                peaks[third] = peaks[third].max(soak::memory_bytes(node));
            }
            let next = tokio::time::timeout(STANDSTILL, status.recv()).await;
            assert!(
                next.is_ok_and(|status| status.is_some()),
                "training stands still"
            );
        }
    }
    for ((name, _), peaks) in nodes.iter().zip(peaks) {
        eprintln!(
            "{name}: at most {:?} MiB in each third",
            peaks.map(|bytes| bytes >> 20)
        );
        assert!(peaks[2] <= peaks[1] + NOISE, "{name} grew: {peaks:?}");
    }
}

async fn all(folder: &Path, length: Duration) {
    let out = folder.join("run");
    let system = System::new(folder, "");
    let session = system.session().await;
    let generator = system.start(&["generate", "--workers", "1"]);
    kill_again_and_again(&session, &system, &out).await;
    let trainer = train(&system, &out);
    let nodes = [("generator", &generator), ("trainer", &trainer)];
    memory_stays_flat(&session, &nodes, length).await;
    for node in [trainer, generator] {
        assert!(node.stop().success());
    }
}

#[test]
fn a_trainer_survives_being_killed_and_memory_stays_flat() {
    let length = soak::length();
    let folder = tempfile::tempdir().unwrap();
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let ended = runtime.block_on(async {
        tokio::time::timeout(PATIENCE + length, all(folder.path(), length)).await
    });
    assert!(ended.is_ok(), "not done within {PATIENCE:?} and the soak");
}
