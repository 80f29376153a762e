//! Gradient tree: the tree over each gradient image first, then over the image.
//!
//! With g = M_b(d y) and d x = g + n 2^b, a spanning tree over the pixels of g finds n as
//! `tree` finds k, along edges in the order of `sum_c |M_b(d g_c)|`: exact where *second* differences
//! stay below half a peak. Most gradients are small; they are the sea, one node with n = 0, to
//! which each other gradient has an edge as long as the steepest one nearby, too.
//! The range bounds n as it bounds k. Then `tree` takes the edges in the order of `sum_c |g + n 2^b|`.
//!
//! Slower than `lines`, but an error stays where it is: it bears noise, and edges that end within
//! the image. It fails on edges of a sharp lens and on lines one pixel wide, where second
//! differences wrap as well.

use super::tree::{
    Bounds, Direction, Edge, Grower, LARGE, Region, Regions, Triple, key, read, sort, subtract,
};
use super::wrapped::{raised, size, turns};
use super::{Range, Recovered, Unwrap, UnwrapError, check_frame};
use crate::frame::Frame;

/// Gradients are sea where their sizes, summed over three channels, stay below this
/// (48 of 256 codes) within [`NEARBY`] pixels along the gradient.
const SEA: u32 = 48 << 8;
const NEARBY: usize = 2;

/// The node of the sea.
const SEA_NODE: u32 = 0;

/// The method with its buffers.
#[derive(Default)]
pub struct GradientTree {
    pixels: Vec<[u16; 3]>,
    right: Gradient,
    down: Gradient,
    grower: Grower,
}

impl Unwrap for GradientTree {
    fn name(&self) -> &'static str {
        "gradient_tree"
    }

    fn unwrap(&mut self, y: &Frame, range: Range, out: &mut Recovered) -> Result<(), UnwrapError> {
        check_frame(y, range)?;
        out.prepare(y.dim(), self.name());
        read(y, range, &mut self.pixels);
        let right = self.right.unwrap(&self.pixels, y.width(), Direction::Right, range);
        let down = self.down.unwrap(&self.pixels, y.width(), Direction::Down, range);
        self.grower.grow(&self.pixels, y.width(), range, |direction, pixel| match direction {
            Direction::Right => right[pixel],
            Direction::Down => down[pixel],
        });
        self.grower.place(y, range, out);
        Ok(())
    }
}

/// The gradient in one direction. Everything is as large as the image: at pixel p is the
/// difference to p's neighbour, and none (`sizes` 0) where there is no neighbour.
#[derive(Default)]
struct Gradient {
    /// Raised by half a peak.
    g: Vec<[u16; 3]>,
    /// |g| summed over channels, 2^16 a peak.
    sizes: Vec<u32>,
    /// The node of each pixel; [`SEA_NODE`] for all of the sea.
    nodes: Vec<u32>,
    /// Pixel of node 1, 2, ...
    land: Vec<usize>,
    edges: Vec<Edge>,
    sorted: Vec<Edge>,
    regions: Regions,
    n: Vec<Triple>,
}

impl Gradient {
    /// n at each pixel; 0 for the sea and what could not be joined to it.
    fn unwrap(&mut self, pixels: &[[u16; 3]], width: usize, direction: Direction, range: Range) -> &[Triple] {
        self.differentiate(pixels, width, direction);
        self.find_land(width, direction);
        self.bound(pixels, direction.stride(width), range);
        for here in 0..pixels.len() {
            if direction.reaches(here, width, pixels.len()) {
                self.connect(here, Direction::Right, direction, width);
                self.connect(here, Direction::Down, direction, width);
            }
        }
        sort(&self.edges, 0, &mut self.sorted);
        self.regions.join_all(&self.sorted);
        self.read_off(pixels.len());
        &self.n
    }

    fn differentiate(&mut self, pixels: &[[u16; 3]], width: usize, direction: Direction) {
        let stride = direction.stride(width);
        self.g.clear();
        self.g.resize(pixels.len(), [0; 3]);
        self.sizes.clear();
        self.sizes.resize(pixels.len(), 0);
        for here in 0..pixels.len().saturating_sub(stride) {
            if direction.reaches(here, width, pixels.len()) {
                let (from, to) = (pixels[here], pixels[here + stride]);
                self.g[here] = [0, 1, 2].map(|lane| raised(from[lane], to[lane]));
                self.sizes[here] = self.g[here].iter().map(|&g| u32::from(size(g))).sum();
            }
        }
    }

    /// Numbers the nodes, and ties each to the sea: twice the steepest gradient nearby is how unlikely n = 0 is.
    /// Beside an edge of the image nearby reaches round into the next row, which only makes more land.
    fn find_land(&mut self, width: usize, direction: Direction) {
        let stride = direction.stride(width);
        let count = self.g.len();
        self.nodes.clear();
        self.nodes.resize(count, SEA_NODE);
        self.land.clear();
        self.edges.clear();
        for here in (0..count).filter(|&here| direction.reaches(here, width, count)) {
            let nearby =
                (0..=2 * NEARBY).filter_map(|step| (here + step * stride).checked_sub(NEARBY * stride));
            let steepest = nearby.filter_map(|there| self.sizes.get(there)).max().copied().unwrap_or(0);
            if steepest > SEA {
                self.land.push(here);
                let node = self.land.len() as u32;
                self.nodes[here] = node;
                self.edges.push(Edge { key: key(2 * steepest), from: SEA_NODE, to: node, step: [0; 3] });
            }
        }
    }

    /// Starts the regions. With k at both ends in 0 to `highest`, n = k_to - k_from - turns
    /// has its least and greatest value.
    fn bound(&mut self, pixels: &[[u16; 3]], stride: usize, range: Range) {
        let bounds = Bounds::new(range);
        let sea = Region { low: [0; 3], high: [0; 3], size: LARGE };
        let land = self.land.iter().map(|&here| {
            let (from, to) = (pixels[here], pixels[here + stride]);
            let turns = [0, 1, 2].map(|lane| turns(from[lane], to[lane]));
            let low = subtract(subtract([0; 3], bounds.highest(from)), turns);
            Region { low, high: subtract(bounds.highest(to), turns), size: 1 }
        });
        self.regions.reset(std::iter::once(sea).chain(land));
    }

    /// An edge from the gradient at `here` to the next one `along`, unless both are sea or there is none.
    fn connect(&mut self, here: usize, along: Direction, direction: Direction, width: usize) {
        let count = self.g.len();
        let there = here + along.stride(width);
        if !along.reaches(here, width, count) || !direction.reaches(there, width, count) {
            return;
        }
        let ends = [here, there].map(|pixel| (self.nodes[pixel], self.g[pixel]));
        if ends[0].0 != ends[1].0 {
            self.edges.push(Edge::between(ends[0], ends[1], [0; 3]));
        }
    }

    fn read_off(&mut self, count: usize) {
        self.n.clear();
        self.n.resize(count, [0; 3]);
        let (sea, level) = self.regions.find(SEA_NODE);
        for (node, &pixel) in (1..).zip(&self.land) {
            let (root, offset) = self.regions.find(node);
            if root == sea {
                self.n[pixel] = subtract(offset, level);
            }
        }
    }
}
