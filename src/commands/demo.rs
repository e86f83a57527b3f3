//! `swath demo`: every node as a process of its own, on loopback, from samples to a report.

mod children;
mod feed;

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use anyhow::Context;
use swath_bridge::msg::swath::{PlanReport, TrainStatus};
use swath_bridge::{Session, keys};
use tokio::time::{Instant, sleep_until};

use self::children::{Child, Launcher};
use super::plan::node::describe;
use crate::cli::{DemoOptions, NetworkOptions};
use crate::config::Config;
use crate::output::{self, Failure};
use crate::runtime::{on_session, stop_signal};

/// Generators of a demo.
const GENERATORS: usize = 2;
/// Messages that may wait to be shown.
const QUEUE: usize = 32;
/// Time between two lines that say how things stand.
const STATUS_PERIOD: Duration = Duration::from_secs(5);

/// Time for a frame of the paper's planner, which gets two grids a second.
const GUIDED_DEADLINE_MS: &str = "400";

/// Runs the command.
pub(crate) fn run(
    options: &DemoOptions,
    config_file: Option<&Path>,
    config: &Config,
) -> Result<(), Failure> {
    let out = &options.out;
    std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    let recording = out.join("run.mcap");
    // A namespace of its own keeps a demo apart from whatever else runs on this machine.
    let namespace = format!("demo-{}", std::process::id());
    let launcher = Launcher::new(out, &namespace, config_file)?;
    let feed = feed::Feed::open(&options.log, config)?;
    let nodes = node_arguments(options, &recording);
    let network = NetworkOptions {
        namespace: Some(namespace),
        ..NetworkOptions::default()
    };
    let seconds = Duration::from_secs(options.seconds);
    on_session(&network, async |session| {
        let mut children = Vec::new();
        for (name, arguments) in nodes {
            children.push(launcher.start(name, arguments)?);
        }
        let ended = watch(&session, feed, &mut children, seconds).await;
        // Senders stop before the recorder, so that it has everything.
        for child in children {
            child.stop().await?;
        }
        ended
    })?;
    finish(out, &recording)
}

/// The nodes and their arguments, in the order in which they are stopped.
fn node_arguments(options: &DemoOptions, recording: &Path) -> Vec<(String, Vec<String>)> {
    let logs = || {
        let logs = options.log.iter();
        logs.flat_map(|log| ["--log".to_owned(), log.display().to_string()])
    };
    let words = |words: &[&str]| {
        words
            .iter()
            .map(|&word| word.to_owned())
            .collect::<Vec<_>>()
    };
    let mut nodes = Vec::new();
    for index in 0..GENERATORS {
        let id = format!("generator-{index}");
        let mut arguments = words(&["generate", "--id", &id, "--workers", "1"]);
        arguments.extend(logs());
        nodes.push((id, arguments));
    }
    let train = options.out.join("train").display().to_string();
    nodes.push((
        "planner".to_owned(),
        words(&["plan", "--vehicle", feed::VEHICLE]),
    ));
    nodes.push((
        "planner-fcn".to_owned(),
        words(&[
            "plan",
            "--vehicle",
            feed::GUIDED,
            "--method",
            "tiev-fcn",
            "--deadline-ms",
            GUIDED_DEADLINE_MS,
        ]),
    ));
    nodes.push((
        "trainer".to_owned(),
        words(&[
            "train",
            "--out",
            &train,
            "--size",
            "half",
            "--batch",
            "8",
            "--publish-every",
            "20",
        ]),
    ));
    let recording = recording.display().to_string();
    nodes.push((
        "recorder".to_owned(),
        words(&["bridge", "record", "--out", &recording]),
    ));
    nodes
}

/// Feeds the planner and says how things stand until the time is over.
async fn watch(
    session: &Session,
    feed: feed::Feed,
    children: &mut [Child],
    length: Duration,
) -> anyhow::Result<()> {
    let mut plans = session.subscriber(&keys::plan("*"), QUEUE).await?;
    let mut statuses = session.subscriber(&keys::train_status("*"), QUEUE).await?;
    let feeding = tokio::spawn(feed::run(session.clone(), feed));
    let end = Instant::now() + length;
    let mut shown = tokio::time::interval(STATUS_PERIOD);
    let mut newest: BTreeMap<String, PlanReport> = BTreeMap::new();
    let mut status: Option<TrainStatus> = None;
    loop {
        tokio::select! {
            () = sleep_until(end) => break,
            () = stop_signal() => break,
            Some(received) = plans.recv() => {
                let plan = received.message;
                newest.insert(plan.vehicle.clone(), plan);
            }
            Some(received) = statuses.recv() => status = Some(received.message),
            _ = shown.tick() => {
                for child in children.iter_mut() {
                    child.check()?;
                }
                say(end, &newest, status.as_ref())?;
            }
        }
    }
    feeding.abort();
    Ok(())
}

fn say(
    end: Instant,
    newest: &BTreeMap<String, PlanReport>,
    status: Option<&TrainStatus>,
) -> anyhow::Result<()> {
    let left = end.saturating_duration_since(Instant::now()).as_secs();
    let training = status.map_or_else(
        || "trainer starts".to_owned(),
        |status| {
            format!(
                "{} samples received, step {}, loss {:.3}, mIoU {:.3}, weights v{}",
                status.received, status.step, status.loss, status.miou, status.weights_version
            )
        },
    );
    let plans = newest.values();
    let plans = plans.map(|plan| format!("frame {}: {}", plan.frame, describe(plan)));
    let planning = if newest.is_empty() {
        "planners start".to_owned()
    } else {
        plans.collect::<Vec<_>>().join(" | ")
    };
    output::line(format_args!("[{left:>4} s left] {training} | {planning}"))
}

/// Makes the report and says where to look.
fn finish(out: &Path, recording: &Path) -> Result<(), Failure> {
    let report = out.join("report");
    let summary = super::report::write(&[recording.to_owned()], &report)?;
    output::line("")?;
    for line in summary.lines() {
        output::line(line)?;
    }
    output::line("")?;
    let newest = out.join("train").join("weights.safetensors");
    for (what, path) in [
        ("report", report.join("report.md")),
        ("recording", recording.to_owned()),
        ("newest weights", newest),
        ("what each node said", out.join("logs")),
    ] {
        let state = if path.exists() { "" } else { " (not written)" };
        output::line(format_args!("{what:>20}: {}{state}", path.display()))?;
    }
    Ok(())
}
