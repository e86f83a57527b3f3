//! Figures as people read them: `1.2 k`, `3.4 MiB`, `2 min`, and `-` where there is none.

use std::time::Duration;

/// Stands where there is no figure.
pub(crate) const NOTHING: &str = "-";

/// Factors of a thousand, for counts.
const THOUSANDS: [&str; 5] = ["", " k", " M", " G", " T"];
/// Factors of 1024, for bytes.
const BYTES: [&str; 5] = [" B", " KiB", " MiB", " GiB", " TiB"];
const SECONDS_A_MINUTE: u64 = 60;
const SECONDS_AN_HOUR: u64 = 3600;
const SECONDS_A_DAY: u64 = 86_400;

/// A number in units that are `step` times larger each: one decimal from the second unit on.
fn scaled(value: f64, step: f64, units: [&str; 5]) -> String {
    if !value.is_finite() {
        return NOTHING.to_owned();
    }
    let mut rest = value.abs();
    let mut unit = 0;
    // What would be printed as a whole step belongs to the next unit.
    while unit + 1 < units.len() && rest >= step - 0.05 && (unit > 0 || rest >= step) {
        rest /= step;
        unit += 1;
    }
    let sign = if value < 0.0 { "-" } else { "" };
    if unit == 0 {
        format!("{sign}{rest:.0}{}", units[unit])
    } else {
        format!("{sign}{rest:.1}{}", units[unit])
    }
}

/// A count: `999`, `1.2 k`, `3.4 M`.
pub(crate) fn count(value: u64) -> String {
    scaled(value as f64, 1000.0, THOUSANDS)
}

/// A size: `512 B`, `3.4 MiB`.
pub(crate) fn bytes(value: u64) -> String {
    scaled(value as f64, 1024.0, BYTES)
}

/// A rate, without its unit: `0.25`, `7.3`, `42`, `1.2 k`.
pub(crate) fn rate(per_s: f64) -> String {
    let size = per_s.abs();
    if !per_s.is_finite() {
        NOTHING.to_owned()
    } else if size >= 9.95 {
        scaled(per_s.round(), 1000.0, THOUSANDS)
    } else if size >= 0.995 || size == 0.0 {
        format!("{per_s:.1}")
    } else {
        format!("{per_s:.2}")
    }
}

/// `done` in `elapsed`, a second; `-` before any time has passed.
pub(crate) fn rate_of(done: u64, elapsed: Duration) -> String {
    rate(done as f64 / elapsed.as_secs_f64())
}

/// A time in its largest unit, or its two largest ones: `8 s`, `2 min`, `3 h 5 min`.
pub(crate) fn duration(time: Duration) -> String {
    let seconds = time.as_secs() + u64::from(time.subsec_millis() >= 500);
    // Minutes are rounded: seconds beside them only make a line restless.
    let minutes = (seconds + SECONDS_A_MINUTE / 2) / SECONDS_A_MINUTE;
    match seconds {
        0..=89 => format!("{seconds} s"),
        90..=3569 => format!("{minutes} min"),
        _ if seconds < SECONDS_A_DAY => {
            let (hours, minutes) = (minutes / 60, minutes % 60);
            format!("{hours} h {minutes} min")
        }
        _ => {
            let hours = (seconds + SECONDS_AN_HOUR / 2) / SECONDS_AN_HOUR;
            format!("{} d {} h", hours / 24, hours % 24)
        }
    }
}

/// How long `left` more of something takes that took `elapsed` for `done`; none before the first.
pub(crate) fn time_left(done: u64, left: u64, elapsed: Duration) -> Option<Duration> {
    let seconds = elapsed.as_secs_f64() / done as f64 * left as f64;
    Duration::try_from_secs_f64(seconds).ok()
}

/// A share of 1 as a percentage with so many decimals.
pub(crate) fn percent(share: f64, decimals: usize) -> String {
    decimal(100.0 * share, decimals) + if share.is_finite() { " %" } else { "" }
}

/// A number with so many decimals.
pub(crate) fn decimal(value: f64, decimals: usize) -> String {
    if value.is_finite() {
        format!("{value:.decimals$}")
    } else {
        NOTHING.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_and_bytes_change_their_unit_where_the_next_begins() {
        let counts = [0, 1, 999, 1000, 1234, 12_345, 999_940, 999_960, 3_400_000];
        assert_eq!(
            counts.map(count),
            [
                "0", "1", "999", "1.0 k", "1.2 k", "12.3 k", "999.9 k", "1.0 M", "3.4 M"
            ]
        );
        assert_eq!(count(u64::MAX), "18446744.1 T");
        let sizes = [0, 1023, 1024, 3_565_158, 1 << 30, (1 << 20) - 1];
        assert_eq!(
            sizes.map(bytes),
            ["0 B", "1023 B", "1.0 KiB", "3.4 MiB", "1.0 GiB", "1.0 MiB"]
        );
    }

    #[test]
    fn rates_of_no_time_are_no_figure() {
        assert_eq!(rate_of(0, Duration::ZERO), NOTHING);
        assert_eq!(rate_of(7, Duration::ZERO), NOTHING);
        assert_eq!(rate_of(1, Duration::from_secs(4)), "0.25");
        let rates = [0.0, 0.994, 0.996, 7.26, 9.94, 9.96, 999.6, 1234.0].map(rate);
        assert_eq!(
            rates,
            ["0.0", "0.99", "1.0", "7.3", "9.9", "10", "1.0 k", "1.2 k"]
        );
        assert_eq!(rate(f64::NAN), NOTHING);
    }

    #[test]
    fn times_are_said_in_their_largest_units() {
        let times = [0, 8, 89, 90, 150, 3569, 3570, 11_100, 86_399, 100_000];
        assert_eq!(
            times.map(|seconds| duration(Duration::from_secs(seconds))),
            [
                "0 s",
                "8 s",
                "89 s",
                "2 min",
                "3 min",
                "59 min",
                "1 h 0 min",
                "3 h 5 min",
                "24 h 0 min",
                "1 d 4 h"
            ]
        );
        assert_eq!(duration(Duration::from_millis(1500)), "2 s");
    }

    #[test]
    fn what_is_left_is_unknown_until_something_is_done() {
        let elapsed = Duration::from_secs(10);
        assert_eq!(time_left(0, 5, elapsed), None);
        assert_eq!(time_left(0, 0, Duration::ZERO), None);
        assert_eq!(time_left(5, 10, elapsed), Some(Duration::from_secs(20)));
        assert_eq!(time_left(5, 0, elapsed), Some(Duration::ZERO));
    }

    #[test]
    fn what_is_not_a_number_is_a_dash() {
        assert_eq!(percent(0.9019, 1), "90.2 %");
        assert_eq!(percent(f64::NAN, 2), NOTHING);
        assert_eq!(decimal(0.12345, 3), "0.123");
        assert_eq!(decimal(f64::INFINITY, 3), NOTHING);
    }
}
