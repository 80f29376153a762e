//! [`SensorModel`]: the parameters that describe a sensor and its lens, declared once for the node that simulates them,
//! for the nodes that undo them, for the commands that vary them and for the results of these.

use std::borrow::Cow;

use modulo_core::optics::{MAX_SIGMA, Psf};
use modulo_core::sensor::{MAX_NOISE, MAX_OPTICAL_BLACK, MODULI, Sensor, SensorConfig};
use modulo_core::{AutoExposure, ExposureControl, Gains, Metering, Mosaic, Range, Transfer};

use crate::parameter::{ParameterError, ParameterSet as _};

/// Shape of the blur of the lens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlurShape {
    /// A Gaussian of `psf_sigma`.
    Gaussian,
    /// The paper's fixed 7 taps.
    Paper7,
    /// A perfect lens, which does not blur.
    Perfect,
    /// No blur is simulated: the images have that of a lens which nobody describes.
    Unknown,
}

impl BlurShape {
    /// Every shape with its word.
    pub const WORDS: [(&'static str, Self); 4] = [
        ("gaussian", Self::Gaussian),
        ("paper7", Self::Paper7),
        ("perfect", Self::Perfect),
        ("unknown", Self::Unknown),
    ];

    /// Returns the blur of this shape. `sigma` is the width of a Gaussian in px; 0 is a perfect lens.
    pub fn of_sigma(self, sigma: f64) -> Psf {
        match self {
            Self::Gaussian => Psf::of_sigma(sigma),
            Self::Paper7 => Psf::Paper7,
            Self::Perfect | Self::Unknown => Psf::None,
        }
    }
}

crate::parameters! {
    /// A sensor and its lens.
    pub struct SensorModel {
        /// Bits of the sensor's converter. The peak is 2^bits code units.
        bits: u8 = 8 => 1..=16,
        /// Saturation factor: the brightest radiance of the scene divided by the sensor's peak.
        alpha: f64 = 4.0 => 1e-3..=256.0,
        /// Full scale of the pictures of a source divided by alpha * 2^bits: the radiance of the largest code, the
        /// white of EXR and HDR images, or 1 in rendered frames. The images of 8 bits undo it, so that an ideal image
        /// is the picture that it comes from. 1: the brightest parts lie at the end of the range.
        headroom: f64 = 0.97 => 1e-3..=1.0,
        /// Transfer function of the pictures: codes of 8 and 16 bits of a source are decoded by it, and the images
        /// ideal, saturated and recovered are encoded by it. linear: codes are radiance. EXR, HDR and rendered frames
        /// hold radiance, which is not decoded.
        transfer: Transfer = Transfer::Linear => Transfer::WORDS; fixed,
        /// Columns at the left border that a field stop in front of the lens shades: the radiance is 0 in the first
        /// quarter of them, at least in one column, and rises linearly over the others. They show where the radiance
        /// is 0. 32 columns keep neighbouring samples within half a peak up to an alpha of 8.
        optical_black: usize = 32 => 0..=MAX_OPTICAL_BLACK,
        /// Radiance in code units that you promise the darkest pixels of each frame to have, as the pedestal of a data
        /// sheet, to 1/32 of 2^bits. It shows unwrap the absolute level of a frame in which some pixels have it. -1: no
        /// promise.
        black_level: Option<f64> = None => -1.0..=65536.0,
        /// Shape of the lens blur: gaussian with the width psf_sigma, paper7 for the paper's fixed 7 taps (about 1.4
        /// px), perfect for no blur, or unknown for images that have the blur of a real lens. Images of raw mosaics
        /// always have the latter.
        psf: BlurShape = BlurShape::Gaussian => BlurShape::WORDS,
        /// Standard deviation of the gaussian lens blur in px. 0 is a perfect lens. Other shapes do not use it.
        psf_sigma: f64 = 1.4 => 0.0..=MAX_SIGMA,
        /// Pixels with a lower gain, which do not wrap: none, or every second one, as on a checkerboard.
        gains: bool = false => Gains::WORDS,
        /// The lower gain divided by the full one, at most 1 / alpha. 0: 1 / alpha.
        gain_ratio: Option<f64> = None => 0.0..=1.0,
        /// Standard deviation of the read noise in code units.
        read_noise: f64 = 0.0 => 0.0..=MAX_NOISE,
        /// Strength of the shot noise: its standard deviation at the signal x is sqrt(shot_noise * x) in code units.
        shot_noise: f64 = 0.0 => 0.0..=MAX_NOISE,
        /// Electrons that fill the 2^bits codes of the converter at full gain (the saturation capacity of EMVA 1288).
        /// They add shot noise of the variance x * 2^bits / full_well_electrons. 0: only shot_noise.
        full_well_electrons: Option<f64> = None => 0.0..=1e9,
        /// Photo response non-uniformity (EMVA 1288): standard deviation of the gain between pixels, as a fraction. The
        /// pattern is the same in every frame.
        prnu: f64 = 0.0 => 0.0..=1.0,
        /// Share of the samples that are hot: their dark signal is evenly distributed up to the peak. The pattern is
        /// the same in every frame.
        hot_pixels: f64 = 0.0 => 0.0..=1.0,
        /// Mean charge at which a pixel resets itself, divided by 2^bits.
        modulus: f64 = 1.0 => MODULI,
        /// Mean light that a pixel loses while it resets itself, in code units. Radiance has 2^bits of them from one
        /// reset of the mean pixel to the next, so that no error adds up.
        reset_loss: f64 = 0.0 => 0.0..=MAX_NOISE,
        /// Standard deviation between pixels of their modulus and reset_loss, as a fraction. The pattern is the same in
        /// every frame.
        reset_spread: f64 = 0.0 => 0.0..=1.0,
        /// Colour filters of a sensor with one chip, whose pixels see one colour each. none: each pixel sees all
        /// colours of the source. The images of a mosaic have the encoding bayer_*8 or bayer_*16. Images of one channel
        /// are raw mosaics of these filters, which are sensed as they are, without a lens.
        mosaic: Option<Mosaic> = None => Mosaic::WORDS; fixed,
        /// The pixels that decide the exposure of the images auto_exposed and metered: the mean of all of them, that of
        /// the centre, whose pixels count three times, or the highlights, of which 99.9 % shall not clip.
        metering: Metering = Metering::Mean => Metering::WORDS,
        /// Goal of the mean radiance and of that of the centre, divided by that of the largest code. 0.18 is the middle
        /// grey of photography.
        metering_target: f64 = 0.18 => 0.01..=1.0,
        /// Frames of the image auto_exposed after which a measured frame takes effect.
        exposure_delay: usize = 2 => 1..=10,
        /// Largest factor between the exposures of two frames of the image auto_exposed.
        exposure_step: f64 = 2.0 => 1.0..=64.0,
    }
}

/// The parameters of [`SensorModel`] that belong to a scene and its exposure, and not to the chip or the lens.
const OF_EXPOSURE: [&str; 4] = ["alpha", "headroom", "transfer", "gain_ratio"];

impl SensorModel {
    /// The parameters of the exposure control, which only the images auto_exposed and metered depend on.
    pub const EXPOSURE_CONTROL: [&str; 4] =
        ["metering", "metering_target", "exposure_delay", "exposure_step"];

    /// The parameters of an exposure that follows the frames before.
    pub const FOLLOWING: [&str; 2] = ["exposure_delay", "exposure_step"];

    /// Returns the sensor of images of which nothing is known: no columns are taken for black, and no lens is assumed.
    pub fn unknown() -> Self {
        Self { optical_black: 0, psf: BlurShape::Unknown, psf_sigma: 0.0, ..Self::default() }
    }

    /// Returns the names of the parameters that describe the chip or the lens.
    pub fn of_chip() -> Vec<&'static str> {
        let names = Self::descriptors().into_iter().map(|descriptor| descriptor.name);
        names.filter(|name| !OF_EXPOSURE.contains(name)).collect()
    }

    /// Returns the sensor of images of so many channels: a raw mosaic has the blur of its own lens, which is not known.
    pub fn of_channels(&self, channels: usize) -> Cow<'_, Self> {
        if self.mosaic.is_none() || channels != 1 || self.psf() != Psf::None {
            return Cow::Borrowed(self);
        }
        Cow::Owned(Self { psf: BlurShape::Unknown, ..self.clone() })
    }

    /// Returns the simulated sensor.
    ///
    /// # Errors
    /// [`ParameterError`] of the first value that is out of its range.
    pub fn simulated(&self) -> Result<Sensor, ParameterError> {
        Ok(Sensor::new(self.config()?).expect("the declared ranges lie within those of `Sensor`"))
    }

    /// Returns the configuration of the simulated sensor.
    ///
    /// # Errors
    /// [`ParameterError`] of the first value that is out of its range.
    pub fn config(&self) -> Result<SensorConfig, ParameterError> {
        self.check()?;
        Ok(SensorConfig {
            bits: self.bits,
            alpha: self.alpha,
            headroom: self.headroom,
            transfer: self.transfer,
            optical_black: self.optical_black,
            psf: self.psf(),
            read_noise: self.read_noise,
            shot_noise: self.shot_variance(),
            prnu: self.prnu,
            hot_pixels: self.hot_pixels,
            modulus: self.modulus,
            reset_loss: self.reset_loss,
            reset_spread: self.reset_spread,
            gains: self.gains()?,
            mosaic: self.mosaic,
        })
    }

    /// Returns a normal camera of this chip, whose exposure follows the frames.
    ///
    /// # Errors
    /// [`ParameterError`] of the first value that is out of its range.
    pub fn auto_exposure(&self) -> Result<AutoExposure, ParameterError> {
        let Self { metering, metering_target: target, exposure_delay: delay, exposure_step: step, .. } =
            *self;
        let control = ExposureControl { metering, target, delay, step };
        let camera = AutoExposure::new(self.config()?, control);
        Ok(camera.expect("the declared ranges lie within those of `Sensor`"))
    }

    /// Returns the variance of the shot noise divided by the signal in code units, that of the electrons included.
    fn shot_variance(&self) -> f64 {
        let of_electrons =
            self.full_well_electrons.map_or(0.0, |electrons| f64::from(self.bits).exp2() / electrons);
        (self.shot_noise + of_electrons).min(MAX_NOISE)
    }

    /// Returns bits, saturation factor, headroom, and the columns that are black.
    ///
    /// # Errors
    /// [`ParameterError`] of the first value that is out of its range.
    pub fn range(&self) -> Result<Range, ParameterError> {
        self.check()?;
        let range = Range::new(self.bits, self.alpha).and_then(|range| range.with_headroom(self.headroom));
        let range = range.expect("the declared ranges lie within those of `Range`");
        Ok(range.with_optical_black(self.optical_black).with_black_level(self.black_level))
    }

    /// Returns the blur of the lens.
    pub fn psf(&self) -> Psf {
        self.psf.of_sigma(self.psf_sigma)
    }

    /// Returns the standard deviation of the noise at the end of the range, in code units.
    pub fn noise(&self) -> Option<f64> {
        self.config().ok().map(|config| config.noise())
    }

    /// Returns whether the lens is known to have no blur.
    pub fn is_sharp(&self) -> bool {
        self.psf != BlurShape::Unknown && self.psf() == Psf::None
    }

    /// Returns the gains of the pixels.
    ///
    /// # Errors
    /// [`ParameterError`] of a `gain_ratio` above `1 / alpha`, with which the pixels of low gain would wrap, too.
    pub fn gains(&self) -> Result<Gains, ParameterError> {
        if !self.gains {
            return Ok(Gains::One);
        }
        let most = self.alpha.recip().min(1.0);
        match self.gain_ratio {
            None => Ok(Gains::checkerboard(self.alpha)),
            Some(ratio) if ratio <= most => Ok(Gains::Checkerboard { ratio }),
            Some(ratio) => {
                let why =
                    format!("must be at most {most} (1 / alpha), so that the pixels of low gain do not wrap");
                Err(ParameterError::new("gain_ratio", ratio, why))
            }
        }
    }
}

/// The words of [`SensorOverride::gains`]: those of a sensor, and `camera` for the gains that the camera describes.
const OVERRIDES: [(&str, Option<bool>); 3] =
    [("camera", None), ("none", Some(false)), ("checkerboard", Some(true))];

/// The words of [`SensorOverride::transfer`]: those of a sensor, and `camera` for the function that the camera
/// describes.
const TRANSFERS: [(&str, Option<Transfer>); 5] = [
    ("camera", None),
    ("linear", Some(Transfer::Linear)),
    ("srgb", Some(Transfer::Srgb)),
    ("gamma22", Some(Transfer::Gamma22)),
    ("rec709", Some(Transfer::Rec709)),
];

crate::parameters! {
    /// The sensor behind the images that a node reads. Each value that is not set here is taken from the sensor
    /// description that the camera publishes with each frame.
    pub struct SensorOverride {
        /// Bits of the sensor's converter. 0: those of the camera's sensor description.
        bits: Option<u8> = None => 0..=16,
        /// Saturation factor: the brightest radiance of the scene divided by the sensor's peak. 0: that of the camera's
        /// sensor description.
        alpha: Option<f64> = None => 0.0..=256.0,
        /// Full scale of a picture divided by alpha * 2^bits, which the recovered image shows as its largest code. 0:
        /// that of the camera's sensor description (0.97 without a description).
        headroom: Option<f64> = None => 0.0..=1.0,
        /// Transfer function by which the recovered image is encoded: linear, srgb, gamma22, rec709, or as the camera's
        /// sensor description has it (linear without a description).
        transfer: Option<Transfer> = None => TRANSFERS,
        /// Columns at the left border that a field stop shades, as at the camera. 0: those of the camera's sensor
        /// description.
        optical_black: Option<usize> = None => 0..=MAX_OPTICAL_BLACK,
        /// Radiance in code units that you promise the darkest pixels of each frame to have. -1: that of the camera's
        /// sensor description.
        black_level: Option<f64> = None => -1.0..=65536.0,
        /// Shape of the lens blur: gaussian, paper7 for the paper's fixed 7 taps (about 1.4 px), perfect for no blur,
        /// or unknown.
        psf: BlurShape = BlurShape::Gaussian => BlurShape::WORDS,
        /// Standard deviation of the gaussian lens blur in px. 0: the blur of the camera's sensor description (an
        /// unknown one without a description), where psf is gaussian.
        psf_sigma: Option<f64> = None => 0.0..=MAX_SIGMA,
        /// Pixels with a lower gain: none, every second one, as on a checkerboard, or as the camera's sensor
        /// description has them (none without a description).
        gains: Option<bool> = None => OVERRIDES,
        /// The lower gain divided by the full one, where gains is not camera. 0: 1 / alpha.
        gain_ratio: Option<f64> = None => 0.0..=1.0,
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
        let mut model = camera.cloned().unwrap_or_else(SensorModel::unknown);
        model.bits = self.bits.or_else(|| Some(camera?.bits)).ok_or_else(|| missing("bits"))?;
        model.alpha = self.alpha.or_else(|| Some(camera?.alpha)).ok_or_else(|| missing("alpha"))?;
        match (self.psf, self.psf_sigma) {
            (BlurShape::Gaussian, None) => {}
            (shape, sigma) => (model.psf, model.psf_sigma) = (shape, sigma.unwrap_or(model.psf_sigma)),
        }
        if let Some(gains) = self.gains {
            (model.gains, model.gain_ratio) = (gains, self.gain_ratio);
        }
        model.transfer = self.transfer.unwrap_or(model.transfer);
        model.headroom = self.headroom.unwrap_or(model.headroom);
        model.optical_black = self.optical_black.unwrap_or(model.optical_black);
        model.black_level = self.black_level.or(model.black_level);
        model.check()?;
        Ok(model)
    }

    /// Returns whether bits and saturation factor are known without the camera.
    pub fn is_complete(&self) -> bool {
        self.bits.is_some() && self.alpha.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_lens_is_the_requested_one() {
        for (pairs, psf) in [
            (&[][..], Psf::Gaussian { sigma: 1.4 }),
            (&[("psf_sigma", "0")], Psf::None),
            (&[("psf", "paper7")], Psf::Paper7),
        ] {
            assert_eq!(SensorModel::from_text(pairs).expect("possible").psf(), psf);
        }
    }

    #[test]
    fn a_value_that_is_not_set_is_the_cameras() {
        let camera = SensorModel {
            bits: 10,
            alpha: 3.0,
            headroom: 0.9,
            transfer: Transfer::Rec709,
            optical_black: 32,
            psf: BlurShape::Paper7,
            psf_sigma: 0.0,
            gains: true,
            gain_ratio: Some(0.25),
            ..SensorModel::default()
        };
        let unset = SensorOverride::default();
        assert_eq!(unset.over(Some(&camera)), Ok(camera.clone()));
        assert_eq!(unset.over(None).expect_err("nothing is known").name, "bits");
        let complete = SensorOverride { bits: Some(8), alpha: Some(4.0), ..SensorOverride::default() };
        assert_eq!(
            complete.over(None),
            Ok(SensorModel::unknown()),
            "no black columns and no lens are assumed"
        );
        let transfer = Transfer::Srgb;
        let set = SensorOverride {
            alpha: Some(2.0),
            headroom: Some(0.8),
            transfer: Some(transfer),
            optical_black: Some(8),
            black_level: Some(40.0),
            psf_sigma: Some(1.0),
            gains: Some(false),
            ..SensorOverride::default()
        };
        let expected = SensorModel {
            bits: 10,
            alpha: 2.0,
            headroom: 0.8,
            transfer,
            optical_black: 8,
            black_level: Some(40.0),
            psf_sigma: 1.0,
            ..SensorModel::default()
        };
        assert_eq!(set.over(Some(&camera)), Ok(expected));
    }

    #[test]
    fn pixels_of_low_gain_never_wrap() {
        let gains = |alpha, gain_ratio| {
            SensorModel { alpha, gain_ratio, gains: true, ..SensorModel::default() }.gains()
        };
        for (alpha, given, ratio) in [(4.0, None, 0.25), (4.0, Some(0.125), 0.125), (0.5, None, 1.0)] {
            assert_eq!(gains(alpha, given), Ok(Gains::Checkerboard { ratio }));
        }
        let why = gains(4.0, Some(0.26)).expect_err("0.26 * 4 > 1").to_string();
        assert!(why.contains("gain_ratio") && why.contains("0.25"), "{why}");
        assert_eq!(SensorModel { gain_ratio: Some(0.9), ..SensorModel::default() }.gains(), Ok(Gains::One));
    }

    #[test]
    fn other_arrangements_of_gains_are_refused_with_the_possible_ones() {
        for word in ["rows", "colours"] {
            let why = SensorModel::from_text(&[("gains", word)]).expect_err("not supported").to_string();
            assert!(why.contains(word) && why.contains("none, checkerboard"), "{why}");
        }
    }

    #[test]
    fn both_ends_of_each_range_are_a_sensor_and_nothing_beyond_is() {
        let model =
            |bits, alpha, headroom| SensorModel { bits, alpha, headroom, ..SensorModel::unknown() }.range();
        for (bits, alpha, headroom) in [(1, 1e-3, 1e-3), (16, 256.0, 1.0)] {
            let range = Range::new(bits, alpha).and_then(|range| range.with_headroom(headroom));
            assert_eq!(model(bits, alpha, headroom), Ok(range.expect("possible")));
        }
        for (bits, alpha, headroom, named) in [
            (0, 1.0, 1.0, "bits"),
            (17, 1.0, 1.0, "bits"),
            (8, 256.1, 1.0, "alpha"),
            (8, -1.0, 1.0, "alpha"),
            (8, 1.0, 0.0, "headroom"),
            (8, 1.0, 1.01, "headroom"),
        ] {
            assert_eq!(model(bits, alpha, headroom).expect_err("out of range").name, named);
        }
        for optical_black in [0, MAX_OPTICAL_BLACK] {
            assert!(SensorModel { optical_black, ..SensorModel::default() }.simulated().is_ok());
        }
        let shaded = SensorModel { optical_black: MAX_OPTICAL_BLACK + 1, ..SensorModel::default() };
        let why = shaded.simulated().expect_err("too many columns").to_string();
        assert!(why.contains("'optical_black' = 65") && why.contains("0 to 64"), "{why}");
    }
}
