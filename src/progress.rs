//! Progress of long work: a bar where somebody watches a terminal, lines of the log elsewhere.

mod lines;

use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressState, ProgressStyle};

use crate::human;

/// What a bar counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Unit {
    /// Things of this name.
    Count(&'static str),
    /// Bytes.
    Bytes,
}

impl Unit {
    /// A figure without the name.
    fn figure(self, value: u64) -> String {
        match self {
            Self::Count(_) => human::count(value),
            Self::Bytes => human::bytes(value),
        }
    }

    /// A figure with the name.
    fn said(self, value: u64) -> String {
        match self {
            Self::Count(name) => format!("{} {name}", human::count(value)),
            Self::Bytes => human::bytes(value),
        }
    }

    /// `done` in `elapsed`, a second; `-` before anything is known.
    fn rate(self, done: u64, elapsed: Duration) -> String {
        match (self, elapsed.is_zero()) {
            (_, true) => human::NOTHING.to_owned(),
            (Self::Count(name), false) => format!("{} {name}/s", human::rate_of(done, elapsed)),
            (Self::Bytes, false) => format!("{}/s", human::bytes(per_second(done, elapsed))),
        }
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "float to integer casts saturate, and the rate is not negative"
)]
fn per_second(done: u64, elapsed: Duration) -> u64 {
    (done as f64 / elapsed.as_secs_f64()).round() as u64
}

/// A bar of `total` bytes.
pub(crate) fn bar(total: u64, what: &'static str) -> ProgressBar {
    bar_of(total, what, Unit::Bytes)
}

/// A bar of `total` things. Without a terminal the log says that the work begins, and every half
/// minute how far it is.
pub(crate) fn bar_of(total: u64, what: &'static str, unit: Unit) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(total), ProgressDrawTarget::stderr());
    let style = ProgressStyle::with_template(
        "{prefix:>12} [{bar:30}] {position} of {total}, {rate}, {left} {msg}",
    );
    if let Ok(style) = style {
        bar.set_style(styled(style, unit).progress_chars("=> "));
    }
    bar.set_prefix(what);
    bar.enable_steady_tick(Duration::from_millis(250));
    if bar.is_hidden() {
        lines::follow(&bar, what, unit);
    }
    bar
}

/// The figures of a bar.
fn styled(style: ProgressStyle, unit: Unit) -> ProgressStyle {
    type Written<'a> = &'a mut dyn std::fmt::Write;
    // Nothing can be done about a terminal that takes no text.
    style
        .with_key(
            "position",
            move |state: &ProgressState, text: Written<'_>| {
                let _ = write!(text, "{}", unit.figure(state.pos()));
            },
        )
        .with_key("total", move |state: &ProgressState, text: Written<'_>| {
            let _ = write!(text, "{}", unit.said(state.len().unwrap_or(0)));
        })
        .with_key("rate", move |state: &ProgressState, text: Written<'_>| {
            let _ = write!(text, "{}", unit.rate(state.pos(), state.elapsed()));
        })
        .with_key("left", move |state: &ProgressState, text: Written<'_>| {
            let _ = match state.pos() {
                0 => write!(text, "{}", human::NOTHING),
                _ => write!(text, "{} left", human::duration(state.eta())),
            };
        })
}

/// A line for work without an end, hidden unless standard error is a terminal.
pub(crate) fn spinner(what: &'static str) -> ProgressBar {
    let spinner = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
    if let Ok(style) = ProgressStyle::with_template("{prefix:>12} {spinner} {position} {msg}") {
        let style = style.with_key(
            "position",
            |state: &ProgressState, text: &mut dyn std::fmt::Write| {
                let _ = write!(text, "{}", human::count(state.pos()));
            },
        );
        spinner.set_style(style);
    }
    spinner.set_prefix(what);
    spinner.enable_steady_tick(Duration::from_millis(250));
    spinner
}
