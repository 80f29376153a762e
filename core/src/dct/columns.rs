//! Transforms of columns, a band of sixteen at once: from the image to tiles, and from tiles to the output.

use std::ops::Range;

use super::cosine::CosinePlan;
use super::grid::{GridShape, SampleRun};
use super::lanes::{Complex, LANES};
use super::tile::Tile;
use crate::simd::widest;

/// A range of neighbouring bands, the share of one worker.
pub(super) struct ColumnPart<Out> {
    bands: Range<usize>,
    /// The coefficients by band and block.
    spectrum: Vec<Tile>,
    /// The output by band and row.
    out: Vec<Out>,
    data: Vec<Complex>,
    scratch: Vec<Complex>,
}

impl<Out: Copy + Default> ColumnPart<Out> {
    pub fn new(shape: GridShape, plan: &CosinePlan, bands: Range<usize>) -> Self {
        let [data, scratch] = plan.buffer_lengths().map(|length| vec![Complex::default(); length]);
        Self {
            spectrum: vec![Tile::default(); bands.len() * shape.blocks()],
            out: vec![Out::default(); bands.len() * shape.height],
            bands,
            data,
            scratch,
        }
    }
}

impl<Out> ColumnPart<Out> {
    pub fn bands(&self) -> Range<usize> {
        self.bands.clone()
    }

    /// Returns a tile of the result of [`ColumnPart::forward`].
    #[inline(always)]
    pub fn tile(&self, shape: GridShape, block: usize, band: usize) -> &Tile {
        &self.spectrum[(band - self.bands.start) * shape.blocks() + block]
    }

    /// Returns the output of [`ColumnPart::inverse`] by row.
    #[inline(always)]
    pub fn outs(&self, shape: GridShape, band: usize) -> &[Out] {
        &self.out[(band - self.bands.start) * shape.height..][..shape.height]
    }

    pub fn forward(
        &mut self,
        shape: GridShape,
        plan: &CosinePlan,
        band: usize,
        load: &impl Fn(SampleRun) -> [f32; LANES],
    ) {
        let Self { data, scratch, .. } = self;
        widest!({
            for row in 0..shape.height {
                data[plan.position(row)] = Complex::from_lanes(load(SampleRun { row, sample: band * LANES }));
            }
        });
        plan.fourier(data, scratch);
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
        plan.fourier(data, scratch);
        let out = &mut self.out[(band - self.bands.start) * shape.height..][..shape.height];
        widest!({
            for (row, out) in out.iter_mut().enumerate() {
                let value = data[plan.position(row)].swapped().to_lanes();
                *out = keep(SampleRun { row, sample: band * LANES }, value);
            }
        });
    }
}
