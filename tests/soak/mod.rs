//! Watching nodes for longer than a test usually takes.

use std::time::Duration;

use crate::nodes::Node;

/// How long nodes are watched without being told otherwise.
const LENGTH: Duration = Duration::from_secs(20);
/// Growth of memory from one third of that time to the next that is still noise, bytes.
pub(crate) const NOISE: u64 = 24 << 20;

/// How long nodes are to be watched by the clock: `SWATH_SOAK_S` seconds, if it is set. Only then the
/// machine is taken to do nothing else.
pub(crate) fn asked_for() -> Option<Duration> {
    let seconds = std::env::var("SWATH_SOAK_S").ok()?;
    Some(Duration::from_secs(seconds.parse().unwrap()))
}

/// How long nodes are watched, whether by the clock or not.
pub(crate) fn length() -> Duration {
    asked_for().unwrap_or(LENGTH)
}

/// Resident memory of a node, bytes.
pub(crate) fn memory_bytes(node: &Node) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{}/status", node.0.id())).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kib = line.unwrap().trim().trim_end_matches(" kB");
    kib.parse::<u64>().unwrap() << 10
}
