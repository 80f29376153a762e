//! Measures of the similarity of a recovered picture and the true one.
//!
//! Pictures are compared as they are shown: 8 bits a sample, with the same linear scale for both
//! ([`crate::tone::linear8`]).

mod ssim;

use ndarray::Array3;

pub use ssim::{LEAST_SIDE, ssim};

/// Error: the pictures have different shapes and cannot be compared.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("pictures of {left:?} and {right:?} (rows, columns, channels) cannot be compared")]
pub struct ShapesDiffer {
    /// The shape of the first.
    pub left: (usize, usize, usize),
    /// The shape of the second.
    pub right: (usize, usize, usize),
}

fn check_shapes(left: (usize, usize, usize), right: (usize, usize, usize)) -> Result<(), ShapesDiffer> {
    if left == right { Ok(()) } else { Err(ShapesDiffer { left, right }) }
}

/// Returns the share, 0 to 1, of samples of all channels whose wrap count is the true one; no offset is removed.
///
/// # Errors
/// [`ShapesDiffer`] when the shapes differ.
pub fn exact_share(found: &Array3<u8>, truth: &Array3<u8>) -> Result<f64, ShapesDiffer> {
    check_shapes(found.dim(), truth.dim())?;
    let exact = found.iter().zip(truth).filter(|(a, b)| a == b).count();
    Ok(exact as f64 / truth.len().max(1) as f64)
}

/// Returns the mean of the squared differences over all samples of all channels, 0 to 255^2.
///
/// # Errors
/// [`ShapesDiffer`] when the shapes differ.
pub fn mse(left: &Array3<u8>, right: &Array3<u8>) -> Result<f64, ShapesDiffer> {
    check_shapes(left.dim(), right.dim())?;
    let squares = left.iter().zip(right).map(|(&a, &b)| u64::from(a.abs_diff(b)).pow(2));
    Ok(squares.sum::<u64>() as f64 / left.len().max(1) as f64)
}

/// Returns `10 log10(255^2 / mse)` in dB, and `None` if nothing differs and the ratio is infinite.
pub fn psnr_db(mse: f64) -> Option<f64> {
    (mse > 0.0).then(|| 10.0 * (255.0 * 255.0 / mse).log10())
}

/// Returns the quantile of `sorted` values by the nearest rank: the least value that a share of at least `q` (0
/// to 1) of them does not exceed. It is one of the values, never a mean of two, and `None` if there is no value.
pub fn quantile<T: Copy>(sorted: &[T], q: f64) -> Option<T> {
    let rank = (q * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_samples() {
        let truth = Array3::from_shape_fn((2, 2, 3), |(i, j, c)| (i + j + c) as u8);
        let mut found = truth.clone();
        found[(1, 0, 2)] += 1;
        assert_eq!(exact_share(&found, &truth), Ok(11.0 / 12.0));
        assert!(exact_share(&Array3::zeros((2, 3, 2)), &truth).is_err());
    }

    #[test]
    fn is_the_ratio_to_the_peak() {
        let zero = Array3::zeros((3, 5, 3));
        let full = Array3::from_elem((3, 5, 3), 255);
        assert_eq!(psnr_db(mse(&zero, &full).unwrap()), Some(0.0));
        assert_eq!(psnr_db(mse(&full, &full).unwrap()), None);
        // One of 45 samples off by 3: mse = 9 / 45.
        let mut near = full.clone();
        near[(2, 4, 1)] = 252;
        let got = psnr_db(mse(&near, &full).unwrap()).unwrap();
        assert!((got - 10.0 * (65025.0f64 / 0.2).log10()).abs() < 1e-12, "{got}");
        assert!(mse(&zero, &Array3::zeros((3, 5, 1))).is_err());
    }

    #[test]
    fn quantiles_are_those_of_numpys_inverted_cdf() {
        let got = [0.0, 0.05, 0.25, 0.5, 0.75, 0.76, 1.0].map(|q| quantile(&[1, 2, 4, 8], q));
        // numpy.quantile([1, 2, 4, 8], [0, .05, .25, .5, .75, .76, 1], method="inverted_cdf")
        assert_eq!(got, [1, 1, 1, 2, 4, 8, 8].map(Some));
        assert_eq!(quantile::<f64>(&[], 0.5), None);
    }
}
