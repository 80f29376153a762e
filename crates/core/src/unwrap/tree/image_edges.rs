//! The edges of an image between its pixels, with the counts that each pixel can have.

use std::ops::Range as Indices;

use super::forest::{EdgeSource, Edges};
use super::keys::MAX_KEY;
use super::pixels::{Bounds, EdgeDirection, Pixels, Quad, add, wrap_steps};
use super::regions::Region;

/// The largest key that counts as flat, 56 of 256 codes.
pub(in crate::unwrap) const FLAT: u16 = 56 << 6;

/// The edges of an image whose differences are `M_b(d y) + n * 2^b`.
pub(in crate::unwrap) struct ImageEdges<'a> {
    pub pixels: &'a Pixels,
    pub bounds: Bounds,
    /// The edges by [`first_difference_keys`] with [`FLAT`]; broken also where n is not 0.
    pub edges: Edges<'a>,
    /// The n by pixel, to the right and down; empty where all are 0.
    pub n: [&'a [Quad]; 2],
    /// The pixels, to the right and down, at which n may differ from 0, in ascending order.
    pub changed: [&'a [u32]; 2],
}

impl EdgeSource for ImageEdges<'_> {
    const FLAT: u16 = FLAT;

    #[inline(always)]
    fn width(&self) -> usize {
        self.pixels.width()
    }

    #[inline(always)]
    fn extent(&self) -> (usize, usize) {
        (self.pixels.count() / self.pixels.width(), self.pixels.width())
    }

    #[inline(always)]
    fn edges(&self) -> &Edges<'_> {
        &self.edges
    }

    #[inline(always)]
    fn mask(&self) -> Option<&[u8]> {
        None
    }

    #[inline(always)]
    fn background_key(&self, _at: usize) -> u16 {
        MAX_KEY
    }

    #[inline(always)]
    fn interval(&self, pixels: Indices<usize>) -> Region {
        // Most segments have no bright code, so one look at the mask settles the whole segment.
        if !self.pixels.limited()[pixels.clone()].contains(&1) {
            return Region { low: [0; 4], high: self.bounds.widest(), size: pixels.len() as u32 };
        }
        Region::of_equal(pixels, |at| {
            let code = self.pixels.code(at);
            match self.bounds.of_clipped(code).filter(|_| self.is_plateau(at)) {
                Some(most) => (most, most),
                None => ([0; 4], self.bounds.highest(code)),
            }
        })
    }

    #[inline(always)]
    fn step(&self, to: EdgeDirection, at: usize) -> Quad {
        let step = wrap_steps(self.pixels.code(at), self.pixels.code(at + self.pixels.stride(to)));
        self.n[to as usize].get(at).map_or(step, |&n| add(step, n))
    }
}

impl ImageEdges<'_> {
    /// Returns whether the 3 x 3 pixels around `at` have one code.
    fn is_plateau(&self, at: usize) -> bool {
        let width = self.pixels.width();
        let column = at % width;
        // In a single channel, codes of full scale meet by chance too often to tell a plateau from a slope.
        let inside = self.pixels.has_colours()
            && column > 0
            && column + 1 < width
            && at >= width
            && at + width < self.pixels.count();
        let code = self.pixels.code(at);
        inside
            && [at - width, at, at + width]
                .iter()
                .all(|&middle| (middle - 1..=middle + 1).all(|there| self.pixels.code(there) == code))
    }
}
