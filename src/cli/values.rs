//! Values of options that are checked while the command line is read, so that a wrong one is wrong
//! usage and its range is said.

use std::fmt::Display;
use std::str::FromStr;

/// Longest name that becomes a part of a key, bytes.
const MAX_NAME_BYTES: usize = 64;

/// A name that becomes one part of a key: letters, digits, `-`, `_` and `.`.
///
/// # Errors
/// What a name may be made of.
pub(crate) fn name(text: &str) -> Result<String, String> {
    let is_allowed = |symbol: char| symbol.is_alphanumeric() || "-_.".contains(symbol);
    if text.is_empty() || text.len() > MAX_NAME_BYTES || !text.chars().all(is_allowed) {
        return Err(format!(
            "expected a name of 1 to {MAX_NAME_BYTES} bytes from letters, digits, '-', '_' and '.'"
        ));
    }
    Ok(text.to_owned())
}

/// A whole number from `least` to `most`, both included.
pub(crate) fn whole<T>(
    least: T,
    most: T,
) -> impl Fn(&str) -> Result<T, String> + Clone + Send + Sync + 'static
where
    T: FromStr + PartialOrd + Display + Copy + Send + Sync + 'static,
{
    move |text| {
        text.parse()
            .ok()
            .filter(|value| (least..=most).contains(value))
            .ok_or_else(|| format!("expected a whole number from {least} to {most}"))
    }
}

/// A number from `least` to `most`, both included; not a number is out of range.
pub(crate) fn number(
    least: f64,
    most: f64,
) -> impl Fn(&str) -> Result<f64, String> + Clone + Send + Sync + 'static {
    move |text| {
        text.parse()
            .ok()
            .filter(|value| (least..=most).contains(value))
            .ok_or_else(|| format!("expected a number from {least} to {most}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_parts_of_keys() {
        for good in ["v0", "car-1", "lab_2.north", "Prüfstand", &"a".repeat(64)] {
            assert_eq!(name(good).as_deref(), Ok(good));
        }
        for bad in [
            "",
            "a/b",
            "*",
            "a*",
            "$x",
            "a b",
            "a#b",
            "a?b",
            "@x",
            "\n",
            &"a".repeat(65),
        ] {
            assert!(name(bad).is_err(), "{bad:?}");
        }
    }

    #[test]
    fn numbers_end_at_their_limits() {
        let share = number(0.0, 1.0);
        assert_eq!((share("0"), share("1e0")), (Ok(0.0), Ok(1.0)));
        for bad in ["-0.001", "1.001", "nan", "inf", "-inf", "", "1,5", "one"] {
            assert!(share(bad).is_err(), "{bad:?}");
        }
        let count = whole(1usize, 256);
        assert_eq!((count("1"), count("256")), (Ok(1), Ok(256)));
        for bad in ["0", "257", "-1", "1.5", "", "18446744073709551616"] {
            assert_eq!(
                count(bad),
                Err("expected a whole number from 1 to 256".to_owned())
            );
        }
    }
}
