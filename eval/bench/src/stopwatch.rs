//! The one place of the studies that reads a clock: durations to report, never anything that decides.

use std::time::Instant;

/// What `work` gives, and how long it took, ms.
pub(crate) fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = work();
    (result, start.elapsed().as_secs_f64() * 1e3)
}
