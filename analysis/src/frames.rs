//! Columns of a frame as plain numbers and names.

use polars::prelude::{DataFrame, DataType};

use crate::Error;
use crate::error::InTable as _;

/// A column of numbers; NaN where there is none.
///
/// # Errors
/// [`Error::Table`] if there is no such column or it does not hold numbers.
pub(crate) fn numbers(
    frame: &DataFrame,
    column: &str,
    table: &'static str,
) -> Result<Vec<f64>, Error> {
    let column = frame.column(column).in_table(table)?;
    let column = column.cast(&DataType::Float64).in_table(table)?;
    let values = column.f64().in_table(table)?;
    Ok(values.iter().map(|v| v.unwrap_or(f64::NAN)).collect())
}

/// A column of counts; 0 where there is none.
///
/// # Errors
/// [`Error::Table`] if there is no such column or it does not hold numbers.
pub(crate) fn counts(
    frame: &DataFrame,
    column: &str,
    table: &'static str,
) -> Result<Vec<u64>, Error> {
    let column = frame.column(column).in_table(table)?;
    let column = column.cast(&DataType::UInt64).in_table(table)?;
    let values = column.u64().in_table(table)?;
    Ok(values.iter().map(Option::unwrap_or_default).collect())
}

/// A column of names.
///
/// # Errors
/// [`Error::Table`] if there is no such column or it does not hold text.
pub(crate) fn names(
    frame: &DataFrame,
    column: &str,
    table: &'static str,
) -> Result<Vec<String>, Error> {
    let values = frame.column(column).in_table(table)?;
    let values = values.str().in_table(table)?;
    Ok(values
        .iter()
        .map(|value| value.unwrap_or_default().to_owned())
        .collect())
}
