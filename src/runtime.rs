//! What all nodes share: a runtime, a session, and the signal to stop.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use swath_bridge::{Session, SessionConfig};
use tokio::signal::unix::{SignalKind, signal};

use crate::cli::NetworkOptions;

/// Runs a node to its end on a session of its own.
pub(crate) fn with_session<T>(
    network: &NetworkOptions,
    node: impl AsyncFnOnce(Session) -> anyhow::Result<T>,
) -> anyhow::Result<T> {
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .enable_all()
        .build()?;
    runtime.block_on(async {
        let session = Session::open(&session_config(network)).await?;
        let result = node(session.clone()).await;
        session.close().await?;
        result
    })
}

fn session_config(network: &NetworkOptions) -> SessionConfig {
    SessionConfig {
        file: network.zenoh_config.clone(),
        listen: network.listen.clone(),
        connect: network.connect.clone(),
        namespace: network.namespace.clone(),
        ..SessionConfig::default()
    }
}

/// Done when the process is asked to stop, by Ctrl-C or SIGTERM.
pub(crate) async fn stop_signal() {
    let Ok(mut terminate) = signal(SignalKind::terminate()) else {
        // Without that handler the signal ends the process by itself.
        drop(tokio::signal::ctrl_c().await);
        return;
    };
    tokio::select! {
        _ = tokio::signal::ctrl_c() => (),
        _ = terminate.recv() => (),
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
