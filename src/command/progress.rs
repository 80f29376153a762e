//! The progress line of a run: one line of standard error that is redrawn in place, on a terminal only.

use std::io::{self, Write};
use std::sync::{LazyLock, Mutex, PoisonError};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget};
use modulo_launch::{NodeReport, Progress, supervisor::Channel};
use modulo_runtime::{Clock as _, SystemClock};

use super::bench::style;

/// The line on the screen; hidden while nothing runs.
static LINE: LazyLock<ProgressBar> = LazyLock::new(ProgressBar::hidden);
/// Shortest time between two texts of the line.
const PAUSE: Duration = Duration::from_millis(100);

/// The progress line of one run. It disappears when this is dropped.
pub struct ProgressLine {
    clock: SystemClock,
    start: Duration,
    /// The progress, and the time of the last text.
    state: Mutex<(Progress, Option<Duration>)>,
}

impl ProgressLine {
    /// Shows the line if standard error is a terminal that can redraw a line.
    pub fn start() -> Self {
        // After the line of an earlier run.
        LINE.reset();
        LINE.set_style(style("{wide_msg}"));
        LINE.set_draw_target(ProgressDrawTarget::stderr());
        let clock = SystemClock::default();
        Self { start: Duration::from_nanos(clock.ticks_ns()), clock, state: Mutex::default() }
    }

    /// Whether there is a line to redraw.
    pub fn is_shown(&self) -> bool {
        !LINE.is_hidden()
    }

    /// Redraws the line from the reports of the nodes, at most ten times a second.
    pub fn show(&self, reports: impl FnOnce() -> Vec<NodeReport>) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let (progress, drawn) = &mut *state;
        let now = Duration::from_nanos(self.clock.ticks_ns()).saturating_sub(self.start);
        // To collect the reports takes time, so it is done only for a text that is shown.
        if !self.is_shown() || drawn.is_some_and(|drawn| now.saturating_sub(drawn) < PAUSE) {
            return;
        }
        *drawn = Some(now);
        LINE.set_message(progress.line(&reports(), now));
    }
}

impl Drop for ProgressLine {
    fn drop(&mut self) {
        LINE.finish_and_clear();
        // A line of the log that comes later must not bring the progress line back.
        LINE.set_draw_target(ProgressDrawTarget::hidden());
    }
}

/// Writes a line above the progress line. A closed terminal is no reason to end.
pub fn print(channel: Channel, line: &str) {
    let _ = LINE.suspend(|| match channel {
        Channel::Out => writeln!(io::stdout().lock(), "{line}"),
        Channel::Err => writeln!(io::stderr().lock(), "{line}"),
    });
}

/// Standard error for the log: its lines are written above the progress line.
pub struct LogWriter;

impl Write for LogWriter {
    fn write(&mut self, text: &[u8]) -> io::Result<usize> {
        LINE.suspend(|| io::stderr().write(text))
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stderr().flush()
    }
}
