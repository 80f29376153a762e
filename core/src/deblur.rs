//! Removes the blur of a known lens by a Wiener filter in the domain of the cosine transform.
//!
//! The filter needs radiance that was recovered exactly and a point spread function that is known; nothing is
//! estimated from the image.

use std::f64::consts::PI;

use ndarray::Array3;

use crate::dct::{self, ImageDct, LANES, SpectralFilter};
use crate::frame::{Frame, FrameError, check_shape, in_order};
use crate::optics::Psf;
use crate::range::{HALF_A_CODE, Range};
use crate::simd::widest;
use crate::tone;
use crate::workers::Workers;

/// The ratio of the power of the noise to that of the image, the same at all frequencies.
pub const NSR: f64 = 4e-4;

/// The inverse filter of one lens with its buffers; it plans anew when the image size changes.
pub struct Deblur {
    taps: Vec<f32>,
    grid: ImageDct<[f32; LANES]>,
    by_row: Vec<[f32; LANES]>,
    by_column: Vec<f32>,
}

impl Deblur {
    /// Makes the filter for images that `psf` has blurred.
    pub fn new(psf: Psf) -> Self {
        Self {
            taps: psf.taps(),
            grid: ImageDct::new((1, 1, 1), 1),
            by_row: vec![[1.0; LANES]],
            by_column: vec![1.0],
        }
    }

    /// Returns the image `X H / (H^2 + NSR)`, clamped to `[0, alpha 2^b)` and scaled to 8 bits as by
    /// [`tone::linear8`]. `x` (H x W x C, code units) holds whole codes.
    ///
    /// # Errors
    /// [`FrameError`] when `x` does not have the shape of an image.
    pub fn linear8(&mut self, x: &Array3<f32>, range: Range) -> Result<Frame, FrameError> {
        // A perfect lens has nothing to undo, and the transforms would only add rounding errors.
        if self.taps.len() == 1 {
            return tone::linear8(x, range);
        }
        check_shape(x.dim())?;
        self.plan(x.dim());
        let x = x.as_standard_layout();
        let samples = in_order(x.view());
        let (_, width, channels) = x.dim();
        let stride = width * channels;
        let filter = SpectralFilter {
            by_row: &self.by_row,
            by_column: &self.by_column,
            rule: |by_row: f32, by_column: f32, c: f32| {
                let h = by_row * by_column;
                // Where H is near 0 the noise would be amplified without bound; the NSR limits the gain to 25.
                c * (h / (h * h + NSR as f32))
            },
        };
        let max = (range.limit() as f32).next_down();
        self.grid.filter(
            &Workers::current_thread(),
            #[inline(always)]
            // Rounding down is a bias of half a code, which the filter must not see as part of the image.
            |run| dct::load_run(samples, stride, run).map(|x| x + HALF_A_CODE),
            &filter,
            #[inline(always)]
            |_, values| values.map(|value| value.clamp(0.0, max)),
        );
        // The output of the transform lies by bands of columns, so it is read in runs of sixteen samples.
        let (mut shown, scale) = (vec![0; samples.len()], 255.0 / range.limit());
        for (row, out) in shown.chunks_exact_mut(stride).enumerate() {
            let values = |index: usize| self.grid.out(dct::SampleRun { row, sample: index * LANES });
            widest!({
                for (index, out) in out.chunks_mut(LANES).enumerate() {
                    // A loop, since `map` of an array is not inlined here.
                    out.iter_mut()
                        .zip(values(index))
                        .for_each(|(out, value)| *out = tone::to_u8(*value, scale));
                }
            });
        }
        Frame::from_u8(Array3::from_shape_vec(x.dim(), shown).expect("one pixel is shown for each of x"))
    }

    fn plan(&mut self, dim @ (height, width, _): (usize, usize, usize)) {
        // Tables and buffers depend only on the size, which the frames of a stream share.
        if self.grid.dim() != dim {
            self.grid = ImageDct::new(dim, 1);
            self.by_column = transfer(&self.taps, width);
            // The rows that fill up the last block keep the factor 0, so nothing of them reaches the image.
            self.by_row = vec![[0.0; LANES]; height.div_ceil(LANES)];
            let by_row = self.by_row.as_flattened_mut().iter_mut().zip(transfer(&self.taps, height));
            by_row.for_each(|(to, value)| *to = value);
        }
    }
}

/// Returns H at the `n` frequencies of the cosine transform: `h_0 + 2 sum_i h_i cos(pi k i / n)`.
fn transfer(taps: &[f32], n: usize) -> Vec<f32> {
    let at = |k: usize| {
        let of = |(i, &tap): (usize, &f32)| f64::from(tap) * (PI * (k * i) as f64 / n as f64).cos();
        // The kernel is symmetric, so one half of it suffices, with the middle tap counted once.
        2.0 * taps[taps.len() / 2..].iter().enumerate().map(of).sum::<f64>() - f64::from(taps[taps.len() / 2])
    };
    (0..n).map(|k| at(k) as f32).collect()
}
