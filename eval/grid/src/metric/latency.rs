//! Quantiles of durations.

use std::collections::BTreeMap;

use modulo_core::metric::quantile;
use modulo_runtime::report::Percentiles;

/// The definition of a latency for the report.
pub const DEFINITION: &str = "\
    Wall-clock time of one stage on one frame, ms; p50, p95 and p99 over the first frames of the data, all of them again where there are fewer (the smallest \
    duration that is not exceeded by that share). Measured in a pass of its own after all cells are scored: one \
    frame at a time, the cells in turn and in changing order on each frame, every image detected anew, after one frame of \
    each size to warm up. \
    frame_ms: the sum of all stages but sense, its median with the 95 % interval (order statistics), and the median \
    processor time of all threads. Only times of one pass are compared. threads: threads of one inference.";

/// Quantiles of each stage. Durations of a stage that occurs twice in a frame are added.
pub fn by_stage<'a>(
    frames: impl Iterator<Item = &'a [(&'static str, u64)]>,
) -> BTreeMap<String, Percentiles> {
    let mut stages: BTreeMap<&str, Vec<u64>> = BTreeMap::new();
    for frame in frames {
        // Durations are added within a frame first. Otherwise the percentiles would be over parts of frames.
        let mut sums: BTreeMap<&str, u64> = BTreeMap::new();
        frame.iter().for_each(|(stage, ns)| *sums.entry(stage).or_default() += ns);
        sums.into_iter().for_each(|(stage, ns)| stages.entry(stage).or_default().push(ns));
    }
    stages.into_iter().map(|(stage, durations)| (stage.to_owned(), percentiles(durations))).collect()
}

/// Median of `sorted` values and the bounds of its 95 % interval. `None` without a value.
///
/// The bounds are order statistics: the number of values below the true median is binomial with n and 1/2.
pub fn median(sorted: &[f64]) -> Option<(f64, [f64; 2])> {
    let n = sorted.len() as f64;
    let half_width = 1.96 * n.sqrt() / 2.0;
    let at = |rank: f64| sorted.get((rank.max(1.0) as usize).min(sorted.len()).checked_sub(1)?).copied();
    Some((
        quantile(sorted, 0.5)?,
        [at((n / 2.0 - half_width).floor())?, at((1.0 + n / 2.0 + half_width).ceil())?],
    ))
}

fn percentiles(mut ns: Vec<u64>) -> Percentiles {
    ns.sort_unstable();
    Percentiles::of(|q| quantile(&ns, q).map(|ns| ns as f64 / 1e6))
        .expect("a stage is listed with its first duration")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The ranks of the interval for n = 20 are 6 and 15 by the exact binomial table, and at most one rank wider here.
    #[test]
    fn the_interval_of_a_median_contains_it() {
        let sorted: Vec<f64> = (1..=20).map(f64::from).collect();
        assert_eq!(median(&sorted), Some((10.0, [5.0, 16.0])));
        assert_eq!(median(&[3.0]), Some((3.0, [3.0, 3.0])));
        assert_eq!(median(&[]), None);
    }

    #[test]
    fn quantiles_are_durations_that_happened() {
        let frames: Vec<Vec<(&'static str, u64)>> =
            (1..=100).map(|ms| vec![("infer", ms * 1_000_000), ("pre", 1), ("pre", 2)]).collect();
        let stages = by_stage(frames.iter().map(|frame| &frame[..]));
        assert_eq!(stages["infer"], Percentiles { p50: 50.0, p95: 95.0, p99: 99.0 });
        assert_eq!(stages["pre"].p50, 3e-6);
        assert!(by_stage([].into_iter()).is_empty());
    }
}
