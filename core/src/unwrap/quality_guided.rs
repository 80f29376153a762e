//! Quality-guided unwrapping, the classical reference: Herraez et al. 2002 (Appl. Opt. 41, 7437), one channel
//! after the other.
//!
//! A pixel is reliable where wrapped differences change little through it, in four directions:
//! ```text
//!     D^2 = sum over {horizontal, vertical, 2 diagonals} of (M_b(y_before - y) - M_b(y - y_after))^2
//! ```
//! The key of an edge is the sum of the D^2 of its ends. Edges are taken in ascending order, and each joins two
//! groups of pixels by Itoh's step. Pixels on the border of the image have no D and come last, as in
//! scikit-image's `unwrap_phase` without wrap-around.
//!
//! It is exact when first differences are below half a peak. It uses the range only for the absolute offset.

use super::wrapped::{codes, difference, wrap_step_signed};
use super::{Integers, Range, Recovered, Unwrap, UnwrapError, congruence};
use crate::frame::Frame;

/// The D^2 of a pixel on the border, above that of any other pixel: four squares of less than 2^17.
const BORDER: u64 = 1 << 36;

/// The method with its buffers.
#[derive(Default)]
pub struct QualityGuided {
    y: Vec<f32>,
    codes: Vec<u16>,
    unreliability: Vec<u64>,
    edges: Vec<PixelEdge>,
    groups: PixelGroups,
    k: Vec<i32>,
    levels: Vec<usize>,
}

/// An edge; the order is by unreliability, then by position, right before down.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct PixelEdge {
    unreliability: u64,
    from: u32,
    to: u32,
}

impl Unwrap for QualityGuided {
    fn name(&self) -> &'static str {
        "quality_guided"
    }

    fn unwrap(&mut self, y: &Frame, range: Range, out: &mut Recovered) -> Result<(), UnwrapError> {
        let samples = Integers::checked(y, range)?;
        out.prepare(y.dim(), self.name());
        let (_, width, channels) = y.dim();
        for channel in 0..channels {
            // Channels are unwrapped one by one, as in the paper of the method, which knows only one.
            samples.take(channels, channel, &mut self.y);
            codes(&self.y, range, &mut self.codes);
            self.grow(width);
            congruence::write_channel(&self.k, &self.y, range, channel, &mut self.levels, out);
        }
        Ok(())
    }
}

impl QualityGuided {
    /// Writes to `k` the wrap counts of the codes relative to one pixel.
    fn grow(&mut self, width: usize) {
        let codes = &self.codes;
        self.unreliability.clear();
        self.unreliability.extend((0..codes.len()).map(|here| unreliability(codes, width, here)));
        self.edges.clear();
        for here in 0..codes.len() {
            // No edge may join the end of a row to the start of the next one.
            let right = (!(here + 1).is_multiple_of(width)).then_some(here + 1);
            let down = Some(here + width).filter(|&there| there < codes.len());
            for there in [right, down].into_iter().flatten() {
                let unreliability = self.unreliability[here] + self.unreliability[there];
                self.edges.push(PixelEdge { unreliability, from: here as u32, to: there as u32 });
            }
        }
        // The position is part of the order, so no two edges are equal and the result is the same on every machine.
        self.edges.sort_unstable();
        self.groups.reset(codes.len());
        for PixelEdge { from, to, .. } in &self.edges {
            self.groups.join(*from, *to, wrap_step_signed(codes[*from as usize], codes[*to as usize]).into());
        }
        self.k.clear();
        self.k.extend((0..codes.len() as u32).map(|node| self.groups.find(node).1));
    }
}

/// Returns D^2 in units of `codes`.
fn unreliability(codes: &[u16], width: usize, here: usize) -> u64 {
    let column = here % width;
    if column == 0 || column + 1 == width || here < width || here + width >= codes.len() {
        return BORDER;
    }
    // The square of a difference of two 16-bit differences needs more than 32 bits.
    let bend = |stride: usize| {
        let [before, at, after] = [here - stride, here, here + stride].map(|index| codes[index]);
        i64::from(difference(at, before)) - i64::from(difference(after, at))
    };
    // Along the row, along both diagonals, and down the column.
    [1, width - 1, width, width + 1].into_iter().map(|stride| bend(stride).pow(2) as u64).sum()
}

/// Groups of pixels: a union-find with the count of each node relative to the root of its group.
#[derive(Default)]
struct PixelGroups {
    /// The parent, and the count of the node minus that of the parent; a root is its own parent.
    nodes: Vec<(u32, i32)>,
    sizes: Vec<u32>,
}

impl PixelGroups {
    fn reset(&mut self, count: usize) {
        self.nodes.clear();
        self.nodes.extend((0..count as u32).map(|node| (node, 0)));
        self.sizes.clear();
        self.sizes.resize(count, 1);
    }

    /// Returns the root, and the count of the node minus that of the root, and halves the path.
    fn find(&mut self, mut node: u32) -> (u32, i32) {
        let mut total = 0;
        loop {
            let (parent, offset) = self.nodes[node as usize];
            if parent == node {
                return (node, total);
            }
            let (above, further) = self.nodes[parent as usize];
            self.nodes[node as usize] = (above, offset + further);
            total += offset + further;
            node = above;
        }
    }

    /// Joins the groups of two nodes, where the count of `to` is `step` above that of `from`.
    fn join(&mut self, from: u32, to: u32, step: i32) {
        let ((from, below), (to, above)) = (self.find(from), self.find(to));
        if from == to {
            return;
        }
        // The step is known between the pixels; the union needs it between the roots.
        let step = below + step - above;
        let (parent, child, step) = if self.sizes[from as usize] >= self.sizes[to as usize] {
            (from, to, step)
        } else {
            (to, from, -step)
        };
        self.nodes[child as usize] = (parent, step);
        self.sizes[parent as usize] += self.sizes[child as usize];
    }
}
