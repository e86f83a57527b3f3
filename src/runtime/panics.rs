//! Panics anywhere in the process: the node is told, so that it ends in order.
//!
//! A thread that panics ends alone, and the node would go on without what the thread did. So every
//! panic stops the node as a signal would; a planner then withdraws its path, a recorder ends its file.

use std::panic::{PanicHookInfo, set_hook, take_hook};
use std::pin::pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, Once, PoisonError};

use tokio::sync::Notify;

/// What the first panic said, and where.
static FIRST: Mutex<Option<String>> = Mutex::new(None);
static HAPPENED: AtomicBool = AtomicBool::new(false);
static TOLD: Notify = Notify::const_new();

/// Takes notice of panics from now on.
pub(super) fn watch() {
    static WATCHING: Once = Once::new();
    WATCHING.call_once(|| {
        let usual = take_hook();
        set_hook(Box::new(move |panic| {
            note(panic);
            usual(panic);
        }));
    });
}

fn note(panic: &PanicHookInfo<'_>) {
    let said = panic.payload_as_str().unwrap_or("of an unknown cause");
    let mut first = FIRST.lock().unwrap_or_else(PoisonError::into_inner);
    first.get_or_insert_with(|| match panic.location() {
        Some(place) => format!(
            "{said} (line {} of {})",
            place.line(),
            file_name(place.file())
        ),
        None => said.to_owned(),
    });
    drop(first);
    HAPPENED.store(true, Ordering::Release);
    TOLD.notify_waiters();
}

/// The last part of a path: what stands before it is a folder of the machine that built this.
fn file_name(path: &str) -> &str {
    path.rsplit(['/', '\\']).next().unwrap_or(path)
}

/// What the first panic said, if there was one.
pub(super) fn first() -> Option<String> {
    FIRST.lock().unwrap_or_else(PoisonError::into_inner).clone()
}

/// Done as soon as something has panicked.
pub(super) async fn happened() {
    let mut told = pin!(TOLD.notified());
    // Whoever is told from here on is woken, so none is missed between the look and the wait.
    told.as_mut().enable();
    if !HAPPENED.load(Ordering::Acquire) {
        told.await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
    async fn a_panic_of_any_thread_is_told_to_who_waits_and_to_who_comes_later() {
        watch();
        let waits = tokio::spawn(happened());
        let thread = std::thread::Builder::new()
            .name("one that panics".to_owned())
            .spawn(|| panic!("on purpose, for a test"))
            .unwrap();
        assert!(thread.join().is_err());
        waits.await.unwrap();
        happened().await;
        let said = first().unwrap();
        assert!(said.starts_with("on purpose, for a test"), "{said}");
        assert!(said.ends_with("of panics.rs)"), "{said}");
    }
}
