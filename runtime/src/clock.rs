//! [`Clock`]: the source of stamps and durations. This is the only file that reads the clock of the machine; all other
//! code is given a clock.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use nix::sys::time::TimeValLike;
use nix::time::{ClockId, clock_gettime};

/// Returns a duration in whole nanoseconds; `u64::MAX` for one of 584 years or more.
pub fn nanos(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

/// A source of stamps and durations.
pub trait Clock: Send + Sync {
    /// Returns the nanoseconds since the Unix epoch.
    fn now_ns(&self) -> u64;
    /// Returns the nanoseconds of a monotonic counter with an arbitrary origin; only differences mean anything.
    fn ticks_ns(&self) -> u64;
}

/// Returns the processor time of all threads of this process so far, ns.
pub fn cpu_time_ns() -> u64 {
    let time = clock_gettime(ClockId::CLOCK_PROCESS_CPUTIME_ID).expect("Linux has this clock since 2.6");
    u64::try_from(time.num_nanoseconds()).expect("processor time is never negative")
}

/// Returns the nanoseconds since the machine has started, the same in all its processes.
pub fn monotonic_ns() -> u64 {
    let time = clock_gettime(ClockId::CLOCK_MONOTONIC).expect("Linux has this clock since 2.6");
    u64::try_from(time.num_nanoseconds()).expect("this time is never negative")
}

/// The clock of the machine.
#[derive(Debug, Clone)]
pub struct SystemClock {
    origin: Instant,
}

impl Default for SystemClock {
    fn default() -> Self {
        Self { origin: Instant::now() }
    }
}

impl Clock for SystemClock {
    fn now_ns(&self) -> u64 {
        // A machine whose clock is before 1970 counts as one at the epoch; stamps have no sign.
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        nanos(since)
    }

    fn ticks_ns(&self) -> u64 {
        nanos(self.origin.elapsed())
    }
}

/// A clock that stands still until it is set: lockstep and tests.
#[derive(Debug, Default)]
pub struct ManualClock {
    now: AtomicU64,
}

impl ManualClock {
    /// Creates a clock that shows `now` nanoseconds since the epoch.
    pub fn at(now: u64) -> Self {
        Self { now: AtomicU64::new(now) }
    }

    /// Sets the time, nanoseconds since the epoch.
    pub fn set(&self, now: u64) {
        self.now.store(now, Ordering::Relaxed);
    }
}

impl Clock for ManualClock {
    fn now_ns(&self) -> u64 {
        self.now.load(Ordering::Relaxed)
    }

    fn ticks_ns(&self) -> u64 {
        self.now.load(Ordering::Relaxed)
    }
}
