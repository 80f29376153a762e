//! The modulo sensor, which turns radiance into counts (eq. 1).
//!
//! One exposure gives every stream, so that the modulo, saturated and ideal frames carry the same noise.

use std::borrow::Cow;
use std::ops::RangeInclusive;

use ndarray::{Array3, ArrayView2, ArrayView3, Axis};
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal, StandardUniform};
use rand_pcg::Pcg64Mcg;

use crate::frame::{Frame, FrameError, SamplePosition, check_shape, position_of};
use crate::gains::{Gains, merge_saturated, merge_saturated_mosaic};
use crate::gains_mosaic::MosaicGains;
use crate::mosaic::Mosaic;
use crate::optics::{Border, MAX_SIGMA, Psf, RowFilter};
use crate::range::{Range, RangeError};
use crate::simd::{floor, mapped, widest};
use crate::tone;
use crate::transfer::Transfer;
use crate::unwrap::Scene;

/// The largest `f32` below 1; radiance of full scale and more is clamped to it.
pub const BELOW_ONE: f32 = 1.0 - f32::EPSILON / 2.0;

/// The reason why the frames of an exposure are valid.
const IS_AN_IMAGE: &str = "`Sensor::expose` has checked the shape";

/// The seed of the fixed pattern, which is that of the sensor and not of an exposure.
const PATTERN_SEED: u64 = 0x656d_7661_3132_3838;

/// The seed of the pattern of the resets.
const RESET_SEED: u64 = PATTERN_SEED + 1;

/// The least modulus of a pixel over the mean one. The normal distribution has no least value.
const LEAST_MODULUS: f64 = 0.1;

/// The largest number of columns that [`SensorConfig::optical_black`] takes.
pub const MAX_OPTICAL_BLACK: usize = 64;

/// The largest noise parameter in code units: the peak of 16 bits.
pub const MAX_NOISE: f64 = 65536.0;

/// The possible values of [`SensorConfig::modulus`].
pub const MODULI: RangeInclusive<f64> = 0.5..=1.5;

/// The configuration of a sensor and its lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorConfig {
    /// The bits b of the converter, 1 to 16.
    pub bits: u8,
    /// The saturation factor alpha, in (0, 256]: the brightest radiance over the peak.
    pub alpha: f64,
    /// The full scale of a picture over the end of the range, `alpha * 2^b`, in (0, 1].
    pub headroom: f64,
    /// How the ideal and the saturated image show radiance.
    pub transfer: Transfer,
    /// The columns n at the left border that a field stop shades, 0 to [`MAX_OPTICAL_BLACK`]. With q = max(1, n / 4), the
    /// radiance in column j is multiplied by `max(0, j - q + 1) / (n - q + 1)`.
    pub optical_black: usize,
    /// The blur of the lens.
    pub psf: Psf,
    /// The standard deviation of the read noise in code units, 0 to 65536.
    pub read_noise: f64,
    /// The factor of the shot noise, whose standard deviation is `sqrt(shot_noise * x)` in code units, 0 to 65536.
    pub shot_noise: f64,
    /// The photo response non-uniformity (EMVA 1288): the standard deviation of the gain between pixels as a fraction, 0 to 1.
    pub prnu: f64,
    /// The share of the samples that are hot: their dark signal is evenly distributed up to the peak, 0 to 1.
    pub hot_pixels: f64,
    /// The mean charge at which a pixel resets itself, over 2^b, 0.5 to 1.5.
    pub modulus: f64,
    /// The mean light that a pixel loses while it resets itself, in code units of the charge, 0 to 65536. Radiance is in
    /// code units of which there are 2^b from one reset of the mean pixel to the next, so that no error adds up.
    pub reset_loss: f64,
    /// The standard deviation between pixels of the modulus and of the loss, as a fraction, 0 to 1.
    pub reset_spread: f64,
    /// The gains of the pixels; with a colour mosaic, of each 2 x 2 pixels.
    pub gains: Gains,
    /// The colour filters of the pixels; `None` if each pixel sees all channels of the radiance.
    pub mosaic: Option<Mosaic>,
}

impl SensorConfig {
    /// A sensor of 8 bits, one gain and no mosaic, alpha 4, without headroom (1), blur and noise.
    pub const PLAIN: Self = Self {
        bits: 8,
        alpha: 4.0,
        headroom: 1.0,
        transfer: Transfer::Linear,
        optical_black: 0,
        psf: Psf::None,
        read_noise: 0.0,
        shot_noise: 0.0,
        prnu: 0.0,
        hot_pixels: 0.0,
        modulus: 1.0,
        reset_loss: 0.0,
        reset_spread: 0.0,
        gains: Gains::One,
        mosaic: None,
    };
}

impl SensorConfig {
    /// Returns the standard deviation of the noise at the end of the range, in code units, the fixed patterns of the gains and of the resets
    /// included. Hot samples are no noise.
    pub fn noise(&self) -> f64 {
        let most = self.alpha * self.peak();
        let gains = self.prnu.hypot(self.reset_spread) * most;
        (self.read_noise.powi(2) + self.shot_noise * most + gains.powi(2)).sqrt() + self.reset_error()
    }

    /// Returns the largest error of `y + k 2^b` that a reset of a pixel causes, in code units. It is that of the mean pixel,
    /// [`reset_loss`](Self::reset_loss) or the difference of 2^b from the light between two resets, and the spread of the latter.
    ///
    /// Unlike noise, it can be the same in all samples of a sum. In `noise` it is counted in full, not as a square: seven standard
    /// deviations of noise in a sum of up to 49 samples are then no less than the sum of these errors.
    fn reset_error(&self) -> f64 {
        let cycle = self.cycle();
        self.reset_loss.max((cycle - self.peak()).abs()) + self.reset_spread * cycle
    }

    /// Returns the mean light from one reset to the next, in code units of the charge.
    fn cycle(&self) -> f64 {
        self.modulus * self.peak() + self.reset_loss
    }

    /// Returns whether each pixel resets itself at 2^b and loses no light.
    fn has_ideal_resets(&self) -> bool {
        (self.modulus, self.reset_loss, self.reset_spread) == (1.0, 0.0, 0.0)
    }

    /// Returns 2^b.
    fn peak(&self) -> f64 {
        f64::from(self.bits).exp2()
    }
}

impl Default for SensorConfig {
    /// Returns [`SensorConfig::PLAIN`].
    fn default() -> Self {
        Self::PLAIN
    }
}

/// Error: the sensor cannot be made, or the exposure cannot be taken.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SensorError {
    /// The bits, alpha or the headroom are out of range.
    #[error(transparent)]
    Range(#[from] RangeError),
    /// The field stop shades too many columns.
    #[error("optical_black is {0} columns, 0 to {MAX_OPTICAL_BLACK} are possible")]
    OpticalBlack(usize),
    /// The sigma of the lens, px, is out of range.
    #[error("psf sigma is {0} px, more than 0 and at most {MAX_SIGMA} is possible")]
    PsfSigma(f64),
    /// A noise parameter of this name is out of range: its value, and the largest possible one.
    #[error("{0} is {1}, 0 to {2} is possible")]
    Noise(&'static str, f64, f64),
    /// The modulus over 2^b is out of range.
    #[error("modulus is {0}, {start} to {end} is possible", start = MODULI.start(), end = MODULI.end())]
    Modulus(f64),
    /// The lower gain over the full one is out of range; with the largest one with which a pixel of low gain never wraps.
    #[error("gain_ratio is {0}, more than 0 and at most {1} (1 / alpha) is possible")]
    GainRatio(f64, f64),
    /// The radiance does not have the shape of an image.
    #[error(transparent)]
    Shape(#[from] FrameError),
    /// The radiance of one channel behind a mosaic is a raw mosaic, which a lens would blur across its colours.
    #[error(
        "radiance of one channel behind a colour mosaic is a raw mosaic, which has its lens already; set psf_sigma to 0"
    )]
    RawMosaic,
    /// The sample of the radiance at this position is NaN or infinite.
    #[error("radiance at ({0}) is {1}, finite numbers are needed")]
    NotFinite(SamplePosition, f32),
}

/// A sensor with a valid configuration.
///
/// ```
/// use modulo_core::{Sensor, SensorConfig};
/// use ndarray::Array3;
///
/// // An image whose right half is four times as bright as the peak of 8 bits allows.
/// let radiance = Array3::from_shape_fn((4, 8, 1), |(_, column, _)| if column < 4 { 0.1 } else { 0.9 });
/// let config = SensorConfig { alpha: 4.0, ..SensorConfig::default() };
/// let exposure = Sensor::new(config)?.expose(radiance.view(), 0)?;
/// let modulo = exposure.modulo();
/// // x = 0.9 * 4 * 256 = 921 counts, which wrap three times: 921 = 153 + 3 * 256.
/// assert_eq!(modulo.as_u8().map(|pixels| pixels[(0, 7, 0)]), Some(153));
/// assert_eq!(exposure.wraps()[(0, 7, 0)], 3);
/// # Ok::<(), modulo_core::SensorError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Sensor {
    config: SensorConfig,
    range: Range,
    /// The share of the radiance that passes the field stop in each of the first columns.
    shade: Vec<f32>,
    taps: Vec<f32>,
    layout: PixelArrangement,
}

/// The gain and the colour of each pixel.
#[derive(Clone, Copy, Debug)]
struct PixelArrangement {
    gains: Gains,
    mosaic: Option<Mosaic>,
}

impl PixelArrangement {
    /// Returns the gain of a pixel over the full one.
    fn gain(self, row: usize, column: usize) -> f64 {
        self.gains.behind(self.mosaic, row, column)
    }
}

impl Sensor {
    /// Checks `config` and makes the kernel of the lens.
    ///
    /// # Errors
    /// [`SensorError`] names the parameter, its value and its range; NaN is an error.
    pub fn new(config: SensorConfig) -> Result<Self, SensorError> {
        let range = Range::new(config.bits, config.alpha)?
            .with_headroom(config.headroom)?
            .with_optical_black(config.optical_black);
        if config.optical_black > MAX_OPTICAL_BLACK {
            return Err(SensorError::OpticalBlack(config.optical_black));
        }
        // The negation and `contains` below refuse NaN, too.
        if let Psf::Gaussian { sigma } = config.psf
            && !(sigma > 0.0 && sigma <= MAX_SIGMA)
        {
            return Err(SensorError::PsfSigma(sigma));
        }
        let SensorConfig { read_noise, shot_noise, prnu, hot_pixels, gains, mosaic, .. } = config;
        for (name, value, most) in [
            ("read_noise", read_noise, MAX_NOISE),
            ("shot_noise", shot_noise, MAX_NOISE),
            ("prnu", prnu, 1.0),
            ("hot_pixels", hot_pixels, 1.0),
            ("reset_loss", config.reset_loss, MAX_NOISE),
            ("reset_spread", config.reset_spread, 1.0),
        ] {
            if !(0.0..=most).contains(&value) {
                return Err(SensorError::Noise(name, value, most));
            }
        }
        if !MODULI.contains(&config.modulus) {
            return Err(SensorError::Modulus(config.modulus));
        }
        if let Gains::Checkerboard { ratio } = gains {
            let most = range.alpha().recip().min(1.0);
            if !(ratio > 0.0 && ratio <= most) {
                return Err(SensorError::GainRatio(ratio, most));
            }
        }
        let (shade, taps) = (shade(config.optical_black, range.black()), config.psf.taps());
        Ok(Self { config, range, shade, taps, layout: PixelArrangement { gains, mosaic } })
    }

    /// Returns the bits, alpha, the headroom and the number of columns that are black.
    pub fn range(&self) -> Range {
        self.range
    }

    /// Returns the gains of the pixels.
    pub fn gains(&self) -> Gains {
        self.layout.gains
    }

    /// Exposes the sensor to `radiance`, H x W x C with full scale 1; values outside `[0, 1)` are clamped. `x =
    /// headroom * alpha * 2^b * blur(shade * radiance) + noise`, with the shade of [`SensorConfig::optical_black`], is clamped to `[0, alpha * 2^b)`. The blur repeats the sample at the
    /// border of the image (`dcba|abcd|dcba`). With a mosaic, each pixel keeps one of three channels; radiance of one channel is that of a raw mosaic,
    /// which is taken as it is and cannot be blurred.
    ///
    /// # Errors
    /// [`SensorError`] when the shape is not that of an image, or not one of which the sensor has a mosaic, or a value is NaN or
    /// infinite.
    pub fn expose(&self, radiance: ArrayView3<'_, f32>, seed: u64) -> Result<Exposure, SensorError> {
        let dim @ (height, width, channels) = radiance.dim();
        self.check_radiance(dim)?;
        // `floor(x / 2^b)` must never reach `ceil(alpha)`, so x stays strictly below the limit even after rounding.
        let (most, white) = (largest_below(self.range.limit()), self.range.white());
        let (mut random, mut fault) = (Pcg64Mcg::seed_from_u64(seed), None);
        let mut pattern = Pcg64Mcg::seed_from_u64(PATTERN_SEED);
        let mut lens = RowFilter::new(dim, &self.taps, Border::HalfSample);
        let seen = if self.layout.mosaic.is_some() { 1 } else { channels };
        let mut x = Vec::with_capacity(height * width * seen);
        let (mut light, mut line) = (vec![0.0; width * channels], vec![0.0; width * seen]);
        // All steps row by row, since a row stays in the cache and an image does not.
        for row in 0..height {
            let read = |row: usize, to: &mut [f32]| {
                if let Some(index) = self.read_row(radiance.index_axis(Axis(0), row), to) {
                    fault.get_or_insert((row * to.len() + index, to[index]));
                }
            };
            match self.layout.mosaic {
                Some(mosaic) if channels == 3 => {
                    // The lens lies in front of the filters, so that it blurs each colour by itself.
                    lens.next_row(read, &mut light);
                    mosaic.filter_row(row, &light, &mut line);
                }
                _ => lens.next_row(read, &mut line),
            }
            // The factor need not be exact in `f32`; in double precision a product is rounded only once.
            widest!(line.iter_mut().for_each(|value| *value = (white * f64::from(*value)) as f32));
            self.add_fixed_pattern(&mut line, &mut pattern);
            // The noise comes after the lens, which blurs light and not the charge of the sensor.
            self.add_noise(&mut line, (row, seen), &mut random);
            widest!(line.iter_mut().for_each(|value| *value = value.clamp(0.0, most)));
            x.extend_from_slice(&line);
        }
        if let Some((index, value)) = fault {
            return Err(SensorError::NotFinite(position_of(index, dim), value));
        }
        let x = Array3::from_shape_vec((height, width, seen), x).expect("x has the rows of this shape");
        Ok(Exposure { x, range: self.range, config: self.config, layout: self.layout })
    }

    /// Copies a row of radiance (W x C) into `to`, clamped to `[0, 1)` and shaded by the field stop, which lies in front of the lens: a value above
    /// full scale would otherwise leak into its neighbours in the blur. Returns the index of the first value that is not finite; then the row is
    /// copied as it is.
    fn read_row(&self, radiance: ArrayView2<'_, f32>, to: &mut [f32]) -> Option<usize> {
        let channels = radiance.dim().1;
        // The order of the samples is that of the noise, so that a seed gives the same image for every memory layout.
        match radiance.to_slice() {
            Some(row) => to.copy_from_slice(row),
            None => to.iter_mut().zip(radiance).for_each(|(to, &value)| *to = value),
        }
        // One pass without a branch; the position is looked for only when there is one.
        if !widest!(to.iter().fold(true, |finite, value| finite & value.is_finite())) {
            return to.iter().position(|value| !value.is_finite());
        }
        widest!(to.iter_mut().for_each(|value| *value = value.clamp(0.0, BELOW_ONE)));
        for (pixel, share) in to.chunks_exact_mut(channels).zip(&self.shade) {
            pixel.iter_mut().for_each(|value| *value *= share);
        }
        None
    }

    /// Returns an error for radiance of a shape that this sensor cannot see.
    fn check_radiance(
        &self,
        dim @ (height, width, channels): (usize, usize, usize),
    ) -> Result<(), SensorError> {
        check_shape(dim)?;
        if self.layout.mosaic.is_some() && channels == 1 && self.taps.len() > 1 {
            return Err(SensorError::RawMosaic);
        }
        if self.layout.mosaic.is_some() && height.min(width) < 2 {
            return Err(FrameError::Mosaic(height, width, 1, 8).into());
        }
        Ok(())
    }

    /// Applies the gains of the pixels to the row `x` (>= 0, code units) and adds the dark signal of the hot ones.
    fn add_fixed_pattern(&self, x: &mut [f32], pattern: &mut Pcg64Mcg) {
        let SensorConfig { prnu, hot_pixels, .. } = self.config;
        if prnu == 0.0 && hot_pixels == 0.0 {
            return;
        }
        for sample in x {
            // All numbers of a sample are drawn whether they are used or not, so that the hot pixels do not depend on the gains.
            let deviate: f64 = StandardNormal.sample(pattern);
            let [chance, level]: [f64; 2] = [(); 2].map(|()| StandardUniform.sample(pattern));
            let dark = if chance < hot_pixels { level * f64::from(self.range.peak()) } else { 0.0 };
            *sample = (f64::from(*sample) * (1.0 + prnu * deviate).max(0.0) + dark) as f32;
        }
    }

    /// Adds Gaussian noise of the variance `(read / gain)^2 + shot x` to every sample of the row `x` (>= 0, code units at full gain).
    ///
    /// Shot and read noise are independent, so one random number stands for both.
    fn add_noise(&self, x: &mut [f32], (row, channels): (usize, usize), random: &mut Pcg64Mcg) {
        let SensorConfig { shot_noise: shot, read_noise: read, .. } = self.config;
        // A sensor without noise is the common case, and drawing numbers for it would only cost time.
        if shot == 0.0 && read == 0.0 {
            return;
        }
        for (index, sample) in x.iter_mut().enumerate() {
            let gain = self.layout.gain(row, index / channels);
            let sigma = (read * read / (gain * gain) + shot * f64::from(*sample)).sqrt();
            let deviate: f64 = StandardNormal.sample(random);
            *sample += (sigma * deviate) as f32;
        }
    }
}

/// Returns the share of the radiance that passes the field stop in each of `columns` columns: 0 in those that are `black`, then a
/// straight line to 1 in the first column that is not shaded.
fn shade(columns: usize, black: usize) -> Vec<f32> {
    (1..=columns).map(|n| n.saturating_sub(black) as f32 / (columns - black + 1) as f32).collect()
}

/// Returns the largest `f32` strictly below `limit` (> 0), or 0.
fn largest_below(limit: f64) -> f32 {
    let nearest = limit as f32;
    // The conversion rounds to nearest, which may be at the limit or above it.
    if f64::from(nearest) < limit { nearest } else { nearest.next_down().max(0.0) }
}

/// The radiance on the sensor before any converter: the ground truth of unwrapping.
#[derive(Clone, Debug)]
pub struct Exposure {
    x: Array3<f32>,
    range: Range,
    config: SensorConfig,
    layout: PixelArrangement,
}

impl Exposure {
    /// Returns the radiance with blur and noise, H x W x C in code units, in `[0, alpha * 2^b)`; C is 1 with a mosaic.
    pub fn x(&self) -> &Array3<f32> {
        &self.x
    }

    /// Returns the bits, alpha and the columns that are black.
    pub fn range(&self) -> Range {
        self.range
    }

    /// Returns what a method that unwraps the modulo image is to know: the range and the lens.
    pub fn scene(&self) -> Scene {
        let noise = Some(self.config.noise());
        Scene { lens: Some(self.config.psf), noise, ..self.range.into() }
    }

    /// Returns how the ideal and the saturated image show radiance.
    pub fn transfer(&self) -> Transfer {
        self.config.transfer
    }

    /// Returns the gains of the pixels.
    pub fn gains(&self) -> Gains {
        self.layout.gains
    }

    /// Returns the colour filters of the pixels.
    pub fn mosaic(&self) -> Option<Mosaic> {
        self.layout.mosaic
    }

    /// Returns the gain of a pixel over the full one.
    pub fn gain(&self, row: usize, column: usize) -> f64 {
        self.layout.gain(row, column)
    }

    /// Returns the modulo stream (eq. 1): `y = floor(gain x mod 2^b)`, 8-bit samples for b <= 8, else 16-bit samples. With resets that are
    /// not ideal, y is the [charge](Self::charge), clipped at the largest code.
    pub fn modulo(&self) -> Frame {
        if !self.config.has_ideal_resets() {
            let most = self.most();
            return self.digitise(&self.charged().0, |count| count.min(most));
        }
        // x is not negative, so the remainder by a power of two is a mask of its integer part.
        let mask = (1 << self.range.bits()) - 1;
        self.digitise(&self.converted(), |count| count & mask)
    }

    /// Returns the saturated stream: the codes that the transfer function has for `floor(min(x, 2^b - 1))`, with samples as in
    /// [`Exposure::modulo`]. With two gains it is the image of spatially varying exposure, `floor(x / (headroom * alpha))`, where a
    /// pixel of full gain that saturates is predicted from its neighbours of low gain.
    pub fn saturated(&self) -> Frame {
        if self.layout.gains == Gains::One {
            return self.clipped(&self.x);
        }
        let scale = (self.range.white() / f64::from(self.range.peak())) as f32;
        self.clipped(&self.saturated_radiance().mapv(|x| x / scale))
    }

    /// Returns the radiance that a sensor which saturates measures, in code units at full gain: the codes clipped at the peak. With two
    /// gains, what saturates is predicted as in [`Exposure::saturated`].
    pub fn saturated_radiance(&self) -> Array3<f32> {
        let most = self.most();
        let codes = mapped(&self.converted(), |x| whole(x).min(most) as f32);
        let Gains::Checkerboard { ratio } = self.layout.gains else { return codes };
        let x = match self.layout.mosaic {
            None => merge_saturated(&codes, ratio, self.range),
            Some(mosaic) => {
                let (ratio, peak) = (ratio as f32, self.range.peak());
                merge_saturated_mosaic(&codes, MosaicGains { ratio, mosaic, peak })
            }
        };
        x.mapv_into(|x| x.max(0.0))
    }

    /// Returns the ideal stream: `floor(x)`, neither wrapped nor clipped, shown with 8 bits as by [`tone::picture`].
    pub fn ideal(&self) -> Frame {
        // Rounded down before it is shown: the ideal stream shows the same counts as the other two.
        self.frame(Frame::from_u8(tone::shown(&self.x, self.range, self.config.transfer, |x| {
            whole(x) as f32
        })))
    }

    /// Returns the charge of each sample before the converter, in code units: `gain x mod 2^b` if the resets are ideal.
    pub fn charge(&self) -> Array3<f32> {
        if self.config.has_ideal_resets() {
            return self.converted().mapv(|x| x % self.range.peak());
        }
        self.charged().0
    }

    /// Returns the charge of each sample, and how often it was reset. A pixel resets itself when its charge reaches its modulus,
    /// and then loses light. Light beyond the resets that the range has is lost, as that beyond the range is, and that of low gain
    /// resets no pixel.
    fn charged(&self) -> (Array3<f32>, Array3<u8>) {
        let config = &self.config;
        let (cycle, most) = (config.cycle(), f64::from(self.range.max_wraps()));
        let mut pattern = Pcg64Mcg::seed_from_u64(RESET_SEED);
        let mut charge = self.converted().into_owned();
        let mut resets = Array3::zeros(charge.dim());
        for (((row, column, _), charge), resets) in charge.indexed_iter_mut().zip(&mut resets) {
            let deviate: f64 = StandardNormal.sample(&mut pattern);
            let own = (1.0 + config.reset_spread * deviate).max(LEAST_MODULUS);
            let modulus = own * config.modulus * config.peak();
            let light = f64::from(*charge) / config.peak() * cycle;
            let last = if self.gain(row, column) == 1.0 { most } else { 0.0 };
            let full = (light / (own * cycle)).floor().min(last);
            let rest = light - full * own * cycle;
            let is_resetting = rest >= modulus && full < last;
            // The quotient may be rounded up.
            *charge = if is_resetting { 0.0 } else { rest.clamp(0.0, modulus) } as f32;
            *resets = full as u8 + u8::from(is_resetting);
        }
        (charge, resets)
    }

    /// Returns the true wrap counts: `k = floor(gain x / 2^b)`, at most `ceil(alpha) - 1`, and 0 at pixels of low gain. With resets that
    /// are not ideal, it is their number.
    pub fn wraps(&self) -> Array3<u8> {
        if !self.config.has_ideal_resets() {
            return self.charged().1;
        }
        let bits = self.range.bits();
        self.converted().mapv(|x| (whole(x) >> bits) as u8)
    }

    /// Returns the number of the samples of full gain with the true wrap count in `k`, and that of all of full gain. `None` if `k` has
    /// another shape.
    pub fn exact_counts(&self, k: &Array3<u8>) -> Option<(u64, u64)> {
        let wraps = self.wraps();
        if k.dim() != wraps.dim() {
            return None;
        }
        let full =
            wraps.indexed_iter().zip(k).filter(|(((row, column, _), _), _)| self.gain(*row, *column) == 1.0);
        Some(full.fold((0, 0), |(exact, all), ((_, true_k), k)| (exact + u64::from(true_k == k), all + 1)))
    }

    /// Returns the share of [`exact_counts`](Self::exact_counts); 1 if there are no samples.
    pub fn exact_share(&self, k: &Array3<u8>) -> Option<f64> {
        let (exact, all) = self.exact_counts(k)?;
        Some(if all == 0 { 1.0 } else { exact as f64 / all as f64 })
    }

    /// Returns the radiance in the code units of each pixel: `gain x`.
    fn converted(&self) -> Cow<'_, Array3<f32>> {
        let Gains::Checkerboard { .. } = self.layout.gains else { return Cow::Borrowed(&self.x) };
        // The product must stay below 2^b at pixels of low gain, also when it is rounded.
        let below_peak = largest_below(f64::from(self.range.peak()));
        let mut x = self.x.clone();
        for ((row, column, _), x) in x.indexed_iter_mut() {
            let gain = self.gain(row, column);
            if gain < 1.0 {
                *x = ((f64::from(*x) * gain) as f32).min(below_peak);
            }
        }
        Cow::Owned(x)
    }

    /// Returns the largest code of the converter.
    fn most(&self) -> u32 {
        (1 << self.range.bits()) - 1
    }

    /// Returns the picture of a sensor that saturates.
    pub(crate) fn clipped(&self, x: &Array3<f32>) -> Frame {
        let most = self.most();
        if self.config.transfer == Transfer::Linear {
            return self.digitise(x, |count| count.min(most));
        }
        let codes = self.config.transfer.codes(most as u16);
        self.digitise(x, |count| codes[count.min(most) as usize].into())
    }

    /// Makes integer samples from `floor(x)`.
    #[inline(always)]
    fn digitise(&self, x: &Array3<f32>, code: impl Fn(u32) -> u32) -> Frame {
        self.frame(if self.range.bits() <= 8 {
            Frame::from_u8(mapped(x, |x| code(whole(x)) as u8))
        } else {
            Frame::from_u16(mapped(x, |x| code(whole(x)) as u16))
        })
    }

    /// Returns the frame with the mosaic of the sensor.
    fn frame(&self, frame: Result<Frame, FrameError>) -> Frame {
        match self.layout.mosaic {
            None => frame,
            Some(mosaic) => frame.and_then(|frame| frame.with_mosaic(mosaic)),
        }
        .expect(IS_AN_IMAGE)
    }
}

/// Returns `floor(x)`, which fits 24 bits.
#[inline(always)]
fn whole(x: f32) -> u32 {
    floor(f64::from(x))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variance_is_shot_and_read_together() {
        let mut x = vec![400.0; 100_000];
        let config = SensorConfig { read_noise: 5.0, shot_noise: 0.25, ..SensorConfig::default() };
        Sensor::new(config).unwrap().add_noise(&mut x, (0, 1), &mut Pcg64Mcg::seed_from_u64(7));
        let mean = x.iter().map(|v| f64::from(*v)).sum::<f64>() / x.len() as f64;
        let variance = x.iter().map(|v| (f64::from(*v) - mean).powi(2)).sum::<f64>() / x.len() as f64;
        assert!((mean - 400.0).abs() < 0.2, "mean {mean}");
        assert!((variance - 125.0).abs() < 3.0, "variance {variance}");
    }
}
