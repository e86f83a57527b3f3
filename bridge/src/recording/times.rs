//! Which log times are times, and which come from before the clock was set.

/// 1990-01-01, nanoseconds since the Unix epoch. Clocks that tell the date are later, clocks that count
/// from the start of a machine or a simulation are earlier.
const DATED_NANOS: u64 = 631_152_000_000_000_000;

/// The log times of messages: from when to when, and how many are none.
///
/// A log time of 0 is none: recorders write it before `/clock` came. Where some messages have a date,
/// those without one are from before the clock was set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct LogTimes {
    zeros: u64,
    counted: Span,
    dated: Span,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Span {
    messages: u64,
    first_nanos: u64,
    last_nanos: u64,
}

impl Default for Span {
    fn default() -> Self {
        Self {
            messages: 0,
            first_nanos: u64::MAX,
            last_nanos: 0,
        }
    }
}

impl Span {
    fn add(&mut self, other: &Self) {
        self.messages += other.messages;
        self.first_nanos = self.first_nanos.min(other.first_nanos);
        self.last_nanos = self.last_nanos.max(other.last_nanos);
    }
}

impl LogTimes {
    /// Adds the log time of a message.
    pub(super) fn add(&mut self, log_nanos: u64) {
        let one = Span {
            messages: 1,
            first_nanos: log_nanos,
            last_nanos: log_nanos,
        };
        match log_nanos {
            0 => self.zeros += 1,
            DATED_NANOS.. => self.dated.add(&one),
            _ => self.counted.add(&one),
        }
    }

    /// Adds those of other messages.
    pub(super) fn merge(&mut self, other: &Self) {
        self.zeros += other.zeros;
        self.counted.add(&other.counted);
        self.dated.add(&other.dated);
    }

    const fn real(&self) -> &Span {
        if self.is_dated() {
            &self.dated
        } else {
            &self.counted
        }
    }

    /// Whether the clock tells the date.
    pub(super) const fn is_dated(&self) -> bool {
        self.dated.messages > 0
    }

    /// Whether a log time is one, where a clock tells the date or not.
    pub(super) const fn is_real(log_nanos: u64, is_dated: bool) -> bool {
        log_nanos >= if is_dated { DATED_NANOS } else { 1 }
    }

    /// The earliest and the latest time, `None` if no message has one. `is_dated` is that of all topics
    /// of a recording.
    pub(super) fn span(&self, is_dated: bool) -> Option<(u64, u64)> {
        let span = if is_dated { &self.dated } else { self.real() };
        (span.messages > 0).then_some((span.first_nanos, span.last_nanos))
    }

    /// Messages that have a time.
    pub(super) const fn timed(&self) -> u64 {
        self.real().messages
    }

    /// Messages that have none.
    pub(super) const fn untimed(&self) -> u64 {
        let counted = if self.is_dated() {
            self.counted.messages
        } else {
            0
        };
        self.zeros + counted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: u64 = 1_700_000_000_000_000_000;

    fn times(of: &[u64]) -> LogTimes {
        let mut times = LogTimes::default();
        of.iter().for_each(|nanos| times.add(*nanos));
        times
    }

    #[test]
    fn the_clock_begins_at_the_first_time_that_is_one() {
        let times = times(&[0, 0, 7, NOW + 5, NOW, NOW + 9]);
        assert_eq!(times.span(true), Some((NOW, NOW + 9)));
        assert_eq!((times.timed(), times.untimed()), (3, 3));
        assert!(!LogTimes::is_real(7, true) && LogTimes::is_real(7, false));
    }

    #[test]
    fn clocks_of_simulations_count_from_their_own_start() {
        let times = times(&[0, 9_000_000_000, 3_000_000_000]);
        assert_eq!(times.span(false), Some((3_000_000_000, 9_000_000_000)));
        assert_eq!(times.untimed(), 1);
        assert_eq!(LogTimes::default().span(false), None);
    }
}
