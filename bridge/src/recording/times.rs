//! Which log times are times, and which come from before the clock was set.

/// 1990-01-01, nanoseconds since the Unix epoch. Clocks that tell the date are later, clocks that count
/// from the start of a machine or a simulation are earlier.
const DATED_NANOS: u64 = 631_152_000_000_000_000;

/// A clock whose second message comes this soon behind 0 began at 0, nanoseconds.
const SOON_NANOS: u64 = 1_000_000_000;

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

    /// The least log time that is one, given all messages of a recording.
    pub(super) const fn least(&self) -> u64 {
        if self.dated.messages > 0 {
            DATED_NANOS
        } else if self.counted.messages > 0 && self.counted.first_nanos <= SOON_NANOS {
            0
        } else {
            1
        }
    }

    /// The messages with log times from the least one of the recording on.
    fn timed_from(&self, least: u64) -> Span {
        let mut span = self.dated;
        if least < DATED_NANOS {
            span.add(&self.counted);
        }
        if least == 0 && self.zeros > 0 {
            span.add(&Span {
                messages: self.zeros,
                first_nanos: 0,
                last_nanos: 0,
            });
        }
        span
    }

    /// The earliest and the latest time, `None` if no message has one.
    pub(super) fn span(&self, least: u64) -> Option<(u64, u64)> {
        let span = self.timed_from(least);
        (span.messages > 0).then_some((span.first_nanos, span.last_nanos))
    }

    /// Messages that have a time.
    pub(super) fn timed(&self, least: u64) -> u64 {
        self.timed_from(least).messages
    }

    /// All messages.
    pub(super) const fn messages(&self) -> u64 {
        self.zeros + self.counted.messages + self.dated.messages
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: u64 = 1_700_000_000_000_000_000;

    fn times(of: &[u64]) -> LogTimes {
        let mut times = LogTimes::default();
        for nanos in of {
            times.add(*nanos);
        }
        times
    }

    #[test]
    fn the_clock_begins_at_the_first_time_that_is_one() {
        let times = times(&[0, 0, 7, NOW + 5, NOW, NOW + 9]);
        let least = times.least();
        assert!(least > 7 && least < NOW);
        assert_eq!(times.span(least), Some((NOW, NOW + 9)));
        assert_eq!((times.timed(least), times.messages()), (3, 6));
    }

    #[test]
    fn clocks_of_simulations_count_from_their_own_start() {
        let late = times(&[0, 9_000_000_000, 3_000_000_000]);
        assert_eq!(
            late.span(late.least()),
            Some((3_000_000_000, 9_000_000_000))
        );
        let from_0 = times(&[0, 100_000_000, 200_000_000]);
        assert_eq!(from_0.span(from_0.least()), Some((0, 200_000_000)));
        let none = times(&[0, 0]);
        assert_eq!(
            (none.span(none.least()), none.timed(none.least())),
            (None, 0)
        );
    }
}
