//! SPUD, the paper's method: wrapped gradients, one Poisson equation, a hard
//! threshold (eq. 2 and 3). Each channel on its own.

use ndarray::{Array3, ArrayView3, Axis};

use super::poisson::{Poisson, ThresholdOn};
use super::{Range, Recovered, Unwrap, UnwrapError, check_codes, check_frame, congruence};
use crate::frame::Frame;
use crate::{gradient, plane};

/// SPUD with its buffers; replans when the image size changes.
pub struct Spud {
    tau: f64,
    on: ThresholdOn,
    poisson: Poisson,
    y: Vec<f32>,
    gx: Vec<f32>,
    gy: Vec<f32>,
    phi: Vec<f32>,
    k: Vec<i32>,
}

impl Spud {
    /// `tau` >= 0 in units of the peak; 0 is plain least squares.
    ///
    /// # Errors
    /// [`UnwrapError::Tau`] for a negative, infinite or NaN `tau`.
    pub fn new(tau: f64, on: ThresholdOn) -> Result<Self, UnwrapError> {
        if !(tau >= 0.0 && tau.is_finite()) {
            return Err(UnwrapError::Tau { tau });
        }
        let [y, gx, gy, phi] = [const { Vec::new() }; 4];
        Ok(Self { tau, on, poisson: Poisson::new(1, 1), y, gx, gy, phi, k: Vec::new() })
    }

    /// Phi of eq. 3, before congruence: H x W x C in code units, mean 0 in each channel.
    ///
    /// `y` (H x W x C, code units) lies in `[0, 2^b]` and need not be quantised; 2^b itself
    /// is what the paper's scripts deliver for a multiple of the peak.
    ///
    /// # Errors
    /// [`UnwrapError::Code`] when a value is outside or NaN, [`UnwrapError::Shape`] when `y` is no image.
    pub fn solve(&mut self, y: ArrayView3<'_, f32>, range: Range) -> Result<Array3<f32>, UnwrapError> {
        check_codes(y, range, range.peak())?;
        let (height, width, channels) = y.dim();
        let mut out = Array3::zeros(y.dim());
        for channel in 0..channels {
            plane::take(y, channel, &mut self.y);
            self.solve_plane(height, width, range)?;
            let channel = out.index_axis_mut(Axis(2), channel);
            channel.into_iter().zip(&self.phi).for_each(|(out, &phi)| *out = phi);
        }
        Ok(out)
    }

    /// From `self.y` to `self.phi`.
    fn solve_plane(&mut self, height: usize, width: usize, range: Range) -> Result<(), UnwrapError> {
        if self.poisson.dim() != (height, width) {
            self.poisson = Poisson::new(height, width);
        }
        gradient::dx(&self.y, width, &mut self.gx);
        gradient::dy(&self.y, width, &mut self.gy);
        for d in self.gx.iter_mut().chain(&mut self.gy) {
            *d = gradient::wrap_centered(*d, range.bits());
        }
        self.phi.resize(height * width, 0.0);
        gradient::adjoint(&self.gx, &self.gy, width, &mut self.phi);
        let tau = (self.tau * f64::from(range.peak())) as f32;
        Ok(self.poisson.solve(&mut self.phi, tau, self.on)?)
    }
}

impl Unwrap for Spud {
    fn name(&self) -> &'static str {
        "spud"
    }

    fn unwrap(&mut self, y: &Frame, range: Range, out: &mut Recovered) -> Result<(), UnwrapError> {
        check_frame(y, range)?;
        out.prepare(y.dim(), self.name());
        let (height, width, channels) = y.dim();
        for channel in 0..channels {
            plane::take_from_frame(y, channel, &mut self.y);
            self.solve_plane(height, width, range)?;
            congruence::nearest(&self.phi, &self.y, range, &mut self.k);
            congruence::place(&self.k, &self.y, range, channel, out);
        }
        Ok(())
    }
}
