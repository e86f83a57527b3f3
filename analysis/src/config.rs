//! What a report may be told.

use serde::{Deserialize, Serialize};

/// Choices of a report; the defaults give the paper's tables.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ReportOptions {
    /// First line of the report.
    pub title: String,
    /// Method that every other method is compared with.
    pub baseline: String,
    /// Most rows of one table, over all recordings; 1 and more.
    pub max_rows: usize,
}

impl Default for ReportOptions {
    fn default() -> Self {
        Self {
            title: "swath report".to_owned(),
            baseline: "tiev".to_owned(),
            max_rows: 20_000_000,
        }
    }
}
