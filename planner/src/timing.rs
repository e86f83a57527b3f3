//! Clocks that measure planning; they never decide what is planned, except through a time limit.

use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};

/// A processor-time clock that was read once.
#[derive(Debug, Clone, Copy)]
pub struct CpuTimer {
    clock: ClockId,
    start: Duration,
}

impl CpuTimer {
    /// Starts to count the calling thread's processor time; read it on the same thread.
    pub fn of_thread() -> Self {
        Self::start(ClockId::ThreadCPUTime)
    }

    /// Starts to count the processor time of all threads of the process.
    pub fn of_process() -> Self {
        Self::start(ClockId::ProcessCPUTime)
    }

    fn start(clock: ClockId) -> Self {
        Self {
            clock,
            start: read(clock),
        }
    }

    /// Processor time since the start.
    pub fn elapsed(&self) -> Duration {
        read(self.clock).saturating_sub(self.start)
    }
}

fn read(clock: ClockId) -> Duration {
    Duration::try_from(clock_gettime(clock)).unwrap_or_default()
}

/// A duration in milliseconds.
pub fn millis(duration: Duration) -> f64 {
    duration.as_secs_f64() * 1e3
}
