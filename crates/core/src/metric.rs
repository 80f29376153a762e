//! Measures of the similarity of a recovered picture and the true one.
//!
//! Pictures are compared as they are shown: 8 bits a sample, with the same linear scale for both
//! ([`crate::tone::linear8`]).

use ndarray::Array3;

use crate::frame::in_order;
use crate::simd::widest;

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

/// Returns the mean of the squared differences over all samples of all channels, 0 to 255^2.
///
/// # Errors
/// [`ShapesDiffer`] when the shapes differ.
pub fn mse(left: &Array3<u8>, right: &Array3<u8>) -> Result<f64, ShapesDiffer> {
    check_shapes(left.dim(), right.dim())?;
    // Squares are summed as integers, so the result does not depend on the order of the samples.
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
    // Ranks count from 1; rank 0, which q = 0 gives, means the least value as well.
    let rank = (q * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).copied()
}

/// The side of the window in px; a picture with a shorter side has no SSIM.
pub const LEAST_SIDE: usize = 11;

const SIGMA: f64 = 1.5;
/// The constants (0.01 * 255)^2 and (0.03 * 255)^2.
const C1: f64 = 6.5025;
const C2: f64 = 58.5225;

/// The number of weighted sums under a window: of a, b, a^2 + b^2 and ab, a row of samples each.
const MOMENTS: usize = 4;

/// Returns the mean structural similarity (Wang, Bovik, Sheikh, Simoncelli 2004), -1 to 1, over all positions and
/// channels, or `None` when a side is shorter than [`LEAST_SIDE`]. The window is an 11 x 11 Gaussian of sigma 1.5 px at
/// every position where it fits, `K1 = 0.01`, `K2 = 0.03`, the peak is 255, and the covariance has no sample
/// correction.
///
/// # Errors
/// [`ShapesDiffer`] when the shapes differ.
pub fn ssim(left: &Array3<u8>, right: &Array3<u8>) -> Result<Option<f64>, ShapesDiffer> {
    check_shapes(left.dim(), right.dim())?;
    let (height, width, channels) = left.dim();
    if height.min(width) < LEAST_SIDE || channels == 0 {
        return Ok(None);
    }
    let (left, right) = (left.as_standard_layout(), right.as_standard_layout());
    let (a, b) = (in_order(left.view()), in_order(right.view()));
    let sum = widest!(sum_over_windows(a, b, width * channels, channels));
    let places = (height - LEAST_SIDE + 1) * (width - LEAST_SIDE + 1);
    Ok(Some(sum / (places * channels) as f64))
}

fn window() -> [f64; LEAST_SIDE] {
    let middle = (LEAST_SIDE / 2) as f64;
    let weights: [f64; LEAST_SIDE] =
        std::array::from_fn(|i| (-0.5 * ((i as f64 - middle) / SIGMA).powi(2)).exp());
    let sum: f64 = weights.iter().sum();
    weights.map(|weight| weight / sum)
}

/// Returns the sum of the SSIM of every window of every channel; rows are `stride` interleaved samples.
#[inline(always)]
fn sum_over_windows(a: &[u8], b: &[u8], stride: usize, channels: usize) -> f64 {
    let window = window();
    // A window is separable: sums along the rows first, then down the columns.
    // The window must fit, so the last ten pixels of a row start none.
    let inner = stride - (LEAST_SIDE - 1) * channels;
    // The sums along the last eleven rows, row r in place r mod 11, so that each row is summed once.
    let mut along = vec![vec![0.0; MOMENTS * inner]; LEAST_SIDE];
    let mut products = vec![0.0; MOMENTS * stride];
    let mut under = vec![0.0; MOMENTS * inner];
    let mut sum = 0.0;
    for (row, (a, b)) in a.chunks_exact(stride).zip(b.chunks_exact(stride)).enumerate() {
        multiply(a, b, &mut products);
        let sums = &mut along[row % LEAST_SIDE];
        sums.fill(0.0);
        for (sums, products) in sums.chunks_exact_mut(inner).zip(products.chunks_exact(stride)) {
            window.iter().enumerate().for_each(|(t, &weight)| add(sums, &products[t * channels..], weight));
        }
        // The first ten rows complete no window.
        let Some(top) = (row + 1).checked_sub(LEAST_SIDE) else { continue };
        under.fill(0.0);
        for (below, &weight) in (top..).zip(&window) {
            add(&mut under, &along[below % LEAST_SIDE], weight);
        }
        sum += of_row(&under, inner);
    }
    sum
}

/// Writes the rows a, b, a^2 + b^2 and ab of `products`.
#[inline(always)]
fn multiply(a: &[u8], b: &[u8], products: &mut [f64]) {
    let (means, squares) = products.split_at_mut(2 * a.len());
    let ((to_a, to_b), (to_squares, to_ab)) = (means.split_at_mut(a.len()), squares.split_at_mut(a.len()));
    let to = to_a.iter_mut().zip(to_b).zip(to_squares.iter_mut().zip(to_ab));
    for ((&a, &b), ((to_a, to_b), (to_squares, to_ab))) in a.iter().zip(b).zip(to) {
        let (a, b) = (f64::from(a), f64::from(b));
        (*to_a, *to_b, *to_squares, *to_ab) = (a, b, a * a + b * b, a * b);
    }
}

/// Returns the sum of the SSIM of the windows of one row.
#[inline(always)]
fn of_row(moments: &[f64], inner: usize) -> f64 {
    let [a, b, squares, ab] = [0, 1, 2, 3].map(|moment| &moments[moment * inner..][..inner]);
    let mut sum = 0.0;
    for i in 0..inner {
        let (mean, power) = (a[i] * b[i], a[i] * a[i] + b[i] * b[i]);
        // The sum of both variances is enough, so a^2 and b^2 share one moment.
        let luminance = (2.0 * mean + C1) / (power + C1);
        sum += luminance * (2.0 * (ab[i] - mean) + C2) / (squares[i] - power + C2);
    }
    sum
}

#[inline(always)]
fn add(sums: &mut [f64], values: &[f64], weight: f64) {
    sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
}

#[cfg(test)]
mod tests {
    use super::*;

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
