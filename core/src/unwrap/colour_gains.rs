//! Colour gains: unwraps green of a sensor whose red and blue have a lower gain and do not wrap, so that they tell how bright a pixel is.
//!
//! | image | method used | trusted |
//! |---|---|---|
//! | hardly a count of `nearest_colour` is doubtful, or there are too many candidates for `path_sums` | nearest_colour | yes in the first case |
//! | else | path_sums | if hardly a sum has two candidates, and hardly a colour difference bends by more than one peak |
//!
//! The colour difference `D = G - (R + B) / 2` changes little from pixel to pixel. Around a region of wrong counts its second differences
//! are off by one peak, also where edges of the scene are too sharp for those of a single colour to tell.

use ndarray::Array3;

use super::colour_costs::ColourCosts;
use super::path_sums::{MARGIN, MOST_CANDIDATES, PathSums, Shape};
use super::{
    Integers, NEAREST_COLOUR, Options, PATH_SUMS, Range, Recovered, Trust, Unwrap, UnwrapError,
    nearest_colour,
};
use crate::frame::Frame;
use crate::gains::{GainPattern, Gains};
use crate::green_rows::{GreenRow, GreenRows};
use crate::simd::widest;

/// The largest share of doubtful counts with which `nearest_colour` suffices. A wrong region has doubtful counts along its border.
const FEW_DOUBTFUL: f64 = 1e-5;

/// A sum whose second best candidate is no farther than this has two candidates.
const CLOSE: u8 = 10 * MARGIN;

/// The largest share of sums with two candidates in a trusted result. On KITTI frames, between a third and two thirds of these counts
/// are wrong, and hardly any others.
const FEW_CLOSE: f64 = 5e-4;

/// With at most this share of them, [`MORE_BENDS`] times as many bends may be true ones: sharp colour edges bend, too.
const FEWEST_CLOSE: f64 = 1.2e-4;
const MORE_BENDS: f64 = 6.0;

/// The margin from which on a count is far better than any other one.
const FAR: u8 = 60 * MARGIN;

/// The largest share of bends above one peak with which pixels are vouched for. With more of them, whole objects of saturated colours are
/// wrong with a large margin.
const MANY_BENDS: f64 = 1.5e-3;

/// The second difference of D, in peaks, above which a count is not vouched for.
const BARRIER: f32 = 0.375;

/// The method with its buffers.
pub struct ColourGains {
    ratio: f64,
    /// The largest share of bends of a trusted result.
    most_bends: f64,
    paths: PathSums<GreenRow>,
    row: GreenRow,
    counts: Vec<u8>,
    /// The margins of the counts; 0 where D bends.
    margins: Vec<u8>,
    /// The colour differences of three rows: row i lies at i modulo 3.
    differences: [Vec<f32>; 3],
    /// The confidence image of the last result, as a buffer.
    vouched: Option<Array3<u8>>,
}

impl ColourGains {
    /// Makes the method for the gains of a sensor; `None` for gains that are not those of colours.
    ///
    /// # Errors
    /// [`UnwrapError::Workers`] when the threads are not available.
    pub fn new(gains: Gains, options: &Options) -> Result<Option<Self>, UnwrapError> {
        let Gains::Two { pattern: GainPattern::Colours, ratio } = gains else { return Ok(None) };
        Ok(Some(Self {
            ratio,
            most_bends: options.trust.jumps,
            paths: PathSums::new(options.threads)?,
            row: GreenRow::default(),
            counts: Vec::new(),
            margins: Vec::new(),
            differences: Default::default(),
            vouched: None,
        }))
    }

    /// Writes radiance and counts into `out`, and what to think of them.
    fn recover<T>(&mut self, rows: GreenRows<'_, T>, range: Range, out: &mut Recovered)
    where
        T: Copy + Into<f32> + Sync,
    {
        let (height, width) = (out.x.dim().0, rows.width());
        let share = |count: usize| count as f64 / (height * width) as f64;
        self.counts.resize(height * width, 0);
        self.margins.clear();
        let (doubtful, sharp) = self.take_nearest(rows, range);
        let candidates = usize::from(range.max_wraps()) + 1;
        // Where nothing can wrap, every count is 0.
        let suffices = share(doubtful) <= FEW_DOUBTFUL || candidates == 1;
        let close = if suffices || candidates > MOST_CANDIDATES {
            out.report.method = NEAREST_COLOUR;
            0.0
        } else {
            out.report.method = PATH_SUMS;
            let costs = ColourCosts::new(range, share(sharp));
            share(self.take_paths(rows, Shape { height, width, candidates }, costs))
        };
        self.margins.resize(height * width, if suffices { u8::MAX } else { 0 });
        let bends = share(self.write(rows, range, out));
        self.vouch(rows, bends <= MANY_BENDS, out);
        let most_bends = self.most_bends * if close <= FEWEST_CLOSE { MORE_BENDS } else { 1.0 };
        let trusted = (suffices || out.report.method == PATH_SUMS)
            && close <= FEW_CLOSE
            && (bends <= most_bends || candidates == 1);
        out.report.trust = if trusted { Trust::Trusted } else { Trust::Untrusted };
    }

    /// Takes the counts of `nearest_colour`, and returns how many are doubtful, and how many second differences of R - B along rows are
    /// above half a peak.
    fn take_nearest<T>(&mut self, rows: GreenRows<'_, T>, range: Range) -> (usize, usize)
    where
        T: Copy + Into<f32>,
    {
        let (mut doubtful, mut sharp) = (0, 0);
        for (at, counts) in self.counts.chunks_exact_mut(rows.width()).enumerate() {
            rows.read(at, &mut self.row);
            doubtful += nearest_colour::count(&self.row, range, counts) as usize;
            let GreenRow { red, blue, .. } = &self.row;
            // The buffer of the colour differences is free until the result is written.
            let difference = &mut self.differences[0];
            difference.clear();
            difference.extend(red.iter().zip(blue).map(|(red, blue)| red - blue));
            sharp += bends_along(difference, range.peak() / 2.0);
        }
        (doubtful, sharp)
    }

    /// Takes the counts of `path_sums`, and returns how many sums have two candidates.
    fn take_paths<T>(&mut self, rows: GreenRows<'_, T>, shape: Shape, costs: ColourCosts) -> usize
    where
        T: Copy + Into<f32> + Sync,
    {
        self.paths.choose(shape, costs.peak(), |at, row: &mut GreenRow, colours, own| {
            rows.read(at, row);
            costs.write(row, colours, own);
        });
        self.margins.resize(self.counts.len(), 0);
        let lines = self.counts.chunks_exact_mut(shape.width).zip(self.margins.chunks_exact_mut(shape.width));
        lines.enumerate().for_each(|(at, (counts, margins))| self.paths.copy_row(at, counts, margins));
        self.margins.iter().filter(|&&margin| margin <= CLOSE).count()
    }

    /// Writes radiance and counts into `out`, and returns how many second differences of D are above one peak.
    fn write<T>(&mut self, rows: GreenRows<'_, T>, range: Range, out: &mut Recovered) -> usize
    where
        T: Copy + Into<f32>,
    {
        let (_, width, channels) = out.x.dim();
        let (stride, peak, largest) = (width * channels, range.peak(), (range.limit() as f32).next_down());
        let (x, k) = out.buffers();
        let lines = x.chunks_exact_mut(stride).zip(k.chunks_exact_mut(stride)).enumerate();
        let counts = self.counts.chunks_exact_mut(rows.width());
        let mut bends = 0;
        for ((at, (x, k)), counts) in lines.zip(counts) {
            rows.read(at, &mut self.row);
            let GreenRow { red, green, blue, .. } = &mut self.row;
            widest!(for (green, count) in green.iter_mut().zip(&mut *counts) {
                // The last period of the range need not be a whole one, whatever the paths say.
                let is_beyond = (*green + f32::from(*count) * peak > largest) & (*count > 0);
                *count -= u8::from(is_beyond);
                *green += f32::from(*count) * peak;
            });
            rows.write(at, green, largest, x);
            let (first, step) = rows.places(at);
            k.fill(0);
            k[first..].iter_mut().step_by(step).zip(counts).for_each(|(k, count)| *k = *count);
            let differences = &mut self.differences[at % 3];
            differences.resize(green.len(), 0.0);
            let samples = red.iter().zip(&*green).zip(blue);
            widest!(differences.iter_mut().zip(samples).for_each(|(difference, ((red, green), blue))| {
                *difference = green - (red + *blue) * 0.5;
            }));
            let [here, before, first] = [0, 1, 2].map(|up| &self.differences[(at + 3 - up) % 3]);
            bends += bends_along(here, peak);
            let margins = &mut self.margins[at.saturating_sub(1) * here.len()..];
            let (above, own) = margins.split_at_mut(at.min(1) * here.len());
            if let [_, inner @ .., _] = &mut own[..here.len()] {
                clear_bends(inner, [here, &here[1..], &here[2..]], BARRIER * peak);
            }
            if at >= 2 {
                bends += bends_of(first, before, here, peak);
                clear_bends(above, [first, before, here], BARRIER * peak);
            }
        }
        bends
    }

    /// Writes the confidence image; `can_vouch` says whether any green pixel can be vouched for. On a mosaic, the samples of red and
    /// blue are right in any case.
    fn vouch<T: Copy + Into<f32>>(&mut self, rows: GreenRows<'_, T>, can_vouch: bool, out: &mut Recovered) {
        let (height, width, channels) = out.x.dim();
        let value = |margin: u8| if can_vouch && margin >= FAR { u8::MAX } else { 0 };
        let dim = (height, width, 1);
        let last = self.vouched.take().filter(|last| last.dim() == dim && last.is_standard_layout());
        let mut vouched = last.unwrap_or_else(|| Array3::zeros(dim));
        vouched.fill(u8::MAX);
        let lines = vouched.as_slice_mut().expect("the layout is standard").chunks_exact_mut(width);
        for ((at, line), margins) in lines.enumerate().zip(self.margins.chunks_exact(rows.width())) {
            let (first, step) = rows.places(at);
            let pixels = line[first / channels..].iter_mut().step_by(step / channels);
            pixels.zip(margins).for_each(|(pixel, &margin)| *pixel = value(margin));
        }
        out.vouched = Some(vouched);
    }
}

/// Returns the second differences of a row above `limit`.
fn bends_along(line: &[f32], limit: f32) -> usize {
    let inner = line.len().saturating_sub(2);
    bends_of(&line[..inner], &line[line.len().min(1)..][..inner], &line[line.len() - inner..], limit)
}

/// Sets the margins to 0 at the second differences above `limit` of three lines.
fn clear_bends(margins: &mut [u8], lines: [&[f32]; 3], limit: f32) {
    let [before, here, after] = lines;
    let samples = before.iter().zip(here).zip(after);
    widest!(margins.iter_mut().zip(samples).for_each(|(margin, ((before, here), after))| {
        *margin = if (before + after - 2.0 * here).abs() > limit { 0 } else { *margin };
    }));
}

/// Returns the second differences above `limit`.
fn bends_of(before: &[f32], here: &[f32], after: &[f32], limit: f32) -> usize {
    let samples = before.iter().zip(here).zip(after);
    let bends = |((before, here), after): ((&f32, &f32), &f32)| (before + after - 2.0 * here).abs() > limit;
    widest!(samples.fold(0u32, |count, sample| count + u32::from(bends(sample)))) as usize
}

impl Unwrap for ColourGains {
    fn name(&self) -> &'static str {
        GainPattern::Colours.method()
    }

    fn unwrap(&mut self, y: &Frame, range: Range, out: &mut Recovered) -> Result<(), UnwrapError> {
        let (samples, dim, mosaic) = (Integers::checked(y, range)?, y.dim(), y.mosaic());
        if mosaic.is_none() && y.channels() != 3 {
            return Err(UnwrapError::Colours);
        }
        self.vouched = out.vouched.take();
        out.prepare(dim, self.name());
        match samples {
            Integers::U8(codes) => self.recover(GreenRows::new(codes, dim, mosaic, self.ratio), range, out),
            Integers::U16(codes) => self.recover(GreenRows::new(codes, dim, mosaic, self.ratio), range, out),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{Exposure, Mosaic, Psf, Sensor, SensorConfig};

    fn gains(alpha: f64) -> Gains {
        let pattern = GainPattern::Colours;
        Gains::Two { pattern, ratio: pattern.default_ratio(alpha) }
    }

    fn expose(radiance: &Array3<f32>, config: SensorConfig) -> Exposure {
        let sensor = Sensor::new(SensorConfig { gains: gains(config.alpha), ..config }).unwrap();
        sensor.expose(radiance.view(), 0).unwrap()
    }

    fn unwrapped(exposure: &Exposure, threads: usize) -> Recovered {
        let options = Options { threads, ..Options::default() };
        let mut method = ColourGains::new(exposure.gains(), &options).unwrap().unwrap();
        let mut out = Recovered::default();
        method.unwrap(&exposure.modulo(), exposure.range(), &mut out).unwrap();
        out
    }

    /// Grey light as a constant, a ramp, or anything at all: neighbours do not matter to a pixel that sees all colours.
    fn grey(what: usize, (height, width): (usize, usize), seed: u64) -> Array3<f32> {
        let mut random = seed | 1;
        let mut next = || {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (random >> 40) as f32 / (1u64 << 24) as f32
        };
        let level = next();
        let mut row = vec![0.0; width];
        Array3::from_shape_fn((height, width, 3), |(i, j, c)| {
            if c == 0 {
                row[j] = match what {
                    0 => level,
                    1 => (i + j) as f32 / (height + width) as f32,
                    _ => next(),
                };
            }
            row[j]
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(100))]
        #[test]
        fn a_constant_a_ramp_and_any_grey_scene_are_exact_at_any_alpha(
            dim in (3usize..40, 3usize..40), (bits, share) in (6u8..=12, 0.02f64..1.0), what in 0usize..3, seed in any::<u64>(),
        ) {
            // Red and blue count steps of alpha codes, which must be far below the peak.
            let alpha = (share * f64::from(bits).exp2() / 8.0).min(256.0);
            let exposure = expose(&grey(what, dim, seed), SensorConfig { bits, alpha, ..SensorConfig::PLAIN });
            let out = unwrapped(&exposure, 1);
            prop_assert_eq!(&out.k, &exposure.wraps());
            prop_assert_eq!(out.report.trust, Trust::Trusted);
            prop_assert_eq!(out.report.method, NEAREST_COLOUR);
        }

        #[test]
        fn on_a_mosaic_a_constant_and_a_ramp_are_exact(
            dim in (12usize..40, 12usize..40), alpha in 1.1f64..16.0, what in 0usize..2, which in 1usize..5, seed in any::<u64>(),
        ) {
            let mosaic = Mosaic::WORDS[which].1;
            let exposure = expose(&grey(what, dim, seed), SensorConfig { alpha, mosaic, ..SensorConfig::PLAIN });
            prop_assert_eq!(&unwrapped(&exposure, 1).k, &exposure.wraps());
        }

        #[test]
        fn any_codes_of_any_size_give_a_congruent_result_in_range(
            (height, width) in (1usize..40, 1usize..40), bits in 1u8..=16, alpha in 0.6f64..200.0, mosaic in 0usize..5,
            ratio in 0.001f64..1.0, seed in any::<u64>(),
        ) {
            let (range, mosaic) = (Range::new(bits, alpha).unwrap(), Mosaic::WORDS[mosaic].1.filter(|_| height.min(width) > 1));
            let mut random = seed | 1;
            let codes = Array3::from_shape_simple_fn((height, width, if mosaic.is_some() { 1 } else { 3 }), || {
                random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                ((random >> 40) % (1 << bits).min(range.limit().floor().max(1.0) as u64)) as u16
            });
            let y = Frame::from_u16(codes.clone()).unwrap();
            let y = match mosaic { Some(mosaic) => y.with_mosaic(mosaic).unwrap(), None => y };
            let gains = Gains::Two { pattern: GainPattern::Colours, ratio };
            let [one, three] = [1, 3].map(|threads| {
                let options = Options { threads, ..Options::default() };
                let mut out = Recovered::default();
                ColourGains::new(gains, &options).unwrap().unwrap().unwrap(&y, range, &mut out).unwrap();
                out
            });
            prop_assert_eq!(&one, &three, "the result does not depend on the threads");
            for ((at, x), &y) in one.x.indexed_iter().zip(&codes) {
                let channel = mosaic.map_or(at.2, |mosaic| mosaic.channel(at.0, at.1));
                prop_assert!(f64::from(*x) < range.limit());
                if channel == 1 {
                    prop_assert_eq!(*x, f32::from(y) + f32::from(one.k[at]) * range.peak());
                } else {
                    prop_assert_eq!(one.k[at], 0);
                }
            }
        }
    }

    /// Discs of different colours on a coloured ground.
    fn discs(tint: f32) -> Array3<f32> {
        Array3::from_shape_fn((120, 160, 3), |(i, j, c)| {
            let disc =
                |row: f32, column: f32, radius: f32| (i as f32 - row).hypot(j as f32 - column) < radius;
            let light = if disc(40.0, 50.0, 25.0) {
                [0.9 - tint, 0.9, 0.9 - tint / 2.0]
            } else if disc(80.0, 110.0, 30.0) {
                [0.5, 0.5 - tint / 2.0, 0.5 + tint / 2.0]
            } else {
                [0.06, 0.05, 0.04]
            };
            light[c]
        })
    }

    #[test]
    fn coloured_discs_are_exact_and_trusted_behind_every_lens_by_path_sums() {
        for (sigma, mosaic) in [(0.0, None), (0.5, None), (1.4, None), (1.4, Some(Mosaic::Grbg))] {
            let config = SensorConfig { psf: Psf::of_sigma(sigma), mosaic, ..SensorConfig::PLAIN };
            let exposure = expose(&discs(0.1), config);
            let out = unwrapped(&exposure, 2);
            assert_eq!(exposure.exact_share(&out.k), Some(1.0), "{sigma} px, {mosaic:?}");
            assert_eq!(
                (out.report.method, out.report.trust),
                (PATH_SUMS, Trust::Trusted),
                "{sigma} px, {mosaic:?}"
            );
            let confidence = out.confidence(mosaic, exposure.range()).to_f32().to_owned();
            let vouched = confidence.iter().filter(|value| **value == 255.0).count() as f64;
            assert!(vouched >= 0.9 * confidence.len() as f64, "{sigma} px, {mosaic:?}: {vouched}");
        }
    }

    /// Colours whose green is half of full scale away from red and blue are taken for duller ones.
    #[test]
    fn saturated_colours_are_wrong_and_not_trusted() {
        for sigma in [0.5, 0.8] {
            let exposure =
                expose(&discs(0.6), SensorConfig { psf: Psf::of_sigma(sigma), ..SensorConfig::PLAIN });
            let out = unwrapped(&exposure, 1);
            assert!(exposure.exact_share(&out.k).unwrap() < 0.95, "{sigma} px");
            let confidence = out.confidence(None, exposure.range());
            let wraps = exposure.wraps();
            for ((i, j, _), &value) in confidence.as_u8().unwrap().indexed_iter() {
                assert!(value == 0 || out.k[(i, j, 1)] == wraps[(i, j, 1)], "{sigma} px: ({i}, {j})");
            }
            assert_eq!(out.report.trust, Trust::Untrusted, "{sigma} px");
        }
    }

    #[test]
    fn an_image_without_colours_is_refused() {
        let mut method = ColourGains::new(gains(4.0), &Options::default()).unwrap().unwrap();
        let (mono, range) = (Frame::from_u8(Array3::zeros((4, 5, 1))).unwrap(), Range::new(8, 4.0).unwrap());
        let why = method.unwrap(&mono, range, &mut Recovered::default()).unwrap_err();
        assert_eq!(why, UnwrapError::Colours);
        assert!(ColourGains::new(Gains::One, &Options::default()).unwrap().is_none());
    }
}
