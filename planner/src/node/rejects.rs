//! Messages that could not be used: counted by topic and cause, and logged at a limited rate for each.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use swath_bridge::msg::swath::Rejection;
use tokio::time::Instant;

/// Time between two log lines about the same cause.
const LOG_PERIOD: Duration = Duration::from_secs(10);
/// Maximum number of things that are remembered as said; then they may be said again.
const MAX_SAID: usize = 64;

/// When something was last said.
#[derive(Debug, Default, Clone, Copy)]
pub(super) struct Limiter {
    last: Option<Instant>,
}

impl Limiter {
    /// Whether it is time to say it, again or for the first time.
    pub(super) fn is_due(&mut self, now: Instant) -> bool {
        let is_due = self
            .last
            .is_none_or(|last| now.saturating_duration_since(last) >= LOG_PERIOD);
        if is_due {
            self.last = Some(now);
        }
        is_due
    }
}

/// What a message was sent on and why it could not be used: words of the code, not of messages, so that
/// their number is limited.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Cause {
    pub(super) topic: &'static str,
    pub(super) cause: &'static str,
}

#[derive(Debug, Default)]
struct Seen {
    messages: u64,
    limiter: Limiter,
}

/// Counts by topic and cause.
#[derive(Debug, Default)]
pub(super) struct Rejects {
    seen: BTreeMap<Cause, Seen>,
    said: BTreeSet<String>,
}

impl Rejects {
    /// Counts a message; gives a line for the log if it is time for one.
    pub(super) fn note(
        &mut self,
        topic: &'static str,
        cause: &'static str,
        detail: &dyn std::fmt::Display,
        now: Instant,
    ) -> Option<String> {
        let seen = self.seen.entry(Cause { topic, cause }).or_default();
        seen.messages += 1;
        let count = match seen.messages {
            1 => String::new(),
            more => format!(" ({more} so far with this cause)"),
        };
        let is_due = seen.limiter.is_due(now);
        is_due.then(|| format!("{topic} not used: {detail}{count}"))
    }

    /// Counts a message whose cause is said once for each `subject`; gives the line if it is new.
    pub(super) fn note_once(
        &mut self,
        topic: &'static str,
        cause: &'static str,
        subject: &str,
        detail: &dyn std::fmt::Display,
    ) -> Option<String> {
        let seen = self.seen.entry(Cause { topic, cause }).or_default();
        seen.messages += 1;
        let is_new = self.is_new(&format!("{subject}: {cause}"));
        is_new.then(|| format!("{topic} not used: {detail}"))
    }

    /// Whether something is said for the first time.
    pub(super) fn is_new(&mut self, what: &str) -> bool {
        if self.said.contains(what) {
            return false;
        }
        if self.said.len() >= MAX_SAID {
            self.said.clear();
        }
        self.said.insert(what.to_owned());
        true
    }

    /// The counts, in the order of topics and causes.
    pub(super) fn rejections(&self) -> Vec<Rejection> {
        let rejections = self.seen.iter().map(|(cause, seen)| Rejection {
            topic: cause.topic.to_owned(),
            cause: cause.cause.to_owned(),
            messages: seen.messages,
        });
        rejections.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_cause_is_logged_at_once_and_then_at_a_limited_rate() {
        let mut rejects = Rejects::default();
        let begin = Instant::now();
        let mut lines = Vec::new();
        for k in 0u32..1000 {
            let now = begin + Duration::from_millis(100) * k;
            for (topic, cause) in [("grid", "size"), ("grid", "value"), ("odom", "value")] {
                lines.extend(rejects.note(topic, cause, &format!("{cause} {k}"), now));
            }
        }
        // A hundred seconds of three causes, each said ten times.
        assert_eq!(lines.len(), 30);
        assert_eq!(lines[0], "grid not used: size 0");
        assert_eq!(lines[1], "grid not used: value 0");
        assert_eq!(lines[2], "odom not used: value 0");
        assert_eq!(
            lines[3],
            "grid not used: size 100 (101 so far with this cause)"
        );
        let counts = rejects.rejections();
        assert!(counts.len() == 3 && counts.iter().all(|counted| counted.messages == 1000));
    }

    #[test]
    fn what_is_said_once_is_counted_always_and_remembered_within_a_limit() {
        let mut rejects = Rejects::default();
        assert!(
            rejects
                .note_once("weights", "grid", "run a", &"other")
                .is_some()
        );
        assert!(
            rejects
                .note_once("weights", "grid", "run a", &"other")
                .is_none()
        );
        assert!(
            rejects
                .note_once("weights", "grid", "run b", &"other")
                .is_some()
        );
        assert_eq!(rejects.rejections()[0].messages, 3);
        for k in 0..10 * MAX_SAID {
            assert!(rejects.is_new(&k.to_string()));
            assert!(rejects.said.len() <= MAX_SAID);
        }
    }
}
