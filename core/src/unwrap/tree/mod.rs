//! Tree: Itoh's steps along a spanning tree that takes the flattest edges first, all channels at once, within the
//! range.
//!
//! Edges between 4-neighbours are taken in the order of `keys` (Kruskal); along an edge `d k = (M_b(d y) - d y) /
//! 2^b`. Each region has the interval in which `0 <= y + k 2^b < alpha 2^b` leaves its k; a merge that would
//! empty it is refused.
//!
//! The sensor clamps radiance to just below full scale, so whatever is brighter is a plateau there. 3 x 3 pixels
//! of exactly the code of full scale in all of three channels are taken for k = ceil(alpha) - 1, from 8 bits on.
//! An image with such a plateau at another k is recovered wrongly.
//!
//! Where all differences are consistent, `direct_sums` gives the result of the tree without one.
//!
//! It is exact when first differences are below half a peak along some path to every pixel, and that path is
//! flatter than any wrong one: `M_b(d y)` must not be near 0 by accident in three channels at once. It fails on
//! islands, whose whole contour jumps by more than half a peak. A region that stays separate gets the least
//! offset that its interval allows.

mod direct_sums;
mod edge_queue;
mod forest;
mod image_edges;
mod keys;
mod pixels;
mod regions;
mod segments;

pub(super) use direct_sums::DirectSums;
pub(super) use forest::{BACKGROUND, EdgeSource, Edges, Forest};
use image_edges::place;
pub(super) use image_edges::{FLAT, ImageEdges};
pub(super) use keys::{MAX_KEY, first_difference_keys, key_of_change, second_difference_keys};
pub(super) use pixels::{Bounds, EdgeDirection, Pixels, Quad, subtract, wrap_steps};
pub(super) use regions::Region;

use super::{Integers, Range, Recovered, Unwrap, UnwrapError};
use crate::frame::Frame;

/// The method with its buffers.
#[derive(Default)]
pub struct Tree {
    pixels: Pixels,
    keys: [Vec<u16>; 2],
    breaks: [Vec<u8>; 2],
    forest: Forest,
    sums: DirectSums,
}

/// Writes `out` from known differences: by direct sums where they are consistent, else by a tree.
pub(super) fn recover(
    image: &ImageEdges<'_>,
    sums: &mut DirectSums,
    forest: &mut Forest,
    y: Integers<'_>,
    range: Range,
    out: &mut Recovered,
) {
    // Also for the frames that need no tree: a later one may.
    forest.make_room(image.extent());
    if sums.agree(image) {
        return sums.place(y, range, out);
    }
    forest.grow(image);
    place(forest, y, range, out);
}

impl Unwrap for Tree {
    fn name(&self) -> &'static str {
        "tree"
    }

    fn unwrap(&mut self, y: &Frame, range: Range, out: &mut Recovered) -> Result<(), UnwrapError> {
        let samples = Integers::checked(y, range)?;
        out.prepare(y.dim(), self.name());
        let bounds = Bounds::new(range);
        self.pixels.read(samples, (y.width(), y.channels()), range, bounds);
        let Self { pixels, keys, breaks, forest, sums } = self;
        for ((keys, breaks), stride) in keys.iter_mut().zip(&mut *breaks).zip([1, y.width()]) {
            first_difference_keys(pixels.planes(), stride, FLAT, keys, breaks);
        }
        let ([right, down], [right_breaks, down_breaks]) = (keys, breaks);
        let image = ImageEdges {
            pixels,
            bounds,
            edges: Edges { keys: [right, down], breaks: [right_breaks, down_breaks] },
            n: [&[], &[]],
            changed: [&[], &[]],
        };
        recover(&image, sums, forest, samples, range, out);
        Ok(())
    }
}
