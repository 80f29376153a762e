//! [`Activity`]: whether a process computes, which tells a long step from a hang.

use std::time::Duration;

/// A process that used the processor for this share of a time has computed in it, as in a step of a large model ...
const BUSY: f64 = 0.05;
/// ... and gets so many times the patience with a process that has not.
pub(super) const LONG_STEP: u32 = 20;

/// The use of the processor by one process.
pub(super) struct Activity {
    id: i32,
    used: Duration,
}

impl Activity {
    pub fn of(id: i32) -> Self {
        Self { id, used: used(id) }
    }

    /// Returns whether the process has computed since the last look, which was `time` ago.
    pub fn was_busy(&mut self, time: Duration) -> bool {
        let before = std::mem::replace(&mut self.used, used(self.id));
        self.used.saturating_sub(before) >= time.mul_f64(BUSY)
    }
}

/// Returns the time that all threads of the process `id` have used the processor; zero where the system does not tell.
fn used(id: i32) -> Duration {
    let stat = std::fs::read_to_string(format!("/proc/{id}/stat")).unwrap_or_default();
    // The name of the program comes before these fields, and may have spaces and brackets itself.
    let fields = stat.rsplit(") ").next().unwrap_or_default().split(' ');
    // `utime` and `stime` of proc(5), in hundredths of a second.
    let hundredths: u64 = fields.skip(11).take(2).filter_map(|field| field.parse::<u64>().ok()).sum();
    Duration::from_millis(10 * hundredths)
}
