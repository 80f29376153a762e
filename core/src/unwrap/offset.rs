//! The absolute offset of a result, which differences do not determine: `x` and `x + 2^b` have the same y.
//!
//! Every method takes the darkest offset that leaves the result in range, up to a share of outliers. This is the true one if some part
//! of the scene is below the peak. Only the range can say whether that is so: where the brightest samples come so near to its end
//! that one more peak would leave it, no other offset is possible.

use super::{Range, Recovered, congruence};
use crate::simd::widest;

/// The shortest side, in pixels, of an image whose lines can contradict each other.
const SHORTEST_SIDE: usize = 3;

/// The share of the pixels that have to be near the end of the range: a few samples may be wrong.
const BRIGHT: f64 = 1e-4;

/// The least alpha that may be given, over the true one, with which no result at a wrong offset is trusted.
const LEAST_ALPHA: f64 = 0.9;

/// Returns whether the range leaves no other offset for `out`, in no channel.
///
/// In each channel more than [`BRIGHT`] of the pixels have to be at `alpha * 2^b / LEAST_ALPHA - 2^b` or above. An image with fewer
/// than [`SHORTEST_SIDE`] rows or columns shows nothing at all, since no majority of lines can be wrong.
pub(super) fn is_evident(out: &Recovered, range: Range) -> bool {
    let (height, width, channels) = out.x.dim();
    // Where nothing can wrap, every count is 0.
    if range.max_wraps() == 0 || height.min(width) < SHORTEST_SIDE {
        return range.max_wraps() == 0;
    }
    let x = out.x.as_slice().expect("prepare has made the layout standard");
    let limit = (range.limit() / LEAST_ALPHA) as f32 - range.peak();
    let mut bright = [0; 3];
    // Most images show it in their first rows.
    x.chunks(PART).any(|part| {
        let counts = widest!(count_from(part, channels, limit));
        bright.iter_mut().zip(counts).for_each(|(bright, count)| *bright += count);
        bright[..channels].iter().all(|&count| f64::from(count) > BRIGHT * (height * width) as f64)
    })
}

/// Makes each channel of `out` as dark as the outliers of `range` allow. `levels` is a buffer.
pub(super) fn darken(out: &mut Recovered, range: Range, levels: &mut Vec<usize>) {
    let (channels, peak) = (out.x.dim().2, range.peak());
    let (x, k) = out.buffers();
    for channel in 0..channels {
        levels.clear();
        levels.resize(usize::from(range.max_wraps()) + 1, 0);
        k.iter().skip(channel).step_by(channels).for_each(|&k| levels[usize::from(k)] += 1);
        let zero = congruence::base_level_index(levels, range) as u8;
        if zero == 0 {
            continue;
        }
        let samples = x.iter_mut().zip(k.iter_mut()).skip(channel).step_by(channels);
        for (x, k) in samples {
            let less = zero.min(*k);
            *k -= less;
            *x -= f32::from(less) * peak;
        }
    }
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
    use ndarray::Array3;

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
            assert_eq!(is_evident(&out, range), evident, "{brightest} and {other}");
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
            assert_eq!(is_evident(&out, range), evident, "{bright} of 250,000 pixels");
        }
    }

    #[test]
    fn darkens_by_whole_peaks_up_to_the_outliers() {
        let range = Range::new(8, 4.0).unwrap();
        for (dark, less) in [(1, 1), (3, 0)] {
            let k = Array3::from_shape_fn((10, 10, 1), |(i, j, _)| if i == 4 && j < dark { 0 } else { 2 });
            let x = k.mapv(|k| 7.0 + 256.0 * f32::from(k));
            let mut out = Recovered { x, k, ..Recovered::default() };
            darken(&mut out, range, &mut Vec::new());
            assert_eq!((out.k[(0, 0, 0)], out.k[(4, 0, 0)]), (2 - 2 * less, 0), "{dark} % are dark");
            assert!(out.x.iter().zip(&out.k).all(|(x, k)| *x == 7.0 + 256.0 * f32::from(*k)));
        }
    }
}
