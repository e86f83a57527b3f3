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

/// Most time for one target's search when nobody says: a live grid is soon out of date.
const TIME_LIMIT_MS: u64 = 100;

/// Plans on live grids until stopped.
pub(super) fn run(
    options: &PlanOptions,
    network: &NetworkOptions,
    config: &Config,
) -> Result<(), Failure> {
    let initial = network_of(options, config)?.map(|network| ServedNetwork {
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
            bar.inc(1);
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
    Ok(())
}

fn node_config(options: &PlanOptions, config: &Config) -> NodeConfig {
    let mut plan = config.plan;
    plan.speed_m_per_s = options.speed.unwrap_or(plan.speed_m_per_s);
    let configured = Some(plan.time_limit_ms).filter(|&limit_ms| limit_ms > 0);
    plan.time_limit_ms = options
        .time_limit_ms
        .or(configured)
        .unwrap_or(TIME_LIMIT_MS);
    NodeConfig {
        vehicle_id: options.vehicle.clone(),
        vehicle: config.vehicle,
        grid: config.grid,
        obstacles: config.obstacles,
        targets: config.targets,
        plan,
        method: options.method,
        run: "*".to_owned(),
        trusted: Vec::new(),
    }
}

/// One line about a planned frame.
pub(crate) fn describe(report: &PlanReport) -> String {
    let solved = report
        .targets
        .iter()
        .filter(|target| target.status == Outcome::Solved.code());
    let weights = match report.weights_version {
        0 => String::new(),
        version => format!(", weights {} v{version}", report.weights_run),
    };
    format!(
        "{}: {} of {} targets, network {:.0} ms, search {:.0} ms{weights}",
        report.method,
        solved.count(),
        report.targets.len(),
        report.network_ms,
        report.search_ms,
    )
}
