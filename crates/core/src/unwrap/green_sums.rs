//! Green sums: unwraps the green pixels of a mosaic by [`gradient_sums`](super::gradient_sums).

use super::congruence::{FEW_OUTLIERS, OUTLIERS};
use super::gradient_sums::{GradientSums, GreenCodes};
use super::margin_tree::MarginTree;
use super::mosaic_image::MosaicImage;
use super::smoothing::noise;
use super::{Range, Recovered, UnwrapError, congruence};

/// The largest share of contradictions of a result in which hardly a count can be wrong.
pub(super) const FEW_CONTRADICTIONS: f64 = 7e-4;

/// The method with its buffers.
pub(super) struct GreenSums {
    codes: GreenCodes,
    sums: GradientSums,
    tree: MarginTree,
    levels: Vec<usize>,
    /// The codes with a peak of 2^16, of which the noise is found.
    words: Vec<u16>,
}

/// The measures that speak against a result.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Doubts {
    /// The share of the differences between neighbours that contradict the counts.
    pub contradictions: f64,
    /// The share of the pixels whose counts were out of range.
    pub outside: f64,
}

impl GreenSums {
    /// Makes the method for `threads` threads.
    ///
    /// # Errors
    /// [`UnwrapError::Workers`] when the threads are not available.
    pub fn new(threads: usize) -> Result<Self, UnwrapError> {
        let (codes, tree) = (GreenCodes::default(), MarginTree::default());
        Ok(Self { codes, sums: GradientSums::new(threads)?, tree, levels: Vec::new(), words: Vec::new() })
    }

    /// Reads an image, and returns the standard deviation of its noise in peaks, at most 0.19.
    pub fn read(&mut self, image: &MosaicImage, range: Range) -> f32 {
        self.codes.read(image, range.bits());
        let (codes, dim) = self.codes.padded();
        self.words.clear();
        self.words.extend(codes.iter().map(|&code| u16::from(code) << 8));
        noise(&self.words, dim) / (u32::from(u16::MAX) + 1) as f32
    }

    /// Writes green of the image that was read to `out`, which must be prepared.
    pub fn unwrap(&mut self, image: &MosaicImage, range: Range, out: &mut Recovered) -> Doubts {
        let Self { codes, sums, tree, levels, .. } = self;
        sums.find(codes);
        tree.grow(codes, sums, range.max_wraps());
        let contradictions = tree.contradictions(codes, sums);
        // Wrong regions must not raise the whole image.
        let outliers = if contradictions <= FEW_CONTRADICTIONS { FEW_OUTLIERS } else { OUTLIERS };
        let zero = congruence::base_level(&tree.counts, range, outliers, levels);
        let mut outside = 0;
        for (row, counts) in tree.counts.chunks_exact(codes.width).enumerate() {
            let counts = counts.iter().map(|count| count.saturating_sub(zero));
            outside += image.write_row((row, codes.shift(row)), counts, range, out);
        }
        Doubts { contradictions, outside: outside as f64 / tree.counts.len() as f64 }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;
    use proptest::prelude::*;

    use super::*;
    use crate::Mosaic;

    proptest! {
        /// Where second differences of green are below half a peak, all steps between neighbours agree.
        #[test]
        fn a_steep_smooth_scene_is_exact_without_contradictions(
            (height, width) in (6usize..60, 6usize..60), bits in 4u8..=12, period in 18f32..40.0, which in 1usize..5, threads in 1usize..3,
        ) {
            let range = Range::new(bits, 4.0).unwrap();
            let light = |row: usize, column: usize| {
                let wave = (row as f32 / period * 3.0).sin() * (column as f32 / period * 2.0).cos();
                ((0.5 + 0.49 * wave) * range.limit() as f32).floor()
            };
            let mosaic = Mosaic::WORDS[which].1.unwrap();
            let codes = (0..height * width).map(|at| (light(at / width, at % width) % range.peak()) as u16).collect();
            let image = MosaicImage { codes, height, width, mosaic };
            let mut out = Recovered::default();
            out.prepare((height, width, 1), "");
            let mut sums = GreenSums::new(threads).unwrap();
            sums.read(&image, range);
            let doubts = sums.unwrap(&image, range, &mut out);
            prop_assert_eq!(doubts.contradictions, 0.0);
            let truth = Array3::from_shape_fn((height, width, 1), |(row, column, _)| {
                (light(row, column) / range.peak()) as u8
            });
            // A small image may have hardly a dark part, and is then one peak too dark everywhere; what would be below 0 is clamped.
            let green = |(row, column): (usize, usize)| mosaic.channel(row, column) == 1;
            let counts = truth.indexed_iter().filter(|((i, j, _), _)| green((*i, *j))).map(|(at, k)| (*k, out.k[at]));
            let counts: Vec<(u8, u8)> = counts.collect();
            let offset = counts.iter().map(|(truth, k)| truth - k).max().unwrap();
            prop_assert!(counts.iter().all(|(truth, k)| *k == truth.saturating_sub(offset)), "{}: {:?}", offset, counts);
            let clamped = counts.iter().filter(|(truth, _)| *truth < offset).count();
            prop_assert!(clamped * 50 <= counts.len(), "{} of {} are clamped", clamped, counts.len());
        }
    }
}
