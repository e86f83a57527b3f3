//! `swath train` as a node.

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
use crate::progress;
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
    let bar = progress::spinner("trainer");
    bar.set_message("waits for samples");
    let summary = with_session(network, async |session| {
        let observe = |status: &TrainStatus| {
            bar.set_position(status.step);
            bar.set_message(format!(
                "steps, {} samples, loss {}, mIoU {}, weights v{}",
                human::count(status.received),
                human::decimal(status.loss.into(), 3),
                human::decimal(status.miou.into(), 3),
                status.weights_version
            ));
        };
        node::run(&session, node_config, stop_signal(), observe)
            .await
            .context("trainer node")
    })?;
    bar.finish_and_clear();
    let miou = summary
        .miou
        .filter(|miou| miou.is_finite())
        .map_or_else(|| "not scored".to_owned(), |miou| format!("{miou:.4}"));
    output::line(format_args!(
        "{} steps, weights v{} (mIoU {miou}) in {}",
        summary.steps,
        summary.version,
        options.out.display()
    ))?;
    Ok(())
}
