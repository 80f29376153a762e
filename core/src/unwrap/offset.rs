//! The absolute offset of a result, which differences do not determine: `x` and `x + 2^b` have the same y.
//!
//! Every method takes the darkest offset that leaves the result in range, up to a share of outliers. This is the true one if some part
//! of the scene is below the peak. Three facts can show whether that is so:
//!
//! - **The range.** Where the brightest samples come so near to its end that one more peak would leave it, no other offset is possible
//!   ([`trust`]).
//! - **Black columns.** The radiance is 0 where the sensor is shaded ([`Range::black`]).
//! - **The last trusted frame**, if the images are successive frames of one camera: most pixels differ from it by less than half a
//!   peak at one offset only. It gives the offset of a frame whose counts agree with each other, and never a count of a pixel. After a
//!   cut, no offset fits most pixels.

use ndarray::{Array3, ArrayView2, s};

use super::{Range, Recovered, Trust};
use crate::simd::widest;

/// The evidence for the absolute offset of a trusted result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OffsetEvidence {
    /// One more peak would leave the range.
    Range,
    /// The shaded columns of the sensor are black.
    OpticalBlack,
    /// The last trusted frame of the same camera.
    LastFrame,
}

impl OffsetEvidence {
    /// Returns the name for tables and messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Range => "range",
            Self::OpticalBlack => "optical_black",
            Self::LastFrame => "last_frame",
        }
    }
}

/// The shortest side, in pixels, of an image whose lines can contradict each other.
const SHORTEST_SIDE: usize = 3;

/// The share of the pixels that have to be near the end of the range: a few samples may be wrong.
const BRIGHT: f64 = 1e-4;

/// The least alpha that may be given, over the true one, with which no result at a wrong offset is trusted.
const LEAST_ALPHA: f64 = 0.9;

/// The least share of the samples of the black columns that have to be black: some may be defects.
const BLACK: f64 = 0.95;

/// The least share of the pixels that the last frame has to explain at one offset.
const UNCHANGED: f64 = 0.75;

/// One pixel of so many rows and columns is compared with the last frame. An odd number meets all colours of a mosaic.
const SAMPLED: usize = 7;

/// Returns the trust in `out`, whose counts agree with each other, by its range alone.
///
/// It is trusted where in each channel more than [`BRIGHT`] of the pixels are at `alpha * 2^b / LEAST_ALPHA - 2^b` or above. An image with
/// fewer than [`SHORTEST_SIDE`] rows or columns shows nothing at all, since no majority of lines can be wrong.
pub(super) fn trust(out: &Recovered, range: Range) -> Trust {
    let (height, width, channels) = out.x.dim();
    // Where nothing can wrap, every count is 0.
    if range.max_wraps() == 0 {
        return Trust::Trusted;
    }
    if height.min(width) < SHORTEST_SIDE {
        return Trust::Untrusted;
    }
    let x = out.x.as_slice().expect("prepare has made the layout standard");
    let limit = (range.limit() / LEAST_ALPHA) as f32 - range.peak();
    let mut bright = [0; 3];
    // Most images show it in their first rows.
    let is_evident = x.chunks(PART).any(|part| {
        let counts = widest!(count_from(part, channels, limit));
        bright.iter_mut().zip(counts).for_each(|(bright, count)| *bright += count);
        bright[..channels].iter().all(|&count| f64::from(count) > BRIGHT * (height * width) as f64)
    });
    if is_evident { Trust::Trusted } else { Trust::Relative }
}

/// Finds evidence for results whose range shows none.
#[derive(Default)]
pub(super) struct OffsetFinder {
    /// Whether the images are successive frames of one camera.
    successive: bool,
    /// The sampled radiance of the last trusted frame, by [`Group`], and the range and shape that it had.
    last: Vec<Vec<f32>>,
    last_of: Option<(Range, (usize, usize, usize))>,
}

impl OffsetFinder {
    pub fn new(successive: bool) -> Self {
        Self { successive, ..Self::default() }
    }

    /// Looks for the offset of a result that is relative, and makes it trusted where there is evidence. `is_mosaic` says whether `out`
    /// is a colour mosaic.
    pub fn settle(&mut self, out: &mut Recovered, is_mosaic: bool, range: Range) {
        let groups = groups(out.x.dim().2, is_mosaic);
        let trust = out.report.trust;
        out.report.offset = if trust == Trust::Trusted {
            Some(OffsetEvidence::Range)
        } else if trust == Trust::Relative && is_black(out, &groups, range) {
            Some(OffsetEvidence::OpticalBlack)
        } else if trust == Trust::Relative && self.shift(out, &groups, range) {
            Some(OffsetEvidence::LastFrame)
        } else {
            None
        };
        if out.report.offset.is_none() {
            return;
        }
        out.report.trust = Trust::Trusted;
        if self.successive {
            self.last_of = Some((range, out.x.dim()));
            self.last.resize(groups.len(), Vec::new());
            for (last, group) in self.last.iter_mut().zip(&groups) {
                last.clear();
                last.extend(group.of(&out.x).slice(s![..;SAMPLED, ..;SAMPLED]));
            }
        }
    }

    /// Shifts `out` to the offset at which most pixels of each group are within half a peak of the last trusted frame; returns whether
    /// there is one.
    fn shift(&self, out: &mut Recovered, groups: &[Group], range: Range) -> bool {
        if self.last_of != Some((range, out.x.dim())) {
            return false;
        }
        let steps: Option<Vec<i16>> =
            groups.iter().zip(&self.last).map(|(group, last)| group.step_to(last, &out.x, range)).collect();
        let Some(steps) = steps else { return false };
        let most = i16::from(range.max_wraps());
        let fits = |(group, step): (&Group, &i16)| {
            group.of(&out.k).iter().all(|&k| (0..=most).contains(&(i16::from(k) + step)))
        };
        if !groups.iter().zip(&steps).all(fits) {
            return false;
        }
        for (group, step) in groups.iter().zip(steps).filter(|(_, step)| *step != 0) {
            group.raise(out, step, range);
        }
        true
    }
}

/// The pixels of one colour: one channel, or one place of the 2 x 2 pixels of a mosaic.
struct Group {
    channel: usize,
    row: usize,
    column: usize,
    period: isize,
}

/// Returns the groups of an image of so many channels.
fn groups(channels: usize, is_mosaic: bool) -> Vec<Group> {
    match is_mosaic {
        true => (0..4).map(|at| Group { channel: 0, row: at / 2, column: at % 2, period: 2 }).collect(),
        false => (0..channels).map(|channel| Group { channel, row: 0, column: 0, period: 1 }).collect(),
    }
}

impl Group {
    /// Returns the values of the group in an image.
    fn of<'a, T>(&self, image: &'a Array3<T>) -> ArrayView2<'a, T> {
        let Self { channel, row, column, period } = *self;
        image.slice(s![row..;period, column..;period, channel])
    }

    /// Returns the whole peaks that bring most samples of `x` to `last`, which holds one of [`SAMPLED`] rows and columns; `None` if they
    /// bring less than [`UNCHANGED`].
    fn step_to(&self, last: &[f32], x: &Array3<f32>, range: Range) -> Option<i16> {
        let most = usize::from(range.max_wraps());
        // The steps from -most to most.
        let mut pixels = vec![0; 2 * most + 1];
        let x = self.of(x);
        let x = x.slice(s![..;SAMPLED, ..;SAMPLED]);
        for (x, last) in x.iter().zip(last) {
            let step = ((last - x) / range.peak()).round() as isize + most.cast_signed();
            pixels.get_mut(step.cast_unsigned()).into_iter().for_each(|count| *count += 1);
        }
        let enough = |count: &usize| *count as f64 >= UNCHANGED * last.len() as f64;
        // More than half of the pixels have one step only.
        pixels.iter().position(enough).map(|step| step as i16 - most as i16)
    }

    /// Adds `step` peaks to each sample, which must leave its count in range.
    fn raise(&self, out: &mut Recovered, step: i16, range: Range) {
        let Self { channel, row, column, period } = *self;
        let place = s![row..;period, column..;period, channel];
        out.x.slice_mut(place).mapv_inplace(|x| x + f32::from(step) * range.peak());
        out.k.slice_mut(place).mapv_inplace(|k| (i16::from(k) + step) as u8);
    }
}

/// Returns whether the shaded columns are black in each group.
fn is_black(out: &Recovered, groups: &[Group], range: Range) -> bool {
    groups.iter().all(|group| {
        let columns = range.black().saturating_sub(group.column).div_ceil(group.period.unsigned_abs());
        let x = group.of(&out.x);
        let x = x.slice(s![.., ..columns.min(x.ncols())]);
        let black = x.iter().filter(|&&x| x < range.peak() / 2.0).count();
        black as f64 >= BLACK * x.len() as f64 && !x.is_empty()
    })
}

/// Samples in a block, which holds whole pixels of one and of three channels, so that a lane belongs to one channel.
/// It is longer than the widest vector.
const BLOCK: usize = 768;

/// The number of samples that are counted together.
const PART: usize = 64 * BLOCK;

/// Returns the number of the interleaved samples of each channel that are at least `limit`.
#[inline(always)]
fn count_from(samples: &[f32], channels: usize, limit: f32) -> [u32; 3] {
    let mut lanes = [0; BLOCK];
    let (blocks, rest) = samples.as_chunks::<BLOCK>();
    for block in blocks {
        lanes.iter_mut().zip(block).for_each(|(lane, &sample)| *lane += u32::from(sample >= limit));
    }
    lanes.iter_mut().zip(rest).for_each(|(lane, &sample)| *lane += u32::from(sample >= limit));
    std::array::from_fn(|channel| lanes.iter().skip(channel).step_by(channels).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_result_that_reaches_the_end_of_its_range_is_evident() {
        let range = Range::new(8, 4.0).unwrap();
        // One more peak leaves 4 / 0.9 peaks where the brightest sample is above 3.44 peaks.
        for (brightest, other, evident) in
            [(890.0, 890.0, true), (870.0, 890.0, false), (870.0, 870.0, false)]
        {
            let x = Array3::from_shape_fn((20, 30, 3), |(i, j, c)| {
                [0.0, if c == 1 { brightest } else { other }][usize::from((i, j) == (7, 9))]
            });
            let out = Recovered { k: x.mapv(|x| (x / 256.0) as u8), x, ..Recovered::default() };
            assert_eq!(trust(&out, range) == Trust::Trusted, evident, "{brightest} and {other}");
        }
    }

    #[test]
    fn a_few_bright_samples_are_no_evidence() {
        let range = Range::new(8, 4.0).unwrap();
        for (bright, evident) in [(20, false), (30, true)] {
            let x = Array3::from_shape_fn(
                (500, 500, 1),
                |(i, j, _)| if i == 9 && j < bright { 1000.0 } else { 0.0 },
            );
            let out = Recovered { k: x.mapv(|x| (x / 256.0) as u8), x, ..Recovered::default() };
            assert_eq!(trust(&out, range) == Trust::Trusted, evident, "{bright} of 250,000 pixels");
        }
    }
}
