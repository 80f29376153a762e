//! The lens undone: a Wiener filter for a known point spread function, in the
//! domain of the cosine transform, on radiance that was recovered exactly.
//!
//! Nothing is estimated from the image: the lens is known or there is no filter.

use std::f64::consts::PI;

use ndarray::{Array3, Axis};

use crate::dct::Dct2;
use crate::frame::{Frame, FrameError};
use crate::optics::Psf;
use crate::plane::{self, check_shape};
use crate::range::Range;
use crate::tone;

/// Power of the noise over that of the image, the same at all frequencies.
pub const NSR: f64 = 4e-4;

/// What the converter's floor takes away on average, code units.
const HALF_A_CODE: f32 = 0.5;

/// The filter of one lens with its buffers; replans when the image size changes.
pub struct Deblur {
    taps: Vec<f32>,
    nsr: f64,
    dct: Dct2,
    plane: Vec<f32>,
    sharp: Array3<f32>,
}

impl Deblur {
    /// For images that `psf` has blurred.
    pub fn new(psf: Psf) -> Self {
        let sharp = Array3::zeros((0, 0, 0));
        Self { taps: psf.taps(), nsr: NSR, dct: Dct2::new(1, 1), plane: Vec::new(), sharp }
    }

    /// The sharp image as [`tone::linear8`] shows it; `x` (H x W x C, code units) comes from whole codes.
    ///
    /// # Errors
    /// [`FrameError`] when `x` is not of an image's shape.
    pub fn linear8(&mut self, x: &Array3<f32>, range: Range) -> Result<Frame, FrameError> {
        self.filter(x, range)?;
        tone::linear8(&self.sharp, range)
    }

    /// The sharp image as [`tone::counts16`] shows it; `x` (H x W x C, code units) comes from whole codes.
    ///
    /// # Errors
    /// [`FrameError`] when `x` is not of an image's shape.
    pub fn counts16(&mut self, x: &Array3<f32>, range: Range) -> Result<Frame, FrameError> {
        self.filter(x, range)?;
        tone::counts16(&self.sharp)
    }

    fn filter(&mut self, x: &Array3<f32>, range: Range) -> Result<(), FrameError> {
        let (height, width, channels) = x.dim();
        check_shape(x.dim())?;
        if self.dct.dim() != (height, width) {
            self.dct = Dct2::new(height, width);
        }
        self.sharp.clone_from(x);
        if self.taps.len() == 1 {
            return Ok(());
        }
        let (down, across) = (transfer(&self.taps, height), transfer(&self.taps, width));
        for channel in 0..channels {
            plane::take(x.view(), channel, &mut self.plane);
            self.plane.iter_mut().for_each(|x| *x += HALF_A_CODE);
            // The plan is of this very size.
            let _ = self.dct.forward(&mut self.plane);
            for (row, down) in self.plane.chunks_exact_mut(width).zip(&down) {
                for (c, across) in row.iter_mut().zip(&across) {
                    let h = down * across;
                    *c *= h / (h * h + self.nsr as f32);
                }
            }
            let _ = self.dct.inverse(&mut self.plane);
            let sharp = self.sharp.index_axis_mut(Axis(2), channel);
            let most = (range.limit() as f32).next_down();
            sharp.into_iter().zip(&self.plane).for_each(|(to, &from)| *to = from.clamp(0.0, most));
        }
        Ok(())
    }
}

/// H at the frequencies of a cosine transform of `n` samples: `h_0 + 2 sum_i h_i cos(pi k i / n)`.
fn transfer(taps: &[f32], n: usize) -> Vec<f32> {
    let at = |k: usize| {
        let of = |(i, &tap): (usize, &f32)| f64::from(tap) * (PI * (k * i) as f64 / n as f64).cos();
        2.0 * taps[taps.len() / 2..].iter().enumerate().map(of).sum::<f64>() - f64::from(taps[taps.len() / 2])
    };
    (0..n).map(|k| at(k) as f32).collect()
}
