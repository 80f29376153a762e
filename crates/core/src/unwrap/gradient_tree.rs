//! Gradient tree: a spanning tree over each gradient image first, then over the image.
//!
//! With g = M_b(d y) and d x = g + n 2^b, a spanning tree over the pixels of g finds n as `tree` finds k, along
//! edges in the order of `M_b(d g)`: exact where *second* differences are below half a peak. Most gradients are
//! small. They form the background, one node with n = 0, to which each other gradient has an edge as well, with a
//! key by the steepest gradient nearby. The range bounds n as it bounds k. Then `tree` takes the edges of the
//! image in the order of `g + n 2^b`.
//!
//! It is slower than `lines`, but an error stays local: it tolerates noise, and edges that end within the image.
//! It fails on edges of a sharp lens and on lines one pixel wide, where second differences wrap as well.

use std::ops::Range as Indices;

use super::congruence::OUTLIERS;
use super::tree::{
    BACKGROUND, Bounds, DirectSums, EdgeDirection, EdgeSource, Edges, FLAT as FLAT_IMAGE_KEY, Forest,
    ImageEdges, MAX_KEY, Pixels, Quad, Region, first_difference_keys, key_of_change, place, recover,
    second_difference_keys, subtract, wrap_steps,
};
use super::{Integers, Range, Recovered, Scene, Unwrap, UnwrapError, WorkersError};
use crate::frame::Frame;
use crate::simd::widest;
use crate::workers::Workers;

/// The largest key of a second difference that counts as flat, 80 of 256 codes.
const FLAT: u16 = 80 << 6;

/// A gradient belongs to the background if no key nearby is larger than this, 160 of 256 codes.
const BACKGROUND_LIMIT: u16 = 160 << 6;

/// The number of pixels along the gradient that are nearby.
const NEARBY: usize = 2;

/// The method with its buffers.
pub struct GradientTree {
    workers: Workers,
    pixels: Pixels,
    gradients: [DirectionalGradient; 2],
    /// The buffers of the trees: those of the image and of its gradients, by turns.
    buffers: TreeBuffers,
    /// Those of the gradient that has a thread of its own.
    second: Option<TreeBuffers>,
    sums: DirectSums,
    /// Whether the last image was recovered by the forest, not by the sums.
    grown: bool,
}

impl GradientTree {
    /// The name of the method.
    pub(super) const NAME: &'static str = "gradient_tree";

    /// Runs on `threads` threads; the result does not depend on their number.
    ///
    /// # Errors
    /// [`WorkersError`] when the threads are not available.
    pub fn new(threads: usize) -> Result<Self, WorkersError> {
        Ok(Self {
            workers: Workers::new(threads)?,
            pixels: Pixels::default(),
            gradients: [EdgeDirection::Right, EdgeDirection::Down]
                .map(|direction| DirectionalGradient { direction, ..Default::default() }),
            buffers: TreeBuffers::default(),
            second: (threads > 1).then(TreeBuffers::default),
            sums: DirectSums::default(),
            grown: false,
        })
    }
}

impl Unwrap for GradientTree {
    fn name(&self) -> &'static str {
        Self::NAME
    }

    fn unwrap(&mut self, y: &Frame, scene: &Scene, out: &mut Recovered) -> Result<(), UnwrapError> {
        self.unwrap_within(y, scene.range, OUTLIERS, out)
    }
}

impl GradientTree {
    /// Unwraps `y` at the offset that leaves at most a share of `outliers` below the least count.
    ///
    /// # Errors
    /// Those of [`Unwrap::unwrap`].
    pub(super) fn unwrap_within(
        &mut self,
        y: &Frame,
        range: Range,
        outliers: f64,
        out: &mut Recovered,
    ) -> Result<(), UnwrapError> {
        let samples = Integers::checked(y, range)?;
        out.prepare(y.dim(), self.name());
        self.unwrap_codes(samples, y.dim(), range, outliers, out);
        Ok(())
    }

    /// Unwraps `samples` of an image of `dim`, all below 2^b, into `out`, which must be prepared.
    pub(super) fn unwrap_codes(
        &mut self,
        samples: Integers<'_>,
        (_, width, channels): (usize, usize, usize),
        range: Range,
        outliers: f64,
        out: &mut Recovered,
    ) {
        let bounds = self.pixels.read(samples, (width, channels), range);
        let Self { workers, pixels, gradients: [right, down], buffers, second, .. } = self;
        let unwrap = |gradient: &mut DirectionalGradient, buffers: &mut TreeBuffers| {
            gradient.unwrap(pixels, bounds, buffers);
        };
        if let Some(second) = second {
            // The two directions share nothing, so that each can have a thread.
            let mut both = [(&mut *right, &mut *buffers), (&mut *down, second)];
            workers.each(&mut both, |_, (gradient, buffers)| unwrap(gradient, buffers));
        } else {
            unwrap(right, buffers);
            unwrap(down, buffers);
        }
        let image = ImageEdges {
            pixels,
            bounds,
            edges: Edges { keys: [&right.keys, &down.keys], breaks: [&right.breaks, &down.breaks] },
            n: [&right.n, &down.n],
            changed: [&right.changed, &down.changed],
        };
        self.grown = recover(&image, &mut self.sums, &mut buffers.forest, samples, range, outliers, out);
    }

    /// Writes the result for the last `samples` anew into `out`, which must be prepared, at the offset that so many outliers allow.
    pub(super) fn place(&mut self, samples: Integers<'_>, range: Range, outliers: f64, out: &mut Recovered) {
        if self.grown {
            place(&mut self.buffers.forest, samples, range, outliers, out);
        } else {
            self.sums.place(samples, range, outliers, out);
        }
    }
}

/// The gradient in one direction. All maps have the size of the image: at pixel p is the difference to p's neighbour.
#[derive(Default)]
struct DirectionalGradient {
    direction: EdgeDirection,
    /// The keys of the gradient.
    keys: Vec<u16>,
    /// The edges of the image where the gradient is not flat, wraps, or has an n.
    breaks: Vec<u8>,
    n: Vec<Quad>,
    /// The pixels at which n is not 0.
    changed: Vec<u32>,
}

/// What the tree over a gradient needs no longer when n is found.
#[derive(Default)]
struct TreeBuffers {
    /// The edges of the gradient image to the right and down: their keys, and whether they are not flat or wrap.
    second_edges: [(Vec<u16>, Vec<u8>); 2],
    /// The greatest key nearby.
    steepest: Vec<u16>,
    /// 1 where the greatest key nearby is above [`BACKGROUND_LIMIT`], 0 in the background.
    mask: Vec<u8>,
    forest: Forest,
}

impl DirectionalGradient {
    /// Finds n and the keys of `g + n 2^b`; n is 0 for the background and for pixels that no edge joins to it.
    fn unwrap(&mut self, pixels: &Pixels, bounds: Bounds, buffers: &mut TreeBuffers) {
        let stride = pixels.stride(self.direction);
        // These are the keys of the image, which the second tree uses; the first one needs them for its background.
        first_difference_keys(pixels.planes(), stride, FLAT_IMAGE_KEY, &mut self.keys, &mut self.breaks);
        if self.direction == EdgeDirection::Right {
            // There the difference is across the edge of the image.
            self.keys.chunks_exact_mut(pixels.width()).for_each(|row| row[row.len() - 1] = 0);
        }
        for ((keys, breaks), step) in buffers.second_edges.iter_mut().zip([1, pixels.width()]) {
            second_difference_keys(pixels.planes(), (stride, step), FLAT, keys, breaks);
        }
        buffers.find_mask(&self.keys, stride);
        let TreeBuffers { steepest, mask, second_edges: [right, down], forest } = buffers;
        let edges = Edges { keys: [&right.0, &down.0], breaks: [&right.1, &down.1] };
        let direction = self.direction;
        forest.grow(&GradientEdges { pixels, bounds, direction, steepest, mask, edges });
        self.write_counts(pixels, forest);
    }

    fn write_counts(&mut self, pixels: &Pixels, forest: &Forest) {
        // Few pixels change, so clearing these is faster than clearing the map.
        if self.n.len() == pixels.count() {
            self.changed.iter().for_each(|&at| self.n[at as usize] = [0; 4]);
        } else {
            // The system gives zeros, which take memory only where they are written.
            self.n = vec![[0; 4]; pixels.count()];
        }
        self.changed.clear();
        // Reserved for the worst case, so that no later frame of this size allocates.
        self.changed.reserve(pixels.count());
        let (regions, stride) = (&forest.regions, pixels.stride(self.direction));
        for segment in forest.segments.iter().filter(|segment| segment.node != BACKGROUND) {
            // Only regions that an edge has joined to the background have a known n.
            let n = subtract(regions.offset_from_root(segment.node), regions.offset_from_root(BACKGROUND));
            if n == [0; 4] || regions.root(segment.node) != regions.root(BACKGROUND) {
                continue;
            }
            for at in segment.pixels() {
                self.n[at] = n;
                self.changed.push(at as u32);
                self.keys[at] = key_of_change(pixels.code(at), pixels.code(at + stride), n);
                // An edge with an n must not join its ends as a flat edge with equal counts does.
                self.breaks[at] = 1;
            }
        }
    }
}

impl TreeBuffers {
    /// Computes the mask from the keys of the gradient. Beside an edge of the image, "nearby" extends into the next row, which only makes the
    /// mask larger.
    fn find_mask(&mut self, keys: &[u16], stride: usize) {
        let Self { steepest, mask, second_edges: [(_, right), _], .. } = self;
        steepest.clear();
        steepest.extend_from_slice(keys);
        mask.resize(keys.len(), 0);
        widest!({
            // A small image has no pixel that far away.
            for reach in (1..=NEARBY).map(|n| n * stride).filter(|&reach| reach < keys.len()) {
                steepest[reach..].iter_mut().zip(keys).for_each(|(most, &key)| *most = key.max(*most));
                steepest.iter_mut().zip(&keys[reach..]).for_each(|(most, &key)| *most = key.max(*most));
            }
            mask.iter_mut().zip(&*steepest).for_each(|(mask, &key)| *mask = u8::from(key > BACKGROUND_LIMIT));
            // Within the background nothing is cut; at its border everything is, so that it stays one node.
            for ((cut, here), next) in right.iter_mut().zip(&*mask).zip(&mask[1..]) {
                *cut = (*cut & here) | (here ^ next);
            }
        });
    }
}

/// Returns the rows and columns of pixels that have a neighbour in that direction.
fn extent(pixels: &Pixels, direction: EdgeDirection) -> (usize, usize) {
    let (rows, columns) = (pixels.count() / pixels.width(), pixels.width());
    match direction {
        EdgeDirection::Right => (rows, columns - 1),
        EdgeDirection::Down => (rows - 1, columns),
    }
}

/// The edges of the gradient image, whose counts are n.
struct GradientEdges<'a> {
    pixels: &'a Pixels,
    bounds: Bounds,
    direction: EdgeDirection,
    steepest: &'a [u16],
    mask: &'a [u8],
    edges: Edges<'a>,
}

impl EdgeSource for GradientEdges<'_> {
    const FLAT: u16 = FLAT;

    #[inline(always)]
    fn width(&self) -> usize {
        self.pixels.width()
    }

    #[inline(always)]
    fn extent(&self) -> (usize, usize) {
        extent(self.pixels, self.direction)
    }

    #[inline(always)]
    fn edges(&self) -> &Edges<'_> {
        &self.edges
    }

    #[inline(always)]
    fn mask(&self) -> Option<&[u8]> {
        Some(self.mask)
    }

    /// Returns twice the steepest gradient nearby, which measures how unlikely n = 0 is.
    #[inline(always)]
    fn background_key(&self, at: usize) -> u16 {
        self.steepest[at].saturating_mul(2).min(MAX_KEY)
    }

    /// Returns the interval of n, which the range bounds: k at both ends lies in 0 to `highest`, and n = k_to - k_from - steps.
    #[inline(always)]
    fn interval(&self, pixels: Indices<usize>) -> Region {
        Region::of_equal(pixels, |at| {
            let ends = [at, at + self.pixels.stride(self.direction)].map(|at| self.pixels.code(at));
            let [below, above] = ends.map(|code| self.bounds.highest(code));
            let wrap_steps = wrap_steps(ends[0], ends[1]);
            (subtract(subtract([0; 4], below), wrap_steps), subtract(above, wrap_steps))
        })
    }

    #[inline(always)]
    fn step(&self, to: EdgeDirection, at: usize) -> Quad {
        let stride = self.pixels.stride(self.direction);
        wrap_steps(
            self.pixels.difference(at, stride),
            self.pixels.difference(at + self.pixels.stride(to), stride),
        )
    }
}
