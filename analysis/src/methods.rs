//! Every plan by method, whether another method planned the same frame or not.

use polars::prelude::{DataFrame, IntoLazy as _, col, lit};

use crate::Error;
use crate::comparison::{Side, side};
use crate::error::InTable as _;
use crate::frames::{counts, names};

const TABLE: &str = "methods";

/// What a method did over all its plans.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct MethodStatistics {
    /// Plans.
    pub(crate) plans: usize,
    /// Targets of all plans.
    pub(crate) targets: u64,
    /// Targets reached.
    pub(crate) solved: u64,
    /// Times and steps.
    pub(crate) side: Side,
}

/// The plans of each method, ordered by its name.
///
/// # Errors
/// [`Error::Table`] if polars fails.
pub(crate) fn methods(plans: &DataFrame) -> Result<Vec<MethodStatistics>, Error> {
    let mut all = names(plans, "method", TABLE)?;
    all.sort();
    all.dedup();
    all.iter().map(|method| statistics(plans, method)).collect()
}

fn statistics(plans: &DataFrame, method: &str) -> Result<MethodStatistics, Error> {
    let of_method = plans
        .clone()
        .lazy()
        .filter(col("method").eq(lit(method)))
        .collect()
        .in_table(TABLE)?;
    Ok(MethodStatistics {
        plans: of_method.height(),
        targets: counts(&of_method, "targets", TABLE)?.iter().sum(),
        solved: counts(&of_method, "solved", TABLE)?.iter().sum(),
        side: side(&of_method, method, "")?,
    })
}
