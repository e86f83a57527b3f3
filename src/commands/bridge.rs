//! `swath bridge`: recordings and logs.

use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use anyhow::Context;
use clap::CommandFactory;
use clap::error::ErrorKind;
use indicatif::ProgressBar;
use swath_bridge::WeightsStore;
use swath_bridge::ingest::{GridsOut, IngestReport, Progress, write_grids};
use swath_bridge::recording::{self, Existing, RecordCounts, RecordOptions, Recorder, check_out};

use crate::cli::{BridgeCommand, Cli, GridsOptions, NetworkOptions, ReplayOptions};
use crate::config::Config;
use crate::human;
use crate::output::{self, Failure};
use crate::progress;
use crate::reporter::Reporter;
use crate::runtime::{stop_signal, with_session};

pub(crate) mod pictures;

/// Time between two looks at a recorder.
const LOOK_EVERY: Duration = Duration::from_millis(250);

/// Runs the command.
pub(crate) fn run(
    command: &BridgeCommand,
    network: &NetworkOptions,
    config: &Config,
) -> Result<(), Failure> {
    match command {
        BridgeCommand::Record {
            out,
            seconds,
            force,
        } => record(out, *seconds, *force, network),
        BridgeCommand::Replay(options) => replay(options, network),
        BridgeCommand::Grids(options) => grids(options, config),
        BridgeCommand::Pictures(options) => pictures::run(options, config),
        BridgeCommand::Info { file, json } => info(file, *json),
        BridgeCommand::Recover { file, out, force } => {
            recover(file, out, Existing::of_force(*force))
        }
    }
}

fn record(
    out: &Path,
    seconds: Option<u64>,
    force: bool,
    network: &NetworkOptions,
) -> Result<(), Failure> {
    let existing = Existing::of_force(force);
    check_out(out, existing)?;
    let name = out
        .file_stem()
        .map_or_else(String::new, |stem| stem.to_string_lossy().into());
    let recorded = Arc::new(Mutex::new(RecordCounts::default()));
    let reporter = Reporter::start("recorder", &name, standing(&recorded));
    let options = RecordOptions {
        path: out.to_owned(),
        existing,
        keys: Vec::new(),
    };
    let counts = with_session(network, async |session| {
        let recorder = Recorder::start(&session, &options).await?;
        let _token = session.declare_node("recorder", &key_part(&name)).await?;
        // Late planners get the newest weights from here when their trainer is gone.
        let _store = WeightsStore::open(&session, &out.with_extension("weights"), &[]).await?;
        let end = async {
            match seconds {
                Some(seconds) => tokio::time::sleep(Duration::from_secs(seconds)).await,
                None => std::future::pending().await,
            }
        };
        let watch = async {
            let mut looks = tokio::time::interval(LOOK_EVERY);
            while recorder.is_running() {
                looks.tick().await;
                *recorded.lock().unwrap_or_else(PoisonError::into_inner) = recorder.counts();
            }
        };
        tokio::select! {
            () = stop_signal() => (),
            () = end => (),
            () = watch => (),
        }
        Ok(recorder.finish().await?)
    })?;
    drop(reporter);
    output::note(format_args!(
        "{} messages ({}) written to {}",
        counts.written,
        human::bytes(counts.written_bytes),
        out.display()
    ));
    let lost = counts.dropped + counts.missed;
    if lost > 0 {
        return Err(Failure::DataLost(format!(
            "{} messages came while the queue was full, {} never came",
            counts.dropped, counts.missed
        )));
    }
    Ok(())
}

/// How the recorder does, in a line.
fn standing(recorded: &Arc<Mutex<RecordCounts>>) -> impl FnMut() -> String + Send + 'static {
    let recorded = Arc::clone(recorded);
    move || {
        let counts = *recorded.lock().unwrap_or_else(PoisonError::into_inner);
        let lost = match counts.dropped + counts.missed {
            0 => String::new(),
            lost => format!(", {lost} lost"),
        };
        format!(
            "{} messages recorded, {}{lost}",
            human::count(counts.written),
            human::bytes(counts.written_bytes)
        )
    }
}

/// A name as a part of a key: what a key has its own use for is a dash.
fn key_part(name: &str) -> String {
    let is_plain = |letter: char| letter.is_alphanumeric() || "-_.".contains(letter);
    let plain: String = name
        .chars()
        .map(|letter| if is_plain(letter) { letter } else { '-' })
        .collect();
    if plain.is_empty() {
        "-".to_owned()
    } else {
        plain
    }
}

fn replay(options: &ReplayOptions, network: &NetworkOptions) -> Result<(), Failure> {
    if let (Some(start), Some(end)) = (options.start, options.end)
        && end < start
    {
        let what = format!("--end {end} is before --start {start}\n");
        Cli::command()
            .error(ErrorKind::ValueValidation, what)
            .exit();
    }
    let bar = progress::bar(0, "replay");
    let replayed = recording::ReplayOptions {
        rate: options.rate,
        is_endless: options.repeat,
        start_s: options.start.unwrap_or(0.0),
        end_s: options.end.unwrap_or(f64::INFINITY),
        topics: options.topic.clone(),
        ..recording::ReplayOptions::all_of(&options.file)
    };
    let report = with_session(network, async |session| {
        let mut show = |done, total| show(&bar, done, total);
        tokio::select! {
            report = recording::replay(&session, &replayed, &mut show) => Ok(Some(report?)),
            () = stop_signal() => Ok(None),
        }
    })?;
    bar.finish_and_clear();
    if let Some(report) = report {
        output::line(format_args!(
            "{} messages in {:.1} s; late by {:.2} ms on average, {:.1} ms at most",
            report.messages, report.elapsed_s, report.mean_late_ms, report.worst_late_ms
        ))?;
    }
    Ok(())
}

fn show(bar: &ProgressBar, done: u64, total: u64) {
    bar.set_length(total);
    bar.set_position(done);
}

fn grids(options: &GridsOptions, config: &Config) -> Result<(), Failure> {
    let mut ingest = options.ingest.apply(config.ingest());
    ingest.vehicle_id.clone_from(&options.vehicle);
    let bar = progress::bar(0, "grids");
    let mut on_progress = |progress: Progress| show(&bar, progress.sweeps, progress.of_sweeps);
    let out = GridsOut {
        recording: &options.out,
        existing: Existing::of_force(options.force),
        pictures: options.pictures.as_deref(),
    };
    let report = write_grids(&options.log, &out, &ingest, &mut on_progress)?;
    bar.finish_and_clear();
    output::line(format_args!(
        "{} grids of {} sweeps on {} with {} written to {}",
        report.frames,
        report.sweeps,
        sensors_of(&report),
        report.odom_topic,
        options.out.display()
    ))?;
    if report.sensors.len() > 1 {
        for sensor in &report.sensors {
            output::line(format_args!(
                "  {}: {} sweeps, {} of them without a pose",
                sensor.topic, sensor.sweeps, sensor.without_pose
            ))?;
        }
    }
    if report.bad_messages > 0 || report.without_pose > 0 {
        output::line(format_args!(
            "not used: {} sweeps without a pose, {} messages that did not decode",
            report.without_pose, report.bad_messages
        ))?;
    }
    Ok(())
}

/// The topics of the sensors, in a line.
fn sensors_of(report: &IngestReport) -> String {
    let topics = report.sensors.iter().map(|sensor| sensor.topic.as_str());
    topics.collect::<Vec<_>>().join(", ")
}

fn info(file: &Path, json: bool) -> Result<(), Failure> {
    let bar = progress::bar(0, "reading");
    let info = recording::info(file, &mut |done, total| show(&bar, done, total))?;
    bar.finish_and_clear();
    if json {
        output::json(&info)?;
    } else {
        output::line(&info)?;
    }
    Ok(())
}

fn recover(file: &Path, out: &Path, existing: Existing) -> Result<(), Failure> {
    let bar = progress::bar(0, "recovering");
    let report = recording::recover(file, out, existing, &mut |done, total| {
        show(&bar, done, total);
    })
    .context("nothing was recovered")?;
    bar.finish_and_clear();
    for damage in &report.damage {
        output::line(format_args!("damage: {damage}"))?;
    }
    output::line(format_args!(
        "{} messages saved to {}; lost: {} messages, {} of {} bytes",
        report.messages,
        out.display(),
        report.messages_lost,
        report.bytes_lost,
        report.bytes
    ))?;
    if report.has_no_end {
        return Err(Failure::DataLost(format!(
            "{} has no end: what its writer had not written is lost",
            file.display()
        )));
    }
    if report.bytes_lost > 0 || report.messages_lost > 0 {
        return Err(Failure::DataLost(format!("{} was damaged", file.display())));
    }
    Ok(())
}
