//! Turns an estimate into integers: wrap counts that agree with y, at the absolute offset that gradients do not
//! contain.
//!
//! [`write_channel`] takes integers. For a real estimate phi, the wrap counts nearest to it are found without storing
//! it: residuals `(phi - y) / 2^b` are counted in steps of 1/[`STEPS_PER_PERIOD`] of a peak, and one [`Histogram`] then
//! gives the fractional offset and the number of pixels of each wrap count. Sums of integers do not depend on their
//! order.

use std::f64::consts::TAU;

use super::{Range, Recovered};
use crate::dct::LANES;
use crate::simd::widest;

/// The share of the pixels of an image that may be below the least count at a greater base level: hot pixels and small wrong regions
/// must not raise the whole image.
pub(super) const OUTLIERS: f64 = 0.02;

/// The same for a result without contradictions, in which hardly a sample can be wrong.
pub(super) const FEW_OUTLIERS: f64 = 0.002;

/// Finds the absolute offset of `k`, clamps to the range, and writes one channel of `out`, which must be
/// prepared. `levels` is a buffer.
pub(super) fn write_channel(
    k: &[i32],
    y: &[f32],
    range: Range,
    channel: usize,
    levels: &mut Vec<usize>,
    out: &mut Recovered,
) {
    let most = i32::from(range.max_wraps());
    let zero = base_level(k, range, OUTLIERS, levels);
    let k = k.iter().map(|k| (k.saturating_sub(zero)).clamp(0, most) as u8);
    let peak = range.peak();
    let channels = out.x.dim().2;
    let (x, counts) = out.buffers();
    // x is made from y and the clamped k, so that it stays congruent even where the range cuts k off.
    let pixels = x.chunks_exact_mut(channels).zip(counts.chunks_exact_mut(channels));
    for (((x, count), k), y) in pixels.zip(k).zip(y) {
        x[channel] = y + f32::from(k) * peak;
        count[channel] = k;
    }
}

/// Up to so many levels, vectors count each by itself faster than a histogram does, in so many pixels at once.
const FEW_LEVELS: usize = 8;
const PART: usize = 1 << 12;

/// Returns the count that stands for k = 0. Of all levels that leave nearly as many pixels in `0..=most` as the
/// best one does, it is the highest, which makes the image darkest.
pub(super) fn base_level(k: &[i32], range: Range, outliers: f64, levels: &mut Vec<usize>) -> i32 {
    let ends = |(low, high): (i32, i32), &k: &i32| (low.min(k), high.max(k));
    let &first = k.first().expect("an image has pixels");
    let (low, high) = widest!(k.iter().fold((first, first), ends));
    let count = high.abs_diff(low) as usize + 1;
    // Steps of at most one from pixel to pixel: no image of this size needs more, so that none is made twice.
    levels.clear();
    levels.reserve(k.len());
    if count <= FEW_LEVELS {
        levels.resize(count, 0);
        for k in k.chunks(PART) {
            for (level, sum) in (low..=high).zip(&mut *levels) {
                *sum += widest!(k.iter().fold(0u32, |sum, &k| sum + u32::from(k == level))) as usize;
            }
        }
    } else {
        histogram(k.iter().map(|k| k.abs_diff(low) as usize), count, levels);
    }
    // An estimate may contain any integers, so no sum may overflow.
    low.saturating_add(base_level_index(levels, range, outliers) as i32)
}

/// A histogram has so many counters for each level, which take turns: neighbours are mostly at one level, and a counter waits for its last sum.
pub(super) const TURNS: usize = 4;

/// Writes to `counts` how many of `items` are at each of the levels from 0 on.
#[inline]
pub(super) fn histogram(items: impl Iterator<Item = usize>, levels: usize, counts: &mut Vec<usize>) {
    counts.clear();
    counts.resize(TURNS * levels, 0);
    items.enumerate().for_each(|(at, level)| counts[TURNS * level + at % TURNS] += 1);
    (0..levels).for_each(|level| counts[level] = counts[TURNS * level..][..TURNS].iter().sum());
    counts.truncate(levels);
}

/// Returns the index of the [`base_level`] for `counts` pixels at each level. A level below the first holds no
/// more pixels than the first itself.
pub(super) fn base_level_index(counts: &[usize], range: Range, outliers: f64) -> usize {
    let pixels = counts.iter().sum();
    let in_range =
        |zero: usize| counts[zero..].iter().take(usize::from(range.max_wraps()) + 1).sum::<usize>();
    let best = (0..counts.len()).map(in_range).max().expect("an image has at least one level");
    let enough = (0..counts.len()).rfind(|&zero| is_enough(in_range(zero), best, pixels, outliers));
    enough.expect("the best level is enough")
}

/// Returns whether `share` is nearly `best`, within the share of outliers among so many `pixels`.
pub(super) fn is_enough(share: usize, best: usize, pixels: usize, outliers: f64) -> bool {
    share as f64 >= best as f64 - outliers * pixels as f64
}

/// The number of steps of one peak; 16 bits hold residuals of up to 256 peaks.
const STEPS_PER_PERIOD: i32 = 128;

/// One step in codes whose peak is 2^16.
const CODES_PER_STEP: f32 = 65536.0 / STEPS_PER_PERIOD as f32;

/// The greatest magnitude of a residual in steps; others are clamped to it.
const LIMIT: f32 = 32767.0;

/// Adding 2^23 to a number in [0, 2^23] rounds off its fraction and leaves its integer in the lowest bits.
const ROUNDING: f32 = 8_388_608.0;

/// Returns `(phi - code)` in steps, rounded down (within 1/256 of a step); both are in units whose peak is 2^16.
#[inline(always)]
pub(super) fn residuals(phi: [f32; LANES], codes: [u16; LANES]) -> [i16; LANES] {
    let mut steps = [0; LANES];
    for ((step, phi), code) in steps.iter_mut().zip(phi).zip(codes) {
        // The clamp keeps residuals in 16 bits; an estimate that is out by more is wrong anyway.
        let value = ((phi - f32::from(code)) * (1.0 / CODES_PER_STEP)).clamp(-LIMIT, LIMIT) + (LIMIT + 1.0);
        // `floor` would be a call into the maths library on plain x86-64, and `as` one number at a time.
        let nearest = (value + ROUNDING) - ROUNDING;
        let whole = if nearest > value { nearest - 1.0 } else { nearest };
        *step = ((whole + ROUNDING).to_bits() as u16 ^ (1 << 15)).cast_signed();
    }
    steps
}

/// The number of residuals of one channel at each step.
#[derive(Clone)]
pub(super) struct Histogram {
    counts: Vec<u32>,
}

/// The rule that turns a residual into a wrap count.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct CountRule {
    offset: i32,
    zero: i32,
    most: i32,
}

/// The [`CountRule`] of each lane.
#[derive(Clone, Copy)]
pub(super) struct LaneCountRules {
    offset: [i32; LANES],
    zero: [i32; LANES],
    most: [i32; LANES],
}

impl Histogram {
    pub fn new() -> Self {
        Self { counts: vec![0; 1 << 16] }
    }

    pub fn clear(&mut self) {
        self.counts.fill(0);
    }

    #[inline(always)]
    pub fn count(&mut self, residual: i16) {
        // The index always fits; the mask says so.
        self.counts[usize::from(residual.cast_unsigned() ^ (1 << 15))] += 1;
    }

    pub fn add(&mut self, other: &Self) {
        self.counts.iter_mut().zip(&other.counts).for_each(|(count, other)| *count += other);
    }

    /// Returns the rule `k = round((phi + s - y) / 2^b) - zero` in `0..=most`: s is the circular mean of the
    /// residuals, zero the level that [`base_level_index`] finds.
    pub fn count_rule(&self, range: Range) -> CountRule {
        let shift = self.mean_phase();
        // Half a period more makes the shift to the right round to the nearest count.
        let offset = ((0.5 + shift) * f64::from(STEPS_PER_PERIOD) + 0.5).floor() as i32;
        // The offset moves the borders of the levels, so there may be one more of them than residuals have periods.
        let mut levels = [0; (1 << 16) / STEPS_PER_PERIOD as usize + 2];
        // The histogram of residuals is also that of the wrap counts, for any offset.
        let low = wraps(i32::from(i16::MIN), offset);
        let counted = (i32::from(i16::MIN)..).zip(&self.counts).filter(|(_, count)| **count > 0);
        for (residual, &count) in counted {
            levels[(wraps(residual, offset) - low) as usize] += count as usize;
        }
        let zero = low + base_level_index(&levels, range, OUTLIERS) as i32;
        CountRule { offset, zero, most: range.max_wraps().into() }
    }

    /// Returns the circular mean of `(y - phi) / 2^b` in peaks, -0.5 to 0.5.
    fn mean_phase(&self) -> f64 {
        let mut by_phase = [0u64; STEPS_PER_PERIOD as usize];
        for period in self.counts.as_chunks().0 as &[[u32; STEPS_PER_PERIOD as usize]] {
            by_phase.iter_mut().zip(period).for_each(|(sum, &count)| *sum += u64::from(count));
        }
        let (mut sine, mut cosine) = (0.0, 0.0);
        for (step, count) in by_phase.into_iter().enumerate() {
            // A residual was rounded down, so on average it is half a step higher.
            let angle = TAU * (step as f64 + 0.5) / f64::from(STEPS_PER_PERIOD);
            // Residuals are phases: only their mean on the circle does not depend on where a period starts.
            sine -= count as f64 * angle.sin();
            cosine += count as f64 * angle.cos();
        }
        sine.atan2(cosine) / TAU
    }
}

impl LaneCountRules {
    /// Makes the rules from the rule `of` each lane.
    pub fn new(of: impl Fn(usize) -> CountRule) -> Self {
        let each = |part: fn(CountRule) -> i32| std::array::from_fn(|lane| part(of(lane)));
        Self { offset: each(|of| of.offset), zero: each(|of| of.zero), most: each(|of| of.most) }
    }

    /// Returns the wrap counts of residuals.
    #[inline(always)]
    pub fn wraps(&self, residuals: &[i16; LANES]) -> [u8; LANES] {
        let mut counts = [0; LANES];
        for lane in 0..LANES {
            let count = wraps(i32::from(residuals[lane]), self.offset[lane]) - self.zero[lane];
            // `clamp` would check in each lane that its bounds are in order.
            counts[lane] = count.max(0).min(self.most[lane]) as u8;
        }
        counts
    }
}

#[inline(always)]
fn wraps(residual: i32, offset: i32) -> i32 {
    (residual + offset) >> STEPS_PER_PERIOD.ilog2()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with_counts_to(most: u8) -> Range {
        Range::new(8, f64::from(most) + 1.0).unwrap()
    }

    #[test]
    fn a_difference_has_no_outliers() {
        let mut k = vec![3; 1000];
        k[0] = 2;
        let range = with_counts_to(1);
        assert_eq!(base_level(&k, range, OUTLIERS, &mut Vec::new()), 3);
        assert_eq!(base_level(&k, range.of_differences(), 0.0, &mut Vec::new()), 2);
    }

    #[test]
    fn darkest_offset_that_keeps_the_image_in_range() {
        assert_eq!(base_level(&[5, 5, 6, 7], with_counts_to(3), OUTLIERS, &mut Vec::new()), 5);
        assert_eq!(base_level(&[-1, -1, 0, 0], with_counts_to(1), OUTLIERS, &mut Vec::new()), -1);
    }

    #[test]
    fn hot_pixels_do_not_lift_the_image() {
        let mut k = vec![3; 1000];
        k[500..].fill(4);
        k[..19].fill(-7);
        assert_eq!(base_level(&k, with_counts_to(1), OUTLIERS, &mut Vec::new()), 3);
        k[..30].fill(2);
        assert_eq!(
            base_level(&k, with_counts_to(2), OUTLIERS, &mut Vec::new()),
            2,
            "more than 2 % are no outliers"
        );
    }

    #[test]
    fn finds_the_shift_between_estimate_and_image() {
        let x: Vec<f32> = (0..400).map(|i| (i * 5 / 2) as f32 * 256.0).collect();
        for shift in [0.0, 9472.0, -32768.0, -127_872.0] {
            let mut histogram = Histogram::new();
            let residuals: Vec<i16> =
                x.iter().map(|&x| residuals([x + shift; LANES], [(x % 65536.0) as u16; LANES])[0]).collect();
            residuals.iter().for_each(|&residual| histogram.count(residual));
            let rule = histogram.count_rule(with_counts_to(3));
            let rule = LaneCountRules::new(|_| rule);
            for (x, residual) in x.iter().zip(residuals) {
                let want = [(x / 65536.0) as u8; LANES];
                assert_eq!(rule.wraps(&[residual; LANES]), want, "shift {shift}, x {x}");
            }
        }
    }

    #[test]
    fn residuals_round_down_and_stay_in_range() {
        let of = |phi| residuals([phi; LANES], [0; LANES])[0];
        assert_eq!([of(0.0), of(510.0), of(512.0), of(-1.0), of(-512.0), of(-513.0)], [0, 0, 1, -1, -1, -2]);
        assert_eq!([of(1e9), of(-1e9), of(f32::MAX)], [32767, -32767, 32767]);
    }
}
