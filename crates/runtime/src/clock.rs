//! [`Clock`]: the source of stamps and durations. This is the only file that reads the clock of the machine.

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
pub(crate) fn monotonic_ns() -> u64 {
    let time = clock_gettime(ClockId::CLOCK_MONOTONIC).expect("Linux has this clock since 2.6");
    u64::try_from(time.num_nanoseconds()).expect("this time is never negative")
}

/// Returns the date and the time in UTC of a time in seconds since the Unix epoch, as `2026-11-24 06:12:04`.
///
/// Source: <https://howardhinnant.github.io/date_algorithms.html>, `civil_from_days`
pub fn utc(seconds: u64) -> String {
    // Years begin in March here, so that a leap day is the last day of one. The epoch is day 719,468 since 0000-03-01.
    let days = seconds / 86_400 + 719_468;
    let (era, day) = (days / 146_097, days % 146_097);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let day = day - (365 * year + year / 4 - year / 100);
    let month = (5 * day + 2) / 153;
    let day = day - (153 * month + 2) / 5 + 1;
    let (year, month) = if month < 10 { (year, month + 3) } else { (year + 1, month - 9) };
    let (year, hour) = (400 * era + year, seconds / 3600 % 24);
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{:02}:{:02}", seconds / 60 % 60, seconds % 60)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_have_leap_days() {
        for (seconds, date) in [
            (0, "1970-01-01 00:00:00"),
            (951_782_399, "2000-02-28 23:59:59"),
            (951_782_400, "2000-02-29 00:00:00"),
            (1_735_689_599, "2024-12-31 23:59:59"),
            (4_107_542_400, "2100-03-01 00:00:00"),
            (u64::MAX / 1_000_000_000, "2554-07-21 23:34:33"),
        ] {
            assert_eq!(utc(seconds), date);
        }
    }
}
