//! The edges of the image, whose counts are k.

use std::ops::Range;

use super::forest::{EdgeSource, Edges, Forest};
use super::keys::MAX_KEY;
use super::pixels::{Bounds, EdgeDirection, Pixels, Quad, add, wrap_steps};
use super::regions::Region;
use super::segments::Segment;
use crate::simd::widest;
use crate::unwrap::{Integers, Range as RangeOfX, Recovered, Trust, congruence};

/// The largest key that counts as flat, 56 of 256 codes.
pub(in crate::unwrap) const FLAT: u16 = 56 << 6;

/// The edges of an image whose differences are `M_b(d y) + n * 2^b`.
pub(in crate::unwrap) struct ImageEdges<'a> {
    pub pixels: &'a Pixels,
    pub bounds: Bounds,
    /// The edges by [`first_difference_keys`](super::first_difference_keys) with [`FLAT`]; broken also where n is
    /// not 0.
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
    fn interval(&self, pixels: Range<usize>) -> Region {
        // Most segments have no bright code, so one look at the mask settles the whole segment.
        if !self.pixels.limited()[pixels.clone()].contains(&1) {
            return Region { low: [0; 4], high: self.bounds.widest(), size: pixels.len() as u32 };
        }
        Region::of_equal(pixels, |at| {
            let code = self.pixels.code(at);
            match self.bounds.at_full_scale(code).filter(|_| self.is_plateau(at)) {
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

/// Writes `out`: the largest region at the offset that keeps it in range, others at their least. A result with
/// clamped counts contradicts itself and is not trusted.
pub(in crate::unwrap) fn place(forest: &mut Forest, y: Integers<'_>, range: RangeOfX, out: &mut Recovered) {
    let outside = match out.k.dim().2 {
        1 => write_counts::<1>(forest, range, out),
        _ => write_counts::<3>(forest, range, out),
    };
    finish(outside, y, range, out);
}

/// Completes `out` from its counts, of which `outside` were out of range.
pub(super) fn finish(outside: usize, y: Integers<'_>, range: RangeOfX, out: &mut Recovered) {
    if outside > 0 {
        out.report.trust = Trust::Contradicted;
    }
    match y {
        Integers::U8(y) => write_radiance(y, range, out),
        Integers::U16(y) => write_radiance(y, range, out),
    }
}

/// Writes the counts, and returns the number of segments that are out of range.
fn write_counts<const CHANNELS: usize>(forest: &mut Forest, range: RangeOfX, out: &mut Recovered) -> usize {
    let main = forest.regions.largest();
    let most = i16::from(range.max_wraps());
    let level = level(forest, main, most);
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

fn write_radiance<T: Copy + Into<f32>>(y: &[T], range: RangeOfX, out: &mut Recovered) {
    let (x, k) = out.buffers();
    let peak = range.peak();
    widest!({
        for ((x, y), k) in x.iter_mut().zip(y).zip(&*k) {
            *x = (*y).into() + f32::from(*k) * peak;
        }
    });
}

/// Returns the k of the root `main` by channel.
fn level(Forest { regions, segments, levels, .. }: &mut Forest, main: u32, most: i16) -> Quad {
    let parts = || segments.iter().filter(|segment| regions.root(segment.node) == main);
    let offset = |segment: &Segment, lane: usize| regions.offset_from_root(segment.node)[lane];
    std::array::from_fn(|lane| {
        let offsets = || parts().map(|segment| offset(segment, lane));
        let [low, high] = [offsets().min(), offsets().max()].map(|end| end.expect("a region has a segment"));
        levels.clear();
        levels.resize(usize::from(high.abs_diff(low)) + 1, 0);
        for segment in parts() {
            levels[usize::from(offset(segment, lane).abs_diff(low))] += segment.pixels().len();
        }
        -(low + congruence::base_level_index(levels, most.into()) as i16)
    })
}
