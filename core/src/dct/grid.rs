//! The transform of a whole image in three walks over memory: down bands of
//! sixteen columns, along blocks of sixteen rows and back, up the bands.
//!
//! The image is interleaved. Columns do not care for channels; along rows each
//! channel is its own sequence. No sample of another size is ever looked at:
//! the last band and the last block are filled up with zeros.

use super::cosine::{Buffers, Cosine};
use super::lanes::{Complex, REALS};
use super::tile::{Tile, transpose};
use crate::simd::widest;
use crate::workers::Workers;

/// A plan for images of one size with its memory. `Out` is what is kept of sixteen samples.
pub(crate) struct Grid<Out> {
    shape: Shape,
    down: Cosine,
    across: Cosine,
    stripes: Vec<Stripe<Out>>,
    slabs: Vec<Slab>,
}

/// Sides and how they are cut, for all walks.
#[derive(Clone, Copy)]
struct Shape {
    height: usize,
    width: usize,
    channels: usize,
    /// Bands a stripe and blocks a slab has, at most.
    bands_each: usize,
    blocks_each: usize,
}

/// Neighbouring bands, the share of one worker.
struct Stripe<Out> {
    bands: std::ops::Range<usize>,
    /// By band and block.
    spectrum: Vec<Tile>,
    /// By band and row.
    out: Vec<Out>,
    buffers: Buffers,
}

/// Neighbouring blocks, the share of one worker.
struct Slab {
    blocks: std::ops::Range<usize>,
    /// By block and band.
    tiles: Vec<Tile>,
    channels: Vec<Buffers>,
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
    fn samples(self) -> usize {
        self.width * self.channels
    }

    fn bands(self) -> usize {
        self.samples().div_ceil(REALS)
    }

    fn blocks(self) -> usize {
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
        let (down, across) = (Cosine::new(height), Cosine::new(width));
        let mut shape = Shape { height, width, channels, bands_each: 0, blocks_each: 0 };
        shape.bands_each = shape.bands().div_ceil(parts.max(1));
        shape.blocks_each = shape.blocks().div_ceil(parts.max(1));
        let stripe = |bands: std::ops::Range<usize>| Stripe {
            spectrum: vec![Tile::default(); bands.len() * shape.blocks()],
            out: vec![Out::default(); bands.len() * height],
            buffers: down.buffers(),
            bands,
        };
        let slab = |blocks: std::ops::Range<usize>| Slab {
            tiles: vec![Tile::default(); blocks.len() * shape.bands()],
            channels: (0..channels).map(|_| across.buffers()).collect(),
            blocks,
        };
        let stripes = runs(shape.bands(), shape.bands_each).map(stripe).collect();
        let slabs = runs(shape.blocks(), shape.blocks_each).map(slab).collect();
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
        let stripe = &self.stripes[band / self.shape.bands_each];
        &stripe.out[(band - stripe.bands.start) * self.shape.height..][..self.shape.height]
    }

    /// Forward transform of what `load` gives, `change`, inverse transform, `keep`.
    pub fn filter(
        &mut self,
        workers: &Workers,
        load: impl Fn(Place) -> [f32; REALS] + Sync,
        change: &Change<'_, impl Fn(f32, f32, f32) -> f32 + Sync>,
        keep: impl Fn(Place, [f32; REALS]) -> Out + Sync,
    ) {
        self.columns_forward(workers, load);
        let Self { shape, across, stripes, slabs, .. } = self;
        workers.each(slabs, |_, slab| {
            for block in 0..slab.blocks.len() {
                slab.filter(*shape, across, block, stripes, change);
            }
        });
        self.columns_inverse(workers, keep);
    }

    /// Forward transform of what `load` gives; [`Grid::coefficients`] has the result.
    pub fn forward(&mut self, workers: &Workers, load: impl Fn(Place) -> [f32; REALS] + Sync) {
        self.columns_forward(workers, load);
        let Self { shape, across, stripes, slabs, .. } = self;
        workers.each(slabs, |_, slab| {
            for block in 0..slab.blocks.len() {
                slab.forward(*shape, across, block, stripes);
            }
        });
    }

    /// Inverse transform of [`Grid::coefficients`], `keep`.
    pub fn inverse(&mut self, workers: &Workers, keep: impl Fn(Place, [f32; REALS]) -> Out + Sync) {
        let Self { shape, across, slabs, .. } = self;
        workers.each(slabs, |_, slab| {
            for block in 0..slab.blocks.len() {
                slab.inverse(*shape, across, block);
            }
        });
        self.columns_inverse(workers, keep);
    }

    /// Sixteen coefficients of a row, interleaved as the samples are.
    pub fn coefficients(&mut self, place: Place) -> [f32; REALS] {
        self.coefficient(place).reals()
    }

    /// Replaces [`Grid::coefficients`].
    pub fn set_coefficients(&mut self, place: Place, coefficients: [f32; REALS]) {
        *self.coefficient(place) = Complex::of(coefficients);
    }

    fn coefficient(&mut self, Place { row, sample }: Place) -> &mut Complex {
        let block = row / REALS;
        let slab = &mut self.slabs[block / self.shape.blocks_each];
        let tile = (block - slab.blocks.start) * self.shape.bands() + sample / REALS;
        &mut slab.tiles[tile][row % REALS]
    }

    fn columns_forward(&mut self, workers: &Workers, load: impl Fn(Place) -> [f32; REALS] + Sync) {
        let Self { shape, down, stripes, .. } = self;
        workers.each(stripes, |_, stripe| {
            for band in 0..stripe.bands.len() {
                stripe.forward(*shape, down, band, &load);
            }
        });
    }

    fn columns_inverse(&mut self, workers: &Workers, keep: impl Fn(Place, [f32; REALS]) -> Out + Sync) {
        let Self { shape, down, stripes, slabs, .. } = self;
        workers.each(stripes, |_, stripe| {
            for band in 0..stripe.bands.len() {
                stripe.inverse(*shape, down, band, slabs, &keep);
            }
        });
    }
}

impl<Out> Stripe<Out> {
    fn forward(&mut self, shape: Shape, down: &Cosine, band: usize, load: &impl Fn(Place) -> [f32; REALS]) {
        let sample = (self.bands.start + band) * REALS;
        widest(
            #[inline(always)]
            || {
                let input = self.buffers.input();
                for row in 0..shape.height {
                    input[down.position(row)] = Complex::of(load(Place { row, sample }));
                }
            },
        );
        down.fourier(&mut self.buffers);
        let to = self.spectrum[band * shape.blocks()..][..shape.blocks()].as_flattened_mut();
        widest(
            #[inline(always)]
            || {
                let result = self.buffers.result();
                for (k, mirrored) in down.pairs() {
                    [to[k], to[mirrored]] = down.coefficients(k, [result[k], result[mirrored]]);
                }
            },
        );
    }

    fn inverse(
        &mut self,
        shape: Shape,
        down: &Cosine,
        band: usize,
        slabs: &[Slab],
        keep: &impl Fn(Place, [f32; REALS]) -> Out,
    ) {
        let bands = shape.bands();
        let index = self.bands.start + band;
        let from = |row: usize| {
            let block = row / REALS;
            let slab = &slabs[block / shape.blocks_each];
            slab.tiles[(block - slab.blocks.start) * bands + index][row % REALS]
        };
        widest(
            #[inline(always)]
            || {
                let input = self.buffers.input();
                for (k, mirrored) in down.pairs() {
                    [input[k], input[mirrored]] = down.spectrum(k, [from(k), from(mirrored)]);
                }
            },
        );
        down.fourier(&mut self.buffers);
        let out = &mut self.out[band * shape.height..][..shape.height];
        widest(
            #[inline(always)]
            || {
                let result = self.buffers.result();
                for (row, out) in out.iter_mut().enumerate() {
                    let value = result[down.position(row)].swapped().reals();
                    *out = keep(Place { row, sample: index * REALS }, value);
                }
            },
        );
    }
}

impl Slab {
    fn filter<Out>(
        &mut self,
        shape: Shape,
        across: &Cosine,
        block: usize,
        stripes: &[Stripe<Out>],
        change: &Change<'_, impl Fn(f32, f32, f32) -> f32>,
    ) {
        let down = self.blocks.start + block;
        widest(
            #[inline(always)]
            || self.load(shape, |column| across.position(column), of_stripes(shape, down, stripes)),
        );
        for buffers in &mut self.channels {
            across.fourier(buffers);
            widest(
                #[inline(always)]
                || {
                    let result = buffers.result();
                    for (k, mirrored) in across.pairs() {
                        let [mut x, mut y] = across.coefficients(k, [result[k], result[mirrored]]);
                        x = change.apply(&change.down[down], k, x);
                        y = change.apply(&change.down[down], mirrored, y);
                        [result[k], result[mirrored]] = across.spectrum(k, [x, y]);
                    }
                },
            );
            across.fourier(buffers);
        }
        widest(
            #[inline(always)]
            || self.store(shape, block, |column| across.position(column), Complex::swapped),
        );
    }

    fn forward<Out>(&mut self, shape: Shape, across: &Cosine, block: usize, stripes: &[Stripe<Out>]) {
        let down = self.blocks.start + block;
        widest(
            #[inline(always)]
            || self.load(shape, |column| across.position(column), of_stripes(shape, down, stripes)),
        );
        for buffers in &mut self.channels {
            across.fourier(buffers);
            widest(
                #[inline(always)]
                || {
                    let result = buffers.result();
                    for (k, mirrored) in across.pairs() {
                        [result[k], result[mirrored]] = across.coefficients(k, [result[k], result[mirrored]]);
                    }
                },
            );
        }
        widest(
            #[inline(always)]
            || self.store(shape, block, |column| column, |lanes| lanes),
        );
    }

    fn inverse(&mut self, shape: Shape, across: &Cosine, block: usize) {
        let tiles = std::mem::take(&mut self.tiles);
        let first = block * shape.bands();
        widest(
            #[inline(always)]
            || self.load(shape, |column| column, |band| &tiles[first + band]),
        );
        self.tiles = tiles;
        for buffers in &mut self.channels {
            widest(
                #[inline(always)]
                || {
                    let input = buffers.input();
                    for (k, mirrored) in across.pairs() {
                        [input[k], input[mirrored]] = across.spectrum(k, [input[k], input[mirrored]]);
                    }
                },
            );
            across.fourier(buffers);
        }
        widest(
            #[inline(always)]
            || self.store(shape, block, |column| across.position(column), Complex::swapped),
        );
    }

    /// Takes the columns of a block apart by channel, each to its `position`.
    #[inline(always)]
    fn load<'a>(
        &mut self,
        shape: Shape,
        position: impl Fn(usize) -> usize,
        tile: impl Fn(usize) -> &'a Tile,
    ) {
        for band in 0..shape.bands() {
            let mut turned = Tile::default();
            transpose(tile(band), &mut turned);
            for (sample, &lanes) in (band * REALS..shape.samples()).zip(&turned) {
                let (column, channel) = (sample / shape.channels, sample % shape.channels);
                self.channels[channel].input()[position(column)] = lanes;
            }
        }
    }

    /// Undoes [`Slab::load`].
    #[inline(always)]
    fn store(
        &mut self,
        shape: Shape,
        block: usize,
        position: impl Fn(usize) -> usize,
        finish: impl Fn(Complex) -> Complex,
    ) {
        let tiles = &mut self.tiles[block * shape.bands()..][..shape.bands()];
        for (band, tile) in tiles.iter_mut().enumerate() {
            let mut turned = Tile::default();
            for (sample, lanes) in (band * REALS..shape.samples()).zip(&mut turned) {
                let (column, channel) = (sample / shape.channels, sample % shape.channels);
                *lanes = finish(self.channels[channel].result()[position(column)]);
            }
            transpose(&turned, tile);
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
    move |band| {
        let stripe = &stripes[band / shape.bands_each];
        &stripe.spectrum[(band - stripe.bands.start) * shape.blocks() + block]
    }
}

impl<F: Fn(f32, f32, f32) -> f32> Change<'_, F> {
    #[inline(always)]
    fn apply(&self, down: &[f32; REALS], column: usize, coefficients: Complex) -> Complex {
        let across = self.across[column];
        let mut values = coefficients.reals();
        for (value, &down) in values.iter_mut().zip(down) {
            *value = (self.rule)(down, across, *value);
        }
        Complex::of(values)
    }
}
