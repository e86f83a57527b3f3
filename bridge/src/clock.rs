//! The wall clock, for stamps of messages and recordings. Nothing else reads it.

/// Nanoseconds since the Unix epoch; 0 if the clock is set before it.
#[expect(clippy::disallowed_methods, reason = "this is the one place that may")]
pub fn now_nanos() -> u64 {
    std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .map_or(0, |elapsed| {
            u64::try_from(elapsed.as_nanos()).unwrap_or(u64::MAX)
        })
}
