//! Transforms of rows, a block of sixteen at once, from tiles to tiles.

use std::ops::Range;

use super::cosine::{CosinePlan, Scratch};
use super::lanes::{Complex, LANES, Tile, transpose};
use crate::simd::widest;

/// The sides of an image and its parts for the workers, the same in all passes.
#[derive(Clone, Copy)]
pub(super) struct GridShape {
    pub height: usize,
    pub width: usize,
    pub channels: usize,
    /// The largest number of bands and of blocks in a part.
    pub bands_per_part: usize,
    pub blocks_per_part: usize,
}

/// The position of a run of sixteen samples in a row.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SampleRun {
    pub row: usize,
    /// The first sample in the interleaved row, a multiple of sixteen.
    pub sample: usize,
}

/// A change of the coefficients by a rule on one number for the row and one for the column.
pub(crate) struct SpectralFilter<'a, F> {
    /// One number for each row of coefficients, and 0 for the rows that fill up the last block.
    pub by_row: &'a [[f32; LANES]],
    /// One number for each column of coefficients.
    pub by_column: &'a [f32],
    /// Returns the new coefficient from the number of its row, that of its column, and its old value.
    pub rule: F,
}

impl GridShape {
    pub fn samples(self) -> usize {
        self.width * self.channels
    }

    pub fn bands(self) -> usize {
        self.samples().div_ceil(LANES)
    }

    pub fn blocks(self) -> usize {
        self.height.div_ceil(LANES)
    }
}

pub(super) struct RowPlan {
    shape: GridShape,
    cosine: CosinePlan,
    /// The positions, in the data of all channels, of the columns of each band, as the transform permutes them.
    samples: Vec<[usize; LANES]>,
}

/// A range of neighbouring blocks, the share of one worker.
pub(super) struct RowPart {
    pub blocks: Range<usize>,
    /// The tiles by block and band.
    tiles: Vec<Tile>,
    /// The data by channel, and one number for columns beyond the end of the row.
    data: Vec<Complex>,
    scratch: Scratch,
}

impl<F: Fn(f32, f32, f32) -> f32> SpectralFilter<'_, F> {
    #[inline(always)]
    fn apply(&self, by_row: &[f32; LANES], column: usize, coefficients: Complex) -> Complex {
        let by_column = self.by_column[column];
        let mut values = coefficients.to_lanes();
        for (value, &by_row) in values.iter_mut().zip(by_row) {
            *value = (self.rule)(by_row, by_column, *value);
        }
        Complex::from_lanes(values)
    }
}

impl RowPlan {
    pub fn new(shape: GridShape) -> Self {
        let cosine = CosinePlan::new(shape.width);
        // Samples beyond the end of the row go to one extra number after all channels: no branch in the loop.
        let at = |sample: usize| {
            let (column, channel) = (sample / shape.channels, sample % shape.channels);
            let last = shape.channels * shape.width;
            if column < shape.width { channel * shape.width + cosine.position(column) } else { last }
        };
        let order = |band| std::array::from_fn(|lane| at(band * LANES + lane));
        Self { shape, samples: (0..shape.bands()).map(order).collect(), cosine }
    }
}

impl RowPart {
    pub fn new(plan: &RowPlan, blocks: Range<usize>) -> Self {
        Self {
            tiles: vec![Tile::default(); blocks.len() * plan.shape.bands()],
            data: vec![Complex::default(); plan.shape.channels * plan.shape.width + 1],
            // The channels are transformed one after the other and share the scratch.
            scratch: plan.cosine.scratch(),
            blocks,
        }
    }

    /// Returns a tile of the result of [`RowPart::filter`].
    #[inline(always)]
    pub fn tile(&self, plan: &RowPlan, block: usize, band: usize) -> &Tile {
        &self.tiles[(block - self.blocks.start) * plan.shape.bands() + band]
    }

    /// Transforms the tiles of a block, applies `filter`, and transforms back.
    pub fn filter<'a>(
        &mut self,
        plan: &RowPlan,
        block: usize,
        tile: impl Fn(usize) -> &'a Tile,
        filter: &SpectralFilter<'_, impl Fn(f32, f32, f32) -> f32>,
    ) {
        self.load(plan, tile);
        let cosine = &plan.cosine;
        // The number at the end takes what lies beyond the row; it belongs to no channel.
        let last = self.data.len() - 1;
        for data in self.data[..last].chunks_exact_mut(plan.shape.width) {
            cosine.forward(data, &mut self.scratch);
            widest!({
                for (k, mirrored) in cosine.pairs() {
                    let [mut x, mut y] = cosine.coefficients(k, [data[k], data[mirrored]]);
                    // The filter acts between the two transforms while the coefficients are in registers.
                    x = filter.apply(&filter.by_row[block], k, x);
                    y = filter.apply(&filter.by_row[block], mirrored, y);
                    [data[k], data[mirrored]] = cosine.spectrum(k, [x, y]);
                }
            });
            cosine.inverse(data, &mut self.scratch);
        }
        self.store(plan, block);
    }

    /// Separates the columns of a block by channel.
    fn load<'a>(&mut self, plan: &RowPlan, tile: impl Fn(usize) -> &'a Tile) {
        let data = &mut self.data;
        widest!({
            for (band, order) in plan.samples.iter().enumerate() {
                scatter(data, order, tile(band));
            }
        });
    }

    /// Undoes [`RowPart::load`] for samples, whose real and imaginary parts are swapped.
    fn store(&mut self, plan: &RowPlan, block: usize) {
        let Self { data, tiles, .. } = self;
        let bands = plan.shape.bands();
        let tiles = &mut tiles[(block - self.blocks.start) * bands..][..bands];
        widest!({
            for (tile, order) in tiles.iter_mut().zip(&plan.samples) {
                transpose(
                    #[inline(always)]
                    |lane| data[order[lane]].swapped(),
                    #[inline(always)]
                    |row, values| tile[row] = values,
                );
            }
        });
    }
}

/// Stores the columns of a tile at the positions `order`.
#[inline(always)]
fn scatter(data: &mut [Complex], order: &[usize; LANES], tile: &Tile) {
    transpose(
        #[inline(always)]
        |row| tile[row],
        #[inline(always)]
        |lane, column| data[order[lane]] = column,
    );
}
