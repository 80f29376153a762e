//! Removes the blur of a known lens by a short Wiener filter along the rows and along the columns.
//!
//! The filter needs radiance that was recovered exactly and a point spread function that is known; nothing is
//! estimated from the image.

use ndarray::{Array3, ArrayRef3};

use crate::frame::{Frame, FrameError, check_shape, in_order};
use crate::optics::{Border, Psf, RowFilter};
use crate::range::{HALF_A_CODE, Range};
use crate::simd::widest;
use crate::tone::{self, ToneTable};
use crate::transfer::Transfer;

/// The power of the noise over that of the image, for the filter along one side. It limits the gain at any frequency to about
/// `1 / (2 sqrt(0.01))` = 5, by which noise and wrong wrap counts are amplified, too.
pub const REGULARISATION: f64 = 1e-2;

/// The inverse filter of one lens.
pub struct Deblur {
    taps: Vec<f32>,
}

impl Deblur {
    /// Makes the filter for images that `psf` has blurred.
    pub fn new(psf: Psf) -> Self {
        Self { taps: inverse(psf) }
    }

    /// Returns the filtered image, clamped to `[0, headroom alpha 2^b)` and shown with 8 bits as by [`tone::picture`]. Along either side,
    /// the transfer function is close to `H / (H^2 + r)`, where H is that of the lens and r is [`REGULARISATION`]. `x` (H x W x
    /// C, code units) holds whole codes. It is continued beyond its border as by [`Sensor::expose`](crate::Sensor::expose).
    ///
    /// # Errors
    /// [`FrameError`] when `x` does not have the shape of an image.
    pub fn picture(&self, x: &ArrayRef3<f32>, range: Range, transfer: Transfer) -> Result<Frame, FrameError> {
        // A perfect lens has nothing to undo, and half a code would be added for nothing.
        if self.taps.len() == 1 {
            return tone::picture(x, range, transfer);
        }
        check_shape(x.dim())?;
        let (_, width, channels) = x.dim();
        let (x, stride) = (x.as_standard_layout(), width * channels);
        let (samples, scale) = (in_order(x.view()), 255.0 / range.white());
        let table = ToneTable::of(range, transfer);
        let (mut shown, mut line) = (vec![0; samples.len()], vec![0.0; stride]);
        let mut filter = RowFilter::new(x.dim(), &self.taps, Border::HalfSample);
        for shown in shown.chunks_exact_mut(stride) {
            let read = |row: usize, to: &mut [f32]| to.copy_from_slice(&samples[row * stride..][..stride]);
            filter.next_row(read, &mut line);
            // The half code undoes the bias of rounding down. Values beyond the range are clamped by the scaling.
            let pixels = shown.iter_mut().zip(&line);
            match &table {
                Some(table) => pixels.for_each(|(out, value)| *out = table.code(value + HALF_A_CODE)),
                None => {
                    widest!(pixels.for_each(|(out, value)| *out = tone::to_u8(value + HALF_A_CODE, scale)))
                }
            }
        }
        Frame::from_u8(Array3::from_shape_vec(x.dim(), shown).expect("one pixel is shown for each of x"))
    }
}

/// Returns the taps g of the inverse filter along one side, with sum 1: among all filters of their length those that minimise
/// `E |g * (h * x + n) - x|^2` for a lens h, a white image x of variance 1 and white noise n of variance [`REGULARISATION`].
fn inverse(psf: Psf) -> Vec<f32> {
    let lens: Vec<f64> = psf.taps().into_iter().map(f64::from).collect();
    let (reach, lens_reach) = ((5.0 * psf.sigma()).ceil() as usize, lens.len() / 2);
    let count = 2 * reach + 1;
    // The autocorrelation of the lens at the distance of two taps.
    let correlation =
        |distance: usize| -> f64 { lens.iter().skip(distance).zip(&lens).map(|(a, b)| a * b).sum() };
    let correlations: Vec<f64> = (0..count).map(correlation).collect();
    // One row for each tap: the normal equations, and behind them the tap of the lens as their right side.
    let mut rows: Vec<Vec<f64>> = (0..count)
        .map(|row| {
            let matrix = (0..count).map(|column| {
                correlations[row.abs_diff(column)] + if row == column { REGULARISATION } else { 0.0 }
            });
            let right = (row + lens_reach).checked_sub(reach).and_then(|tap| lens.get(tap));
            matrix.chain([right.copied().unwrap_or(0.0)]).collect()
        })
        .collect();
    let taps = solve(&mut rows);
    let sum: f64 = taps.iter().sum();
    taps.iter().map(|tap| (tap / sum) as f32).collect()
}

/// Solves equations of a positive definite matrix by Gaussian elimination. Each row ends with its right side.
fn solve(rows: &mut [Vec<f64>]) -> Vec<f64> {
    let count = rows.len();
    for pivot in 0..count {
        let (above, below) = rows.split_at_mut(pivot + 1);
        let by = &above[pivot];
        for row in below {
            let factor = row[pivot] / by[pivot];
            row.iter_mut().zip(by).skip(pivot).for_each(|(value, by)| *value -= factor * by);
        }
    }
    let mut solution = vec![0.0; count];
    for (index, row) in rows.iter().enumerate().rev() {
        let known: f64 = (index + 1..count).map(|column| row[column] * solution[column]).sum();
        solution[index] = (row[count] - known) / row[index];
    }
    solution
}
