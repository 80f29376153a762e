//! The only file of the crate that reads a clock. Durations are reported; they decide nothing.

use std::time::Instant;

/// The result of `work` and its duration in ms.
pub(crate) fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = work();
    (result, start.elapsed().as_secs_f64() * 1e3)
}
