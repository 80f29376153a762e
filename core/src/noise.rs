//! Sensor noise, drawn from a seed: the same seed gives the same bytes.

use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

/// Adds Gaussian noise of variance `shot * x + read^2` to every sample of `x` (>= 0, code units).
///
/// Shot and read noise are independent, so that one deviate stands for both.
pub(crate) fn add(x: &mut [f32], shot: f64, read: f64, seed: u64) {
    if shot == 0.0 && read == 0.0 {
        return;
    }
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    for sample in x {
        let sigma = (shot * f64::from(*sample) + read * read).sqrt();
        let deviate: f64 = StandardNormal.sample(&mut random);
        *sample += (sigma * deviate) as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variance_is_shot_and_read_together() {
        let mut x = vec![400.0; 100_000];
        add(&mut x, 0.25, 5.0, 7);
        let mean = x.iter().map(|v| f64::from(*v)).sum::<f64>() / x.len() as f64;
        let variance = x.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>() / x.len() as f64;
        assert!((mean - 400.0).abs() < 0.2, "mean {mean}");
        assert!((variance - 125.0).abs() < 3.0, "variance {variance}");
    }
}
