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
//! The filters are those with the least square errors on KITTI frames behind several lenses, rounded.

use crate::gains::GainPattern;
use crate::green_rows::radiance_of_low;
use crate::mosaic::{GREEN, Mosaic, PLACES, mirrored};
use crate::simd::widest;

/// One sample of a filter: rows down, columns to the right, and the weight in 64ths.
type Tap = (isize, isize, f32);

/// The filters of a pattern for the upper two pixels of a block in a mosaic whose first pixel is red or blue. Those of the lower two are the
/// same turned by 180 degrees, and a mosaic whose first pixel is green has their mirror images.
#[derive(Clone, Copy)]
struct Filters {
    green: &'static [Tap],
    other: &'static [Tap],
}

const CHECKERBOARD: Filters = Filters {
    green: &[
        (-1, -1, 26.0),
        (1, 1, 26.0),
        (0, -2, 6.0),
        (2, 0, 6.0),
        (-1, 0, 12.0),
        (1, 2, -6.0),
        (-3, -2, -4.0),
        (3, 0, -2.0),
        (0, 1, 12.0),
        (-2, -1, -6.0),
        (2, 3, -4.0),
        (0, -3, -2.0),
    ],
    other: &[
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
    ],
};

const ROWS: Filters = Filters {
    green: &[
        (-1, -1, 35.0),
        (-1, 1, 35.0),
        (2, 0, 25.0),
        (2, -2, 3.5),
        (2, 2, 3.5),
        (-2, 0, -12.0),
        (-2, -2, -6.0),
        (-2, 2, -6.0),
        (3, -1, -7.0),
        (3, 1, -7.0),
        (-1, 0, 8.0),
        (-1, -2, -4.0),
        (-1, 2, -4.0),
    ],
    other: &[
        (-2, 0, 20.0),
        (2, 0, 20.0),
        (-2, -2, 6.0),
        (-2, 2, 6.0),
        (2, -2, 6.0),
        (2, 2, 6.0),
        (0, -1, 26.0),
        (0, 1, 26.0),
        (-1, 0, 12.0),
        (1, 0, 12.0),
        (-2, -1, -15.0),
        (-2, 1, -15.0),
        (2, -1, -15.0),
        (2, 1, -15.0),
        (-1, -2, -4.0),
        (-1, 2, -4.0),
        (1, -2, -4.0),
        (1, 2, -4.0),
    ],
};

/// Blocks of 2 x 2 pixels beyond the border that the filters reach.
const MARGIN: usize = 2;

/// A sample of low gain may lie so far beyond all samples of low gain around it, in peaks: farther off it is a defect, which must not
/// lead the predictions of its neighbours astray.
const MOST_APART: f32 = 0.5;

/// The sensor of a mosaic with two gains.
#[derive(Clone, Copy)]
pub(crate) struct MosaicGains {
    pub pattern: GainPattern,
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
        let filters = if gains.pattern == GainPattern::Rows { ROWS } else { CHECKERBOARD };
        let is_green = |(row, column)| gains.mosaic.channel(row, column) == GREEN;
        for (filter, of_green) in [(filters.green, true), (filters.other, false)] {
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
            low.extend((0..blocks).map(|column| gains.pattern.is_low(parity, column, 0)));
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
        let nearest = match gains.pattern {
            GainPattern::Rows => [(0, -1), (0, 1), (-2, 0), (2, 0)],
            GainPattern::Checkerboard | GainPattern::Colours => [(-1, -1), (-1, 1), (1, -1), (1, 1)],
        };
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
