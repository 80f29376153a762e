//! Tree: Itoh's steps along a spanning tree that takes the flattest edges first,
//! all channels at once, and nothing that leaves the range.
//!
//! Edges between 4-neighbours are taken in the order of `sum_c |M_b(d y_c)|` (Kruskal);
//! along an edge `d k = (M_b(d y) - d y) / 2^b`. Each region knows the interval in which
//! `0 <= y + k 2^b < alpha 2^b` leaves its k; a merge that would empty it is refused.
//!
//! Exact when first differences stay below half a peak along some path to every pixel, and
//! that path is flatter than any that is wrong: an accident of `M_b(d y)` near 0 has to happen in
//! three channels at once. It fails on islands, whose whole contour jumps by more than half
//! a peak. The offset of a region that stays apart is the least that its interval allows.

mod edges;
mod pixels;
mod regions;

pub(super) use edges::{Direction, Edge, key, sort};
pub(super) use pixels::{Bounds, read};
pub(super) use regions::{LARGE, Region, Regions, Triple, subtract};

use super::{Range, Recovered, Unwrap, UnwrapError, check_frame, congruence};
use crate::frame::Frame;
use crate::plane;

/// Keys up to this, 24 of 256 codes summed over three channels, are as good as flat.
const FLAT: u16 = 48;

/// The method with its buffers.
#[derive(Default)]
pub struct Tree {
    pixels: Vec<[u16; 3]>,
    grower: Grower,
}

impl Unwrap for Tree {
    fn name(&self) -> &'static str {
        "tree"
    }

    fn unwrap(&mut self, y: &Frame, range: Range, out: &mut Recovered) -> Result<(), UnwrapError> {
        check_frame(y, range)?;
        out.prepare(y.dim(), self.name());
        read(y, range, &mut self.pixels);
        self.grower.grow(&self.pixels, y.width(), range, |_, _| [0; 3]);
        self.grower.place(y, range, out);
        Ok(())
    }
}

/// Grows the tree over an image.
#[derive(Default)]
pub(super) struct Grower {
    edges: Vec<Edge>,
    sorted: Vec<Edge>,
    regions: Regions,
    y: Vec<f32>,
}

impl Grower {
    /// Joins what can be joined; the difference from pixel p to its neighbour is
    /// `M_b(d y) + n(direction, p) * 2^b`.
    pub fn grow(
        &mut self,
        pixels: &[[u16; 3]],
        width: usize,
        range: Range,
        n: impl Fn(Direction, usize) -> Triple,
    ) {
        let bounds = Bounds::new(range);
        self.regions.reset(pixels.iter().map(|&p| Region { low: [0; 3], high: bounds.highest(p), size: 1 }));
        self.edges.clear();
        for here in 0..pixels.len() {
            for direction in [Direction::Right, Direction::Down] {
                if direction.reaches(here, width, pixels.len()) {
                    let there = here + direction.stride(width);
                    let [from, to] = [here, there].map(|index| (index as u32, pixels[index]));
                    self.edges.push(Edge::between(from, to, n(direction, here)));
                }
            }
        }
        sort(&self.edges, FLAT, &mut self.sorted);
        self.regions.join_all(&self.sorted);
    }

    /// Writes `out`: the largest region at the offset that keeps it in range, others at their least.
    pub fn place(&mut self, y: &Frame, range: Range, out: &mut Recovered) {
        let (height, width, channels) = y.dim();
        let main = self.regions.largest();
        let found: Vec<_> = (0..(height * width) as u32).map(|node| self.regions.find(node)).collect();
        let most = i32::from(range.most_wraps());
        for channel in 0..channels {
            let of_main = found.iter().filter(|(root, _)| *root == main);
            let k: Vec<i32> = of_main.map(|(_, offset)| i32::from(offset[channel])).collect();
            let zero = congruence::zero_level(&k, most);
            let least = |root| {
                if root == main { 0 } else { i32::from(self.regions.region(root).low[channel]) + zero }
            };
            let k: Vec<i32> =
                found.iter().map(|&(root, offset)| i32::from(offset[channel]) + least(root)).collect();
            plane::take_from_frame(y, channel, &mut self.y);
            congruence::place_at(zero, &k, &self.y, range, channel, out);
        }
    }
}
