//! Green sums: unwraps the green pixels of a mosaic by [`gradient_sums`](super::gradient_sums).
//!
//! An edge of whole peaks leaves no trace in green, so that a wrong step there looks sure, and a region behind it comes loose. Hardly an edge is
//! one of whole peaks in all three colours. So where the counts contradict each other, `tree` unwraps the blocks of 2 x 2 pixels in three
//! colours. Steps that differ from its own lose half of their margin, and the result with fewer contradictions stays.
//!
//! The largest region without a contradiction gives the absolute offset. What came loose must not raise the rest.

use ndarray::Array3;

use super::budget::{self, Budget};
use super::congruence::{FEW_OUTLIERS, OUTLIERS, base_level};
use super::gradient_sums::{GradientSums, GreenCodes};
use super::jumps::Regions;
use super::margin_tree::MarginTree;
use super::mosaic_image::{MosaicImage, frame};
use super::smoothing::noise;
use super::{Range, Recovered, Tree, Unwrap, UnwrapError};

/// The largest share of contradictions of a result in which hardly a count can be wrong.
pub(super) const FEW_CONTRADICTIONS: f64 = 7e-4;

/// With at most this share of contradictions, the border of a loose region would be too short for a region that matters.
const NO_LOOSE_REGION: f64 = 1e-4;

/// The least share of the pixels of a region that gives the offset: in a more divided image, it may be a loose one.
const LEAST_REGION: f64 = 0.2;

/// The method with its buffers.
pub(super) struct GreenSums {
    codes: GreenCodes,
    sums: GradientSums,
    tree: MarginTree,
    levels: Vec<usize>,
    /// The codes with a peak of 2^16, of which the noise is found.
    words: Vec<u16>,
    /// Unwraps the blocks of 2 x 2 pixels, and its result.
    blocks: Tree,
    in_colours: Recovered,
    /// Counts as a buffer: those by three colours, those of the tree before, or those of a region.
    counts: Vec<i32>,
    /// Whether the border of a loose region may be among the contradictions of the last image.
    may_be_torn: bool,
    regions: Regions,
}

impl GreenSums {
    /// Makes the method for `threads` threads.
    ///
    /// # Errors
    /// [`UnwrapError::Workers`] when the threads are not available.
    pub fn new(threads: usize) -> Result<Self, UnwrapError> {
        Ok(Self {
            codes: GreenCodes::default(),
            sums: GradientSums::new(threads)?,
            tree: MarginTree::default(),
            levels: Vec::new(),
            words: Vec::new(),
            blocks: Tree::default(),
            in_colours: Recovered::default(),
            counts: Vec::new(),
            may_be_torn: false,
            regions: Regions::default(),
        })
    }

    /// Reads an image, and returns the standard deviation of its noise in peaks, at most 0.19.
    pub fn read(&mut self, image: &MosaicImage<'_>, range: Range) -> f32 {
        self.codes.read(image, range.bits());
        let (codes, dim) = self.codes.padded();
        self.words.clear();
        self.words.extend(codes.iter().map(|&code| u16::from(code) << 8));
        noise(&self.words, dim) / (u32::from(u16::MAX) + 1) as f32
    }

    /// Finds the counts of green of the image that was read. Returns the share of the differences between neighbours that contradict them.
    ///
    /// # Errors
    /// None: the codes are those of the range.
    pub fn find(
        &mut self,
        image: &MosaicImage<'_>,
        range: Range,
        left: &mut Budget,
    ) -> Result<f64, UnwrapError> {
        left.spend(budget::SUMS * image.codes.len() as f64);
        self.sums.find(&self.codes);
        self.tree.grow(&self.codes, &self.sums, range.max_wraps());
        let contradictions = self.tree.contradictions(&self.codes, &self.sums);
        self.may_be_torn = contradictions > NO_LOOSE_REGION;
        if self.may_be_torn && left.take(budget::SUMS_BY_COLOURS * image.codes.len() as f64) {
            return self.grow_by_colours(image, range, contradictions);
        }
        Ok(contradictions)
    }

    /// Writes the counts that were found to `out`, which must be prepared. Returns the share of the pixels whose counts were out of range.
    pub fn write(&mut self, image: &MosaicImage<'_>, range: Range, out: &mut Recovered) -> f64 {
        let zero = if self.may_be_torn {
            self.base_level_of_region(range)
        } else {
            base_level(&self.tree.counts, range, FEW_OUTLIERS, &mut self.levels)
        };
        let mut outside = 0;
        for (row, counts) in self.tree.counts.chunks_exact(self.codes.width).enumerate() {
            outside += image.write_row((row, self.codes.shift(row)), (counts, zero), range, out);
        }
        outside as f64 / self.tree.counts.len() as f64
    }

    /// Grows the tree anew, with half of the margin where three colours say another step, and keeps the result with fewer
    /// `contradictions`, whose share it returns.
    fn grow_by_colours(
        &mut self,
        image: &MosaicImage<'_>,
        range: Range,
        contradictions: f64,
    ) -> Result<f64, UnwrapError> {
        self.unwrap_blocks(image, range)?;
        self.sums.doubt(&self.codes, &self.counts);
        self.counts.clone_from(&self.tree.counts);
        self.tree.grow(&self.codes, &self.sums, range.max_wraps());
        let by_colours = self.tree.contradictions(&self.codes, &self.sums);
        if by_colours >= contradictions {
            std::mem::swap(&mut self.tree.counts, &mut self.counts);
        }
        Ok(by_colours.min(contradictions))
    }

    /// Unwraps the blocks of 2 x 2 pixels in three colours; `counts` are those of their green pixels.
    fn unwrap_blocks(&mut self, image: &MosaicImage<'_>, range: Range) -> Result<(), UnwrapError> {
        let (height, width) = (self.codes.height, self.codes.width);
        let (row, column) = image.mosaic.red();
        let places = [(row, column), (0, self.codes.shift(0)), (1 - row, 1 - column)];
        let code = |row: usize, column: usize| image.code(row.cast_signed(), column.cast_signed());
        let blocks = Array3::from_shape_fn((height.div_ceil(2), width, 3), |(i, j, channel)| {
            code(2 * i + places[channel].0, 2 * j + places[channel].1)
        });
        self.blocks.unwrap(&frame(blocks, range), &range.into(), &mut self.in_colours)?;
        self.counts.clear();
        for row in 0..height {
            // The green pixel of the other row has the count that brings it nearest to the one of the block.
            self.counts.extend((0..width).map(|at| {
                let code = f32::from(code(row, 2 * at + self.codes.shift(row)));
                ((self.in_colours.x[(row / 2, at, 1)] - code) / range.peak()).round() as i32
            }));
        }
        Ok(())
    }

    /// Returns the count that stands for k = 0 in the largest region without a contradiction.
    fn base_level_of_region(&mut self, range: Range) -> i32 {
        let Self { codes, tree, counts, regions, .. } = self;
        let (height, width) = (codes.height, codes.width);
        let pixel = |row: usize, at: usize| row.min(height - 1) * width + at;
        // The two green pixels of each block of 2 x 2 pixels.
        let x = Array3::from_shape_fn((height.div_ceil(2), width, 2), |(i, j, down)| {
            let at = pixel(2 * i + down, j);
            (f32::from(codes.code(at)) / 256.0 + tree.counts[at] as f32) * range.peak()
        });
        regions.find(&x, 1, range);
        counts.clear();
        for block in regions.largest().flatten() {
            let (row, at) = (2 * (block / width), block % width);
            counts.extend([row, row + 1].map(|row| tree.counts[pixel(row, at)]));
        }
        if counts.len() as f64 >= LEAST_REGION * tree.counts.len() as f64 {
            base_level(counts, range, FEW_OUTLIERS, &mut self.levels)
        } else {
            base_level(&tree.counts, range, OUTLIERS, &mut self.levels)
        }
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
            let codes = (0..height * width).map(|at| (light(at / width, at % width) % range.peak()) as u16);
            let image = MosaicImage { codes: &codes.collect::<Vec<_>>(), height, width, mosaic };
            let mut out = Recovered::default();
            out.prepare((height, width, 1), "");
            let mut sums = GreenSums::new(threads).unwrap();
            sums.read(&image, range);
            prop_assert_eq!(sums.find(&image, range, &mut Budget::default()).unwrap(), 0.0);
            sums.write(&image, range, &mut out);
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

    /// The upper edge of a roof is one of a whole peak in green, which leaves no trace there, and one of 0.7 peaks in the other colours. All its
    /// other sides are flat.
    #[test]
    fn an_edge_of_a_whole_peak_is_seen_in_the_other_colours() {
        let (range, mosaic, dim) = (Range::new(8, 4.0).unwrap(), Mosaic::Grbg, (160, 200));
        let light = |row: usize, column: usize| {
            let below = if row < 40 { 0 } else { 140_usize.saturating_sub(row) };
            let beside = column.min(199 - column).min(50);
            let of_colour = if mosaic.channel(row, column) == 1 { 256 } else { 180 };
            128 + (of_colour * below * beside / 5000) as u16
        };
        let codes = (0..dim.0 * dim.1).map(|at| light(at / dim.1, at % dim.1) % 256).collect::<Vec<_>>();
        let image = MosaicImage { codes: &codes, height: dim.0, width: dim.1, mosaic };
        let mut out = Recovered::default();
        out.prepare((dim.0, dim.1, 1), "");
        let mut sums = GreenSums::new(1).unwrap();
        sums.read(&image, range);
        sums.find(&image, range, &mut Budget::default()).unwrap();
        sums.write(&image, range, &mut out);
        let green = out.k.indexed_iter().filter(|((i, j, _), _)| mosaic.channel(*i, *j) == 1);
        let wrong = green.filter(|((i, j, _), k)| u16::from(**k) != light(*i, *j) / 256).count();
        assert!(wrong < 40, "{wrong} of the counts are wrong");
    }
}
