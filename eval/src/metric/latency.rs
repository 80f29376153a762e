//! Quantiles of durations, from the durations themselves.

use std::collections::BTreeMap;

use crate::results::Percentiles;

/// What a latency is.
pub fn definition() -> &'static str {
    "Wall clock of one stage on one frame, ms; p50, p95 and p99 over the frames of the cell (the smallest \
     duration that is not exceeded by that share). An image equal to one that the same model saw before in the \
     same frame of another cell is not detected again: it keeps the durations of then. threads: of one \
     inference; jobs: frames worked on side by side."
}

/// Quantiles by stage; a stage that comes twice in a frame counts with its sum.
pub fn by_stage<'a>(
    frames: impl Iterator<Item = &'a [(&'static str, u64)]>,
) -> BTreeMap<String, Percentiles> {
    let mut stages: BTreeMap<&str, Vec<u64>> = BTreeMap::new();
    for frame in frames {
        let mut sums: BTreeMap<&str, u64> = BTreeMap::new();
        frame.iter().for_each(|(stage, ns)| *sums.entry(stage).or_default() += ns);
        sums.into_iter().for_each(|(stage, ns)| stages.entry(stage).or_default().push(ns));
    }
    stages.into_iter().map(|(stage, durations)| (stage.to_owned(), percentiles(durations))).collect()
}

fn percentiles(mut ns: Vec<u64>) -> Percentiles {
    ns.sort_unstable();
    let at = |q: f64| {
        let rank = (q * ns.len() as f64).ceil() as usize;
        ns.get(rank.saturating_sub(1)).map_or(0.0, |ns| *ns as f64 / 1e6)
    };
    Percentiles { p50: at(0.50), p95: at(0.95), p99: at(0.99) }
}

#[cfg(test)]
mod tests {
    use super::*;

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
