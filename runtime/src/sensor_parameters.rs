//! [`SensorModel`]: the parameters that describe a sensor and its lens, declared once for the node that simulates them
//! and for the nodes that undo them.

use modulo_core::Range;
use modulo_core::optics::{MAX_SIGMA, Psf};

use crate::parameter::{ParameterSet as _, Refusal};

/// Shape of the lens blur.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lens {
    /// A Gaussian of `psf_sigma`.
    Gaussian,
    /// The paper's fixed 7 taps.
    Paper7,
}

impl Lens {
    /// Every shape with its word.
    pub const WORDS: [(&'static str, Self); 2] = [("gaussian", Self::Gaussian), ("paper7", Self::Paper7)];

    /// The blur of this shape. `sigma` is the width of a Gaussian in px; 0 is a perfect lens.
    pub fn of_sigma(self, sigma: f64) -> Psf {
        match self {
            Self::Gaussian => Psf::of_sigma(sigma),
            Self::Paper7 => Psf::Paper7,
        }
    }
}

crate::parameters! {
    /// Bits, saturation factor and lens blur of a sensor.
    pub struct SensorModel {
        /// Bits of the sensor's converter. The peak is 2^bits code units.
        bits: u8 = 8 => 1..=16,
        /// Saturation factor: the brightest radiance of the scene divided by the sensor's peak.
        alpha: f64 = 4.0 => 1e-3..=256.0,
        /// Shape of the lens blur: gaussian with the width psf_sigma, or paper7 for the paper's fixed 7 taps
        /// (about 1.4 px).
        psf: Lens = Lens::Gaussian => Lens::WORDS,
        /// Standard deviation of the gaussian lens blur in px. 0 is a perfect lens. paper7 does not use it.
        psf_sigma: f64 = 0.0 => 0.0..=MAX_SIGMA,
    }
}

impl SensorModel {
    /// Bits and saturation factor.
    ///
    /// # Errors
    /// [`Refusal`] of the first value that is out of its range.
    pub fn range(&self) -> Result<Range, Refusal> {
        self.check()?;
        Ok(Range::new(self.bits, self.alpha).expect("the declared ranges lie within those of `Range`"))
    }

    /// The blur of the lens.
    pub fn psf(&self) -> Psf {
        self.psf.of_sigma(self.psf_sigma)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lens_is_the_requested_one() {
        for (pairs, psf) in [
            (&[][..], Psf::None),
            (&[("psf_sigma", "1.4")], Psf::Gaussian { sigma: 1.4 }),
            (&[("psf", "paper7")], Psf::Paper7),
        ] {
            assert_eq!(SensorModel::from_text(pairs).expect("possible").psf(), psf);
        }
    }

    #[test]
    fn both_ends_of_each_range_are_a_sensor_and_nothing_beyond_is() {
        let model = |bits, alpha| SensorModel { bits, alpha, ..SensorModel::default() }.range();
        for (bits, alpha) in [(1, 1e-3), (16, 256.0)] {
            assert_eq!(model(bits, alpha), Ok(Range::new(bits, alpha).expect("possible")));
        }
        for (bits, alpha, named) in
            [(0, 1.0, "bits"), (17, 1.0, "bits"), (8, 256.1, "alpha"), (8, -1.0, "alpha")]
        {
            assert_eq!(model(bits, alpha).expect_err("out of range").name, named);
        }
    }
}
