//! `swath plan` as a node.

use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Context, anyhow};
use swath_bridge::msg::swath::PlanReport;
use swath_bridge::{Error as BridgeError, Outcome};
use swath_planner::Error;
use swath_planner::node::{self, NodeConfig, ServedNetwork};

use super::network_of;
use crate::cli::{NetworkOptions, PlanOptions};
use crate::config::Config;
use crate::human;
use crate::output::Failure;
use crate::reporter::{Pace, Reporter};
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
            return Err(anyhow::Error::new(Error::GridMismatch {
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
    let tally = Arc::new(Mutex::new(Tally::default()));
    let reporter = Reporter::start("planner", &options.vehicle, standing(options, &tally));
    let summary = with_session(network, async |session| {
        let observe = |report: &PlanReport| {
            tracing::debug!("{}", describe(report));
            tally
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .add(report);
        };
        let run = node::run(&session, node_config, initial, stop_signal(), observe);
        Box::pin(run).await.map_err(advised).context("planner node")
    })?;
    drop(reporter);
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
        shares_vehicle: options.share_vehicle,
    }
}

/// What became of the frames so far.
#[derive(Debug, Default)]
struct Tally {
    planned: u64,
    stopped: u64,
    /// Why the path is empty now; empty while there is one.
    reason: String,
}

impl Tally {
    fn add(&mut self, report: &PlanReport) {
        self.reason.clone_from(&report.reason);
        // A report without a frame says why there is none.
        if report.frame > 0 {
            self.planned += 1;
            self.stopped += u64::from(report.chosen < 0);
        }
    }
}

/// How the planner does, in a line.
fn standing(
    options: &PlanOptions,
    tally: &Arc<Mutex<Tally>>,
) -> impl FnMut() -> String + Send + 'static {
    let (tally, mut pace) = (Arc::clone(tally), Pace::new());
    let waits = format!("waits for grids of {}", options.vehicle);
    move || {
        let tally = tally.lock().unwrap_or_else(PoisonError::into_inner);
        let per_second = pace.per_second(tally.planned);
        if tally.planned == 0 {
            return match tally.reason.as_str() {
                "" => waits.clone(),
                reason => format!("{waits}: {reason}"),
            };
        }
        let now = match tally.reason.as_str() {
            "" => String::new(),
            reason => format!(" (now: {reason})"),
        };
        format!(
            "{} frames planned, {} a second, {} solved, {} stopped{now}",
            human::count(tally.planned),
            human::rate(per_second),
            human::count(tally.planned - tally.stopped),
            human::count(tally.stopped)
        )
    }
}

/// What to do about an error, where it can be said.
fn advised(error: Error) -> anyhow::Error {
    if let Error::Bridge(BridgeError::NodeTaken { .. }) = &error {
        return anyhow!(
            "{error}: stop it, plan for another --vehicle, or give --share-vehicle to let both plan"
        );
    }
    error.into()
}

/// One line about a planned frame, or why there is none.
fn describe(report: &PlanReport) -> String {
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
