//! Smooths a modulo image in which noise is so strong that it makes differences of neighbours wrap.
//!
//! Codes are averaged on the circle of one peak. At pixel p, with `d_q = M_b(y_q - y_p)` for its eight neighbours q, the result is
//! ```text
//!     y_p + sum_q w_q d_q / (1 + sum_q w_q),   w_q = max(0, 1 - |d_q|^2 / (C T^2))^2
//! ```
//! where `|d_q|^2` is the sum over the C channels: a neighbour across an edge counts for none of them. T follows the noise, which is
//! estimated from the image itself.

use crate::simd::widest;

/// T over the standard deviation of the noise, where T is small: neighbours of equal radiance differ by sqrt(2) of it in each channel.
const REACH: f32 = 3.0;

/// The greatest T, in peaks. A greater one also joins what an edge separates that nearly wraps to 0.
const LIMIT: f32 = 0.15;

/// The least T over the standard deviation of the noise, with which nearly half of the neighbours of equal radiance count.
const LEAST_REACH: f32 = 1.4;

/// The standard deviation of a normal variate over the median of its magnitude.
const OF_MEDIAN: f32 = 1.4826;

/// One of this number of rows is read to find the noise.
const ROWS_PER_SAMPLE: usize = 4;

/// The peak of the codes.
const PEAK: f32 = 65536.0;

/// The number of steps of half a peak in which the noise is found.
const STEPS: usize = 256;

/// The smoothing with its buffers. Codes have a peak of 2^16; those of a row stand channel after channel.
#[derive(Default)]
pub(super) struct Smoothing {
    /// The row above, the row itself and the one below, each line with one more code at both ends.
    rows: [Vec<u16>; 3],
    smoothed: Vec<u16>,
    /// The sums of the weighted differences by channel, and of the weights.
    sums: Vec<f32>,
}

impl Smoothing {
    /// Writes `codes` (H x W x C, interleaved) without most of their noise, whose standard deviation is `noise`, to `out`.
    pub fn apply(
        &mut self,
        codes: &[u16],
        (height, width, channels): (usize, usize, usize),
        noise: f32,
        out: &mut Vec<u16>,
    ) {
        let reach = (REACH * noise).min(LIMIT * PEAK).max(LEAST_REACH * noise);
        out.resize(codes.len(), 0);
        let stride = width * channels;
        // The border is continued by its own pixels.
        let row = |row: usize| &codes[row.min(height - 1) * stride..][..stride];
        for (lines, from) in self.rows.iter_mut().zip([0, 0, 1]) {
            split(row(from), channels, lines);
        }
        for (index, out) in out.chunks_exact_mut(stride).enumerate() {
            match channels {
                3 => widest!(self.smooth_row::<3>(width, reach)),
                _ => widest!(self.smooth_row::<1>(width, reach)),
            }
            for (column, pixel) in out.chunks_exact_mut(channels).enumerate() {
                for (channel, code) in pixel.iter_mut().enumerate() {
                    *code = self.smoothed[channel * width + column];
                }
            }
            self.rows.rotate_left(1);
            split(row(index + 2), channels, &mut self.rows[2]);
        }
    }

    /// Smooths the middle one of the rows.
    #[inline(always)]
    fn smooth_row<const C: usize>(&mut self, width: usize, reach: f32) {
        let Self { rows, smoothed, sums } = self;
        sums.clear();
        sums.resize((C + 1) * width, 0.0);
        smoothed.resize(C * width, 0);
        let lines = |row: usize, from: usize| -> [&[u16]; C] {
            std::array::from_fn(|channel| &rows[row][channel * (width + 2) + from..][..width])
        };
        let here = lines(1, 1);
        // In the square of codes, as the differences are.
        let scale = 1.0 / (C as f32 * reach * reach);
        let (sums, total) = sums.split_at_mut(C * width);
        let total = &mut total[..width];
        for (row, from) in [(0, 0), (0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1), (2, 2)] {
            let there = lines(row, from);
            let mut lanes = sums.chunks_exact_mut(width);
            let sums: [&mut [f32]; C] = std::array::from_fn(|_| lanes.next().expect("one line a channel"));
            for j in 0..width {
                let d: [f32; C] =
                    std::array::from_fn(|c| f32::from(there[c][j].wrapping_sub(here[c][j]).cast_signed()));
                let square: f32 = d.iter().map(|d| d * d).sum();
                let near = (1.0 - square * scale).max(0.0);
                let weight = near * near;
                total[j] += weight;
                for c in 0..C {
                    sums[c][j] += weight * d[c];
                }
            }
        }
        for c in 0..C {
            let (sums, smoothed) = (&sums[c * width..][..width], &mut smoothed[c * width..][..width]);
            for j in 0..width {
                // The mean is less than half a peak; it is rounded to nearest by the addition of half a code.
                let step = (sums[j] / (1.0 + total[j]) + 32768.5) as i32 - 32768;
                smoothed[j] = here[c][j].wrapping_add(step as u16);
            }
        }
    }
}

/// Writes a row (W x C, interleaved) as lines of one channel each, with the border pixel once more at both ends.
fn split(row: &[u16], channels: usize, lines: &mut Vec<u16>) {
    lines.clear();
    let last = row.len() - channels;
    for channel in 0..channels {
        lines.push(row[channel]);
        lines.extend(row[channel..].iter().step_by(channels));
        lines.push(row[last + channel]);
    }
}

/// Returns the standard deviation of the noise, for codes whose peak is 2^16, from the median of the wrapped mixed differences: most of
/// a scene is flat, and noise makes them twice as large as it is itself. It is more than 0, and at most 0.19 of the peak: codes of pure
/// chance look like that.
pub(super) fn noise(codes: &[u16], (height, width, channels): (usize, usize, usize)) -> f32 {
    let stride = width * channels;
    let mut counts = [0u32; STEPS];
    for row in (1..height).step_by(ROWS_PER_SAMPLE) {
        let [above, here] = [row - 1, row].map(|row| &codes[row * stride..][..stride]);
        let ends = above.iter().zip(&above[channels..]).zip(here.iter().zip(&here[channels..]));
        for ((a, b), (c, d)) in ends {
            let mixed = d.wrapping_sub(*c).wrapping_sub(b.wrapping_sub(*a)).cast_signed();
            // Half a peak belongs to the last step.
            counts[((usize::from(mixed.unsigned_abs()) * STEPS) >> 15).min(STEPS - 1)] += 1;
        }
    }
    let (half, mut below) = (counts.iter().sum::<u32>() / 2, 0);
    let median = counts.iter().position(|&count| {
        below += count;
        below > half
    });
    let step = (1 << 15) as f32 / STEPS as f32;
    (median.unwrap_or(0) as f32 + 0.5) * step * OF_MEDIAN / 2.0
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64Mcg;

    use super::*;

    /// Codes of `level` with noise of `sigma`, in codes of a peak of 2^16.
    fn noisy(dim: (usize, usize, usize), sigma: f64, level: impl Fn(usize) -> u16) -> Vec<u16> {
        let mut random = Pcg64Mcg::seed_from_u64(1);
        let mut sample = |index: usize| {
            let deviate: f64 = StandardNormal.sample(&mut random);
            level(index / dim.2 % dim.1).wrapping_add((sigma * deviate) as i32 as u16)
        };
        (0..dim.0 * dim.1 * dim.2).map(&mut sample).collect()
    }

    /// The root mean square of the wrapped differences from `level`.
    fn deviation(codes: &[u16], dim: (usize, usize, usize), level: impl Fn(usize) -> u16) -> f64 {
        let square = |(index, code): (usize, &u16)| {
            f64::from(code.wrapping_sub(level(index / dim.2 % dim.1)).cast_signed()).powi(2)
        };
        (codes.iter().enumerate().map(square).sum::<f64>() / codes.len() as f64).sqrt()
    }

    #[test]
    fn measures_the_noise() {
        for sigma in [500.0, 2000.0, 7680.0] {
            for dim in [(60, 80, 3), (90, 120, 1)] {
                let found = noise(&noisy(dim, sigma, |column| 400 * column as u16), dim);
                assert!((f64::from(found) / sigma - 1.0).abs() < 0.1, "{found} for {sigma}");
            }
        }
        assert!(noise(&[7], (1, 1, 1)) > 0.0, "an image without a loop has no noise that could be seen");
    }

    #[test]
    fn removes_noise_at_the_wrap_and_keeps_edges() {
        // The left half lies on both sides of the wrap, and the right half is three eighths of a peak away.
        let level = |column: usize| if column < 40 { 100 } else { 24_576 };
        // Of the strongest noise, half of the neighbours of a pixel count.
        for (dim, sigma, left) in
            [((60, 80, 3), 2500.0, 0.65), ((60, 80, 1), 2500.0, 0.65), ((60, 80, 3), 7000.0, 0.9)]
        {
            let codes = noisy(dim, sigma, level);
            let (mut smoothing, mut out) = (Smoothing::default(), Vec::new());
            smoothing.apply(&codes, dim, sigma as f32, &mut out);
            let [before, after] = [&codes, &out].map(|codes| deviation(codes, dim, level));
            assert!(after < left * before, "{dim:?}, {sigma}: {before} to {after}");
        }
    }

    #[test]
    fn an_image_of_any_size_is_smoothed() {
        for dim in [(1, 1, 1), (1, 7, 3), (5, 1, 3), (2, 2, 1)] {
            let codes = vec![65_535; dim.0 * dim.1 * dim.2];
            let mut out = vec![3; 2];
            Smoothing::default().apply(&codes, dim, 1000.0, &mut out);
            assert_eq!(out, codes, "{dim:?}");
        }
    }
}
