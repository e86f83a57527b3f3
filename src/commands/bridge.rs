//! `swath bridge`: recordings and logs.

use std::path::Path;
use std::time::Duration;

use anyhow::Context;
use indicatif::ProgressBar;
use swath_bridge::WeightsStore;
use swath_bridge::ingest::{Progress, write_grids};
use swath_bridge::recording::{self, RecordOptions, Recorder};

use crate::cli::{BridgeCommand, GridsOptions, NetworkOptions, ReplayOptions};
use crate::config::Config;
use crate::output::{self, Failure};
use crate::progress;
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
        BridgeCommand::Record { out, seconds } => record(out, *seconds, network),
        BridgeCommand::Replay(options) => replay(options, network),
        BridgeCommand::Grids(options) => grids(options, config),
        BridgeCommand::Pictures(options) => pictures::run(options, config),
        BridgeCommand::Info { file, json } => info(file, *json),
        BridgeCommand::Recover { file, out } => recover(file, out),
    }
}

fn record(out: &Path, seconds: Option<u64>, network: &NetworkOptions) -> Result<(), Failure> {
    let bar = progress::spinner("recorder");
    let options = RecordOptions {
        path: out.to_owned(),
        keys: Vec::new(),
    };
    let counts = with_session(network, async |session| {
        let recorder = Recorder::start(&session, &options).await?;
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
                let counts = recorder.counts();
                bar.set_position(counts.written);
                bar.set_message(format!("messages, {} MB", counts.written_bytes / 1_000_000));
            }
        };
        tokio::select! {
            () = stop_signal() => (),
            () = end => (),
            () = watch => (),
        }
        Ok(recorder.finish().await?)
    })?;
    bar.finish_and_clear();
    output::line(format_args!(
        "{} messages ({} MB) written to {}",
        counts.written,
        counts.written_bytes / 1_000_000,
        out.display()
    ))?;
    let lost = counts.dropped + counts.missed;
    if lost > 0 {
        return Err(Failure::DataLost(format!(
            "{} messages came while the queue was full, {} never came",
            counts.dropped, counts.missed
        )));
    }
    Ok(())
}

fn replay(options: &ReplayOptions, network: &NetworkOptions) -> Result<(), Failure> {
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
    let mut ingest = config.ingest();
    ingest.points_topic.clone_from(&options.points);
    ingest.scan_topic.clone_from(&options.scan);
    ingest.odom_topic.clone_from(&options.odom);
    ingest.vehicle_id.clone_from(&options.vehicle);
    let bar = progress::bar(0, "grids");
    let pictures = options.pictures.as_deref();
    let mut on_progress = |progress: Progress| show(&bar, progress.sweeps, progress.of_sweeps);
    let report = write_grids(
        &options.log,
        &options.out,
        pictures,
        &ingest,
        &mut on_progress,
    )?;
    bar.finish_and_clear();
    output::line(format_args!(
        "{} grids of {} sweeps on {} with {} written to {}",
        report.frames,
        report.sweeps,
        report.sensor_topic,
        report.odom_topic,
        options.out.display()
    ))?;
    if report.bad_messages > 0 || report.without_pose > 0 {
        output::line(format_args!(
            "not used: {} sweeps without a pose, {} messages that did not decode",
            report.without_pose, report.bad_messages
        ))?;
    }
    Ok(())
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

fn recover(file: &Path, out: &Path) -> Result<(), Failure> {
    let bar = progress::bar(0, "recovering");
    let report = recording::recover(file, out, &mut |done, total| show(&bar, done, total))
        .with_context(|| format!("{} was not recovered", file.display()))?;
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
    if report.bytes_lost > 0 || report.messages_lost > 0 {
        return Err(Failure::DataLost(format!("{} was damaged", file.display())));
    }
    Ok(())
}
