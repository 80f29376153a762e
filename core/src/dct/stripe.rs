//! Transforms of columns: sixteen neighbours, a band, at once, from the image to
//! tiles and from tiles to what is kept of it.

use std::ops::Range;

use super::cosine::Cosine;
use super::grid::{Place, Shape};
use super::lanes::{Complex, REALS};
use super::tile::Tile;
use crate::simd::widest;

/// Neighbouring bands, the share of one worker.
pub(super) struct Stripe<Out> {
    bands: Range<usize>,
    /// By band and block.
    spectrum: Vec<Tile>,
    /// By band and row.
    out: Vec<Out>,
    data: Vec<Complex>,
    scratch: Vec<Complex>,
}

impl<Out: Copy + Default> Stripe<Out> {
    pub fn new(shape: Shape, down: &Cosine, bands: Range<usize>) -> Self {
        let [data, scratch] = down.room().map(|room| vec![Complex::default(); room]);
        Self {
            spectrum: vec![Tile::default(); bands.len() * shape.blocks()],
            out: vec![Out::default(); bands.len() * shape.height],
            bands,
            data,
            scratch,
        }
    }
}

impl<Out> Stripe<Out> {
    pub fn bands(&self) -> Range<usize> {
        self.bands.clone()
    }

    /// What [`Stripe::forward`] has left.
    #[inline(always)]
    pub fn tile(&self, shape: Shape, block: usize, band: usize) -> &Tile {
        &self.spectrum[(band - self.bands.start) * shape.blocks() + block]
    }

    /// What [`Stripe::inverse`] has kept, by row.
    #[inline(always)]
    pub fn outs(&self, shape: Shape, band: usize) -> &[Out] {
        &self.out[(band - self.bands.start) * shape.height..][..shape.height]
    }

    pub fn forward(
        &mut self,
        shape: Shape,
        down: &Cosine,
        band: usize,
        load: &impl Fn(Place) -> [f32; REALS],
    ) {
        let Self { data, scratch, .. } = self;
        widest(
            #[inline(always)]
            || {
                for row in 0..shape.height {
                    data[down.position(row)] = Complex::of(load(Place { row, sample: band * REALS }));
                }
            },
        );
        down.fourier(data, scratch);
        let first = (band - self.bands.start) * shape.blocks();
        let to = self.spectrum[first..][..shape.blocks()].as_flattened_mut();
        widest(
            #[inline(always)]
            || {
                for (k, mirrored) in down.pairs() {
                    [to[k], to[mirrored]] = down.coefficients(k, [data[k], data[mirrored]]);
                }
            },
        );
    }

    pub fn inverse<'a>(
        &mut self,
        shape: Shape,
        down: &Cosine,
        band: usize,
        tile: impl Fn(usize) -> &'a Tile,
        mut keep: impl FnMut(Place, [f32; REALS]) -> Out,
    ) {
        let Self { data, scratch, .. } = self;
        let from = |row: usize| tile(row / REALS)[row % REALS];
        widest(
            #[inline(always)]
            || {
                for (k, mirrored) in down.pairs() {
                    [data[k], data[mirrored]] = down.spectrum(k, [from(k), from(mirrored)]);
                }
            },
        );
        down.fourier(data, scratch);
        let out = &mut self.out[(band - self.bands.start) * shape.height..][..shape.height];
        widest(
            #[inline(always)]
            || {
                for (row, out) in out.iter_mut().enumerate() {
                    let value = data[down.position(row)].swapped().reals();
                    *out = keep(Place { row, sample: band * REALS }, value);
                }
            },
        );
    }
}
