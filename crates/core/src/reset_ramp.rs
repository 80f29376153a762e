//! [`ResetRamp`]: how the pixels of a chip reset themselves, measured on frames whose light rises evenly.
//!
//! The charge of a pixel rises on a line, `c = s (t - t_i)` in frame t, until it is reset at its modulus M; the light L
//! is lost, and it rises again from t_(i+1) on. The codes between a quarter and three quarters of the largest one give
//! the lines, and `S = s (t_(i+1) - t_i)`. The line ends in the middle between the last frame before the reset and the
//! first one after it, as the number of the frames with codes above half of the largest one says, which noise lowers as
//! often as it raises it. The charge there is M, and `L = S - M`. A pixel need not see the light of another one.

use crate::frame::{Frame, Samples};
use crate::range::Range;

/// The most samples of an image that are read, which are spread over it, and the most frames.
const SAMPLES: usize = 4096;
const FRAMES: usize = 16384;

/// The least number of resets of a pixel, of frames from one to the next, and of codes on a line.
const RESETS: usize = 2;
const FRAMES_PER_RESET: f64 = 32.0;
const CODES: usize = 8;

/// At least one of this many samples must be reset as often as is needed. Those of black columns are never reset.
const ONE_OF: usize = 8;

/// The largest relative difference of the slopes and of the durations of the lines of a pixel.
const UNEVEN: f64 = 0.01;

/// The largest error that the rounding leaves to a line, in codes.
const ROUNDING: f64 = 0.5;

/// The golden ratio less 1, whose multiples spread over an interval.
const GOLDEN: f64 = 0.618_033_988_749_894_8;

/// Error: frames from which nothing can be measured.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RampError {
    /// An image differs in size from the first one.
    #[error("frame {0} has other sizes than the first one")]
    Size(usize),
    /// A code is not one of the converter.
    #[error("frame {0} has the code {1}, {2} is the largest one of so many bits")]
    Code(usize, f32, u16),
    /// There are too many frames.
    #[error("there are more than {FRAMES} frames")]
    TooMany,
    /// Too few samples have lines: how many, of how many, and how many of these never fall from above three quarters of their largest
    /// code to below a quarter of it.
    #[error(
        "{0} of {1} samples rise through {RESETS} resets with {FRAMES_PER_RESET} frames and more from one to the next, {2} \
         are never reset; let the light rise more slowly or further, until the codes have fallen to 0 three times"
    )]
    Resets(usize, usize, usize),
    /// The light does not rise evenly.
    #[error(
        "the light does not rise evenly: about reset {0}, it rises by {1:.1} % faster or slower than on average, or frames are missing; \
         {most} % is possible", most = 100.0 * UNEVEN
    )]
    Uneven(usize, f64),
}

/// How the pixels of a chip reset themselves, in code units of the charge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Resets {
    /// The median charge at which a pixel is reset.
    pub modulus: f64,
    /// The median light that is lost then.
    pub loss: f64,
    /// The largest error of both: half of the step of the light from frame to frame, and the rounding.
    pub error: f64,
    /// The standard deviation between pixels of the light from one reset to the next, as a fraction, and its error.
    pub spread: [f64; 2],
    /// The samples that were measured.
    pub samples: usize,
    /// The median number of frames from one reset to the next.
    pub frames: f64,
}

/// Frames of rising light.
#[derive(Clone, Debug)]
pub struct ResetRamp {
    largest: u16,
    dim: Option<(usize, usize, usize)>,
    places: Vec<usize>,
    /// The codes at all places, frame by frame.
    codes: Vec<u16>,
    frames: usize,
}

impl ResetRamp {
    /// Returns a ramp without frames, whose codes are those of this range.
    pub fn new(range: Range) -> Self {
        let largest = u16::MAX >> (16 - range.bits());
        Self { largest, dim: None, places: Vec::new(), codes: Vec::new(), frames: 0 }
    }

    /// Adds the next modulo image, whose light is brighter by the same step as that of all others.
    ///
    /// # Errors
    /// [`RampError`] when it is not one of this converter, or has other sizes than the first one.
    pub fn push(&mut self, y: &Frame) -> Result<(), RampError> {
        let (height, width, channels) = y.dim();
        let all = height * width * channels;
        if self.dim.is_none() {
            let place = |number: usize| ((number as f64 * GOLDEN).fract() * all as f64) as usize;
            let few = all.min(SAMPLES);
            self.places = if all <= SAMPLES { (0..all).collect() } else { (0..few).map(place).collect() };
        }
        if *self.dim.get_or_insert(y.dim()) != y.dim() {
            return Err(RampError::Size(self.frames));
        }
        if self.frames == FRAMES {
            return Err(RampError::TooMany);
        }
        for &place in &self.places {
            let at = (place / channels / width, place / channels % width, place % channels);
            let code = match y.samples() {
                Samples::U8(codes) => codes[at].into(),
                Samples::U16(codes) => codes[at].into(),
                Samples::F32(codes) => codes[at],
            };
            if !(code >= 0.0 && code <= f32::from(self.largest) && code.fract() == 0.0) {
                return Err(RampError::Code(self.frames, code, self.largest));
            }
            self.codes.push(code as u16);
        }
        self.frames += 1;
        Ok(())
    }

    /// Returns how the pixels reset themselves.
    ///
    /// # Errors
    /// [`RampError`] when too few are reset, or the light does not rise evenly.
    pub fn measured(&self) -> Result<Resets, RampError> {
        let count = self.places.len();
        let of_place = |place| self.codes.iter().skip(place).step_by(count).copied().collect::<Vec<_>>();
        let all: Vec<_> = (0..count).map(|place| Pixel::of(&of_place(place))).collect();
        let pixels: Vec<_> = all.iter().flatten().filter(|pixel| pixel.is_sampled()).collect();
        if pixels.len() * ONE_OF < count || pixels.is_empty() {
            let dark = all.iter().filter(|pixel| pixel.is_none()).count();
            return Err(RampError::Resets(pixels.len(), count, dark));
        }
        check_evenness(&pixels)?;
        let of_all = |value: fn(&Pixel) -> f64| pixels.iter().map(|pixel| value(pixel)).collect::<Vec<_>>();
        let cycles = of_all(|pixel| mean(&pixel.cycles));
        let cycle = quantile(cycles.clone(), 0.5);
        let modulus = quantile(of_all(|pixel| mean(&pixel.moduli)), 0.5);
        let [slope, frames, noise] = [
            |pixel: &Pixel| mean(&pixel.slopes),
            |pixel: &Pixel| mean(&pixel.periods),
            |pixel: &Pixel| variance(&pixel.cycles) / pixel.cycles.len() as f64,
        ]
        .map(|value| quantile(of_all(value), 0.5));
        let apart = (quantile(cycles.clone(), 0.841) - quantile(cycles, 0.159)) / 2.0;
        let spread = (apart.powi(2) - noise).max(0.0).sqrt() / cycle;
        let error = slope / 2.0 + ROUNDING;
        let of_spread = (noise.sqrt() / cycle).hypot(2.0 * spread / (2.0 * pixels.len() as f64).sqrt());
        let samples = pixels.len();
        Ok(Resets { modulus, loss: cycle - modulus, error, spread: [spread, of_spread], samples, frames })
    }
}

/// The lines of a pixel: their slopes, and, up to the next one, the frames, the light and the charge at its end.
#[derive(Clone, Debug)]
struct Pixel {
    slopes: Vec<f64>,
    periods: Vec<f64>,
    cycles: Vec<f64>,
    moduli: Vec<f64>,
}

impl Pixel {
    /// Reads the codes of a pixel in all frames; `None` if it is never reset.
    fn of(codes: &[u16]) -> Option<Self> {
        let most = codes.iter().copied().max().unwrap_or(0);
        let lines = lines(codes, most);
        let mut pixel = Self { slopes: vec![], periods: vec![], cycles: vec![], moduli: vec![] };
        for pair in lines.windows(2) {
            let ([line, next], half) = ([&pair[0], &pair[1]], most / 2);
            let period = next.zero - line.zero;
            let above = codes[line.first..next.first].iter().filter(|code| **code >= half).count();
            let end = (line.zero + f64::from(half) / line.slope).ceil() + above as f64 - 0.5;
            pixel.slopes.push(line.slope);
            pixel.periods.push(period);
            pixel.cycles.push(line.slope * period);
            pixel.moduli.push(line.slope * (end - line.zero));
        }
        (!pixel.slopes.is_empty()).then_some(pixel)
    }

    /// Returns whether there are as many resets and frames as are needed.
    fn is_sampled(&self) -> bool {
        self.cycles.len() >= RESETS && mean(&self.periods) >= FRAMES_PER_RESET
    }
}

/// A line on which the codes rise: its first frame, the frame of charge 0, and the codes per frame.
#[derive(Debug)]
struct Line {
    first: usize,
    zero: f64,
    slope: f64,
}

/// Returns the lines of codes up to `most` that begin below half of it.
fn lines(codes: &[u16], most: u16) -> Vec<Line> {
    let mut runs: Vec<Vec<(usize, u16)>> = Vec::new();
    for (frame, &code) in codes.iter().enumerate() {
        if !(most / 4..=most / 4 * 3).contains(&code) {
            continue;
        }
        match runs.last_mut() {
            Some(run) if run[run.len() - 1].1 <= code.saturating_add(most / 4) => run.push((frame, code)),
            _ => runs.push(vec![(frame, code)]),
        }
    }
    runs.retain(|run| run.len() >= CODES && run[0].1 < most / 2);
    let line = |run: &Vec<(usize, u16)>| {
        // A code is rounded down.
        let [t, c] = [
            run.iter().map(|(t, _)| *t as f64).collect(),
            run.iter().map(|(_, c)| f64::from(*c) + 0.5).collect(),
        ] as [Vec<f64>; 2];
        let (at, charge) = (mean(&t), mean(&c));
        let product: f64 = t.iter().zip(&c).map(|(t, c)| (t - at) * (c - charge)).sum();
        let slope = product / t.iter().map(|t| (t - at).powi(2)).sum::<f64>();
        Line { first: run[0].0, zero: at - charge / slope, slope }
    };
    runs.iter().map(line).filter(|line| line.slope > 0.0).collect()
}

/// Checks that the slopes and durations of the lines of the median pixel are alike.
fn check_evenness(pixels: &[&Pixel]) -> Result<(), RampError> {
    let resets = pixels.iter().map(|pixel| pixel.cycles.len()).min().unwrap_or(0);
    let apart = |values: fn(&Pixel) -> &Vec<f64>, reset: usize| {
        let of_pixel = |pixel: &&Pixel| values(pixel)[reset] / mean(values(pixel)) - 1.0;
        quantile(pixels.iter().map(of_pixel).collect(), 0.5).abs()
    };
    let of_reset = |reset| apart(|pixel| &pixel.slopes, reset).max(apart(|pixel| &pixel.periods, reset));
    let worst =
        (0..resets).map(|reset| (of_reset(reset), reset)).max_by(|one, other| one.0.total_cmp(&other.0));
    match worst {
        Some((apart, reset)) if apart > UNEVEN => Err(RampError::Uneven(reset + 1, 100.0 * apart)),
        _ => Ok(()),
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Returns the variance of at least two values.
fn variance(values: &[f64]) -> f64 {
    let mean = mean(values);
    values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (values.len() - 1) as f64
}

/// Returns the value below which a share of the values lies, of which there is one at least.
fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share).round() as usize]
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;

    use super::*;
    use crate::sensor::{Sensor, SensorConfig};

    /// Returns what is measured on `frames` frames of a chip, whose light is a share of the range in each of them.
    fn measured(
        config: SensorConfig,
        frames: usize,
        light: impl Fn(f64) -> f64,
    ) -> Result<Resets, RampError> {
        let sensor = Sensor::new(config).expect("a sensor");
        let mut ramp = ResetRamp::new(sensor.range());
        for frame in 0..frames {
            let light = Array3::from_elem((32, 40, 1), light(frame as f64 / frames as f64) as f32);
            let exposure = sensor.expose(light.view(), frame as u64).expect("an image");
            ramp.push(&exposure.modulo())?;
        }
        ramp.measured()
    }

    #[test]
    fn the_resets_of_a_chip_come_back_within_their_error() {
        let chip = SensorConfig { alpha: 4.0, ..SensorConfig::default() };
        let cases = [
            (chip, 400),
            (SensorConfig { modulus: 0.99, ..chip }, 400),
            (SensorConfig { reset_loss: 2.56, ..chip }, 613),
            (SensorConfig { modulus: 1.01, reset_loss: 12.8, reset_spread: 0.01, ..chip }, 300),
            (SensorConfig { modulus: 0.99, reset_loss: 2.56, reset_spread: 0.01, ..chip }, 300),
            (
                SensorConfig {
                    modulus: 0.95,
                    reset_loss: 2.56,
                    reset_spread: 0.01,
                    prnu: 0.01,
                    read_noise: 2.0,
                    ..chip
                },
                400,
            ),
            (SensorConfig { bits: 12, modulus: 0.99, reset_loss: 41.0, reset_spread: 0.001, ..chip }, 1000),
        ];
        for (config, frames) in cases {
            let found = measured(config, frames, |at| at).expect("a ramp");
            let (modulus, loss) = (config.modulus * f64::from(config.bits).exp2(), config.reset_loss);
            let [spread, of_spread] = found.spread;
            assert!((found.modulus - modulus).abs() <= found.error, "{config:?} {found:?}");
            assert!((found.loss - loss).abs() <= found.error, "{config:?} {found:?}");
            assert!((spread - config.reset_spread).abs() <= of_spread, "{config:?} {found:?}");
            let step = f64::from(config.bits).exp2() * config.alpha / frames as f64;
            assert!(
                found.error < 0.6 + 0.6 * step && of_spread < 0.005,
                "an error that says something: {found:?}"
            );
        }
    }

    #[test]
    fn what_is_no_ramp_is_refused() {
        let chip = SensorConfig { reset_loss: 2.56, ..SensorConfig::default() };
        let why =
            |frames, light: fn(f64) -> f64| measured(chip, frames, light).expect_err("no ramp").to_string();
        for (frames, light, what) in [
            (400, (|at| 0.24 * at) as fn(f64) -> f64, "1280 are never reset"),
            (400, |_| 0.6, "1280 are never reset"),
            (100, |at| at, "0 of 1280 samples"),
            (400, |at| at * at, "evenly"),
            // Ten frames are missing.
            (400, |at| if at < 0.4 { at } else { at + 0.025 }, "about reset 2"),
        ] {
            let why = why(frames, light);
            assert!(why.contains(what), "{why}");
        }
        let mut ramp = ResetRamp::new(Range::new(8, 4.0).expect("possible"));
        assert!(matches!(ramp.measured(), Err(RampError::Resets(0, 0, 0))));
        let frame = |code, width| Frame::from_u16(Array3::from_elem((4, width, 1), code)).expect("an image");
        assert_eq!(ramp.push(&frame(9, 5)), Ok(()));
        assert_eq!(ramp.push(&frame(9, 6)), Err(RampError::Size(1)));
        assert_eq!(ramp.push(&frame(256, 5)), Err(RampError::Code(1, 256.0, 255)));
    }
}
