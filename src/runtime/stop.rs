//! Being asked to stop, by Ctrl-C or SIGTERM: heard from the moment that a command begins, and remembered.

use std::io;
use std::sync::OnceLock;

use tokio::runtime::Builder;
use tokio::signal::unix::{Signal, SignalKind, signal};
use tokio::sync::watch;

/// Whether the process was asked to stop; `None` where no handler could be set, so that a signal ends the
/// process by itself.
static ASKED: OnceLock<Option<watch::Receiver<bool>>> = OnceLock::new();

/// Sets the handlers, unless they are set.
pub(super) fn listen() {
    ASKED.get_or_init(|| watched().ok());
}

/// Done when the process is asked to stop, or was asked before.
pub(super) async fn asked() {
    listen();
    if let Some(Some(asked)) = ASKED.get() {
        // It cannot be closed before it is set.
        let _ = asked.clone().wait_for(|is_asked| *is_asked).await;
    } else {
        std::future::pending::<()>().await;
    }
}

fn watched() -> io::Result<watch::Receiver<bool>> {
    let runtime = Builder::new_current_thread().enable_all().build()?;
    let signals = {
        let _entered = runtime.enter();
        [
            signal(SignalKind::terminate())?,
            signal(SignalKind::interrupt())?,
        ]
    };
    let (say, asked) = watch::channel(false);
    std::thread::Builder::new()
        .name("stop-signal".to_owned())
        .spawn(move || {
            runtime.block_on(first_of(signals));
            say.send_replace(true);
        })?;
    Ok(asked)
}

async fn first_of([mut terminate, mut interrupt]: [Signal; 2]) {
    tokio::select! {
        _ = terminate.recv() => (),
        _ = interrupt.recv() => (),
    }
}
