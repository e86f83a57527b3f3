//! What can go wrong in planning, apart from there being no path, which is an outcome.

/// Errors of this crate, each with the evidence.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Packed bits of the wrong length.
    #[error("a plane of {rows} x {cols} cells takes {wanted} bytes, got {bytes}")]
    Plane {
        /// Rows that were claimed.
        rows: u32,
        /// Columns that were claimed.
        cols: u32,
        /// Bytes that came.
        bytes: usize,
        /// Bytes that the cells take.
        wanted: usize,
    },
    /// Bits behind the last cell are set.
    #[error("a plane of {rows} x {cols} cells has bits set behind its last cell")]
    PlanePadding {
        /// Rows that were claimed.
        rows: u32,
        /// Columns that were claimed.
        cols: u32,
    },
    /// Error of the bridge.
    #[error(transparent)]
    Bridge(#[from] swath_bridge::Error),
}
