//! The transform of a whole image in three walks over memory: down bands of
//! sixteen columns ([`stripe`](super::stripe)), along blocks of sixteen rows and back
//! ([`slab`](super::slab)), up the bands.
//!
//! The image is interleaved. Columns do not care for channels; along rows each
//! channel is its own sequence. No sample of another size is ever looked at:
//! the last band and the last block are filled up with zeros.

use super::cosine::Cosine;
use super::lanes::{Complex, REALS};
use super::slab::{Rows, Slab};
use super::stripe::Stripe;
use super::tile::Tile;
use crate::workers::Workers;

/// A plan for images of one size with its memory. `Out` is what is kept of sixteen samples.
pub(crate) struct Grid<Out> {
    shape: Shape,
    down: Cosine,
    across: Rows,
    stripes: Vec<Stripe<Out>>,
    slabs: Vec<Slab>,
}

/// Sides and how they are cut, for all walks.
#[derive(Clone, Copy)]
pub(super) struct Shape {
    pub height: usize,
    pub width: usize,
    pub channels: usize,
    /// Bands a stripe and blocks a slab has, at most.
    pub bands_each: usize,
    pub blocks_each: usize,
}

/// Where sixteen samples of a row stand.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    /// From 0.
    pub row: usize,
    /// Of the first of them in the interleaved row, a multiple of sixteen.
    pub sample: usize,
}

/// What happens to coefficients: given its value down and across, and sixteen rows of a column at once.
pub(crate) struct Change<'a, F> {
    /// A number for each row of coefficients, and 0 for rows up to a multiple of sixteen.
    pub down: &'a [[f32; REALS]],
    /// A number for each column of coefficients.
    pub across: &'a [f32],
    /// New coefficient from the number of its row, of its column, and itself.
    pub rule: F,
}

impl Shape {
    pub fn samples(self) -> usize {
        self.width * self.channels
    }

    pub fn bands(self) -> usize {
        self.samples().div_ceil(REALS)
    }

    pub fn blocks(self) -> usize {
        self.height.div_ceil(REALS)
    }
}

/// `count` things in at most `parts` runs of `each`.
fn runs(count: usize, each: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
    (0..count).step_by(each).map(move |first| first..(first + each).min(count))
}

impl<Out: Copy + Default + Send + Sync> Grid<Out> {
    /// For images of `dim`, all of it at least 1, cut for `parts` workers.
    pub fn new((height, width, channels): (usize, usize, usize), parts: usize) -> Self {
        let down = Cosine::new(height);
        let mut shape = Shape { height, width, channels, bands_each: 0, blocks_each: 0 };
        shape.bands_each = shape.bands().div_ceil(parts.max(1));
        shape.blocks_each = shape.blocks().div_ceil(parts.max(1));
        let across = Rows::new(shape);
        let stripes =
            runs(shape.bands(), shape.bands_each).map(|bands| Stripe::new(shape, &down, bands)).collect();
        let slabs =
            runs(shape.blocks(), shape.blocks_each).map(|blocks| Slab::new(&across, blocks)).collect();
        Self { shape, down, across, stripes, slabs }
    }

    /// (height, width, channels) as planned.
    pub fn dim(&self) -> (usize, usize, usize) {
        (self.shape.height, self.shape.width, self.shape.channels)
    }

    /// What was kept of the sixteen samples at `place`.
    #[inline(always)]
    pub fn out(&self, Place { row, sample }: Place) -> &Out {
        &self.outs(sample)[row]
    }

    /// What was kept of sixteen columns, by row; `sample` is a multiple of sixteen.
    #[inline(always)]
    pub fn outs(&self, sample: usize) -> &[Out] {
        let band = sample / REALS;
        self.stripes[band / self.shape.bands_each].outs(self.shape, band)
    }

    /// Forward transform of what `load` gives, `change`, inverse transform, `keep`.
    #[expect(clippy::redundant_closure, reason = "a reference is called by its shim, which is not inlined")]
    pub fn filter(
        &mut self,
        workers: &Workers,
        load: impl Fn(Place) -> [f32; REALS] + Sync,
        change: &Change<'_, impl Fn(f32, f32, f32) -> f32 + Sync>,
        keep: impl Fn(Place, [f32; REALS]) -> Out + Sync,
    ) {
        let Self { shape, down, across, stripes, slabs } = self;
        let shape = *shape;
        workers.each(stripes, |_, stripe| {
            stripe.bands().for_each(|band| stripe.forward(shape, down, band, &load));
        });
        workers.each(slabs, |_, slab| {
            slab.blocks()
                .for_each(|block| slab.filter(across, block, of_stripes(shape, block, stripes), change));
        });
        workers.each(stripes, |_, stripe| {
            stripe.bands().for_each(|band| {
                let tile = |block: usize| slabs[block / shape.blocks_each].tile(across, block, band);
                stripe.inverse(
                    shape,
                    down,
                    band,
                    tile,
                    #[inline(always)]
                    |place, values| keep(place, values),
                );
            });
        });
    }

    /// First half of a forward transform, of what `load` gives; [`Grid::forward_across`] is the second.
    pub fn forward_down(&mut self, load: impl Fn(Place) -> [f32; REALS]) {
        for stripe in &mut self.stripes {
            stripe.bands().for_each(|band| stripe.forward(self.shape, &self.down, band, &load));
        }
    }

    /// `put` receives the coefficients, interleaved as the samples are.
    pub fn forward_across(&mut self, mut put: impl FnMut(Place, [f32; REALS])) {
        let Self { shape, across, stripes, slabs, .. } = self;
        for slab in slabs {
            slab.blocks()
                .for_each(|block| slab.forward(across, block, of_stripes(*shape, block, stripes), &mut put));
        }
    }

    /// First half of an inverse transform, of coefficients that `take` gives; [`Grid::inverse_up`] is the second.
    pub fn inverse_across(&mut self, take: impl Fn(Place) -> [f32; REALS]) {
        for slab in &mut self.slabs {
            slab.blocks().for_each(|block| slab.inverse(&self.across, block, &take));
        }
    }

    /// `put` receives the samples.
    pub fn inverse_up(&mut self, mut put: impl FnMut(Place, [f32; REALS]) -> Out) {
        let Self { shape, down, across, stripes, slabs } = self;
        for stripe in stripes {
            stripe.bands().for_each(|band| {
                let tile = |block: usize| slabs[block / shape.blocks_each].tile(across, block, band);
                stripe.inverse(*shape, down, band, tile, &mut put);
            });
        }
    }
}

/// The tile of `block` by its band.
#[inline(always)]
fn of_stripes<'a, Out>(
    shape: Shape,
    block: usize,
    stripes: &'a [Stripe<Out>],
) -> impl Fn(usize) -> &'a Tile + use<'a, Out> {
    move |band| stripes[band / shape.bands_each].tile(shape, block, band)
}

impl<F: Fn(f32, f32, f32) -> f32> Change<'_, F> {
    #[inline(always)]
    pub(super) fn apply(&self, down: &[f32; REALS], column: usize, coefficients: Complex) -> Complex {
        let across = self.across[column];
        let mut values = coefficients.reals();
        for (value, &down) in values.iter_mut().zip(down) {
            *value = (self.rule)(down, across, *value);
        }
        Complex::of(values)
    }
}
