//! The transform of a whole image in three passes over memory: down the bands of sixteen columns ([`ColumnPart`]),
//! along the blocks of sixteen rows and back ([`rows`](super::rows)), and up the bands.
//!
//! The image is interleaved. Along columns the channels make no difference; along rows each channel is a sequence
//! of its own. The last band and the last block are filled up with zeros.

use std::ops::Range;

use super::cosine::{CosinePlan, Scratch};
use super::lanes::{Complex, LANES, Tile};
use super::rows::{GridShape, RowPart, RowPlan, SampleRun, SpectralFilter};
use crate::simd::widest;
use crate::workers::Workers;

/// A plan for images of one size with its memory. `Out` is the output for a run of sixteen samples.
pub(crate) struct ImageDct<Out> {
    shape: GridShape,
    column_plan: CosinePlan,
    row_plan: RowPlan,
    column_parts: Vec<ColumnPart<Out>>,
    row_parts: Vec<RowPart>,
}

/// Splits `count` items into ranges of at most `each`.
fn split(count: usize, each: usize) -> impl Iterator<Item = Range<usize>> {
    (0..count).step_by(each).map(move |first| first..(first + each).min(count))
}

impl<Out: Copy + Default + Send + Sync> ImageDct<Out> {
    /// Plans for images of `dim`, all at least 1, with parts for `parts` workers.
    pub fn new((height, width, channels): (usize, usize, usize), parts: usize) -> Self {
        let column_plan = CosinePlan::new(height);
        let mut shape = GridShape { height, width, channels, bands_per_part: 0, blocks_per_part: 0 };
        // Parts are whole bands and blocks, so each worker writes its own memory without a lock.
        shape.bands_per_part = shape.bands().div_ceil(parts.max(1));
        shape.blocks_per_part = shape.blocks().div_ceil(parts.max(1));
        let row_plan = RowPlan::new(shape);
        let column_parts = split(shape.bands(), shape.bands_per_part)
            .map(|bands| ColumnPart::new(shape, &column_plan, bands))
            .collect();
        let row_parts = split(shape.blocks(), shape.blocks_per_part)
            .map(|blocks| RowPart::new(&row_plan, blocks))
            .collect();
        Self { shape, column_plan, row_plan, column_parts, row_parts }
    }

    /// Returns (height, width, channels) as planned.
    pub fn dim(&self) -> (usize, usize, usize) {
        (self.shape.height, self.shape.width, self.shape.channels)
    }

    #[inline(always)]
    pub fn out(&self, SampleRun { row, sample }: SampleRun) -> &Out {
        &self.outs(sample)[row]
    }

    /// Returns the outputs of sixteen columns by row; `sample` is a multiple of sixteen.
    #[inline(always)]
    pub fn outs(&self, sample: usize) -> &[Out] {
        let band = sample / LANES;
        let part = &self.column_parts[band / self.shape.bands_per_part];
        &part.out[(band - part.bands.start) * self.shape.height..][..self.shape.height]
    }

    /// Transforms the samples of `load`, applies `filter`, transforms back, and stores the output of `keep`.
    #[expect(clippy::redundant_closure, reason = "a reference is called by its shim, which is not inlined")]
    pub fn filter(
        &mut self,
        workers: &Workers,
        load: impl Fn(SampleRun) -> [f32; LANES] + Sync,
        filter: &SpectralFilter<'_, impl Fn(f32, f32, f32) -> f32 + Sync>,
        keep: impl Fn(SampleRun, [f32; LANES]) -> Out + Sync,
    ) {
        let Self { shape, column_plan, row_plan, column_parts, row_parts } = self;
        let shape = *shape;
        // The three passes are separated by barriers: each reads what all workers have written in the one before.
        workers.each(column_parts, |_, part| {
            part.bands.clone().for_each(|band| part.forward(shape, column_plan, band, &load));
        });
        workers.each(row_parts, |_, part| {
            part.blocks.clone().for_each(|block| {
                let tile = |band: usize| column_parts[band / shape.bands_per_part].tile(shape, block, band);
                part.filter(row_plan, block, tile, filter)
            });
        });
        workers.each(column_parts, |_, part| {
            part.bands.clone().for_each(|band| {
                let tile =
                    |block: usize| row_parts[block / shape.blocks_per_part].tile(row_plan, block, band);
                part.inverse(
                    shape,
                    column_plan,
                    band,
                    tile,
                    #[inline(always)]
                    |run, values| keep(run, values),
                );
            });
        });
    }
}

/// A range of neighbouring bands, the share of one worker: it transforms a band of sixteen columns at once, from the
/// image to tiles, and from tiles to the output.
struct ColumnPart<Out> {
    bands: Range<usize>,
    /// The coefficients by band and block.
    spectrum: Vec<Tile>,
    /// The output by band and row.
    out: Vec<Out>,
    data: Vec<Complex>,
    scratch: Scratch,
}

impl<Out: Copy + Default> ColumnPart<Out> {
    pub fn new(shape: GridShape, plan: &CosinePlan, bands: Range<usize>) -> Self {
        Self {
            spectrum: vec![Tile::default(); bands.len() * shape.blocks()],
            out: vec![Out::default(); bands.len() * shape.height],
            bands,
            data: vec![Complex::default(); shape.height],
            scratch: plan.scratch(),
        }
    }
}

impl<Out> ColumnPart<Out> {
    /// Returns a tile of the result of [`ColumnPart::forward`].
    #[inline(always)]
    pub fn tile(&self, shape: GridShape, block: usize, band: usize) -> &Tile {
        &self.spectrum[(band - self.bands.start) * shape.blocks() + block]
    }

    pub fn forward(
        &mut self,
        shape: GridShape,
        plan: &CosinePlan,
        band: usize,
        load: &impl Fn(SampleRun) -> [f32; LANES],
    ) {
        // Loading permutes the rows as Makhoul's transform needs them, so that no pass of its own does it.
        let Self { data, scratch, .. } = self;
        widest!({
            for row in 0..shape.height {
                data[plan.position(row)] = Complex::from_lanes(load(SampleRun { row, sample: band * LANES }));
            }
        });
        plan.forward(data, scratch);
        let first = (band - self.bands.start) * shape.blocks();
        let to = self.spectrum[first..][..shape.blocks()].as_flattened_mut();
        widest!({
            for (k, mirrored) in plan.pairs() {
                [to[k], to[mirrored]] = plan.coefficients(k, [data[k], data[mirrored]]);
            }
        });
    }

    pub fn inverse<'a>(
        &mut self,
        shape: GridShape,
        plan: &CosinePlan,
        band: usize,
        tile: impl Fn(usize) -> &'a Tile,
        mut keep: impl FnMut(SampleRun, [f32; LANES]) -> Out,
    ) {
        let Self { data, scratch, .. } = self;
        let from = |row: usize| tile(row / LANES)[row % LANES];
        widest!({
            for (k, mirrored) in plan.pairs() {
                [data[k], data[mirrored]] = plan.spectrum(k, [from(k), from(mirrored)]);
            }
        });
        plan.inverse(data, scratch);
        let out = &mut self.out[(band - self.bands.start) * shape.height..][..shape.height];
        widest!({
            for (row, out) in out.iter_mut().enumerate() {
                // The spectrum was written with its parts swapped, which makes the forward transform an inverse one.
                let value = data[plan.position(row)].swapped().to_lanes();
                *out = keep(SampleRun { row, sample: band * LANES }, value);
            }
        });
    }
}
