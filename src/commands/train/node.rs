//! `swath train` as a node.

use std::sync::{Arc, Mutex, PoisonError};

use anyhow::Context;
use swath_bridge::msg::swath::TrainStatus;
use swath_bridge::signature::load_or_create_key;
use swath_planner::network::Parameters;
use swath_trainer::TrainConfig;
use swath_trainer::node::{self, NodeConfig};

use super::make_directory;
use crate::cli::{NetworkOptions, TrainOptions};
use crate::config::Config;
use crate::human;
use crate::output::{self, Failure};
use crate::reporter::Reporter;
use crate::runtime::{stop_signal, with_session};

/// File of the key that signs a run's weights.
const KEY_FILE: &str = "signing.key";

/// Trains on the live stream until stopped.
pub(super) fn run(
    options: &TrainOptions,
    network: &NetworkOptions,
    config: &Config,
    (train, initial): (TrainConfig, Option<Parameters>),
) -> Result<(), Failure> {
    make_directory(&options.out)?;
    let node_config = NodeConfig {
        train,
        initial,
        grid: config.grid,
        vehicle: config.vehicle,
        directory: Some(options.out.clone()),
        publish_every_steps: options.publish_every,
        replay_capacity: options.keep,
        ..NodeConfig::new(
            &options.run,
            load_or_create_key(&options.out.join(KEY_FILE))?,
        )
    };
    // With less to keep than it waits for, the first step would never come.
    let node_config = NodeConfig {
        first_samples: node_config.first_samples.min(options.keep),
        ..node_config
    };
    let newest = Arc::new(Mutex::new(None));
    let reporter = Reporter::start("trainer", &options.run, standing(&newest));
    let summary = with_session(network, async |session| {
        let observe = |status: &TrainStatus| {
            *newest.lock().unwrap_or_else(PoisonError::into_inner) = Some(status.clone());
        };
        node::run(&session, node_config, stop_signal(), observe)
            .await
            .context("trainer node")
    })?;
    drop(reporter);
    let miou = summary
        .miou
        .filter(|miou| miou.is_finite())
        .map_or_else(|| "not scored".to_owned(), |miou| format!("{miou:.4}"));
    output::note(format_args!(
        "{} steps, weights v{} (mIoU {miou}) in {}",
        summary.steps,
        summary.version,
        options.out.display()
    ));
    Ok(())
}

/// How the trainer does, in a line.
fn standing(newest: &Arc<Mutex<Option<TrainStatus>>>) -> impl FnMut() -> String + Send + 'static {
    let newest = Arc::clone(newest);
    move || {
        let newest = newest.lock().unwrap_or_else(PoisonError::into_inner);
        let Some(status) = newest.as_ref() else {
            return "waits for samples".to_owned();
        };
        let miou = if status.miou.is_finite() {
            format!(", mIoU {:.3}", status.miou)
        } else {
            String::new()
        };
        format!(
            "step {}, loss {}{miou}, {} samples received, weights v{}",
            status.step,
            human::decimal(status.loss.into(), 3),
            human::count(status.received),
            status.weights_version
        )
    }
}
