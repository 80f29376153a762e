//! Two gains in one shot: every second pixel has a lower gain and does not wrap, so that its neighbours of full gain can be
//! unwrapped from it, whatever the lens.
//!
//! At a pixel of full gain, each pair of neighbours of low gain on opposite sides gives a guess of x, its mean. The weight of a
//! guess falls with the square of the difference within its pair, here and at the pixels of full gain around, since a pair along an
//! edge knows more than one across it. The wrap count is the one that brings `y + k 2^b` nearest to this prediction.
//!
//! On a colour mosaic, pixels of one colour are farther apart, and all colours predict together: `gains_mosaic.rs`.
//!
//! The layout is that of spatially varying exposure (Nayar and Mitsunaga 2000, *CVPR*), whose pixels of full gain saturate; see
//! [`Exposure::saturated`](crate::Exposure::saturated).

use ndarray::Array3;

use crate::frame::Frame;
use crate::gains_mosaic::{MosaicGains, MosaicRadiance, radiance_of_low};
use crate::mosaic::{Mosaic, PLACES};
use crate::range::Range;
use crate::simd::widest;
use crate::unwrap::{Integers, Recovered, Scene, Trust, Unwrap, UnwrapError};

/// The gains of the pixels of a sensor.
#[derive(Clone, Copy, Debug, PartialEq, Default)]
pub enum Gains {
    /// All pixels have the full gain.
    #[default]
    One,
    /// The pixels whose row and column (from 0) add up to an odd number have a lower gain.
    Checkerboard {
        /// The lower gain over the full one, more than 0 and at most `1 / alpha`, so that these pixels never wrap.
        ratio: f64,
    },
}

/// The pairs of neighbours of low gain on opposite sides of a pixel of full gain, by one of the two: rows down, columns to the right.
const PAIRS: [(isize, isize); 2] = [(0, -1), (-1, 0)];

/// The nearest pixels of full gain around one of them.
const FULL_AROUND: [(isize, isize); 4] = [(-1, -1), (-1, 1), (1, -1), (1, 1)];

/// This share of the peak is added to each difference, so that differences far below it hardly change the weights.
const SOFT: f32 = 3.0 / 16.0;

/// The largest share of the doubtful pixels, farther than 3/8 of the peak from their prediction, with which the result is trusted.
/// A lamp of one pixel that no neighbour sees is wrong whatever its brightness, and doubtful in one case of four. With this limit,
/// at most four times as many pixels are wrong, which is below the 0.1 % that trust allows.
const MOST_DOUBTFUL: f64 = 2e-4;

impl Gains {
    /// The words of the sensors with one gain and with two, and whether the sensor has two.
    pub const WORDS: [(&'static str, bool); 2] = [("none", false), ("checkerboard", true)];

    /// Returns the word of a sensor with two gains or with one, as in [`Gains::WORDS`].
    pub fn word(has_two: bool) -> &'static str {
        Self::WORDS[usize::from(has_two)].0
    }

    /// Returns the checkerboard whose lower gain is the largest possible one: `1 / alpha`, at most 1.
    pub fn checkerboard(alpha: f64) -> Self {
        Self::Checkerboard { ratio: alpha.recip().min(1.0) }
    }

    /// Returns the gain of a pixel over the full one.
    pub fn at(self, row: usize, column: usize) -> f64 {
        match self {
            Self::Checkerboard { ratio } if is_low(row, column) => ratio,
            Self::One | Self::Checkerboard { .. } => 1.0,
        }
    }

    /// Returns the gain of a pixel over the full one. With a mosaic, 2 x 2 pixels have one gain, so that the pixels of each colour by
    /// themselves are a checkerboard.
    pub(crate) fn behind(self, mosaic: Option<Mosaic>, row: usize, column: usize) -> f64 {
        match mosaic {
            None => self.at(row, column),
            Some(_) => self.at(row / 2, column / 2),
        }
    }
}

/// Returns whether a pixel of a checkerboard has the lower gain.
pub(crate) fn is_low(row: usize, column: usize) -> bool {
    (row + column) % 2 == 1
}

/// The unwrapping of images of a sensor some of whose pixels have a lower gain.
pub struct TwoGains {
    prediction: Prediction,
    mosaic: MosaicRadiance,
}

/// The counts that bring samples nearest to their predictions.
#[derive(Clone, Copy)]
struct NearestCount {
    peak: f32,
    per_peak: f32,
    /// The largest count.
    most: f32,
    /// The end of the range.
    limit: f32,
}

impl NearestCount {
    fn new(range: Range) -> Self {
        let (peak, most) = (range.peak(), f32::from(range.max_wraps()));
        Self { peak, per_peak: peak.recip(), most, limit: range.limit() as f32 }
    }

    /// Returns the radiance of a code, and its count.
    #[inline(always)]
    fn nearest(self, y: f32, predicted: f32) -> (f32, u8) {
        /// The floats from here on are whole numbers.
        const WHOLE: f32 = (1 << 23) as f32;
        // The last period of the range need not be a whole one.
        let most =
            if y + self.most * self.peak < self.limit { self.most } else { (self.most - 1.0).max(0.0) };
        // The sum is rounded to the nearest whole number, which its low bits hold.
        let nearest = ((predicted - y) * self.per_peak).max(0.0).min(most) + WHOLE;
        (y + (nearest - WHOLE) * self.peak, nearest.to_bits() as u8)
    }

    /// Returns whether the radiance is far from its prediction.
    #[inline(always)]
    fn is_doubtful(self, full: f32, predicted: f32) -> bool {
        (full - predicted).abs() > 0.375 * self.peak
    }
}

impl TwoGains {
    /// The name of the method in reports.
    pub const NAME: &str = "checkerboard_gains";

    /// Makes the method for the gains of a sensor; `None` for a sensor whose pixels have one gain.
    pub fn new(gains: Gains) -> Option<Self> {
        let Gains::Checkerboard { ratio } = gains else { return None };
        let prediction = Prediction { ratio: ratio as f32, ..Prediction::default() };
        Some(Self { prediction, mosaic: MosaicRadiance::default() })
    }

    /// Writes radiance and wrap counts of the codes `y` into `out`.
    fn recover_any<T>(&mut self, y: &[T], mosaic: Option<Mosaic>, range: Range, out: &mut Recovered)
    where
        T: Copy + Into<f32>,
    {
        match mosaic {
            Some(mosaic) => self.recover_mosaic(y, mosaic, range, out),
            None => self.recover(y, range, out),
        }
    }

    /// Writes radiance and wrap counts of a mosaic into `out`.
    fn recover_mosaic<T>(&mut self, y: &[T], mosaic: Mosaic, range: Range, out: &mut Recovered)
    where
        T: Copy + Into<f32>,
    {
        let ((height, width, _), counts) = (out.x.dim(), NearestCount::new(range));
        let (ratio, peak) = (self.prediction.ratio, range.peak());
        let mut doubtful = [0; PLACES.len()];
        let gains = MosaicGains { ratio, mosaic, peak };
        self.mosaic.fill(gains, y, (height, width), |place, samples, predicted, low| {
            let samples = samples.iter_mut().zip(predicted.iter().zip(low));
            doubtful[place] += widest!({
                let mut doubtful = 0u32;
                for (sample, (&predicted, &is_low)) in samples {
                    let (full, _) = counts.nearest(*sample, predicted);
                    doubtful += u32::from(!is_low & counts.is_doubtful(full, predicted));
                    *sample = if is_low { *sample } else { full };
                }
                doubtful
            });
        });
        let largest = (range.limit() as f32).next_down();
        let (x, k) = out.buffers();
        self.mosaic.each(gains, y, width, |at, is_low, radiance| {
            x[at] = radiance.min(largest);
            k[at] = if is_low { 0 } else { ((radiance - y[at].into()) / peak) as u8 };
        });
        // Along a short side, a colour has no pixels of low gain at both sides.
        let has_neighbours = height.min(width) >= 4;
        let most = self.mosaic.full().map(|full| MOST_DOUBTFUL * full as f64);
        let agrees = doubtful.iter().zip(most).all(|(&count, most)| f64::from(count) <= most);
        out.report.trust = trust(agrees, has_neighbours);
    }

    /// Writes radiance and wrap counts of codes without a mosaic into `out`.
    fn recover<T: Copy + Into<f32>>(&mut self, y: &[T], range: Range, out: &mut Recovered) {
        let dim @ (height, width, channels) = out.x.dim();
        let (stride, counts, largest) =
            (width * channels, NearestCount::new(range), (range.limit() as f32).next_down());
        let low_at = |row| low_samples(row, width, channels);
        let low_rows = [low_at(0), low_at(1)];
        let (x, k) = out.buffers();
        let mut doubtful = 0;
        self.prediction.rows(y, dim, range, |row, low, predicted| {
            let from = row * stride;
            let samples =
                x[from..][..stride].iter_mut().zip(&mut k[from..][..stride]).zip(&y[from..][..stride]);
            let known = low.iter().zip(predicted).zip(&low_rows[row % 2]);
            doubtful += widest!({
                let mut doubtful = 0u32;
                for (((x, k), y), ((&low, &predicted), &is_low)) in samples.zip(known) {
                    let (full, count) = counts.nearest((*y).into(), predicted);
                    doubtful += u32::from(!is_low & counts.is_doubtful(full, predicted));
                    *x = if is_low { low.min(largest) } else { full };
                    *k = if is_low { 0 } else { count };
                }
                doubtful
            });
        });
        let pixels_of_full_gain = (height * width * channels).div_ceil(2);
        let agrees = f64::from(doubtful) <= MOST_DOUBTFUL * pixels_of_full_gain as f64;
        // An image of one pixel has no neighbours of low gain.
        out.report.trust = trust(agrees, height.max(width) > 1);
    }
}

/// Returns the trust in a result whose two gains agree or do not.
fn trust(agrees: bool, has_neighbours: bool) -> Trust {
    match (agrees, has_neighbours) {
        (_, false) => Trust::Unobservable,
        (true, true) => Trust::Trusted,
        (false, true) => Trust::Untrusted,
    }
}

impl Unwrap for TwoGains {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn unwrap(&mut self, y: &Frame, scene: &Scene, out: &mut Recovered) -> Result<(), UnwrapError> {
        let range = scene.range;
        let samples = Integers::checked(y, range)?;
        out.prepare(y.dim(), Self::NAME);
        match samples {
            Integers::U8(codes) => self.recover_any(codes, y.mosaic(), range, out),
            Integers::U16(codes) => self.recover_any(codes, y.mosaic(), range, out),
        }
        Ok(())
    }
}

/// Returns the radiance (H x W x C, code units) of a sensor whose pixels of full gain saturate at the peak, as spatially varying
/// exposure reads it: a pixel that saturates gets the prediction of its neighbours of low gain. `codes` are below 2^b.
pub(crate) fn merge_saturated(codes: &Array3<f32>, ratio: f64, range: Range) -> Array3<f32> {
    let dim @ (_, width, channels) = codes.dim();
    let (codes, stride, most) = (codes.as_standard_layout(), width * channels, range.peak() - 1.0);
    let y = codes.as_slice().expect("the layout was made standard");
    let mut x = Vec::with_capacity(y.len());
    let mut prediction = Prediction { ratio: ratio as f32, ..Prediction::default() };
    prediction.rows(y, dim, range, |row, low, predicted| {
        let is_low = low_samples(row, width, channels);
        let samples = y[row * stride..][..stride].iter().zip(low.iter().zip(predicted)).zip(is_low);
        x.extend(samples.map(|((&y, (&low, &predicted)), is_low)| match (is_low, y >= most) {
            (true, _) => low,
            (false, false) => y,
            (false, true) => predicted.max(y),
        }));
    });
    Array3::from_shape_vec(dim, x).expect("every code has its radiance")
}

/// Returns for each sample of a row whether it has the lower gain.
fn low_samples(row: usize, width: usize, channels: usize) -> Vec<bool> {
    (0..width * channels).map(|sample| is_low(row, sample / channels)).collect()
}

/// Returns the radiance of a mosaic as [`merge_saturated`] does.
pub(crate) fn merge_saturated_mosaic(codes: &Array3<f32>, gains: MosaicGains) -> Array3<f32> {
    let ((height, width, _), most) = (codes.dim(), gains.peak - 1.0);
    let codes = codes.as_standard_layout();
    let y = codes.as_slice().expect("the layout was made standard");
    let (mut x, mut mosaic) = (vec![0.0; y.len()], MosaicRadiance::default());
    mosaic.fill(gains, y, (height, width), |_, samples, predicted, low| {
        for (sample, (&predicted, &is_low)) in samples.iter_mut().zip(predicted.iter().zip(low)) {
            if !is_low && *sample >= most {
                *sample = predicted.max(*sample);
            }
        }
    });
    mosaic.each(gains, y, width, |at, _, radiance| x[at] = radiance);
    Array3::from_shape_vec(codes.dim(), x).expect("every code has its radiance")
}

/// The prediction of one row after the other. Rows have one pixel more at both ends.
#[derive(Default)]
struct Prediction {
    ratio: f32,
    width: usize,
    channels: usize,
    /// Radiance of the last rows as if all pixels had low gain: row i lies at i modulo 4.
    radiance: [Vec<f32>; 4],
    /// Differences within each pair, for the last rows: row i lies at i modulo 3.
    differences: [[Vec<f32>; 3]; PAIRS.len()],
    predicted: Vec<f32>,
    weights: Vec<f32>,
}

impl Prediction {
    /// Calls `take` with each row: its number, the radiance of its codes as if they had low gain, and the prediction from
    /// neighbours of low gain, which holds at pixels of full gain only.
    fn rows<T: Copy + Into<f32>>(
        &mut self,
        y: &[T],
        (height, width, channels): (usize, usize, usize),
        range: Range,
        mut take: impl FnMut(usize, &[f32], &[f32]),
    ) {
        (self.width, self.channels) = (width, channels);
        let stride = width * channels;
        // The differences of a row need the row below it, and its prediction the differences of the row below it.
        for row in 0..height + 2 {
            if row < height {
                self.read(row, &y[row * stride..][..stride]);
            }
            if let Some(row) = row.checked_sub(1).filter(|row| *row < height) {
                self.compare(row, height);
            }
            if let Some(row) = row.checked_sub(2) {
                self.predict(row, height, SOFT * range.peak());
                take(row, &self.radiance[row % 4][channels..][..stride], &self.predicted);
            }
        }
    }

    /// Takes the codes of a row.
    fn read<T: Copy + Into<f32>>(&mut self, row: usize, y: &[T]) {
        let (channels, ratio) = (self.channels, self.ratio);
        let radiance = &mut self.radiance[row % 4];
        radiance.resize(y.len() + 2 * channels, 0.0);
        let inner = radiance[channels..].iter_mut().zip(y);
        widest!(inner.for_each(|(x, &y)| *x = radiance_of_low(y.into(), ratio)));
        mirror(radiance, self.width, channels);
    }

    /// Computes the differences within the pairs around the pixels of a row.
    fn compare(&mut self, row: usize, height: usize) {
        let (samples, channels) = (self.width * self.channels, self.channels);
        for (step, rows) in PAIRS.into_iter().zip(&mut self.differences) {
            let differences = &mut rows[row % 3];
            differences.resize(samples + 2 * channels, 0.0);
            let (a, b) = pair(&self.radiance, (row, height), step, (samples, channels));
            let pairs = differences[channels..].iter_mut().zip(a.iter().zip(b));
            widest!(pairs.for_each(|(difference, (a, b))| *difference = (a - b).abs()));
            mirror(differences, self.width, channels);
        }
    }

    /// Predicts a row from the means of its pairs.
    fn predict(&mut self, row: usize, height: usize, soft: f32) {
        let (samples, channels) = (self.width * self.channels, self.channels);
        for sums in [&mut self.predicted, &mut self.weights] {
            sums.clear();
            sums.resize(samples, 0.0);
        }
        for (step @ (down, right), differences) in PAIRS.into_iter().zip(&self.differences) {
            // Along a side of one pixel there are no neighbours.
            if (down != 0 && height == 1) || (right != 0 && self.width == 1) {
                continue;
            }
            let (a, b) = pair(&self.radiance, (row, height), step, (samples, channels));
            let around = |(down, right): (isize, isize)| {
                &differences[mirrored(row, down, height) % 3][(right + 1) as usize * channels..][..samples]
            };
            let (here, [p, q, r, s]) = (around((0, 0)), FULL_AROUND.map(around));
            let differences = here.iter().zip(p.iter().zip(q)).zip(r.iter().zip(s));
            let sums = self.predicted.iter_mut().zip(&mut self.weights).zip(a.iter().zip(b)).zip(differences);
            widest!(sums.for_each(|(((sum, weights), (a, b)), ((here, (p, q)), (r, s)))| {
                let difference = here + (p + q + r + s) * 0.25 + soft;
                let weight = (difference * difference).recip();
                *sum += weight * (a + b) * 0.5;
                *weights += weight;
            }));
        }
        let normalised = self.predicted.iter_mut().zip(&self.weights);
        // Without any pair the prediction would be 0 / 0; such an image is dark for all that is known.
        widest!(normalised.for_each(|(sum, weight)| *sum = if *weight > 0.0 { *sum / weight } else { 0.0 }));
    }
}

/// Returns the samples of both neighbours of a pair, for the pixels of a row.
fn pair(
    radiance: &[Vec<f32>; 4],
    (row, height): (usize, usize),
    (down, right): (isize, isize),
    (samples, channels): (usize, usize),
) -> (&[f32], &[f32]) {
    let neighbour = |down, right: isize| {
        &radiance[mirrored(row, down, height) % 4][(right + 1) as usize * channels..][..samples]
    };
    (neighbour(down, right), neighbour(-down, -right))
}

/// Returns the row `down` rows below `row`. Beyond the border lies the mirror image without the border row (`dcb|abcd`), whose
/// pixels have the same gains.
fn mirrored(row: usize, down: isize, height: usize) -> usize {
    let last = height as isize - 1;
    let at = (row as isize + down).abs();
    (if at > last { 2 * last - at } else { at }).max(0) as usize
}

/// Fills the pixel at both ends of a row with the mirror image of the row without its border pixel.
fn mirror(row: &mut [f32], width: usize, channels: usize) {
    let (inner, reach) = (width * channels, if width > 1 { 2 * channels } else { channels });
    row.copy_within(reach..reach + channels, 0);
    row.copy_within(channels + inner - reach..2 * channels + inner - reach, channels + inner);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{Sensor, SensorConfig};

    /// The prediction by its definition, one pixel after the other.
    fn predicted(
        x: impl Fn(usize, usize) -> f64,
        (i, j): (usize, usize),
        (height, width): (usize, usize),
        peak: f64,
    ) -> f64 {
        let at = |i: isize, j: isize| {
            let mirror = |at: isize, n: usize| {
                let last = n as isize - 1;
                (if at < 0 {
                    -at
                } else if at > last {
                    2 * last - at
                } else {
                    at
                }) as usize
            };
            x(mirror(i, height), mirror(j, width))
        };
        let (mut sum, mut weights) = (0.0, 0.0);
        let (i, j) = (i as isize, j as isize);
        for (down, right) in PAIRS {
            if (down != 0 && height == 1) || (right != 0 && width == 1) {
                continue;
            }
            let difference = |(i, j)| (at(i + down, j + right) - at(i - down, j - right)).abs();
            // Where a side has one pixel there is one pair, so that its weight does not matter.
            let around = if height == 1 || width == 1 {
                0.0
            } else {
                let mirror = |at: isize, n: usize| {
                    if at < 0 {
                        -at
                    } else if at >= n as isize {
                        2 * n as isize - 2 - at
                    } else {
                        at
                    }
                };
                FULL_AROUND
                    .map(|(a, b)| difference((mirror(i + a, height), mirror(j + b, width))))
                    .iter()
                    .sum::<f64>()
            };
            let weight = 1.0 / (difference((i, j)) + around / 4.0 + 3.0 / 16.0 * peak).powi(2);
            let (a, b) = (at(i + down, j + right), at(i - down, j - right));
            sum += weight * (a + b) / 2.0;
            weights += weight;
        }
        if weights > 0.0 { sum / weights } else { 0.0 }
    }

    proptest! {
        #[test]
        fn takes_the_count_that_is_nearest_to_the_prediction(
            (height, width, rgb) in (1usize..7, 1usize..9, any::<bool>()),
            (bits, alpha) in (2u8..=10, 0.6f64..9.0),
            seed in any::<u64>(),
        ) {
            let channels = if rgb { 3 } else { 1 };
            let ratio = alpha.recip().min(1.0);
            let range = Range::new(bits, alpha).unwrap();
            let mut random = seed | 1;
            let codes = Array3::from_shape_simple_fn((height, width, channels), || {
                random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                // Only codes that x below the limit can have.
                ((random >> 40) % f64::from(range.peak()).min(range.limit()).floor().max(1.0) as u64) as u16
            });
            let mut out = Recovered::default();
            let mut method = TwoGains::new(Gains::Checkerboard { ratio }).unwrap();
            method.unwrap(&Frame::from_u16(codes.clone()).unwrap(), &range.into(), &mut out).unwrap();
            let peak = f64::from(range.peak());
            for ((i, j, c), &k) in out.k.indexed_iter() {
                let y = f64::from(codes[(i, j, c)]);
                prop_assert!(f64::from(out.x[(i, j, c)]) < range.limit());
                if is_low(i, j) {
                    prop_assert_eq!(k, 0);
                    let low = ((y + 0.5) / ratio - 0.5).min(range.limit());
                    prop_assert!((f64::from(out.x[(i, j, c)]) - low).abs() < 1e-3 * peak);
                    continue;
                }
                prop_assert_eq!(f64::from(out.x[(i, j, c)]), y + f64::from(k) * peak);
                let low = |i, j| (f64::from(codes[(i, j, c)]) + 0.5) / ratio - 0.5;
                let goal = predicted(low, (i, j), (height, width), peak);
                let off = |k: u8| (y + f64::from(k) * peak - goal).abs();
                let possible = (0..=range.max_wraps()).filter(|k| *k == 0 || y + f64::from(*k) * peak < range.limit());
                let best = possible.map(off).fold(f64::MAX, f64::min);
                prop_assert!(off(k) <= best + 1e-3 * peak, "({i}, {j}, {c}): {} {best}", off(k));
            }
        }

        #[test]
        fn a_smooth_scene_is_exact_and_trusted(alpha in 1.5f64..8.0, rgb in any::<bool>()) {
            let gains = Gains::checkerboard(alpha);
            let radiance = Array3::from_shape_fn((60, 80, if rgb { 3 } else { 1 }), |(i, j, c)| {
                0.5 + 0.45 * ((i as f32 / 17.0).sin() * (j as f32 / 23.0 + c as f32).cos())
            });
            let sensor = Sensor::new(SensorConfig { alpha, gains, ..SensorConfig::default() }).unwrap();
            let exposure = sensor.expose(radiance.view(), 0).unwrap();
            let mut out = Recovered::default();
            TwoGains::new(gains).unwrap().unwrap(&exposure.modulo(), &exposure.range().into(), &mut out).unwrap();
            prop_assert_eq!(exposure.exact_share(&out.k), Some(1.0));
            prop_assert_eq!(out.report.trust, Trust::Trusted);
            // A pixel of low gain counts steps of alpha codes.
            let error = out.x.iter().zip(exposure.x()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            prop_assert!(f64::from(error) <= alpha / 2.0 + 1.0, "{error}");
        }
    }

    #[test]
    fn noise_without_a_scene_and_an_image_without_neighbours_are_not_trusted() {
        let range = Range::new(8, 4.0).unwrap();
        let trust = |codes: Array3<u8>| {
            let mut out = Recovered::default();
            let mut method = TwoGains::new(Gains::checkerboard(4.0)).unwrap();
            method.unwrap(&Frame::from_u8(codes).unwrap(), &range.into(), &mut out).unwrap();
            out.report.trust
        };
        let noise = Array3::from_shape_fn((20, 30, 3), |(i, j, c)| {
            (((i * 7919 + j * 104_729 + c * 31) * 2_654_435_761) >> 7) as u8
        });
        assert_eq!(trust(noise), Trust::Untrusted);
        assert_eq!(trust(Array3::zeros((1, 1, 1))), Trust::Unobservable);
        assert_eq!(trust(Array3::zeros((1, 9, 1))), Trust::Trusted);
    }

    #[test]
    fn a_saturated_pixel_takes_the_radiance_of_its_neighbours() {
        let gains = Gains::checkerboard(4.0);
        let sensor = Sensor::new(SensorConfig { gains, ..SensorConfig::default() }).unwrap();
        for (radiance, shown) in [(0.1, 25.0), (0.8, 204.0)] {
            let saturated =
                sensor.expose(Array3::from_elem((6, 8, 3), radiance).view(), 0).unwrap().saturated();
            assert!(saturated.to_f32().iter().all(|v| (v - shown).abs() <= 1.0), "{radiance}");
        }
    }

    /// Lamps of one pixel are the worst case: most of them are wrong without being doubtful.
    #[test]
    fn a_result_with_lamps_of_one_pixel_is_trusted_only_if_they_are_few() {
        let mut trusted = [0, 0];
        for lamps in [0, 10, 40, 80, 120, 200, 400] {
            // The lamps lie at pixels of full gain, and their brightness takes all values from 0.3 to 1.
            let mut radiance = ndarray::Array3::from_elem((400, 400, 1), 0.1f32);
            for lamp in 0..lamps {
                let row = 2 * ((lamp * 89) % 200);
                radiance[(row, 2 * ((lamp * 57) % 200), 0)] = 0.3 + 0.7 * ((lamp * 37) % 101) as f32 / 101.0;
            }
            let gains = Gains::checkerboard(4.0);
            let sensor = Sensor::new(SensorConfig { gains, ..SensorConfig::PLAIN }).expect("possible");
            let exposure = sensor.expose(radiance.view(), 0).expect("an image");
            let mut out = Recovered::default();
            let mut method = TwoGains::new(gains).expect("two gains");
            method.unwrap(&exposure.modulo(), &exposure.range().into(), &mut out).expect("valid codes");
            let exact = exposure.exact_share(&out.k).expect("the same shape");
            let is_trusted = out.report.trust == Trust::Trusted;
            assert!(!is_trusted || exact >= 0.999, "{lamps} lamps: {exact}");
            trusted[usize::from(is_trusted)] += 1;
        }
        assert!(trusted.iter().all(|cases| *cases > 2), "both verdicts are met: {trusted:?}");
    }

    #[test]
    fn read_noise_comes_after_the_gain() {
        let gains = Gains::checkerboard(4.0);
        let sensor = Sensor::new(SensorConfig { read_noise: 3.0, gains, ..SensorConfig::default() }).unwrap();
        let exposure = sensor.expose(Array3::from_elem((200, 300, 1), 0.5).view(), 1).unwrap();
        for (parity, expected) in [(0, 3.0), (1, 12.0)] {
            let pixels = exposure.x().indexed_iter().filter(|((i, j, _), _)| (i + j) % 2 == parity);
            let squares: Vec<f64> = pixels.map(|(_, x)| (f64::from(*x) - 512.0).powi(2)).collect();
            let sigma = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
            assert!((sigma / expected - 1.0).abs() < 0.02, "{sigma}");
        }
    }
}
