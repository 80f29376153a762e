//! The progress line of a run: one line of standard error that is redrawn in place, on a terminal only.

use std::collections::{BTreeMap, VecDeque};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use indicatif::{HumanDuration, ProgressBar, ProgressDrawTarget, ProgressStyle};
use modulo_launch::NodeReport;
use modulo_runtime::report::{Histogram, quantile};
use modulo_runtime::{Clock as _, SystemClock};

use super::terminal::{LINE, takes_log};

/// Returns the style of a line in the form of `template`.
pub fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).expect("the templates of this program are valid")
}

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
        if !self.is_shown() || !takes_log() || drawn.is_some_and(|drawn| now.saturating_sub(drawn) < PAUSE) {
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

/// The progress of frames: a bar on a terminal, else a line a minute.
pub struct FrameProgress {
    bar: ProgressBar,
    clock: SystemClock,
    lines: Mutex<MinuteLines>,
}

impl FrameProgress {
    pub fn new() -> Self {
        // The message is cut where the line ends.
        let bar =
            ProgressBar::new(0).with_style(style("{bar:20} {pos}/{len} frames, {eta} left: {wide_msg}"));
        Self { bar, clock: SystemClock::default(), lines: Mutex::default() }
    }

    /// Begins something after `done` of `all` frames.
    pub fn begin(&self, (done, all): (u64, u64), name: &str) {
        self.bar.set_length(all);
        self.bar.set_position(done);
        if done == 0 {
            self.with_lines(|lines, now| lines.begin(now));
        }
        self.bar.set_message(name.to_owned());
    }

    /// Counts a frame.
    pub fn frame(&self) {
        self.bar.inc(1);
        if self.bar.is_hidden() {
            let (done, all) = (self.bar.position(), self.bar.length().unwrap_or_default());
            let line = self.with_lines(|lines, now| lines.line(now, done, all));
            line.iter().for_each(|line| note!("modulo: {line}"));
        }
    }

    /// Prints a line beside the bar.
    pub fn warn(&self, warning: &str) {
        self.bar.suspend(|| note!("modulo: {warning}"));
    }

    /// Takes the bar away.
    pub fn end(&self) {
        self.bar.finish_and_clear();
    }

    /// Passes the lines and the present time to `with`.
    fn with_lines<T>(&self, with: impl FnOnce(&mut MinuteLines, Duration) -> T) -> T {
        // Workers finish frames in parallel.
        let mut lines = self.lines.lock().unwrap_or_else(PoisonError::into_inner);
        with(&mut lines, Duration::from_nanos(self.clock.ticks_ns()))
    }
}

/// The progress without a terminal: a line a minute.
#[derive(Default)]
struct MinuteLines {
    /// The start of the present pass over the cells.
    start: Duration,
    /// The time of the last line, or the start.
    last: Duration,
}

impl MinuteLines {
    /// Begins a pass at the time `now`; its first line comes a minute later.
    fn begin(&mut self, now: Duration) {
        (self.start, self.last) = (now, now);
    }

    /// Returns the line that is due at the time `now`, with `done` of `all` frames of the pass.
    fn line(&mut self, now: Duration, done: u64, all: u64) -> Option<String> {
        if done == 0 || now < self.last + Duration::from_secs(60) {
            return None;
        }
        self.last = now;
        let left = all.saturating_sub(done);
        let to_go = HumanDuration((now - self.start).mul_f64(left as f64 / done as f64));
        Some(format!("{done} of {all} frames done, {left} left, {to_go} to go"))
    }
}

/// Stages that each frame passes once, the last one on the path of a frame first.
const STAGES: [&str; 3] = ["infer", "unwrap", "sense"];
/// The rate is measured over this time.
const WINDOW: Duration = Duration::from_secs(3);

#[derive(Clone, Debug, Default)]
struct Progress {
    /// The last stage that a frame has passed.
    stage: &'static str,
    /// (time since the start, number of frames at that time), the oldest first.
    counts: VecDeque<(Duration, u64)>,
}

impl Progress {
    /// Returns the line for the time `now` since the start of the run, such as `frames 42, 17.6 Hz, infer 29.7 ms (p50)`:
    /// the frames that have passed the last stage, their rate over the last 3 s once it is known, and the median
    /// duration of that stage.
    fn line(&mut self, reports: &[NodeReport], now: Duration) -> String {
        let Some((stage, frames, durations)) = last_stage(reports) else {
            return "waiting for the first frame".to_owned();
        };
        // The counts of another stage are not comparable, so the rate starts anew.
        if stage != self.stage {
            *self = Self { stage, ..Self::default() };
        }
        // The newest count that is older than the window stays, so that the rate covers all of the window.
        while self.counts.get(1).is_some_and(|(time, _)| now.saturating_sub(*time) >= WINDOW) {
            self.counts.pop_front();
        }
        self.counts.push_back((now, frames));
        let (since, before) = self.counts[0];
        let seconds = now.saturating_sub(since).as_secs_f64();
        let rate = frames.saturating_sub(before) as f64 / seconds;
        let rate = if seconds > 0.0 { format!("{rate:.1} Hz, ") } else { String::new() };
        let ms = quantile(&durations, 0.5).map_or(0.0, |us| us as f64 / 1000.0);
        format!("frames {frames}, {rate}{stage} {ms:.1} ms (p50)")
    }
}

/// Returns the last stage that a frame has passed, the number of its frames, and its durations in all nodes. Where
/// several nodes have the stage, the number is that of the node with the fewest frames.
fn last_stage(reports: &[NodeReport]) -> Option<(&'static str, u64, Histogram)> {
    let stage =
        STAGES.into_iter().find(|stage| reports.iter().any(|report| report.stages.contains_key(*stage)))?;
    let (mut frames, mut durations) = (BTreeMap::<&str, u64>::new(), Histogram::new());
    for (report, buckets) in reports.iter().filter_map(|report| Some((report, report.stages.get(stage)?))) {
        // A node that was restarted has a report for each of its lives.
        *frames.entry(&report.node).or_default() += buckets.values().sum::<u64>();
        buckets.iter().for_each(|(bound, count)| *durations.entry(*bound).or_default() += count);
    }
    let fewest = frames.into_values().min()?;
    Some((stage, fewest, durations))
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

    /// A report of `node` with `count` durations of 20 ms in `stage`.
    fn report(node: &str, stage: &str, count: u64) -> NodeReport {
        NodeReport { stages: [(stage.to_owned(), [(20_000, count)].into())].into(), ..NodeReport::new(node) }
    }

    #[test]
    fn the_rate_is_that_of_the_last_seconds() {
        let mut progress = Progress::default();
        let mut line = |seconds, count| {
            progress.line(
                &[report("/d", "infer", count), report("/u", "unwrap", 99)],
                Duration::from_secs(seconds),
            )
        };
        assert_eq!(line(1, 10), "frames 10, infer 20.0 ms (p50)");
        assert_eq!(line(2, 20), "frames 20, 10.0 Hz, infer 20.0 ms (p50)");
        assert_eq!(line(5, 20), "frames 20, 0.0 Hz, infer 20.0 ms (p50)");
        assert_eq!(line(6, 60), "frames 60, 10.0 Hz, infer 20.0 ms (p50)");
    }

    #[test]
    fn the_lives_of_a_node_are_added_and_the_slowest_node_counts() {
        let mut progress = Progress::default();
        assert_eq!(progress.line(&[NodeReport::new("/d")], Duration::ZERO), "waiting for the first frame");
        let reports = [report("/a", "infer", 3), report("/a", "infer", 4), report("/b", "infer", 9)];
        assert_eq!(progress.line(&reports, Duration::ZERO), "frames 7, infer 20.0 ms (p50)");
        let reports = [report("/s", "sense", 5), report("/u", "unwrap", 4)];
        assert!(progress.line(&reports, Duration::ZERO).starts_with("frames 4, unwrap"));
    }
}
