//! How nodes say what they do: a line at their start and one every half minute in the log, or a bar
//! where somebody watches a terminal.

use std::collections::VecDeque;
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle, WeakProgressBar};

use crate::output::shortened;
use crate::progress;

/// Time between two lines of the log.
const LINE_EVERY: Duration = Duration::from_secs(30);
/// Time between two looks for the bar.
const LOOK_EVERY: Duration = Duration::from_millis(500);
/// Most characters of what a node says; date and level, which stand before it, take 28.
pub(crate) const MOST_CHARS: usize = 72;

/// The bar that is on the terminal now.
static BAR: Mutex<Option<WeakProgressBar>> = Mutex::new(None);

/// Writes beside the bar, if there is one: it is taken away for that moment.
pub(crate) fn beside_bar(write: impl FnOnce()) {
    let shown = BAR.lock().unwrap_or_else(PoisonError::into_inner).clone();
    match shown.and_then(|bar| bar.upgrade()) {
        Some(bar) => bar.suspend(write),
        None => write(),
    }
}

/// Says how a node does until it is finished or dropped.
#[derive(Debug)]
pub(crate) struct Reporter {
    bar: ProgressBar,
    /// Dropped to end the thread.
    going_on: Option<SyncSender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Reporter {
    /// Begins to report on a node. `standing` says how things stand, in plain words.
    pub(crate) fn start(
        kind: &'static str,
        name: &str,
        mut standing: impl FnMut() -> String + Send + 'static,
    ) -> Self {
        let words = format!("{kind} {name} starts (swath {})", env!("CARGO_PKG_VERSION"));
        tracing::info!("{}", shortened(&words, MOST_CHARS));
        let bar = progress::spinner(kind);
        if bar.is_hidden() {
            return Self::every(LINE_EVERY, bar, move || {
                tracing::info!("{}", shortened(&standing(), MOST_CHARS));
            });
        }
        if let Ok(style) = ProgressStyle::with_template("{prefix:>12} {spinner} {msg}") {
            bar.set_style(style);
        }
        *BAR.lock().unwrap_or_else(PoisonError::into_inner) = Some(bar.downgrade());
        let shown = bar.clone();
        shown.set_message(standing());
        Self::every(LOOK_EVERY, bar, move || shown.set_message(standing()))
    }

    fn every(period: Duration, bar: ProgressBar, mut say: impl FnMut() + Send + 'static) -> Self {
        let (going_on, ended) = sync_channel::<()>(0);
        let thread = std::thread::Builder::new().name("reporter".to_owned());
        let thread = thread.spawn(move || {
            while ended.recv_timeout(period) == Err(RecvTimeoutError::Timeout) {
                say();
            }
        });
        Self {
            bar,
            going_on: Some(going_on),
            // A node without reports is better than none.
            thread: thread.ok(),
        }
    }
}

impl Drop for Reporter {
    fn drop(&mut self) {
        self.going_on = None;
        if let Some(thread) = self.thread.take() {
            // What it said last is all that is lost if it panicked.
            let _ = thread.join();
        }
        self.bar.finish_and_clear();
    }
}

/// How fast something goes on: over the last half minute, not since the beginning.
#[derive(Debug)]
pub(crate) struct Pace {
    looks: VecDeque<(Instant, u64)>,
}

impl Pace {
    /// Begins at a count of 0.
    pub(crate) fn new() -> Self {
        Self {
            looks: VecDeque::from([(Instant::now(), 0)]),
        }
    }

    /// How many came a second, lately, now that `count` have come.
    pub(crate) fn per_second(&mut self, count: u64) -> f64 {
        let now = Instant::now();
        let is_old = |look: Option<&(Instant, u64)>| {
            look.is_some_and(|(moment, _)| now.duration_since(*moment) >= LINE_EVERY)
        };
        while is_old(self.looks.get(1)) {
            self.looks.pop_front();
        }
        let (moment, before) = self.looks.front().copied().unwrap_or((now, count));
        self.looks.push_back((now, count));
        let seconds = now.duration_since(moment).as_secs_f64();
        count.saturating_sub(before) as f64 / seconds.max(1e-3)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;

    #[test]
    fn a_node_reports_again_and_again_until_it_ends() {
        let said = Arc::new(AtomicU64::new(0));
        let (sender, lines) = sync_channel(1024);
        let counted = Arc::clone(&said);
        let reporter =
            Reporter::every(Duration::from_millis(1), ProgressBar::hidden(), move || {
                let number = counted.fetch_add(1, Ordering::Relaxed);
                let _ = sender.send(number);
            });
        for number in 0..3 {
            assert_eq!(lines.recv().unwrap(), number);
        }
        drop(reporter);
        // Dropping waits for the thread, so nothing is said any more.
        let last = said.load(Ordering::Relaxed);
        assert_eq!(lines.iter().last().unwrap_or(2), last - 1);
    }

    #[test]
    fn a_pace_is_never_infinite() {
        let mut pace = Pace::new();
        assert_eq!(pace.per_second(0), 0.0);
        assert!(pace.per_second(1_000_000).is_finite());
    }
}
