//! `swath demo`: every node as a process of its own, on loopback, from samples to a report.

mod children;
mod feed;
mod verdict;

use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::path::Path;
use std::time::Duration;

use anyhow::Context;
use swath_bridge::msg::swath::{PlanReport, TargetPlan, TrainStatus};
use swath_bridge::recording::{Existing, check_out};
use swath_bridge::{Outcome, Session, keys};
use swath_trainer::WEIGHTS_FILE;
use tokio::time::{Instant, sleep_until};

use self::children::{Child, Launcher};
use crate::cli::{DemoOptions, NetworkOptions, PicturesOptions};
use crate::commands::bridge;
use crate::config::Config;
use crate::output::{self, Failure};
use crate::runtime::{on_session, stop_signal};
use crate::{human, outputs};

/// With fewer processors than this, a demo does less.
const CORES: usize = 4;
/// Folder of the trainer, in that of the demo.
const TRAIN_FOLDER: &str = "train";
/// Messages that may wait to be shown.
const QUEUE: usize = 32;
/// Pictures of each vehicle's drive, and of each generator's samples.
const PICTURES: u64 = 8;
/// Time between two lines that say how things stand.
const STATUS_PERIOD: Duration = Duration::from_secs(5);

/// Time for a frame of the paper's planner, which gets two grids a second at most.
const GUIDED_DEADLINE_MS: &str = "400";

/// How much a demo does at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Pace {
    generators: usize,
    grids_per_s: u32,
}

impl Pace {
    /// What a machine of so many processors can do beside training.
    const fn on(cores: usize) -> Self {
        if cores < CORES {
            Self {
                generators: 1,
                grids_per_s: 5,
            }
        } else {
            Self {
                generators: 2,
                grids_per_s: 10,
            }
        }
    }

    fn grid_period(self) -> Duration {
        Duration::from_secs(1) / self.grids_per_s
    }
}

/// Runs the command.
pub(crate) fn run(
    options: &DemoOptions,
    config_file: Option<&Path>,
    config: &Config,
) -> Result<(), Failure> {
    let out = &options.out;
    outputs::test_folder(out)?;
    std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    let _claim = claim(out)?;
    let recording = out.join("run.mcap");
    check_out(&recording, Existing::of_force(options.force))?;
    // A namespace of its own keeps a demo apart from whatever else runs on this machine.
    let namespace = format!("demo-{}", std::process::id());
    let launcher = Launcher::new(out, &namespace, config_file)?;
    let feed = feed::Feed::open(&options.log, options.ingest.apply(config.ingest()), config)?;
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let pace = Pace::on(cores);
    output::line(format_args!(
        "{cores} processors: {} generator(s), {} grids a second",
        pace.generators, pace.grids_per_s
    ))?;
    let nodes = nodes(options, pace, &recording);
    let network = NetworkOptions {
        namespace: Some(namespace),
        ..NetworkOptions::default()
    };
    let seconds = Duration::from_secs(options.seconds);
    on_session(&network, async |session| {
        let mut children = Vec::new();
        for node in nodes {
            children.push(launcher.start(node.name, node.arguments, node.is_background)?);
        }
        let feeding = tokio::spawn(feed::run(session.clone(), feed, pace.grid_period()));
        let ended = watch(&session, &mut children, seconds).await;
        feeding.abort();
        // Senders stop before the recorder, so that it has everything.
        for child in children {
            child.stop().await?;
        }
        ended
    })?;
    finish(out, &recording, config)
}

/// Keeps other demos out of the directory for as long as the file is open.
fn claim(out: &Path) -> anyhow::Result<File> {
    let directory = File::open(out).with_context(|| out.display().to_string())?;
    if matches!(directory.try_lock(), Err(TryLockError::WouldBlock)) {
        anyhow::bail!(
            "{}: another demo is running there: give another --out",
            out.display()
        );
    }
    Ok(directory)
}

/// A node of the demo and how it is started.
struct NodeStart {
    name: String,
    arguments: Vec<String>,
    /// Whether it leaves the processors to those that work in real time.
    is_background: bool,
}

impl NodeStart {
    fn new(name: &str, arguments: &[&str]) -> Self {
        Self {
            name: name.to_owned(),
            arguments: arguments.iter().map(|&word| word.to_owned()).collect(),
            is_background: false,
        }
    }

    fn in_background(self) -> Self {
        Self {
            is_background: true,
            ..self
        }
    }
}

/// The nodes, in the order in which they are stopped: senders before the recorder, so that it has
/// everything.
fn nodes(options: &DemoOptions, pace: Pace, recording: &Path) -> Vec<NodeStart> {
    let mut nodes = Vec::new();
    for index in 0..pace.generators {
        let id = format!("generator-{index}");
        let mut node = NodeStart::new(&id, &["generate", "--id", &id, "--workers", "1"]);
        for log in &options.log {
            let log = log.display().to_string();
            node.arguments.extend(["--log".to_owned(), log]);
        }
        if !options.log.is_empty() {
            node.arguments.extend(options.ingest.arguments());
        }
        nodes.push(node.in_background());
    }
    let train = options.out.join(TRAIN_FOLDER).display().to_string();
    let recording = recording.display().to_string();
    let vehicle = ["plan", "--vehicle", feed::VEHICLE];
    let guided = ["plan", "--vehicle", feed::GUIDED];
    let in_regions = ["--method", "tiev-fcn", "--deadline-ms", GUIDED_DEADLINE_MS];
    let trainer = [
        &["train", "--out", &train, "--size", "half", "--batch", "8"][..],
        &["--publish-every", "20"],
    ];
    let mut recorder = vec!["bridge", "record", "--out", &recording];
    recorder.extend(options.force.then_some("--force"));
    nodes.extend([
        NodeStart::new("planner", &vehicle),
        NodeStart::new("planner-fcn", &[&guided[..], &in_regions].concat()),
        NodeStart::new("trainer", &trainer.concat()).in_background(),
        NodeStart::new("recorder", &recorder),
    ]);
    nodes
}

/// Says how things stand until the time is over.
async fn watch(session: &Session, children: &mut [Child], length: Duration) -> anyhow::Result<()> {
    let mut plans = session.subscriber(&keys::plan("*"), QUEUE).await?;
    let mut statuses = session.subscriber(&keys::train_status("*"), QUEUE).await?;
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
                say(end, &newest, status.as_ref());
            }
        }
    }
    Ok(())
}

/// Says how things stand, a line for the trainer and one for each planner.
fn say(end: Instant, newest: &BTreeMap<String, PlanReport>, status: Option<&TrainStatus>) {
    let left = end.saturating_duration_since(Instant::now());
    let left = human::duration(left);
    let training = status.map_or_else(|| "waits for samples".to_owned(), training);
    output::note(format_args!("[{left:>6} left] trainer: {training}"));
    if newest.is_empty() {
        output::note(format_args!("[{left:>6} left] planners: wait for grids"));
    }
    for plan in newest.values() {
        output::note(format_args!("[{left:>6} left] {}", planned(plan)));
    }
}

/// A trainer's status in a line.
fn training(status: &TrainStatus) -> String {
    format!(
        "{} samples, step {}, loss {}, mIoU {}, weights version {}",
        human::count(status.received),
        status.step,
        human::decimal(status.loss.into(), 3),
        human::percent(status.miou.into(), 1),
        status.weights_version
    )
}

/// A planned frame in a line.
fn planned(plan: &PlanReport) -> String {
    let is_solved = |target: &&TargetPlan| target.status == Outcome::Solved.code();
    let path = match plan.chosen {
        -1 => "no path: stop".to_owned(),
        number => format!("path to target {number}"),
    };
    format!(
        "planner {}: frame {}, {} of {} targets solved, {path}, {} ms",
        plan.vehicle,
        plan.frame,
        plan.targets.iter().filter(is_solved).count(),
        plan.targets.len(),
        human::decimal((plan.total_ms + plan.smooth_ms).into(), 0)
    )
}

/// Makes the report and the pictures, says how it went and where to look.
fn finish(out: &Path, recording: &Path, config: &Config) -> Result<(), Failure> {
    let report = out.join("report");
    let summary = super::report::write(&[recording.to_owned()], &report)?;
    output::line("")?;
    for line in summary.lines().into_iter().chain(verdict::lines(&summary)) {
        output::line(line)?;
    }
    let pictures = out.join("pictures");
    let of_drive = PicturesOptions {
        file: recording.to_owned(),
        out: pictures.clone(),
        every: None,
        count: Some(PICTURES),
    };
    if let Err(error) = bridge::pictures::draw(&of_drive, config) {
        tracing::warn!("no pictures of the drive: {error:#}");
    }
    output::line("")?;
    for (what, path) in [
        ("report", report.join("report.md")),
        ("pictures", pictures),
        ("recording", recording.to_owned()),
        ("newest weights", out.join(TRAIN_FOLDER).join(WEIGHTS_FILE)),
        ("what each node said", out.join("logs")),
    ] {
        let state = if path.exists() { "" } else { " (not written)" };
        output::line(format_args!("{what:>20}: {}{state}", path.display()))?;
    }
    Ok(())
}
