//! `swath plan` as a node.

use anyhow::Context;
use swath_bridge::Outcome;
use swath_bridge::msg::swath::PlanReport;
use swath_planner::node::{self, NodeConfig, ServedNetwork};

use super::network_of;
use crate::cli::{NetworkOptions, PlanOptions};
use crate::config::Config;
use crate::output::Failure;
use crate::progress;
use crate::runtime::{stop_signal, with_session};

/// Most time for a frame when nobody says: a live grid is soon out of date.
const DEADLINE_MS: u64 = 100;

/// Plans on live grids until stopped.
pub(super) fn run(
    options: &PlanOptions,
    network: &NetworkOptions,
    config: &Config,
) -> Result<(), Failure> {
    let network_used = network_of(options, config)?;
    // One that was asked for by name is not put aside in silence.
    if let (Some(path), Some(network)) = (&options.weights, &network_used) {
        let wanted = network.info().spec;
        if wanted != config.grid {
            return Err(anyhow::Error::new(swath_planner::Error::GridMismatch {
                got: config.grid,
                wanted,
            })
            .context(path.display().to_string())
            .into());
        }
    }
    let initial = network_used.map(|network| ServedNetwork {
        network,
        run: String::new(),
        version: 0,
        stamp_nanos: 0,
    });
    let node_config = node_config(options, config);
    let bar = progress::spinner("planner");
    bar.set_message(format!("waits for grids of {}", options.vehicle));
    let summary = with_session(network, async |session| {
        let observe = |report: &PlanReport| {
            bar.inc(u64::from(report.frame > 0));
            bar.set_message(describe(report));
        };
        node::run(&session, node_config, initial, stop_signal(), observe)
            .await
            .context("planner node")
    })?;
    bar.finish_and_clear();
    tracing::info!(
        "planned {} frames, used {} versions of weights, rejected {} messages",
        summary.frames,
        summary.weights,
        summary.rejected
    );
    for rejection in &summary.rejections {
        tracing::info!(
            "not used: {} messages on {}: {}",
            rejection.messages,
            rejection.topic,
            rejection.cause
        );
    }
    Ok(())
}

fn node_config(options: &PlanOptions, config: &Config) -> NodeConfig {
    let mut plan = options.plan_config(config);
    if options.deadline_ms.is_none() && plan.frame_deadline_ms == 0 {
        plan.frame_deadline_ms = DEADLINE_MS;
    }
    NodeConfig {
        vehicle_id: options.vehicle.clone(),
        vehicle: config.vehicle,
        grid: config.grid,
        obstacles: config.obstacles,
        targets: config.targets,
        plan,
        follow: config.follow,
        frames: config.frames.clone(),
        run: "*".to_owned(),
        trusted: Vec::new(),
    }
}

/// One line about a planned frame, or why there is none.
pub(crate) fn describe(report: &PlanReport) -> String {
    if report.frame == 0 {
        return format!("stop: {}", why(report));
    }
    let solved = report
        .targets
        .iter()
        .filter(|target| target.status == Outcome::Solved.code());
    let weights = match report.weights_version {
        0 => String::new(),
        version => format!(", weights {} v{version}", report.weights_run),
    };
    format!(
        "{}: {} of {} targets, {}, network {:.0} ms, search {:.0} ms{weights}",
        report.method,
        solved.count(),
        report.targets.len(),
        match report.chosen {
            -1 => format!("stop: {}", report.reason),
            number => format!("to number {number}"),
        },
        report.network_ms,
        report.search_ms,
    )
}

/// Why a path is empty, with the evidence.
fn why(report: &PlanReport) -> String {
    if report.detail.is_empty() {
        return report.reason.clone();
    }
    format!("{}: {}", report.reason, report.detail)
}
