//! Tree: Itoh's steps along a spanning tree that takes the flattest edges first, all channels at once, within the
//! range.
//!
//! Edges between 4-neighbours are taken in the order of `keys` (Kruskal); along an edge `d k = (M_b(d y) - d y) /
//! 2^b`. Each region has the interval in which `0 <= y + k 2^b < alpha 2^b` leaves its k; a merge that would
//! empty it is refused.
//!
//! A picture clips what is brighter than its range, and so does the sensor at full scale: such parts are plateaus. 3 x 3 pixels of
//! exactly this code in all of three channels are taken for the brightest of the image, from 8 bits on. It is the code of nearly all
//! plateaus of the image, if it can be near full scale at one count only, else that of full scale itself.
//! An image with such a plateau at another k is recovered wrongly.
//!
//! Where all differences are consistent, `direct_sums` gives the result of the tree without one.
//!
//! It is exact when first differences are below half a peak along some path to every pixel, and that path is
//! flatter than any wrong one: `M_b(d y)` must not be near 0 by accident in three channels at once. It fails on
//! islands, whose whole contour jumps by more than half a peak. A region that stays separate gets the least
//! offset that its interval allows.

mod direct_sums;
mod forest;
mod image_edges;
mod keys;
mod pixels;
mod regions;
mod segments;

pub(super) use direct_sums::DirectSums;
pub(super) use forest::{BACKGROUND, EdgeSource, Edges, Forest};
pub(super) use image_edges::{FLAT, ImageEdges};
pub(super) use keys::{MAX_KEY, first_difference_keys, key_of_change, second_difference_keys};
use pixels::add;
pub(super) use pixels::{Bounds, EdgeDirection, Pixels, Quad, subtract, wrap_steps};
pub(super) use regions::Region;

use super::congruence::OUTLIERS;
use super::{Integers, Range, Recovered, Scene, Trust, Unwrap, UnwrapError, congruence};
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

/// Writes `out` from known differences: by direct sums where they are consistent, else by a tree. Returns whether it was by a tree.
pub(super) fn recover(
    image: &ImageEdges<'_>,
    sums: &mut DirectSums,
    forest: &mut Forest,
    y: Integers<'_>,
    range: Range,
    outliers: f64,
    out: &mut Recovered,
) -> bool {
    // Memory is reserved also for a frame that needs no tree, since a later one may need it.
    forest.make_room(image.extent());
    let grown = !sums.agree(image);
    if grown {
        forest.grow(image);
        place(forest, y, range, outliers, out);
    } else {
        sums.place(y, range, outliers, out);
    }
    grown
}

impl Unwrap for Tree {
    fn name(&self) -> &'static str {
        "tree"
    }

    fn unwrap(&mut self, y: &Frame, scene: &Scene, out: &mut Recovered) -> Result<(), UnwrapError> {
        let range = scene.range;
        let samples = Integers::checked(y, range)?;
        out.prepare(y.dim(), self.name());
        // The codes are stored twice, as planes for the keys and by pixel for the tree.
        let bounds = self.pixels.read(samples, (y.width(), y.channels()), range);
        let Self { pixels, keys, breaks, forest, sums } = self;
        for ((keys, breaks), stride) in keys.iter_mut().zip(&mut *breaks).zip([1, y.width()]) {
            first_difference_keys(pixels.planes(), stride, FLAT, keys, breaks);
        }
        let ([right, down], [right_breaks, down_breaks]) = (keys, breaks);
        // Without a first tree over the gradients, all n are 0.
        let image = ImageEdges {
            pixels,
            bounds,
            edges: Edges { keys: [right, down], breaks: [right_breaks, down_breaks] },
            n: [&[], &[]],
            changed: [&[], &[]],
        };
        recover(&image, sums, forest, samples, range, OUTLIERS, out);
        Ok(())
    }
}

/// Writes `out`: the largest region at the offset that keeps it in range, others at their least. A result with
/// clamped counts contradicts itself and is not trusted.
pub(super) fn place(forest: &mut Forest, y: Integers<'_>, range: Range, outliers: f64, out: &mut Recovered) {
    let outside = match out.k.dim().2 {
        1 => write_counts::<1>(forest, range, outliers, out),
        _ => write_counts::<3>(forest, range, outliers, out),
    };
    if outside > 0 {
        out.report.trust = Trust::Untrusted;
    }
    y.write_radiance(range, out);
}

/// Writes the counts, and returns the number of segments that are out of range.
fn write_counts<const CHANNELS: usize>(
    forest: &mut Forest,
    range: Range,
    outliers: f64,
    out: &mut Recovered,
) -> usize {
    let main = forest.regions.largest();
    let most = i16::from(range.max_wraps());
    let level = level(forest, main, range, outliers);
    let regions = &forest.regions;
    let mut outside = 0;
    let (counts, _) = out.buffers().1.as_chunks_mut::<CHANNELS>();
    for segment in &forest.segments {
        let root = regions.root(segment.node);
        // Only the largest region has enough pixels for a histogram of its levels.
        let base = if root == main { level } else { regions.region(root).low };
        let k = add(base, regions.offset_from_root(segment.node));
        outside += usize::from(k[..CHANNELS].iter().any(|k| !(0..=most).contains(k)));
        counts[segment.pixels()].fill(std::array::from_fn(|channel| k[channel].clamp(0, most) as u8));
    }
    outside
}

/// Returns the k of the root `main` by channel.
fn level(
    Forest { regions, segments, levels, .. }: &mut Forest,
    main: u32,
    range: Range,
    outliers: f64,
) -> Quad {
    let parts = || {
        let parts = segments.iter().filter(|segment| regions.root(segment.node) == main);
        parts.map(|segment| (regions.offset_from_root(segment.node), segment.pixels().len()))
    };
    let lanes = |of: fn(i16, i16) -> i16, a: Quad, b: Quad| std::array::from_fn(|lane| of(a[lane], b[lane]));
    let (low, high) = parts().fold(([i16::MAX; 4], [i16::MIN; 4]), |(low, high), (offset, _)| {
        (lanes(Ord::min, low, offset), lanes(Ord::max, high, offset))
    });
    let width = |lane: usize| usize::from(high[lane].abs_diff(low[lane])) + 1;
    let stride = (0..low.len()).map(width).max().expect("there are four lanes");
    levels.clear();
    levels.resize(low.len() * stride, 0);
    for (offset, pixels) in parts() {
        // Neighbours are mostly at one level, and a sum waits for the one before, but not for those of other lanes.
        for lane in 0..low.len() {
            levels[lane * stride + usize::from(offset[lane].abs_diff(low[lane]))] += pixels;
        }
    }
    std::array::from_fn(|lane| {
        let levels = &levels[lane * stride..][..width(lane)];
        // Counts are relative to the root, so the k of the root is what brings the base level to 0.
        -(low[lane] + congruence::base_level_index(levels, range, outliers) as i16)
    })
}
