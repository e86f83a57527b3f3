//! What can go wrong in making samples, apart from there being no path, which is an outcome.

/// Errors of this crate, each with the evidence.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A field of the configuration is out of range.
    #[error("generator configuration: {field}: {what}")]
    Config {
        /// Section and field.
        field: &'static str,
        /// The value and what was expected.
        what: String,
    },
    /// The system gave no thread.
    #[error("no thread to generate on: {source}")]
    Thread {
        /// The system's word.
        r#source: std::io::Error,
    },
    /// Fewer samples came than were asked for.
    #[error("{got} of {wanted} samples were made before a worker died")]
    Incomplete {
        /// Samples asked for.
        wanted: u64,
        /// Samples made.
        got: u64,
    },
    /// Logs without a frame to make scenes of.
    #[error("no frame of the logs has a reference path of at least {shortest_m} m")]
    NoFrames {
        /// Shortest path that targets can be placed along, metres.
        shortest_m: f64,
    },
    /// Error of the bridge.
    #[error(transparent)]
    Bridge(#[from] swath_bridge::Error),
    /// Error of the planner.
    #[error(transparent)]
    Planner(#[from] swath_planner::Error),
}
