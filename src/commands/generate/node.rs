//! `swath generate` as a node.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

use anyhow::Context;
use swath_generator::Generator;
use swath_generator::node::{self, NodeConfig};

use crate::cli::{GenerateOptions, NetworkOptions};
use crate::human;
use crate::output::{self, Failure};
use crate::reporter::{Pace, Reporter};
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
    let published = Arc::new(AtomicU64::new(0));
    let reporter = Reporter::start("generator", &options.id, standing(&published));
    let started = Instant::now();
    let summary = with_session(network, async |session| {
        let observe = |_: &swath_bridge::msg::swath::Sample| {
            published.fetch_add(1, Ordering::Relaxed);
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
    drop(reporter);
    output::note(format_args!(
        "published {} samples, {} a second",
        summary.published,
        human::rate_of(summary.published, started.elapsed())
    ));
    Ok(())
}

/// How the generator does, in a line.
fn standing(published: &Arc<AtomicU64>) -> impl FnMut() -> String + Send + 'static {
    let (published, mut pace) = (Arc::clone(published), Pace::new());
    move || {
        let count = published.load(Ordering::Relaxed);
        let per_second = pace.per_second(count);
        if count == 0 {
            return "waits for a trainer or a recorder".to_owned();
        }
        format!(
            "{} samples published, {} a second",
            human::count(count),
            human::rate(per_second)
        )
    }
}
