//! Transforms of rows, a block of sixteen at once, from tiles to tiles.

use std::ops::Range;

use super::cosine::CosinePlan;
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
    /// The row, from 0.
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

/// A plan of the transforms of rows.
pub(super) struct RowPlan {
    shape: GridShape,
    cosine: CosinePlan,
    /// The positions, in the data of all channels, of the columns of each band: for the samples, as the transform
    /// permutes them, and for the coefficients, which are in order.
    samples: Vec<[usize; LANES]>,
    coefficients: Vec<[usize; LANES]>,
}

/// A range of neighbouring blocks, the share of one worker.
pub(super) struct RowPart {
    blocks: Range<usize>,
    /// The tiles by block and band.
    tiles: Vec<Tile>,
    /// The data by channel, and one number for columns beyond the end of the row.
    data: Vec<Complex>,
    scratch: Vec<Complex>,
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
        let [length, _] = cosine.buffer_lengths();
        // Samples beyond the end of the row go to one extra number after all channels: no branch in the loop.
        let at = |sample: usize, position: &dyn Fn(usize) -> usize| {
            let (column, channel) = (sample / shape.channels, sample % shape.channels);
            if column < shape.width { channel * length + position(column) } else { shape.channels * length }
        };
        // Planning runs once for a size, so a virtual call does no harm.
        let order = |position: &dyn Fn(usize) -> usize| {
            (0..shape.bands())
                .map(|band| std::array::from_fn(|lane| at(band * LANES + lane, position)))
                .collect()
        };
        Self {
            shape,
            samples: order(&|column| cosine.position(column)),
            coefficients: order(&|column| column),
            cosine,
        }
    }
}

impl RowPart {
    pub fn new(plan: &RowPlan, blocks: Range<usize>) -> Self {
        let [length, scratch] = plan.cosine.buffer_lengths();
        Self {
            tiles: vec![Tile::default(); blocks.len() * plan.shape.bands()],
            data: vec![Complex::default(); plan.shape.channels * length + 1],
            // The channels are transformed one after the other and share the scratch.
            scratch: vec![Complex::default(); scratch],
            blocks,
        }
    }

    pub fn blocks(&self) -> Range<usize> {
        self.blocks.clone()
    }

    /// Returns a tile of the result of [`RowPart::filter`] or [`RowPart::inverse`].
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
        self.each_channel(cosine, |data, scratch| {
            cosine.fourier(data, scratch);
            widest!({
                for (k, mirrored) in cosine.pairs() {
                    let [mut x, mut y] = cosine.coefficients(k, [data[k], data[mirrored]]);
                    // The filter acts between the two transforms while the coefficients are in registers.
                    x = filter.apply(&filter.by_row[block], k, x);
                    y = filter.apply(&filter.by_row[block], mirrored, y);
                    [data[k], data[mirrored]] = cosine.spectrum(k, [x, y]);
                }
            });
            cosine.fourier(data, scratch);
        });
        self.store(plan, block);
    }

    /// Transforms the tiles of a block; `put` receives its rows.
    pub fn forward<'a>(
        &mut self,
        plan: &RowPlan,
        block: usize,
        tile: impl Fn(usize) -> &'a Tile,
        put: &mut impl FnMut(SampleRun, [f32; LANES]),
    ) {
        self.load(plan, tile);
        let cosine = &plan.cosine;
        self.each_channel(cosine, |data, scratch| {
            cosine.fourier(data, scratch);
            widest!({
                for (k, mirrored) in cosine.pairs() {
                    [data[k], data[mirrored]] = cosine.coefficients(k, [data[k], data[mirrored]]);
                }
            });
        });
        let (first, data) = (block * LANES, &self.data);
        widest!({
            for (band, order) in plan.coefficients.iter().enumerate() {
                transpose(
                    #[inline(always)]
                    |lane| data[order[lane]],
                    #[inline(always)]
                    |row, values| {
                        let run = SampleRun { row: first + row, sample: band * LANES };
                        // The last block may have rows below the image.
                        if run.row < plan.shape.height {
                            put(run, values.to_lanes());
                        }
                    },
                );
            }
        });
    }

    /// Transforms rows of coefficients, which `take` gives, back to tiles.
    pub fn inverse(&mut self, plan: &RowPlan, block: usize, take: &impl Fn(SampleRun) -> [f32; LANES]) {
        let Self { data, .. } = self;
        widest!({
            for (band, order) in plan.coefficients.iter().enumerate() {
                // Rows below the image stay 0, as the forward transform leaves them.
                let mut tile = Tile::default();
                for (row, lanes) in (block * LANES..plan.shape.height).zip(&mut tile) {
                    *lanes = Complex::from_lanes(take(SampleRun { row, sample: band * LANES }));
                }
                scatter(data, order, &tile);
            }
        });
        let cosine = &plan.cosine;
        self.each_channel(cosine, |data, scratch| {
            widest!({
                for (k, mirrored) in cosine.pairs() {
                    [data[k], data[mirrored]] = cosine.spectrum(k, [data[k], data[mirrored]]);
                }
            });
            cosine.fourier(data, scratch);
        });
        self.store(plan, block);
    }

    fn each_channel(&mut self, cosine: &CosinePlan, mut work: impl FnMut(&mut [Complex], &mut [Complex])) {
        let [length, _] = cosine.buffer_lengths();
        // The number at the end takes what lies beyond the row; it belongs to no channel.
        let last = self.data.len() - 1;
        for data in self.data[..last].chunks_exact_mut(length) {
            work(data, &mut self.scratch);
        }
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
