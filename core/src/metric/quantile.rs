//! Quantiles by the nearest rank, for all durations that are reported.

/// The least of the `sorted` values that is not exceeded by a share of at least `q` (0 to 1) of them; it is one of
/// the values, never a mean of two. `None` without values.
pub fn quantile<T: Copy>(sorted: &[T], q: f64) -> Option<T> {
    let rank = (q * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_numpys_inverted_cdf() {
        let got = [0.0, 0.05, 0.25, 0.5, 0.75, 0.76, 1.0].map(|q| quantile(&[1, 2, 4, 8], q));
        // numpy.quantile([1, 2, 4, 8], [0, .05, .25, .5, .75, .76, 1], method="inverted_cdf")
        assert_eq!(got, [1, 1, 1, 2, 4, 8, 8].map(Some));
        assert_eq!(quantile::<f64>(&[], 0.5), None);
    }
}
