//! The progress line of a run: one line of standard error that is redrawn in place, on a terminal only.

use std::io::{self, Write};
use std::sync::{LazyLock, Mutex, PoisonError};
use std::time::Duration;

use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget};
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

/// The progress of a grid without a terminal: a line a minute.
#[derive(Default)]
pub struct MinuteLines {
    /// The start of the present pass over the cells.
    start: Duration,
    /// The time of the last line, or the start.
    last: Duration,
}

impl MinuteLines {
    /// Begins a pass at the time `now`; its first line comes a minute later.
    pub fn begin(&mut self, now: Duration) {
        (self.start, self.last) = (now, now);
    }

    /// Returns the line that is due at the time `now`, with `done` of `all` frames of the pass.
    pub fn line(&mut self, now: Duration, done: u64, all: u64) -> Option<String> {
        if done == 0 || now < self.last + Duration::from_secs(60) {
            return None;
        }
        self.last = now;
        let left = all.saturating_sub(done);
        let to_go = HumanDuration((now - self.start).mul_f64(left as f64 / done as f64));
        Some(format!("{done} of {all} frames done, {left} left, {to_go} to go"))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_a_minute_says_what_is_left() {
        let mut lines = MinuteLines::default();
        let mut line = |seconds, done| lines.line(Duration::from_secs(seconds), done, 400);
        assert_eq!(line(59, 50), None);
        assert_eq!(line(60, 100).as_deref(), Some("100 of 400 frames done, 300 left, 3 minutes to go"));
        assert_eq!(line(119, 200), None);
        assert_eq!(line(120, 300).as_deref(), Some("300 of 400 frames done, 100 left, 40 seconds to go"));
        assert_eq!(line(300, 0), None, "nothing is known yet");
        lines.begin(Duration::from_secs(300));
        assert_eq!(lines.line(Duration::from_secs(359), 1, 4), None);
        let line = lines.line(Duration::from_secs(360), 1, 4);
        assert_eq!(line.as_deref(), Some("1 of 4 frames done, 3 left, 3 minutes to go"));
    }
}
