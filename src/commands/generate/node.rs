//! `swath generate` as a node.

use std::sync::Arc;
use std::time::Instant;

use anyhow::Context;
use swath_generator::Generator;
use swath_generator::node::{self, NodeConfig};

use crate::cli::{GenerateOptions, NetworkOptions};
use crate::human;
use crate::output::{self, Failure};
use crate::progress;
use crate::runtime::{stop_signal, with_session};

/// Publishes samples until stopped.
pub(super) fn run(
    options: &GenerateOptions,
    network: &NetworkOptions,
    generator: &Arc<Generator>,
) -> Result<(), Failure> {
    let node_config = NodeConfig {
        id: options.id.clone(),
        seed: options.seed,
        first: 0,
        count: options.count,
        workers: options.workers,
    };
    let bar = progress::spinner("generator");
    bar.set_message("waits for a trainer");
    let started = Instant::now();
    let summary = with_session(network, async |session| {
        let observe = |sample: &swath_bridge::msg::swath::Sample| {
            bar.inc(1);
            bar.set_message(format!("{} published", sample.scene));
        };
        node::run(
            &session,
            Arc::clone(generator),
            node_config,
            stop_signal(),
            observe,
        )
        .await
        .context("generator node")
    })?;
    bar.finish_and_clear();
    output::line(format_args!(
        "published {} samples, {} a second",
        summary.published,
        human::rate_of(summary.published, started.elapsed())
    ))?;
    Ok(())
}
