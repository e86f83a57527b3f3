//! Numbers as text, the same in every table.

use crate::comparison::Ratio;
use crate::interval::Interval;
use crate::spread::Spread;

/// Stands where there is nothing to say.
pub(crate) const NOTHING: &str = "–";

/// Three significant digits, and no decimals from 100 on.
pub(crate) fn significant(value: f64) -> String {
    let size = value.abs();
    if !value.is_finite() {
        NOTHING.to_owned()
    } else if size >= 1000.0 {
        thousands(value)
    } else if size >= 99.95 {
        format!("{value:.0}")
    } else if size >= 9.995 {
        format!("{value:.1}")
    } else if size >= 0.9995 || size == 0.0 {
        format!("{value:.2}")
    } else {
        format!("{value:.3}")
    }
}

/// A whole number with a comma before every three digits.
fn thousands(value: f64) -> String {
    let digits = format!("{:.0}", value.abs());
    let mut text = String::from(if value < 0.0 { "-" } else { "" });
    for (index, digit) in digits.chars().enumerate() {
        if index > 0 && (digits.len() - index) % 3 == 0 {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A count.
pub(crate) fn count(value: u64) -> String {
    thousands(value as f64)
}

/// Median, and the quartiles in brackets.
pub(crate) fn spread(value: Option<&Spread>) -> String {
    value.map_or_else(
        || NOTHING.to_owned(),
        |spread| {
            format!(
                "{} ({}–{})",
                significant(spread.median),
                significant(spread.lower_quartile),
                significant(spread.upper_quartile)
            )
        },
    )
}

/// The median alone.
pub(crate) fn median(value: Option<&Spread>) -> String {
    optional(value.map(|spread| spread.median))
}

/// A number that may be missing.
pub(crate) fn optional(value: Option<f64>) -> String {
    value.map_or_else(|| NOTHING.to_owned(), significant)
}

/// A ratio: two decimals from 0.1 on, three below.
pub(crate) fn times(value: Option<f64>) -> String {
    match value {
        None => NOTHING.to_owned(),
        Some(value) if value.abs() < 0.0995 => format!("{value:.3}"),
        Some(value) => format!("{value:.2}"),
    }
}

/// The median ratio of pairs, and the quartiles in brackets.
pub(crate) fn times_of_pairs(ratio: &Ratio) -> String {
    ratio.of_pairs.as_ref().map_or_else(
        || NOTHING.to_owned(),
        |spread| {
            format!(
                "{} ({}–{})",
                times(Some(spread.median)),
                times(Some(spread.lower_quartile)),
                times(Some(spread.upper_quartile))
            )
        },
    )
}

/// A share of 1 as a percentage with two decimals.
pub(crate) fn percent(share: Option<f64>) -> String {
    share.filter(|share| share.is_finite()).map_or_else(
        || NOTHING.to_owned(),
        |share| format!("{:.2} %", share * 100.0),
    )
}

/// Both ends of an interval of shares as percentages with one decimal.
pub(crate) fn interval(interval: Option<Interval>) -> String {
    interval.map_or_else(
        || NOTHING.to_owned(),
        |Interval { low, high }| format!("{:.1}–{:.1} %", low * 100.0, high * 100.0),
    )
}

/// `part` of `whole` as a percentage without decimals.
pub(crate) fn share(part: u64, whole: u64) -> String {
    if whole == 0 {
        return NOTHING.to_owned();
    }
    format!("{:.0} %", part as f64 / whole as f64 * 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_three_digits_that_mean_something() {
        let texts = [
            29.128, 2026.185, 0.0, 0.01234, 1.0, 73_224.0, 999.6, 99.96, -1234.0,
        ]
        .map(significant);
        assert_eq!(
            texts,
            [
                "29.1", "2,026", "0.00", "0.012", "1.00", "73,224", "1000", "100", "-1,234"
            ]
        );
        assert_eq!(significant(f64::NAN), NOTHING);
    }

    #[test]
    fn shares_of_nothing_are_not_numbers() {
        assert_eq!(share(0, 0), NOTHING);
        assert_eq!(share(1, 3), "33 %");
        assert_eq!(percent(Some(0.9019)), "90.19 %");
        assert_eq!(percent(None), NOTHING);
    }

    #[test]
    fn small_ratios_keep_their_digits() {
        assert_eq!(times(Some(0.5298)), "0.53");
        assert_eq!(times(Some(0.0421)), "0.042");
    }
}
