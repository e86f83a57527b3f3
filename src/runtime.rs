//! What all nodes share: a runtime, a session, what is said of both, and the signal to stop.

mod panics;
mod presence;
mod stop;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Error, bail};
use swath_bridge::{Session, SessionConfig, caught};

use crate::cli::NetworkOptions;

/// What stands for no namespace on the command line.
const NO_NAMESPACE: &str = "-";

/// Runs a node to its end on a session of its own, and says whom it meets there.
///
/// When a thread or a task panics, wherever that is, the node is asked to stop, and the run has failed.
pub(crate) fn with_session<T>(
    network: &NetworkOptions,
    node: impl AsyncFnOnce(Session) -> anyhow::Result<T>,
) -> anyhow::Result<T> {
    on_session(network, async |session: Session| {
        let presence = tokio::spawn(presence::tell(session.clone()));
        let result = node(session).await;
        presence.abort();
        result
    })
}

/// Runs something to its end on a session of its own, and says nothing of whom it meets there.
pub(crate) fn on_session<T>(
    network: &NetworkOptions,
    work: impl AsyncFnOnce(Session) -> anyhow::Result<T>,
) -> anyhow::Result<T> {
    panics::watch();
    stop::listen();
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build()?;
    runtime.block_on(async {
        let session = Session::open(&session_config(network)).await?;
        let result = caught(work(session.clone())).await;
        let closed = session.close().await;
        // What a panic did to the work is no second cause.
        if let Some(panic) = panics::first().or_else(|| result.as_ref().err().cloned()) {
            bail!("stopped by a panic: {panic}");
        }
        let value = result.map_err(Error::msg)??;
        closed?;
        Ok(value)
    })
}

fn session_config(network: &NetworkOptions) -> SessionConfig {
    let namespace = network.namespace.as_deref();
    SessionConfig {
        file: network.zenoh_config.clone(),
        listen: network.listen.clone(),
        connect: network.connect.clone(),
        namespace: namespace.map(|name| {
            let is_none = name == NO_NAMESPACE;
            if is_none {
                String::new()
            } else {
                name.to_owned()
            }
        }),
        ..SessionConfig::default()
    }
}

/// Done when the process is asked to stop, by Ctrl-C or SIGTERM, or when something in it panicked.
pub(crate) async fn stop_signal() {
    tokio::select! {
        () = stop::asked() => (),
        () = panics::happened() => (),
    }
}

/// A flag that is set when the process is asked to stop, for work that is not asynchronous.
pub(crate) fn stop_flag() -> anyhow::Result<Arc<AtomicBool>> {
    let flag = Arc::new(AtomicBool::new(false));
    let raised = Arc::clone(&flag);
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()?;
    std::thread::Builder::new()
        .name("stop-signal".to_owned())
        .spawn(move || {
            runtime.block_on(stop_signal());
            raised.store(true, Ordering::Relaxed);
        })?;
    Ok(flag)
}
