//! [`SensorModel`]: the parameters that describe a sensor and its lens, declared once for the node that simulates them
//! and for the nodes that undo them.

use modulo_core::Range;
use modulo_core::optics::{MAX_SIGMA, Psf};

use crate::parameter::{ParameterError, ParameterSet as _};

/// Shape of the blur of the lens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlurShape {
    /// A Gaussian of `psf_sigma`.
    Gaussian,
    /// The paper's fixed 7 taps.
    Paper7,
}

impl BlurShape {
    /// Every shape with its word.
    pub const WORDS: [(&'static str, Self); 2] = [("gaussian", Self::Gaussian), ("paper7", Self::Paper7)];

    /// Returns the blur of this shape. `sigma` is the width of a Gaussian in px; 0 is a perfect lens.
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
        /// Shape of the lens blur: gaussian with the width psf_sigma, or paper7 for the paper's fixed 7 taps (about 1.4
        /// px).
        psf: BlurShape = BlurShape::Gaussian => BlurShape::WORDS,
        /// Standard deviation of the gaussian lens blur in px. 0 is a perfect lens. paper7 does not use it.
        psf_sigma: f64 = 0.0 => 0.0..=MAX_SIGMA,
    }
}

impl SensorModel {
    /// Returns bits and saturation factor.
    ///
    /// # Errors
    /// [`ParameterError`] of the first value that is out of its range.
    pub fn range(&self) -> Result<Range, ParameterError> {
        self.check()?;
        Ok(Range::new(self.bits, self.alpha).expect("the declared ranges lie within those of `Range`"))
    }

    /// Returns the blur of the lens.
    pub fn psf(&self) -> Psf {
        self.psf.of_sigma(self.psf_sigma)
    }
}

crate::parameters! {
    /// The sensor behind the images that a node reads. Each value that is not set here is taken from the sensor
    /// description that the camera publishes with each frame.
    pub struct SensorOverride {
        /// Bits of the sensor's converter. 0: those of the camera's sensor description.
        bits: u8 = 0 => 0..=16,
        /// Saturation factor: the brightest radiance of the scene divided by the sensor's peak. 0: that of the camera's
        /// sensor description.
        alpha: f64 = 0.0 => 0.0..=256.0,
        /// Shape of the lens blur: gaussian, or paper7 for the paper's fixed 7 taps (about 1.4 px).
        psf: BlurShape = BlurShape::Gaussian => BlurShape::WORDS,
        /// Standard deviation of the gaussian lens blur in px. 0: the blur of the camera's sensor description.
        psf_sigma: f64 = 0.0 => 0.0..=MAX_SIGMA,
    }
}

impl SensorOverride {
    /// Returns the sensor: the values set here, and those of the `camera` for all others.
    ///
    /// # Errors
    /// [`ParameterError`] of a value that is neither set nor described, or out of its range.
    pub fn over(&self, camera: Option<&SensorModel>) -> Result<SensorModel, ParameterError> {
        let missing = |name| {
            let why = "no sensor description has come on sensor_info; start the camera, or set the parameter";
            ParameterError::new(name, 0, why)
        };
        let bits = Some(self.bits).filter(|&bits| bits > 0).or_else(|| Some(camera?.bits));
        let alpha = Some(self.alpha).filter(|&alpha| alpha > 0.0).or_else(|| Some(camera?.alpha));
        // A perfect lens cannot be told from one that is not set, so a sigma of 0 takes the camera's.
        let own_lens = self.psf == BlurShape::Paper7 || self.psf_sigma > 0.0;
        let (psf, psf_sigma) = match camera {
            Some(camera) if !own_lens => (camera.psf, camera.psf_sigma),
            _ => (self.psf, self.psf_sigma),
        };
        let bits = bits.ok_or_else(|| missing("bits"))?;
        let model = SensorModel { bits, alpha: alpha.ok_or_else(|| missing("alpha"))?, psf, psf_sigma };
        model.check()?;
        Ok(model)
    }

    /// Returns whether bits and saturation factor are known without the camera.
    pub fn is_complete(&self) -> bool {
        self.bits > 0 && self.alpha > 0.0
    }
}

impl From<SensorModel> for SensorOverride {
    fn from(model: SensorModel) -> Self {
        let SensorModel { bits, alpha, psf, psf_sigma } = model;
        Self { bits, alpha, psf, psf_sigma }
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
    fn a_value_that_is_not_set_is_the_cameras() {
        let camera = SensorModel { bits: 10, alpha: 3.0, psf: BlurShape::Paper7, psf_sigma: 0.0 };
        let unset = SensorOverride::default();
        assert_eq!(unset.over(Some(&camera)), Ok(camera.clone()));
        assert_eq!(unset.over(None).expect_err("nothing is known").name, "bits");
        let set = SensorOverride { alpha: 2.0, psf_sigma: 1.0, ..SensorOverride::default() };
        let expected = SensorModel { bits: 10, alpha: 2.0, psf: BlurShape::Gaussian, psf_sigma: 1.0 };
        assert_eq!(set.over(Some(&camera)), Ok(expected.clone()));
        assert_eq!(SensorOverride::from(expected.clone()).over(Some(&camera)), Ok(expected));
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
