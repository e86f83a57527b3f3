//! Progress as lines of the log, where no terminal shows a bar.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, WeakProgressBar};

use super::Unit;
use crate::human;

/// Time between two lines.
const PERIOD: Duration = Duration::from_secs(30);

/// Logs that work begins, and every half minute how far it is, until the bar is finished or gone.
pub(super) fn follow(bar: &ProgressBar, what: &'static str, unit: Unit) {
    if let Some(total) = bar.length().filter(|total| *total > 0) {
        tracing::info!("{what}: {}", unit.said(total));
    } else {
        tracing::info!("{what}: begins");
    }
    let watched = bar.downgrade();
    let watch = move || {
        tell(&watched, unit, PERIOD, |line| {
            tracing::info!("{what}: {line}");
        });
    };
    // Without the thread the work goes on all the same; only the lines are missing.
    let _ = std::thread::Builder::new()
        .name("progress".to_owned())
        .spawn(watch);
}

/// Says every `period` how far a bar is, while it is there and not finished.
fn tell(watched: &WeakProgressBar, unit: Unit, period: Duration, mut say: impl FnMut(String)) {
    let began = Instant::now();
    let first = watched.upgrade().map_or(0, |bar| bar.position());
    loop {
        std::thread::sleep(period);
        let Some(bar) = watched.upgrade().filter(|bar| !bar.is_finished()) else {
            return;
        };
        say(line(&bar, unit, first, began.elapsed()));
    }
}

/// How far a bar is that stood at `first` so long ago.
fn line(bar: &ProgressBar, unit: Unit, first: u64, elapsed: Duration) -> String {
    let position = bar.position();
    let done = position.saturating_sub(first);
    let total = bar.length().filter(|total| *total > 0);
    let far = total.map_or_else(
        || unit.said(position),
        |total| format!("{} of {}", unit.figure(position), unit.said(total)),
    );
    let mut parts = vec![far, unit.rate(done, elapsed)];
    let left = total.map(|total| total.saturating_sub(position));
    if let Some(left) = left.and_then(|left| human::time_left(done, left, elapsed)) {
        parts.push(format!("{} left", human::duration(left)));
    }
    let message = bar.message();
    if !message.is_empty() {
        parts.push(message);
    }
    parts.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_says_how_far_it_is_and_how_long_it_takes() {
        let bar = ProgressBar::hidden();
        bar.set_length(4000);
        bar.set_position(1500);
        bar.set_message("loss 0.123");
        let minute = Duration::from_mins(1);
        assert_eq!(
            line(&bar, Unit::Count("steps"), 1000, minute),
            "1.5 k of 4.0 k steps, 8.3 steps/s, 5 min left, loss 0.123"
        );
        let bar = ProgressBar::hidden();
        bar.set_length(8 << 20);
        bar.set_position(2 << 20);
        assert_eq!(
            line(&bar, Unit::Bytes, 0, Duration::from_secs(2)),
            "2.0 MiB of 8.0 MiB, 1.0 MiB/s, 6 s left"
        );
    }

    #[test]
    fn nothing_done_has_no_time_left_and_no_total_no_end() {
        let bar = ProgressBar::hidden();
        bar.set_length(0);
        assert_eq!(line(&bar, Unit::Bytes, 0, Duration::ZERO), "0 B, -");
        bar.set_length(10);
        assert_eq!(
            line(&bar, Unit::Count("plans"), 0, Duration::from_secs(30)),
            "0 of 10 plans, 0.0 plans/s"
        );
    }

    #[test]
    fn lines_come_until_the_bar_is_finished() {
        let bar = ProgressBar::hidden();
        let watched = bar.downgrade();
        let mut lines = 0;
        tell(&watched, Unit::Bytes, Duration::from_millis(1), |_| {
            lines += 1;
            if lines == 3 {
                bar.finish();
            }
        });
        assert_eq!(lines, 3);
        drop(bar);
        tell(&watched, Unit::Bytes, Duration::from_millis(1), |_| {
            lines += 1;
        });
        assert_eq!(lines, 3);
    }
}
