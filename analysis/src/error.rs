//! What can go wrong between a recording and its report.

use std::path::PathBuf;

/// Why no report was made.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// There was nothing to report on.
    #[error("no recording was given: expected one or more MCAP files")]
    NoRecordings,
    /// A recording could not be read.
    #[error(transparent)]
    Recording(#[from] swath_bridge::Error),
    /// A recording holds nothing of swath's.
    #[error("{}: no swath topic among its {messages} message(s); found {found}", path.display())]
    NoSwathTopics {
        /// Path as it was given.
        path: PathBuf,
        /// Messages in the recording.
        messages: u64,
        /// Topics that it does hold, with their types.
        found: String,
    },
    /// A table outgrew its limit.
    #[error("table {table} would have more than {limit} rows: report on fewer recordings at once")]
    TooManyRows {
        /// Name of the table.
        table: &'static str,
        /// Most rows it may have.
        limit: usize,
    },
    /// A file could not be written.
    #[error("{}: {source}", path.display())]
    Write {
        /// Path of the file or directory.
        path: PathBuf,
        /// The system's word.
        r#source: std::io::Error,
    },
    /// A table could not be computed or written.
    #[error("table {table}: {source}")]
    Table {
        /// Name of the table.
        table: &'static str,
        /// What polars says.
        r#source: polars::error::PolarsError,
    },
    /// A plot could not be drawn.
    #[error("plot {plot}: {what}")]
    Plot {
        /// File name of the plot.
        plot: String,
        /// What the drawing library says.
        what: String,
    },
}

/// Names the table that a polars error came from.
pub(crate) trait InTable<T> {
    /// # Errors
    /// [`Error::Table`] with the name.
    fn in_table(self, table: &'static str) -> Result<T, Error>;
}

impl<T> InTable<T> for polars::error::PolarsResult<T> {
    fn in_table(self, table: &'static str) -> Result<T, Error> {
        self.map_err(|source| Error::Table { table, source })
    }
}
