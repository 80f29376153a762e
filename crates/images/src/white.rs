//! [`White`]: the samples of frames as radiance, by the [`Coding`] of their source.

use modulo_core::sensor::BELOW_ONE;
use modulo_core::{Frame, Mosaic, Samples, Transfer};
use ndarray::Array3;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::ImageError;
use crate::knees::Knees;

/// The automatic white point of a float image is this percentile of its samples. A hot pixel is above it.
pub const WHITE_PERCENTILE: f64 = 99.9;
/// The largest code of a converter of 12 bits.
const TWELVE_BITS: u16 = 4095;

/// How the samples of a source stand for radiance.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Coding {
    /// Value of full scale in float images and in images of 16 bits. 0: 65536 in the latter, and the percentile
    /// [`WHITE_PERCENTILE`] of the first float image that is not black.
    pub white: f32,
    /// Value without light (the black level), 0 or above and below that of full scale. Its radiance is 0.
    pub black: f32,
    /// Knee points of companded codes, whose last value is full scale.
    pub knees: Option<Knees>,
    /// How integers without knee points stand for radiance; floats are linear.
    pub transfer: Transfer,
    /// The mosaic of the sensor that sees the frames. Raw mosaics of the same order are sensed as they are, others are refused.
    pub mosaic: Option<Mosaic>,
}

/// Converts frames to radiance as a fraction of the peak.
#[derive(Debug)]
pub struct White {
    coding: Coding,
    /// The value of full scale, where it is given.
    given: Option<f32>,
    /// The code of full scale in images of 8 bits.
    eight: f32,
    /// The radiance of full scale that was found in a float image.
    found: Option<f32>,
    /// Whether an image had codes that need more than 12 bits.
    wide: bool,
}

impl White {
    /// Reads the samples as `coding` has it.
    ///
    /// # Errors
    /// [`ImageError::Coding`] for a white or a black that is negative, infinite or NaN, for a black that is not below a given white, and for a
    /// white beside knee points.
    pub fn new(coding: Coding) -> Result<Self, ImageError> {
        let Coding { white, black, ref knees, .. } = coding;
        let wrong = |name, value, why| Err(ImageError::Coding(name, value, why));
        if !(white.is_finite() && white >= 0.0) {
            return wrong("white", white, "must be a finite number, 0 (automatic) or above");
        }
        if knees.is_some() && white > 0.0 {
            return wrong("white", white, "must be 0 beside knees, whose last value is full scale");
        }
        let given = knees.as_ref().map(|knees| knees.end().1).or(Some(white).filter(|white| *white > 0.0));
        if !(black >= 0.0 && black < given.unwrap_or(65536.0)) {
            return wrong("black", black, "must be 0 or above, and below the value of full scale");
        }
        let given = given.filter(|_| knees.is_none());
        Ok(Self { coding, given, eight: f32::from(u8::MAX), found: None, wide: false })
    }

    /// Takes `most` > 0, the largest sample of a camera that has described itself, for full scale, unless a white was given.
    #[must_use]
    pub fn of_described(self, most: f32) -> Self {
        Self { given: self.given.or(Some(most)), eight: self.eight.min(most), ..self }
    }

    /// The radiance of full scale that was found in a float image.
    pub fn found(&self) -> Option<f32> {
        self.found
    }

    /// Returns whether no image with samples of 8, 16 or 32 bits changes how later images are read.
    pub fn is_settled(&self, depth: u32) -> bool {
        self.given.is_some()
            || self.coding.knees.is_some()
            || match depth {
                8 => true,
                16 => self.wide,
                _ => self.found.is_some(),
            }
    }

    /// Learns from `frame` what [`White::radiance`] would learn from it, such as the white point. `origin` is the name of the
    /// frame in the log.
    pub fn learn(&mut self, frame: &Frame, origin: impl std::fmt::Display) {
        if self.given.is_some() {
            return;
        }
        match frame.samples() {
            Samples::U8(_) => {}
            Samples::U16(codes) => self.wide |= codes.iter().any(|code| *code > TWELVE_BITS),
            // A black image says nothing about the white point, so that the search goes on with the next image. Once
            // found, it stays: a new one for each frame of a sequence would make its brightness flicker.
            Samples::F32(linear) if self.found.is_none() => {
                self.found = bright(linear);
                if let Some(white) = self.found {
                    tracing::info!("white is {white}, the {WHITE_PERCENTILE}th percentile of {origin}");
                }
            }
            Samples::F32(_) => {}
        }
    }

    /// Returns the radiance in `[0, 1)`, `H x W x C`; C is 1 for a raw mosaic. With the value v of a sample, which is its code, its float or
    /// the linear value of its companded code, and the value w of full scale, it is `(v - black) / (w - black)`, clamped to this range, and
    /// decoded by the transfer function for integers without knee points. `origin` is the name of the frame in errors.
    ///
    /// A code of integers stands for all radiance from half a code below it to half a code above it, so each sample is moved
    /// at random within this interval, in the same way for each frame. Without this dither the radiance of a picture lies
    /// on a grid: at an alpha of 4, all counts are multiples of 4, and the low bits of y depend on the wrap count. The
    /// largest code stands for clipped radiance and stays.
    ///
    /// # Errors
    /// [`ImageError::Undecodable`] for 16 bits without a given white point whose largest code is in 256 to 4095, unless an
    /// earlier frame had a larger one; for a raw mosaic of another order than that of the sensor; for knee points of another
    /// kind of samples, or that end below a code; and for a black that is not below full scale.
    pub fn radiance(
        &mut self,
        frame: &Frame,
        origin: impl std::fmt::Display,
    ) -> Result<Array3<f32>, ImageError> {
        let refuse = |why: String| ImageError::Undecodable(origin.to_string(), why);
        if let Some(mosaic) = frame.mosaic().filter(|mosaic| self.coding.mosaic != Some(*mosaic)) {
            let (has, own) = (mosaic.word(), self.coding.mosaic.map_or("none", Mosaic::word));
            return Err(refuse(format!(
                "is a raw mosaic {has}, which only a sensor with the same colour filters can see, but mosaic is {own}; set mosaic to {has}, and \
                 psf_sigma to 0, since the image has its lens already"
            )));
        }
        self.learn(frame, &origin);
        let (values, white) = self.values(frame).map_err(refuse)?;
        let black = self.coding.black;
        if black >= white {
            return Err(refuse(format!(
                "has the full scale {white}, but black is {black}; give a lower black"
            )));
        }
        let radiance = scaled(values, black, white);
        let is_coded = frame.depth() < 32 && self.coding.knees.is_none();
        Ok(match self.coding.transfer {
            Transfer::Linear => radiance,
            transfer if is_coded => radiance.mapv_into(|code| transfer.decode(code.into()) as f32),
            _ => radiance,
        })
    }

    /// Returns the values of a frame and that of full scale, in one linear scale unless the transfer function is another. The error is the
    /// reason.
    fn values(&self, frame: &Frame) -> Result<(Array3<f32>, f32), String> {
        Ok(match (frame.samples(), &self.coding.knees) {
            (samples, Some(knees)) => (companded(samples, knees)?, knees.end().1),
            // The largest code stands for full scale and all beyond it: a clipped sky saturates the sensor, too.
            (Samples::U8(codes), None) => (dithered(codes, self.eight), self.eight),
            (Samples::U16(codes), None) => match self.given {
                Some(white) => (dithered(codes, white.floor()), white),
                None => {
                    let largest = codes.iter().copied().max().unwrap_or_default();
                    // Read as 16 bits, such an image would be so dark that no alpha of use wraps it: every figure would
                    // be perfect and mean nothing. A nearly black image fits both readings, so it says nothing.
                    if !self.wide && largest > u16::from(u8::MAX) {
                        return Err(format!(
                            "is an image of 16 bits, but its largest code is {largest}, as from a converter of at most 12 bits; \
                             give the code of full scale as white, such as 4096 for 12 bits, or 65536 for a dark image of 16 bits"
                        ));
                    }
                    (dithered(codes, f32::from(u16::MAX)), 65536.0)
                }
            },
            // No full scale was found as long as all images were black.
            (Samples::F32(linear), None) => (linear.clone(), self.given.or(self.found).unwrap_or(f32::MAX)),
        })
    }
}

/// Returns the linear values of companded codes, with dither. The error is the reason why these samples are no such codes.
fn companded(samples: &Samples, knees: &Knees) -> Result<Array3<f32>, String> {
    let most = knees.end().0;
    let Samples::U16(codes) = samples else {
        return Err(format!(
            "is no image of 16 bits, in which the companded codes up to {most} of knees are; give no knees for it"
        ));
    };
    let largest = codes.iter().copied().max().expect("an image has a pixel");
    if f32::from(largest) > most {
        return Err(format!(
            "has the code {largest}, but knees end at {most}; give the knee points of its camera"
        ));
    }
    Ok(dithered(codes, most).mapv_into(|code| knees.linear(code)))
}

/// Moves each code by up to half a code, but none below 0, and none from `white` on.
fn dithered<T: Copy + Into<f32>>(codes: &Array3<T>, white: f32) -> Array3<f32> {
    /// Any number will do: the noise of the sensor has its own seed.
    const SEED: u64 = 0x6d6f_6475_6c6f;
    let mut random = Pcg64Mcg::seed_from_u64(SEED);
    let mut shifts = vec![0; codes.len()];
    random.fill_bytes(&mut shifts);
    let shifted = codes.iter().zip(shifts).map(|(&code, shift): (_, u8)| {
        let code = code.into();
        if code >= white { code } else { (code + (f32::from(shift) + 0.5) / 256.0 - 0.5).max(0.0) }
    });
    Array3::from_shape_vec(codes.dim(), shifted.collect()).expect("each code has its shift")
}

/// [`WHITE_PERCENTILE`] of the samples by the nearest rank, or the largest one if that is not above 0. `None` for a black
/// image.
fn bright(linear: &Array3<f32>) -> Option<f32> {
    let mut samples: Vec<f32> = linear.iter().copied().collect();
    let rank = (samples.len() as f64 * WHITE_PERCENTILE / 100.0).ceil() as usize;
    let (_, high, above) = samples.select_nth_unstable_by(rank.checked_sub(1)?, f32::total_cmp);
    let largest = above.iter().copied().fold(*high, f32::max);
    [*high, largest].into_iter().find(|white| *white > 0.0)
}

/// Returns the fraction at which `values` lie between `black` and `white`, clamped to `[0, 1)`.
fn scaled(values: Array3<f32>, black: f32, white: f32) -> Array3<f32> {
    // The division is done in f64, because a tiny white point would overflow f32. The radiance stays below 1,
    // because the full range of the sensor is half-open.
    let (black, range) = (f64::from(black), f64::from(white) - f64::from(black));
    values.mapv_into(|v| (((f64::from(v) - black) / range) as f32).clamp(0.0, BELOW_ONE))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ndarray::Axis;

    fn of_white(white: f32) -> Result<White, ImageError> {
        White::new(Coding { white, ..Coding::default() })
    }

    fn linear(values: [f32; 3]) -> Frame {
        let pixels = Array3::from_shape_vec((1, 3, 1), values.to_vec()).expect("1 x 3 x 1");
        Frame::from_f32(pixels).expect("a frame")
    }

    #[test]
    fn automatic_white_is_the_first_bright_image_and_stays() {
        let mut white = White::new(Coding::default()).expect("0 is automatic");
        let mut radiance =
            |values| white.radiance(&linear(values), "sky").expect("floats").into_raw_vec_and_offset().0;
        assert_eq!(radiance([0.0, 0.0, -1.0]), [0.0; 3]);
        assert_eq!(radiance([1.0, 2.0, 4.0]), [0.25, 0.5, BELOW_ONE]);
        assert_eq!(radiance([1.0, 8.0, 2.0]), [0.25, BELOW_ONE, 0.5]);
        assert_eq!(white.found(), Some(4.0));
    }

    #[test]
    fn a_hot_pixel_is_not_white() {
        let pixels =
            |value: f32| Array3::from_shape_fn((40, 40, 1), |at| if at == (3, 5, 0) { 1e6 } else { value });
        for value in [0.5, 2.0] {
            let mut white = White::new(Coding::default()).expect("0 is automatic");
            let frame = Frame::from_f32(pixels(value)).expect("a frame");
            let radiance = white.radiance(&frame, "sky").expect("floats");
            assert_eq!((white.found(), radiance[(0, 0, 0)]), (Some(value), BELOW_ONE));
        }
        let mut white = White::new(Coding::default()).expect("0 is automatic");
        white.radiance(&Frame::from_f32(pixels(0.0)).expect("a frame"), "stars").expect("floats");
        assert_eq!(white.found(), Some(1e6), "a star on black is all there is");
    }

    fn deep(code: u16) -> Frame {
        Frame::from_u16(Array3::from_elem((1, 1, 1), code)).expect("one pixel")
    }

    /// Codes of 6, 14 and 8 bits.
    #[test]
    fn a_described_camera_has_its_own_full_scale() {
        let eight = |code| Frame::from_u8(Array3::from_elem((1, 1, 1), code)).expect("one pixel");
        for (frame, most) in [(eight(63), 63.0), (deep(16383), 16383.0), (eight(255), 4095.0)] {
            let white = |white: f32| of_white(white).expect("possible").of_described(most);
            assert_eq!(white(0.0).radiance(&frame, "a").expect("radiance")[(0, 0, 0)], BELOW_ONE);
            let dark =
                White::new(Coding::default()).expect("possible").radiance(&frame, "a").expect("radiance");
            assert_eq!(dark[(0, 0, 0)] < 0.3, most < 255.0 || frame.depth() > 8);
        }
        let mut given = of_white(65536.0).expect("possible").of_described(16383.0);
        assert!(
            given.radiance(&deep(16383), "a").expect("radiance")[(0, 0, 0)] < 0.3,
            "what is given counts"
        );
    }

    #[test]
    fn codes_are_fractions_of_the_peak() {
        let codes = |v: u16| {
            White::new(Coding::default()).expect("0 is automatic").radiance(&deep(v), "a").expect("16 bits")
                [(0, 0, 0)]
        };
        for (code, fraction) in [(32768, 0.5), (64, 1.0 / 1024.0), (65535, 65535.0 / 65536.0)] {
            assert!((codes(code) - fraction).abs() <= 0.5 / 65536.0, "{code}");
        }
    }

    #[test]
    fn codes_are_spread_over_the_interval_that_they_stand_for() {
        let pixels = Array3::from_shape_fn((100, 256, 3), |(_, code, _)| code as u8);
        let frame = Frame::from_u8(pixels).expect("a frame");
        let radiance =
            White::new(Coding::default()).expect("0 is automatic").radiance(&frame, "a").expect("8 bits");
        assert!(
            radiance.indexed_iter().all(|((_, code, _), value)| (value * 255.0 - code as f32).abs() <= 0.501)
        );
        assert!(radiance.index_axis(Axis(1), 255).iter().all(|value| *value == BELOW_ONE), "clipped");
        assert!(radiance.iter().all(|value| *value >= 0.0));
        for alpha in [2, 4, 8] {
            let x = radiance.mapv(|value| (value * (alpha * 256) as f32) as i32);
            // On the grid of 8 bits, the wrap count is y modulo alpha on every sample.
            let leaked = x.iter().filter(|x| *x / 256 == *x % 256 % alpha).count() as f64 / x.len() as f64;
            assert!((leaked - 1.0 / f64::from(alpha)).abs() < 0.02, "alpha {alpha}: {leaked}");
        }
    }

    #[test]
    fn integers_are_decoded_and_floats_are_not() {
        let white =
            || White::new(Coding { transfer: Transfer::Srgb, ..Coding::default() }).expect("0 is automatic");
        let pixels = Array3::from_shape_fn((1, 256, 1), |(_, code, _)| code as u8);
        let radiance = white().radiance(&Frame::from_u8(pixels).expect("a frame"), "a").expect("8 bits");
        for ((_, code, _), value) in radiance.indexed_iter() {
            let [least, most] =
                [-0.501, 0.501].map(|half| Transfer::Srgb.decode((code as f64 + half) / 255.0));
            assert!((least..=most).contains(&f64::from(*value)), "{code}: {value}");
        }
        let half = white().radiance(&deep(32768), "a").expect("16 bits")[(0, 0, 0)];
        assert!((half - 0.214).abs() < 1e-4, "{half}");
        let floats = white().radiance(&linear([1.0, 2.0, 4.0]), "a").expect("floats");
        assert_eq!(floats.into_raw_vec_and_offset().0, [0.25, 0.5, BELOW_ONE]);
    }

    #[test]
    fn codes_of_twelve_bits_ask_for_white() {
        let mut white = White::new(Coding::default()).expect("0 is automatic");
        for code in [256, 4095] {
            let why = white.radiance(&deep(code), "a.png").expect_err("few bits").to_string();
            let expected = ["a.png", &format!("largest code is {code}"), "white", "4096", "65536"];
            assert!(expected.iter().all(|expected| why.contains(expected)), "{why}");
        }
        // A sequence that has shown all its bits may go dark.
        white.radiance(&deep(4096), "b.png").expect("16 bits");
        let dark = white.radiance(&deep(4095), "c.png").expect("dark")[(0, 0, 0)];
        assert!((dark - 4095.0 / 65536.0).abs() <= 0.5 / 65536.0);
        let mut white = of_white(4096.0).expect("12 bits");
        let quarter = white.radiance(&deep(1024), "a.png").expect("12 bits")[(0, 0, 0)];
        assert!((quarter - 0.25).abs() <= 0.5 / 4096.0);
        assert_eq!(white.radiance(&deep(4096), "a.png").expect("12 bits")[(0, 0, 0)], BELOW_ONE);
    }

    #[test]
    fn radiance_lies_between_black_and_white() {
        let coding = Coding { white: 4096.0, black: 64.0, ..Coding::default() };
        let mut white = White::new(coding).expect("possible");
        for (code, fraction) in [(0, 0.0), (64, 0.0), (2080, 0.5), (4095, 4031.0 / 4032.0)] {
            let radiance = white.radiance(&deep(code), "a.png").expect("12 bits")[(0, 0, 0)];
            assert!((radiance - fraction).abs() <= 0.5 / 4032.0, "{code}: {radiance}");
        }
        let mut bright = White::new(Coding { black: 300.0, ..Coding::default() }).expect("below 65536");
        let why = bright.radiance(&Frame::from_u8(Array3::zeros((1, 1, 1))).expect("one pixel"), "a.png");
        assert!(why.expect_err("black above white").to_string().contains("black is 300"));
    }

    #[test]
    fn numbers_that_are_no_coding_are_refused() {
        let knees = || Some("10:10,20:100".parse().expect("a curve"));
        for (white, black, knees) in [
            (f32::NAN, 0.0, None),
            (f32::INFINITY, 0.0, None),
            (-1.0, 0.0, None),
            (0.0, -1.0, None),
            (0.0, f32::NAN, None),
            (64.0, 64.0, None),
            (0.0, 100.0, knees()),
            (100.0, 0.0, knees()),
        ] {
            let coding = Coding { white, black, knees, ..Coding::default() };
            assert!(White::new(coding.clone()).is_err(), "{coding:?}");
        }
        let mut white =
            White::new(Coding { knees: Some("300:300".parse().expect("a curve")), ..Coding::default() })
                .expect("possible");
        let eight = Frame::from_u8(Array3::zeros((1, 1, 1))).expect("one pixel");
        for (frame, wanted) in
            [(eight, "up to 300"), (linear([0.0, 0.5, 1.0]), "up to 300"), (deep(301), "code 301")]
        {
            let why = white.radiance(&frame, "a").expect_err("no companded codes").to_string();
            assert!(why.contains(wanted), "{why}");
        }
    }
}
