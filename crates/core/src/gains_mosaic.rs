//! Two gains on a colour mosaic: green is predicted from all colours around it, and red and blue beside green.
//!
//! 2 x 2 pixels have one gain, so that the nearest pixels of another gain and the same colour are two pixels away, and those of green
//! sqrt(2) px along one diagonal. The mean of two pixels is off by half of the bend between them, and how much a scene bends, all colours
//! show. So each prediction is a sum of filters over samples: the weights of the own colour add up to 1, and those of each other colour to 0,
//! so that a scene of one colour, whatever it is, is predicted without error.
//!
//! 1. Green at pixels of full gain, from samples of low gain alone. The count that brings `y + k 2^b` nearest is taken.
//! 2. Red and blue from their samples of low gain and from green at every pixel, which is known by then: mostly the mean of the
//!    differences from green of the four nearest samples of low gain, and green between its neighbours at the place itself.
//!
//! The filters are those with the least square errors on rendered scenes behind several lenses, rounded.

use crate::mosaic::{GREEN, Mosaic, PLACES, mirrored};
use crate::range::HALF_A_CODE;
use crate::simd::widest;

/// One sample of a filter: rows down, columns to the right, and the weight in 64ths.
type Tap = (isize, isize, f32);

// The filters for the upper two pixels of a block in a mosaic whose first pixel is red or blue. Those of the lower two are the same turned by
// 180 degrees, and a mosaic whose first pixel is green has their mirror images.
/// The filter of green at pixels of full gain.
const OF_GREEN: &[Tap] = &[
    (-1, -1, 25.0),
    (1, 1, 25.0),
    (0, -2, 7.0),
    (2, 0, 7.0),
    (-1, 0, 12.0),
    (1, 2, -4.0),
    (-3, -2, -5.0),
    (3, 0, -3.0),
    (0, 1, 12.0),
    (-2, -1, -4.0),
    (2, 3, -5.0),
    (0, -3, -3.0),
];

/// The filter of red and blue.
const OF_OTHERS: &[Tap] = &[
    (-2, 0, 16.0),
    (0, -2, 16.0),
    (0, 2, 16.0),
    (2, 0, 16.0),
    (-1, 0, 16.0),
    (0, -1, 16.0),
    (0, 1, 16.0),
    (1, 0, 16.0),
    (-2, -1, -8.0),
    (-2, 1, -8.0),
    (-1, -2, -8.0),
    (-1, 2, -8.0),
    (1, -2, -8.0),
    (1, 2, -8.0),
    (2, -1, -8.0),
    (2, 1, -8.0),
];

/// Blocks of 2 x 2 pixels beyond the border that the filters reach.
const MARGIN: usize = 2;

/// A sample of low gain may lie so far beyond all samples of low gain around it, in peaks: farther off it is a defect, which must not
/// lead the predictions of its neighbours astray.
const MOST_APART: f32 = 0.5;

/// The sensor of a mosaic with two gains.
#[derive(Clone, Copy)]
pub(crate) struct MosaicGains {
    pub ratio: f32,
    pub mosaic: Mosaic,
    /// 2^b.
    pub peak: f32,
}

/// The radiance of a mosaic, with its buffers.
#[derive(Default)]
pub(crate) struct MosaicRadiance {
    /// One plane for each of [`PLACES`].
    planes: [Plane; PLACES.len()],
    /// Whether each block of an even row has the lower gain, and of an odd one.
    low: [Vec<bool>; 2],
    predicted: Vec<f32>,
    /// The least and the greatest sample around each one of a row.
    around: [Vec<f32>; 2],
}

/// The pixels of one place in the blocks, with [`MARGIN`] more at all sides: codes of full gain, until they are replaced by radiance, and
/// radiance as if the gain was low elsewhere.
#[derive(Default)]
struct Plane {
    rows: usize,
    columns: usize,
    /// The length of a row in memory, the same for all planes.
    pitch: usize,
    samples: Vec<f32>,
}

impl MosaicRadiance {
    /// Takes the codes of an image of `dim` (height, width) and predicts the pixels of full gain. `settle` gets each row of one place in the
    /// blocks: the number of the place in [`PLACES`], the samples, their predictions, and which of them have the lower gain. It replaces
    /// the codes of the other ones by radiance, from which the next predictions follow.
    pub fn fill<T: Copy + Into<f32>>(
        &mut self,
        gains: MosaicGains,
        codes: &[T],
        dim: (usize, usize),
        mut settle: impl FnMut(usize, &mut [f32], &[f32], &[bool]),
    ) {
        self.read(gains, codes, dim);
        let is_green = |(row, column)| gains.mosaic.channel(row, column) == GREEN;
        for (filter, of_green) in [(OF_GREEN, true), (OF_OTHERS, false)] {
            for (at, place) in PLACES.into_iter().enumerate() {
                if is_green(place) != of_green {
                    continue;
                }
                for row in 0..self.planes[at].rows {
                    let low = &self.low[row % 2];
                    // A row of low gain needs no prediction.
                    if low.contains(&false) {
                        predict(&self.planes, filter, gains.mosaic, (place, row), &mut self.predicted);
                        let samples = self.planes[at].line_mut(row);
                        let columns = samples.len();
                        settle(at, samples, &self.predicted[..columns], &low[..columns]);
                    }
                }
                self.planes[at].mirror();
            }
        }
    }

    /// Calls `take` with each pixel of the image of `codes`: its index, whether it has the lower gain, and its radiance.
    pub fn each<T: Copy + Into<f32>>(
        &self,
        gains: MosaicGains,
        codes: &[T],
        width: usize,
        mut take: impl FnMut(usize, bool, f32),
    ) {
        for (row, codes) in codes.chunks_exact(width).enumerate() {
            let low = &self.low[row / 2 % 2];
            for column in [0, 1] {
                let samples = self.planes[row % 2 * 2 + column].line(row / 2).iter().zip(low);
                for (at, (&full, &is_low)) in (column..).step_by(2).zip(samples) {
                    let radiance = if is_low { radiance_of_low(codes[at].into(), gains.ratio) } else { full };
                    take(row * width + at, is_low, radiance);
                }
            }
        }
    }

    /// Returns the number of pixels of full gain at each place, about.
    pub fn full(&self) -> [usize; PLACES.len()] {
        self.planes.each_ref().map(|plane| (plane.rows * plane.columns).div_ceil(2))
    }

    /// Fills the planes from codes.
    fn read<T: Copy + Into<f32>>(
        &mut self,
        gains: MosaicGains,
        codes: &[T],
        (height, width): (usize, usize),
    ) {
        let blocks = width.div_ceil(2);
        for (parity, low) in self.low.iter_mut().enumerate() {
            low.clear();
            low.extend((0..blocks).map(|column| (parity + column) % 2 == 1));
        }
        for (plane, (first, column)) in self.planes.iter_mut().zip(PLACES) {
            (plane.rows, plane.columns) = ((height - first).div_ceil(2), (width - column).div_ceil(2));
            plane.pitch = blocks + 2 * MARGIN;
            plane.samples.resize((height.div_ceil(2) + 2 * MARGIN) * plane.pitch, 0.0);
            for row in 0..plane.rows {
                let codes = codes[(2 * row + first) * width..][..width][column..].iter().step_by(2);
                let samples = plane.line_mut(row).iter_mut().zip(&self.low[row % 2]);
                for ((sample, &is_low), &code) in samples.zip(codes) {
                    let code = code.into();
                    *sample = if is_low { radiance_of_low(code, gains.ratio) } else { code };
                }
            }
            plane.mirror();
        }
        for at in 0..self.planes.len() {
            for row in 0..self.planes[at].rows {
                self.bound(at, row, gains);
            }
            self.planes[at].mirror();
        }
    }

    /// Bounds the samples of low gain of a row by the nearest ones of its colour and those of the other pixels in its block.
    fn bound(&mut self, at: usize, row: usize, gains: MosaicGains) {
        let low = &self.low[row % 2];
        if !low.contains(&true) {
            return;
        }
        let nearest = [(-1, -1), (-1, 1), (1, -1), (1, 1)];
        let columns = self.planes[at].columns;
        let [least, greatest] = &mut self.around;
        let own = nearest.map(|step| (at, step));
        let others = [1, 2, 3].map(|other| ((at + other) % self.planes.len(), (0, 0)));
        for (number, (at, (down, right))) in own.into_iter().chain(others).enumerate() {
            let line = self.planes[at].beside(row, down, right, columns);
            if number == 0 {
                least.clear();
                least.extend_from_slice(line);
                greatest.clone_from(least);
            } else {
                widest!(least.iter_mut().zip(line).for_each(|(least, sample)| *least = least.min(*sample)));
                widest!(greatest.iter_mut().zip(line).for_each(|(most, sample)| *most = most.max(*sample)));
            }
        }
        let margin = MOST_APART * gains.peak;
        let samples = self.planes[at].line_mut(row).iter_mut().zip(low);
        widest!(samples.zip(least.iter().zip(greatest)).for_each(|((sample, &is_low), (least, most))| {
            let bounded = sample.max(*least - margin).min(*most + margin);
            *sample = if is_low { bounded } else { *sample };
        }));
    }
}

impl Plane {
    fn line(&self, row: usize) -> &[f32] {
        &self.samples[(row + MARGIN) * self.pitch + MARGIN..][..self.columns]
    }

    fn line_mut(&mut self, row: usize) -> &mut [f32] {
        &mut self.samples[(row + MARGIN) * self.pitch + MARGIN..][..self.columns]
    }

    /// Returns `count` samples of a row, from the one that lies this many blocks down and to the right on.
    fn beside(&self, row: usize, down: isize, right: isize, count: usize) -> &[f32] {
        let [row, column] = [(row + MARGIN, down), (MARGIN, right)].map(|(at, by)| at.strict_add_signed(by));
        &self.samples[row * self.pitch + column..][..count]
    }

    /// Fills all that lies outside with the mirror image without the border pixel (`dcb|abcd`), in which all pixels keep their gains.
    fn mirror(&mut self) {
        let Self { rows, columns, pitch, ref mut samples } = *self;
        let outside = |at: usize, count: usize| {
            let from = mirrored(at.cast_signed() - MARGIN.cast_signed(), count) + MARGIN;
            (from != at).then_some(from)
        };
        for row in samples.chunks_exact_mut(pitch).skip(MARGIN).take(rows) {
            for at in (0..MARGIN).chain(MARGIN + columns..pitch) {
                if let Some(from) = outside(at, columns) {
                    row[at] = row[from];
                }
            }
        }
        for at in 0..samples.len() / pitch {
            if let Some(from) = outside(at, rows) {
                samples.copy_within(from * pitch..(from + 1) * pitch, at * pitch);
            }
        }
    }
}

/// Returns the radiance of a code of low gain. A code stands for the interval above it, and the radiance of full gain is a whole code,
/// too: the half codes cancel for a ratio of 1.
#[inline(always)]
pub(crate) fn radiance_of_low(code: f32, ratio: f32) -> f32 {
    (code + HALF_A_CODE) / ratio - HALF_A_CODE
}

/// Predicts a row of one place from the samples around it.
fn predict(
    planes: &[Plane; PLACES.len()],
    filter: &[Tap],
    mosaic: Mosaic,
    (place, row): ((usize, usize), usize),
    predicted: &mut Vec<f32>,
) {
    // The filters are those of the upper pixels of a mosaic with red or blue in the first one.
    let turned = if place.0 == 0 { 1 } else { -1 };
    let mirrored = if mosaic.channel(0, 0) == GREEN { -turned } else { turned };
    let count = planes[place.0 * 2 + place.1].columns;
    predicted.clear();
    predicted.resize(count, 0.0);
    for &(down, right, weight) in filter {
        let down = place.0.cast_signed() + turned * down;
        let right = place.1.cast_signed() + mirrored * right;
        let plane = &planes[(down.rem_euclid(2) * 2 + right.rem_euclid(2)).cast_unsigned()];
        let line = plane.beside(row, down.div_euclid(2), right.div_euclid(2), count);
        let weight = weight / 64.0;
        widest!(predicted.iter_mut().zip(line).for_each(|(sum, sample)| *sum += weight * sample));
    }
}

#[cfg(test)]
mod tests {
    use ndarray::{Array3, s};
    use proptest::prelude::*;

    use super::*;
    use crate::unwrap::{Recovered, Trust, Unwrap as _};
    use crate::{Exposure, Frame, Gains, Psf, Range, Sensor, SensorConfig, TwoGains};

    fn expose(radiance: &Array3<f32>, alpha: f64, mosaic: Mosaic, sigma: f64) -> Exposure {
        let gains = Gains::checkerboard(alpha);
        let (mosaic, psf) = (Some(mosaic), Psf::of_sigma(sigma));
        let config = SensorConfig { alpha, gains, mosaic, psf, ..SensorConfig::PLAIN };
        Sensor::new(config).unwrap().expose(radiance.view(), 0).unwrap()
    }

    fn unwrapped(gains: Gains, y: &Frame, range: Range) -> Recovered {
        let mut out = Recovered::default();
        TwoGains::new(gains).unwrap().unwrap(y, &range.into(), &mut out).unwrap();
        out
    }

    fn recovered(exposure: &Exposure) -> (f64, Recovered) {
        let out = unwrapped(exposure.gains(), &exposure.modulo(), exposure.range());
        (exposure.exact_share(&out.k).unwrap(), out)
    }

    /// Discs of one colour before a background of the same colour.
    fn discs(seed: u64, colour: [f32; 3]) -> Array3<f32> {
        let mut random = seed | 1;
        let mut next = || {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (random >> 40) as f32 / (1u64 << 24) as f32
        };
        let discs: Vec<[f32; 4]> =
            (0..14).map(|_| [120.0 * next(), 160.0 * next(), 5.0 + 20.0 * next(), next()]).collect();
        Array3::from_shape_fn((120, 160, 3), |(i, j, c)| {
            let covers = |disc: &&[f32; 4]| (i as f32 - disc[0]).hypot(j as f32 - disc[1]) < disc[2];
            discs.iter().rfind(covers).map_or(0.05, |disc| disc[3]) * colour[c]
        })
    }

    proptest! {
        #[test]
        fn any_codes_of_any_size_give_a_congruent_result_in_range(
            (height, width) in (2usize..12, 2usize..12), bits in 1u8..=16, alpha in 0.6f64..200.0, which in 1usize..5,
            seed in any::<u64>(),
        ) {
            let range = Range::new(bits, alpha).unwrap();
            let gains = Gains::checkerboard(alpha);
            let mut random = seed | 1;
            let codes = Array3::from_shape_simple_fn((height, width, 1), || {
                random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                // Only codes that x below the limit can have.
                ((random >> 40) % f64::from(range.peak()).min(range.limit()).floor().max(1.0) as u64) as u16
            });
            let mosaic = Mosaic::WORDS[which].1;
            let y = Frame::from_u16(codes.clone()).unwrap().with_mosaic(mosaic.unwrap()).unwrap();
            let out = unwrapped(gains, &y, range);
            for ((at, &x), &y) in out.x.indexed_iter().zip(&codes) {
                prop_assert!(f64::from(x) < range.limit());
                if gains.behind(mosaic, at.0, at.1) < 1.0 {
                    prop_assert_eq!(out.k[at], 0);
                } else if alpha > 1.0 {
                    prop_assert_eq!(x, f32::from(y) + f32::from(out.k[at]) * range.peak());
                    prop_assert!(out.k[at] <= range.max_wraps());
                }
            }
        }

        /// The weights of each filter add up to 1 for its own colour and to 0 for the others.
        #[test]
        fn an_equal_scene_of_any_colour_is_exact_and_trusted(
            dim in (4usize..20, 4usize..20), alpha in 1.1f64..16.0, which in 1usize..5,
            colour in prop_oneof![(0f32..1.0).prop_map(|grey| [grey; 3]), [0f32..1.0, 0f32..1.0, 0f32..1.0]],
        ) {
            let radiance = Array3::from_shape_fn((dim.0, dim.1, 3), |(.., c)| colour[c]);
            let exposure = expose(&radiance, alpha, Mosaic::WORDS[which].1.unwrap(), 0.0);
            let (exact, out) = recovered(&exposure);
            prop_assert_eq!((exact, out.report.trust), (1.0, Trust::Trusted));
        }

        #[test]
        fn a_smooth_scene_is_exact_and_trusted(
            dim in (60usize..90, 60usize..90), alpha in 1.5f64..6.0, which in 1usize..5,
        ) {
            let radiance = Array3::from_shape_fn((dim.0, dim.1, 3), |(i, j, c)| {
                0.5 + 0.45 * ((i as f32 / 30.0).sin() * (j as f32 / 40.0 + c as f32).cos())
            });
            let exposure = expose(&radiance, alpha, Mosaic::WORDS[which].1.unwrap(), 0.0);
            let (exact, out) = recovered(&exposure);
            prop_assert_eq!((exact, out.report.trust), (1.0, Trust::Trusted));
        }
    }

    #[test]
    fn edges_of_an_object_of_one_colour_are_found_by_all_colours_together() {
        for (seed, colour) in [(1, [0.96, 1.0, 0.93]), (2, [1.0, 0.7, 0.4])] {
            let exposure = expose(&discs(seed, colour), 4.0, Mosaic::Grbg, 1.0);
            let (exact, _) = recovered(&exposure);
            // Each colour by itself, whose pixels are two apart.
            let (y, mut alone) = (exposure.modulo(), exposure.wraps());
            let codes = y.as_u8().unwrap();
            for (row, column) in PLACES {
                let place = s![row..;2, column..;2, ..];
                let colour = Frame::from_u8(codes.slice(place).as_standard_layout().into_owned()).unwrap();
                alone.slice_mut(place).assign(&unwrapped(exposure.gains(), &colour, exposure.range()).k);
            }
            let alone = exposure.exact_share(&alone).unwrap();
            assert!(exact > 0.999 && 1.0 - exact < 0.25 * (1.0 - alone), "{exact} {alone}");
        }
    }

    /// Lamps of one pixel are the worst case: most of them are wrong without being doubtful.
    #[test]
    fn what_is_trusted_is_exact() {
        let mut verdicts = [0, 0];
        let mut check = |exposure: &Exposure, what: &str| {
            let (exact, out) = recovered(exposure);
            let is_trusted = out.report.trust == Trust::Trusted;
            assert!(exact >= 0.999 || !is_trusted, "{what}: {exact}");
            verdicts[usize::from(is_trusted)] += 1;
        };
        for lamps in [0, 10, 40, 80, 120, 200, 400] {
            let mut radiance = Array3::from_elem((400, 400, 3), 0.1f32);
            for lamp in 0..lamps {
                // The lamps lie at pixels of full gain of all colours, and their brightness takes all values from 0.3 to 1.
                let block = [(lamp * 89) % 100, (lamp * 57) % 100].map(|at| 4 * at);
                let (row, column) = (block[0] + lamp % 2, block[1] + lamp / 2 % 2);
                let light = 0.3 + 0.7 * ((lamp * 37) % 101) as f32 / 101.0;
                radiance.slice_mut(s![row, column, ..]).fill(light);
            }
            check(&expose(&radiance, 4.0, Mosaic::Rggb, 0.0), &format!("{lamps} lamps"));
        }
        for (seed, sigma) in (0..6).flat_map(|seed| [0.0, 0.8, 1.4, 2.0].map(|sigma| (seed, sigma))) {
            for alpha in [1.5, 4.0, 8.0] {
                let exposure = expose(&discs(seed, [0.9, 1.0, 0.8]), alpha, Mosaic::Gbrg, sigma);
                check(&exposure, &format!("discs {seed}, alpha {alpha}, {sigma} px"));
            }
        }
        assert!(verdicts.iter().all(|count| *count > 20), "both verdicts are met: {verdicts:?}");
    }
}
