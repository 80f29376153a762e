//! [`Progress`]: the frames, the rate and the latency of a run, from the reports that its nodes keep while they run.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use modulo_runtime::report::{Histogram, quantile};

use crate::summary::NodeReport;

/// Stages that each frame passes once, the last one on the path of a frame first.
const STAGES: [&str; 3] = ["infer", "unwrap", "sense"];
/// The rate is measured over this time.
const WINDOW: Duration = Duration::from_secs(3);

/// The progress of a run.
#[derive(Clone, Debug, Default)]
pub struct Progress {
    /// The last stage that a frame has passed.
    stage: &'static str,
    /// (time since the start, number of frames at that time), the oldest first.
    counts: VecDeque<(Duration, u64)>,
}

impl Progress {
    /// Returns the line for the time `now` since the start of the run, such as `frames 42, 17.6 Hz, infer 29.7 ms (p50)`:
    /// the frames that have passed the last stage, their rate over the last 3 s once it is known, and the median
    /// duration of that stage.
    pub fn line(&mut self, reports: &[NodeReport], now: Duration) -> String {
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
