//! The absolute offset of a result, which differences do not determine: `x` and `x + 2^b` have the same y.
//!
//! Every method takes the darkest offset that leaves the result in range, up to a share of outliers. This is the true one if some part
//! of the scene is below the peak. Four facts can show whether that is so:
//!
//! - **The range.** Where the brightest samples come so near to its end that one more peak would leave it, no other offset is possible
//!   ([`trust`]).
//! - **Black columns.** The radiance is 0 where the sensor is shaded ([`Range::black`]).
//! - **The black level.** The user promises the radiance of the darkest pixels ([`Range::black_level`]), and the darkest ones of each colour
//!   have it. At a wrong offset they have it only by chance.
//! - **The last trusted frame**, if the images are successive frames of one camera. Most parts of a scene keep their mean radiance from
//!   frame to frame, to less than half a peak and to a part of the contrast of the scene. The last frame gives the offset of a frame
//!   whose counts agree with each other, and never a count of a pixel. After a cut, no offset fits most parts.

use ndarray::{Array2, Array3, ArrayView2, Zip, s};

use super::{Integers, Range, Recovered, Trust};
use crate::frame::{Frame, Samples};
use crate::simd::widest;

/// The evidence for the absolute offset of a trusted result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OffsetEvidence {
    /// One more peak would leave the range.
    Range,
    /// The shaded columns of the sensor are black.
    OpticalBlack,
    /// The darkest pixels have the promised radiance.
    BlackLevel,
    /// The last trusted frame of the same camera.
    LastFrame,
}

impl OffsetEvidence {
    /// Returns the name for tables and messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Range => "range",
            Self::OpticalBlack => "optical_black",
            Self::BlackLevel => "black_level",
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

/// Black samples are below this share of the peak: two standard deviations of read noise of 32 codes of 256.
const BLACKEST: f32 = 0.25;

/// The least share of the samples of the black columns that have to be black: some may be defects.
const BLACK: f64 = 0.95;

/// The share of the pixels that are the darkest ones of a frame, and the most by which they may differ from the black level, in peaks.
const DARKEST: f64 = 5e-4;
const NEAR_BLACK_LEVEL: f32 = 1.0 / 32.0;

/// The rows and columns of the parts of an image that are compared with the last frame.
const PARTS: (usize, usize) = (4, 8);

/// The mean radiance of each part of an image.
type Means = [f32; PARTS.0 * PARTS.1];

/// The most by which a part of the last frame may differ, in peaks and as a share of the distance between the quartiles of its parts, and
/// the least number of parts of which this must hold. A drive of KITTI at 10 Hz keeps it at alpha 4, and no two pictures of different
/// places do, also where one of them is brightened.
const CHANGE: f32 = 0.4;
const CHANGE_OF_CONTRAST: f32 = 0.35;
const UNCHANGED: usize = PARTS.0 * PARTS.1 * 3 / 4;

/// One pixel of so many rows and columns is taken for a mean.
const SAMPLED: isize = 5;

/// Returns the trust in `out`, the result for `y` whose counts agree with each other, by the range of each channel alone.
pub(super) fn trust(y: &Frame, out: &Recovered, range: Range) -> Trust {
    by_range(out, range, |limit| is_reached(y, out, out.k.dim().2, limit, range))
}

/// Returns the same of the mosaic `out`, by the range of each of its colours.
pub(super) fn trust_of_mosaic(out: &Recovered, range: Range) -> Trust {
    by_range(out, range, |limit| {
        groups(1, true).all(|group| {
            let x = group.of(&out.x);
            let most = BRIGHT * x.len() as f64;
            x.iter().filter(|&&x| x >= limit).take(most as usize + 1).count() as f64 > most
        })
    })
}

/// Returns the trust in `out`: whether more than [`BRIGHT`] of the pixels reach `alpha * 2^b / LEAST_ALPHA - 2^b`, which
/// `is_reached` tells, in each group. An image with fewer than [`SHORTEST_SIDE`] rows or columns shows nothing at all,
/// since no majority of lines can be wrong.
fn by_range(out: &Recovered, range: Range, is_reached: impl FnOnce(f32) -> bool) -> Trust {
    let (height, width, _) = out.k.dim();
    // Where nothing can wrap, every count is 0.
    if range.max_wraps() == 0 {
        Trust::Trusted
    } else if height.min(width) < SHORTEST_SIDE {
        Trust::Unobservable
    } else if is_reached((range.limit() / LEAST_ALPHA) as f32 - range.peak()) {
        Trust::Trusted
    } else {
        Trust::Relative
    }
}

/// Returns whether more than [`BRIGHT`] of the samples are at the end of the range or beyond.
fn leaves_range(y: &Frame, out: &Recovered, range: Range) -> bool {
    let limit = range.limit() as f32;
    // The counts are read faster, and show in most images that no sample can be there.
    let most = out.k.iter().fold(0, |most, &k| most.max(k));
    (f32::from(most) + 1.0) * range.peak() > limit && is_reached(y, out, 1, limit, range)
}

/// Finds evidence for results whose range shows none.
#[derive(Default)]
pub(super) struct OffsetFinder {
    /// Whether the images are successive frames of one camera.
    successive: bool,
    /// The last trusted frame; only successive frames have one.
    last: Option<LastFrame>,
}

/// The part of a trusted frame with which the next frames are compared.
struct LastFrame {
    range: Range,
    dim: (usize, usize, usize),
    /// The means of each [`Group`].
    means: [Means; MOST_GROUPS],
}

impl OffsetFinder {
    pub fn new(successive: bool) -> Self {
        Self { successive, ..Self::default() }
    }

    /// Looks for the offset of the result for `y` that is relative, and makes it trusted where there is evidence.
    pub fn settle(&mut self, y: &Frame, out: &mut Recovered, range: Range) {
        let groups = groups(y.channels(), y.mosaic().is_some());
        // What leaves the range contradicts it: alpha or the counts are wrong, and no evidence helps.
        if [Trust::Trusted, Trust::Relative].contains(&out.report.trust) && leaves_range(y, out, range) {
            out.report.trust = Trust::Relative;
            return;
        }
        let trust = out.report.trust;
        out.report.offset = if trust == Trust::Trusted {
            Some(OffsetEvidence::Range)
        } else if trust == Trust::Relative && is_black(y, out, groups.clone(), range) {
            Some(OffsetEvidence::OpticalBlack)
        } else if trust == Trust::Relative && is_at_black_level(y, out, groups.clone(), range) {
            Some(OffsetEvidence::BlackLevel)
        } else if trust == Trust::Relative && self.shift(y, out, groups.clone(), range) {
            Some(OffsetEvidence::LastFrame)
        } else {
            None
        };
        if out.report.offset.is_none() {
            return;
        }
        out.report.trust = Trust::Trusted;
        if self.successive {
            let mut means = [[0.0; PARTS.0 * PARTS.1]; MOST_GROUPS];
            means.iter_mut().zip(groups).for_each(|(means, group)| *means = group.means(y, out, range));
            self.last = Some(LastFrame { range, dim: y.dim(), means });
        }
    }

    /// Shifts `out` to the offset at which most parts of each group are as in the last trusted frame; returns whether there is one.
    fn shift(
        &self,
        y: &Frame,
        out: &mut Recovered,
        groups: impl Iterator<Item = Group> + Clone,
        range: Range,
    ) -> bool {
        let comparable = |last: &&LastFrame| (last.range, last.dim) == (range, y.dim());
        let Some(last) = self.last.as_ref().filter(comparable) else { return false };
        let most = i16::from(range.max_wraps());
        let mut steps = [0; MOST_GROUPS];
        for ((group, last), to) in groups.clone().zip(&last.means).zip(&mut steps) {
            let Some(step) = step(&group.means(y, out, range), last, range) else { return false };
            if !group.of(&out.k).iter().all(|&k| (0..=most).contains(&(i16::from(k) + step))) {
                return false;
            }
            *to = step;
        }
        groups
            .zip(steps)
            .filter(|(_, step)| *step != 0)
            .for_each(|(group, step)| group.raise(out, step, range));
        true
    }
}

/// The most groups of an image.
const MOST_GROUPS: usize = 4;

/// The pixels of one colour: one channel, or one place of the 2 x 2 pixels of a mosaic.
#[derive(Clone, Copy)]
struct Group {
    channel: usize,
    row: usize,
    column: usize,
    period: isize,
}

/// Returns the groups of an image of so many channels, at most [`MOST_GROUPS`].
fn groups(channels: usize, is_mosaic: bool) -> impl Iterator<Item = Group> + Clone {
    (0..if is_mosaic { MOST_GROUPS } else { channels }).map(move |at| match is_mosaic {
        true => Group { channel: 0, row: at / 2, column: at % 2, period: 2 },
        false => Group { channel: at, row: 0, column: 0, period: 1 },
    })
}

impl Group {
    /// Returns the values of the group in an image.
    fn of<'a, T>(&self, image: &'a Array3<T>) -> ArrayView2<'a, T> {
        let Self { channel, row, column, period } = *self;
        image.slice(s![row..;period, column..;period, channel])
    }

    /// Returns the radiance of the group in the first `columns`, at one of so many rows and columns.
    fn radiance(
        &self,
        y: &Frame,
        out: &Recovered,
        range: Range,
        columns: usize,
        every: isize,
    ) -> Array2<f32> {
        fn sum<T: Copy + Into<f32>>(y: ArrayView2<'_, T>, k: ArrayView2<'_, u8>, peak: f32) -> Array2<f32> {
            Zip::from(y).and(k).map_collect(|&y, &k| y.into() + f32::from(k) * peak)
        }
        let (k, place) = (self.of(&out.k), s![..;every, ..columns;every]);
        match y.samples() {
            Samples::U8(y) => sum(self.of(y).slice(place), k.slice(place), range.peak()),
            Samples::U16(y) => sum(self.of(y).slice(place), k.slice(place), range.peak()),
            Samples::F32(_) => unreachable!("a modulo image has integers"),
        }
    }

    /// Returns the number of columns of the group among the first ones of an image.
    fn columns(&self, of_image: usize) -> usize {
        of_image.saturating_sub(self.column).div_ceil(self.period.unsigned_abs())
    }

    /// Returns the mean of the group in each part of an image; NaN in parts without a pixel.
    fn means(&self, y: &Frame, out: &Recovered, range: Range) -> Means {
        let x = self.radiance(y, out, range, self.columns(y.width()), SAMPLED);
        let (mut sums, mut counts) = ([0.0; PARTS.0 * PARTS.1], [0; PARTS.0 * PARTS.1]);
        let (rows, columns) = x.dim();
        for ((i, j), x) in x.indexed_iter() {
            let part = i * PARTS.0 / rows * PARTS.1 + j * PARTS.1 / columns;
            sums[part] += x;
            counts[part] += 1;
        }
        std::array::from_fn(|part| sums[part] / counts[part] as f32)
    }

    /// Adds `step` peaks to each sample, which must leave its count in range.
    fn raise(&self, out: &mut Recovered, step: i16, range: Range) {
        let Self { channel, row, column, period } = *self;
        let place = s![row..;period, column..;period, channel];
        if !out.x.is_empty() {
            out.x.slice_mut(place).mapv_inplace(|x| x + f32::from(step) * range.peak());
        }
        out.k.slice_mut(place).mapv_inplace(|k| (i16::from(k) + step) as u8);
    }
}

/// Returns the whole peaks that bring most parts of an image from its `means` to those of the `last` one, if they do.
fn step(means: &Means, last: &Means, range: Range) -> Option<i16> {
    let sorted = |mut means: Means| {
        means.sort_by(f32::total_cmp);
        means
    };
    let changes: Means = std::array::from_fn(|part| (last[part] - means[part]) / range.peak());
    let ordered = sorted(*last);
    let contrast = (ordered[ordered.len() * 3 / 4] - ordered[ordered.len() / 4]) / range.peak();
    let step = sorted(changes)[changes.len() / 2].round();
    let most = CHANGE.min(CHANGE_OF_CONTRAST * contrast);
    let unchanged = changes.iter().filter(|&change| (change - step).abs() < most).count();
    (unchanged >= UNCHANGED).then_some(step as i16)
}

/// Returns whether the shaded columns are black in each group.
fn is_black(y: &Frame, out: &Recovered, mut groups: impl Iterator<Item = Group>, range: Range) -> bool {
    groups.all(|group| {
        let x = group.radiance(y, out, range, group.columns(range.black().min(y.width())), 1);
        let black = x.iter().filter(|&&x| x < BLACKEST * range.peak()).count();
        black as f64 >= BLACK * x.len() as f64 && !x.is_empty()
    })
}

/// Returns whether the darkest pixels of each group have the black level that is promised.
fn is_at_black_level(
    y: &Frame,
    out: &Recovered,
    mut groups: impl Iterator<Item = Group>,
    range: Range,
) -> bool {
    let Some(level) = range.black_level() else { return false };
    let near = NEAR_BLACK_LEVEL * range.peak();
    groups.all(|group| {
        let x = group.radiance(y, out, range, group.columns(y.width()), 1);
        let below = |limit: f32| x.iter().filter(|&&x| x < limit).count() as f64;
        let few = DARKEST * x.len() as f64;
        below(level - near) <= few && below(level + near) > few
    })
}

/// Samples in a block, which holds whole pixels of one and of three channels, so that a lane belongs to one channel.
/// It is longer than the widest vector.
const BLOCK: usize = 768;

/// The number of samples that are counted together.
const PART: usize = 64 * BLOCK;

/// Returns whether in each channel more than [`BRIGHT`] of the interleaved samples have a radiance of at least `limit`.
fn is_reached(y: &Frame, out: &Recovered, channels: usize, limit: f32, range: Range) -> bool {
    let y = Integers::of(y, range).expect("the image was unwrapped");
    let k = out.k.as_slice().expect("prepare has made the layout standard");
    let limit = limit.ceil() as u32;
    // No sample is beyond the greatest count.
    let Ok(count) = u8::try_from(limit >> range.bits()) else { return false };
    let code = (limit & ((1 << range.bits()) - 1)) as u16;
    let (enough, mut bright) = (BRIGHT * (k.len() / channels) as f64, [0; 3]);
    // Most images show it in their first rows.
    k.chunks(PART).enumerate().any(|(part, k)| {
        let from = part * PART;
        let counts = match y {
            // A code of 8 bits is at most 255.
            Integers::U8(y) => widest!(count_from(&y[from..], k, channels, (count, code as u8))),
            Integers::U16(y) => widest!(count_from(&y[from..], k, channels, (count, code))),
        };
        bright.iter_mut().zip(counts).for_each(|(bright, count)| *bright += count);
        bright[..channels].iter().all(|&count| f64::from(count) > enough)
    })
}

/// Returns the number of the interleaved samples of each channel with at least this count and this code.
#[inline(always)]
fn count_from<T: Copy + Ord>(y: &[T], k: &[u8], channels: usize, (count, code): (u8, T)) -> [u32; 3] {
    // A part has 64 blocks, which words of 8 bits can count.
    let mut lanes = [0u8; BLOCK];
    for (y, k) in y.chunks(BLOCK).zip(k.chunks(BLOCK)) {
        for (lane, (&y, &k)) in lanes.iter_mut().zip(y.iter().zip(k)) {
            *lane += u8::from((k > count) | ((k == count) & (y >= code)));
        }
    }
    std::array::from_fn(|channel| {
        lanes.iter().skip(channel).step_by(channels).map(|&lane| u32::from(lane)).sum()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the modulo image of `x`, and a result with its counts.
    fn unwrapped(x: Array3<f32>, range: Range) -> (Frame, Recovered) {
        let y = x.mapv(|x| x as u16 % (1 << range.bits()));
        let k = x.mapv(|x| (x / range.peak()) as u8);
        (Frame::from_u16(y).unwrap(), Recovered { k, ..Recovered::default() })
    }

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
            let (y, out) = unwrapped(x, range);
            assert_eq!(trust(&y, &out, range) == Trust::Trusted, evident, "{brightest} and {other}");
        }
    }

    #[test]
    fn black_columns_have_to_be_black_in_each_group() {
        let range = Range::new(8, 4.0).unwrap().with_optical_black(32);
        for (level, column, is_mosaic, expected) in
            [(63.0, 0, false, true), (65.0, 0, false, false), (65.0, 8, false, true), (65.0, 7, true, false)]
        {
            let of_channel = |c| level * f32::from(u8::from(c == 2 || is_mosaic));
            let x = Array3::from_shape_fn((12, 40, if is_mosaic { 1 } else { 3 }), |(_, j, c)| {
                if j >= column { of_channel(c) } else { 0.0 }
            });
            let (y, out) = unwrapped(x, range);
            let groups = groups(y.channels(), is_mosaic);
            assert_eq!(
                is_black(&y, &out, groups.clone(), range),
                expected,
                "{level} from column {column} on"
            );
            assert!(
                !is_black(&y, &out, groups, Range::new(8, 4.0).unwrap()),
                "no column is said to be black"
            );
        }
    }

    #[test]
    fn the_darkest_pixels_of_each_group_have_to_be_at_the_black_level() {
        let range = Range::new(10, 4.0).unwrap();
        let dark = |level: f32, share: usize| {
            Array3::from_shape_fn((100, 100, 3), |(i, j, _)| if 100 * i + j < share { level } else { 2000.0 })
        };
        for (level, share, promised, expected) in [
            (64.0, 8, Some(64.0), true),
            (64.0, 8, Some(94.0), true),
            (64.0, 8, Some(97.0), false),
            (94.0, 8, Some(64.0), true),
            (97.0, 8, Some(64.0), false),
            // One peak too high, and a defect.
            (1088.0, 8, Some(64.0), false),
            (64.0, 4, Some(64.0), false),
            (64.0, 8, None, false),
        ] {
            let range = range.with_black_level(promised);
            let (y, out) = unwrapped(dark(level, share), range);
            let found = is_at_black_level(&y, &out, groups(3, false), range);
            assert_eq!(found, expected, "{share} pixels of {level} for {promised:?}");
        }
        let mut one = dark(64.0, 8);
        one.slice_mut(s![.., .., 1]).fill(2000.0);
        let (y, out) = unwrapped(one, range);
        assert!(
            !is_at_black_level(&y, &out, groups(3, false), range.with_black_level(Some(64.0))),
            "green is brighter"
        );
    }

    #[test]
    fn a_few_bright_samples_are_no_evidence() {
        let range = Range::new(8, 4.0).unwrap();
        for (bright, evident) in [(20, false), (30, true)] {
            let x = Array3::from_shape_fn(
                (500, 500, 1),
                |(i, j, _)| if i == 9 && j < bright { 1000.0 } else { 0.0 },
            );
            let (y, out) = unwrapped(x, range);
            assert_eq!(trust(&y, &out, range) == Trust::Trusted, evident, "{bright} of 250,000 pixels");
        }
    }
}
