//! Transforms of rows: sixteen neighbours, a block, at once, from tiles to tiles.

use std::ops::Range;

use super::cosine::Cosine;
use super::grid::{Change, Place, Shape};
use super::lanes::{Complex, REALS};
use super::tile::{Tile, transpose};
use crate::simd::widest;

/// A plan for rows.
pub(super) struct Rows {
    shape: Shape,
    cosine: Cosine,
    /// Where the columns of a band stand among the data of all channels, by band:
    /// as a transform wants its samples, and as it wants its coefficients.
    samples: Vec<[usize; REALS]>,
    coefficients: Vec<[usize; REALS]>,
}

/// Neighbouring blocks, the share of one worker.
pub(super) struct Slab {
    blocks: Range<usize>,
    /// By block and band.
    tiles: Vec<Tile>,
    /// By channel, and one for columns beyond the end of the row.
    data: Vec<Complex>,
    scratch: Vec<Complex>,
}

impl Rows {
    pub fn new(shape: Shape) -> Self {
        let cosine = Cosine::new(shape.width);
        let [room, _] = cosine.room();
        let at = |sample: usize, position: &dyn Fn(usize) -> usize| {
            let (column, channel) = (sample / shape.channels, sample % shape.channels);
            if column < shape.width { channel * room + position(column) } else { shape.channels * room }
        };
        let order = |position: &dyn Fn(usize) -> usize| {
            (0..shape.bands())
                .map(|band| std::array::from_fn(|lane| at(band * REALS + lane, position)))
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

impl Slab {
    pub fn new(rows: &Rows, blocks: Range<usize>) -> Self {
        let [room, scratch] = rows.cosine.room();
        Self {
            tiles: vec![Tile::default(); blocks.len() * rows.shape.bands()],
            data: vec![Complex::default(); rows.shape.channels * room + 1],
            scratch: vec![Complex::default(); scratch],
            blocks,
        }
    }

    pub fn blocks(&self) -> Range<usize> {
        self.blocks.clone()
    }

    /// What [`Slab::filter`] or [`Slab::inverse`] has left.
    #[inline(always)]
    pub fn tile(&self, rows: &Rows, block: usize, band: usize) -> &Tile {
        &self.tiles[(block - self.blocks.start) * rows.shape.bands() + band]
    }

    /// Transforms, changes and transforms back the tiles of a block.
    pub fn filter<'a>(
        &mut self,
        rows: &Rows,
        block: usize,
        tile: impl Fn(usize) -> &'a Tile,
        change: &Change<'_, impl Fn(f32, f32, f32) -> f32>,
    ) {
        self.load(rows, tile);
        let cosine = &rows.cosine;
        self.each_channel(cosine, |data, scratch| {
            cosine.fourier(data, scratch);
            widest(
                #[inline(always)]
                || {
                    for (k, mirrored) in cosine.pairs() {
                        let [mut x, mut y] = cosine.coefficients(k, [data[k], data[mirrored]]);
                        x = change.apply(&change.down[block], k, x);
                        y = change.apply(&change.down[block], mirrored, y);
                        [data[k], data[mirrored]] = cosine.spectrum(k, [x, y]);
                    }
                },
            );
            cosine.fourier(data, scratch);
        });
        self.store(rows, block);
    }

    /// Transforms the tiles of a block; `put` receives its rows.
    pub fn forward<'a>(
        &mut self,
        rows: &Rows,
        block: usize,
        tile: impl Fn(usize) -> &'a Tile,
        put: &mut impl FnMut(Place, [f32; REALS]),
    ) {
        self.load(rows, tile);
        let cosine = &rows.cosine;
        self.each_channel(cosine, |data, scratch| {
            cosine.fourier(data, scratch);
            widest(
                #[inline(always)]
                || {
                    for (k, mirrored) in cosine.pairs() {
                        [data[k], data[mirrored]] = cosine.coefficients(k, [data[k], data[mirrored]]);
                    }
                },
            );
        });
        let (first, data) = (block * REALS, &self.data);
        widest(
            #[inline(always)]
            || {
                for (band, order) in rows.coefficients.iter().enumerate() {
                    transpose(
                        #[inline(always)]
                        |lane| data[order[lane]],
                        #[inline(always)]
                        |row, values| {
                            let place = Place { row: first + row, sample: band * REALS };
                            if place.row < rows.shape.height {
                                put(place, values.reals());
                            }
                        },
                    );
                }
            },
        );
    }

    /// Transforms rows of coefficients that `take` gives back, to tiles.
    pub fn inverse(&mut self, rows: &Rows, block: usize, take: &impl Fn(Place) -> [f32; REALS]) {
        let Self { data, .. } = self;
        widest(
            #[inline(always)]
            || {
                for (band, order) in rows.coefficients.iter().enumerate() {
                    let mut tile = Tile::default();
                    for (row, lanes) in (block * REALS..rows.shape.height).zip(&mut tile) {
                        *lanes = Complex::of(take(Place { row, sample: band * REALS }));
                    }
                    scatter(data, order, &tile);
                }
            },
        );
        let cosine = &rows.cosine;
        self.each_channel(cosine, |data, scratch| {
            widest(
                #[inline(always)]
                || {
                    for (k, mirrored) in cosine.pairs() {
                        [data[k], data[mirrored]] = cosine.spectrum(k, [data[k], data[mirrored]]);
                    }
                },
            );
            cosine.fourier(data, scratch);
        });
        self.store(rows, block);
    }

    fn each_channel(&mut self, cosine: &Cosine, mut work: impl FnMut(&mut [Complex], &mut [Complex])) {
        let [room, _] = cosine.room();
        let last = self.data.len() - 1;
        for data in self.data[..last].chunks_exact_mut(room) {
            work(data, &mut self.scratch);
        }
    }

    /// Takes the columns of a block apart by channel.
    fn load<'a>(&mut self, rows: &Rows, tile: impl Fn(usize) -> &'a Tile) {
        let data = &mut self.data;
        widest(
            #[inline(always)]
            || {
                for (band, order) in rows.samples.iter().enumerate() {
                    scatter(data, order, tile(band));
                }
            },
        );
    }

    /// Undoes [`Slab::load`] for samples, whose parts are swapped.
    fn store(&mut self, rows: &Rows, block: usize) {
        let Self { data, tiles, .. } = self;
        let bands = rows.shape.bands();
        let tiles = &mut tiles[(block - self.blocks.start) * bands..][..bands];
        widest(
            #[inline(always)]
            || {
                for (tile, order) in tiles.iter_mut().zip(&rows.samples) {
                    transpose(
                        #[inline(always)]
                        |lane| data[order[lane]].swapped(),
                        #[inline(always)]
                        |row, values| tile[row] = values,
                    );
                }
            },
        );
    }
}

/// Puts the columns of a tile where `order` says.
#[inline(always)]
fn scatter(data: &mut [Complex], order: &[usize; REALS], tile: &Tile) {
    transpose(
        #[inline(always)]
        |row| tile[row],
        #[inline(always)]
        |lane, column| data[order[lane]] = column,
    );
}
