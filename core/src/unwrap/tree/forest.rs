//! Regions over a grid of pixels, grown along its edges from the flattest on (Kruskal).
//!
//! 1. Runs: flat neighbours along a row are one node from the start, and flat edges join runs of
//!    neighbouring rows, in the order of the image.
//! 2. What edges are left between regions are sorted by key, and join in that order.

use super::order::{Edge, Kind, Order};
use super::pixels::{Direction, Quad, add, subtract};
use super::regions::{LARGE, Region, Regions};

/// The node of all that is sea; no region of the others knows of it unless it is joined.
pub(in crate::unwrap) const SEA: u32 = 0;

/// What a forest grows over: values that are known but for whole peaks.
pub(in crate::unwrap) trait Ground {
    /// Columns of the image; pixel p's lower neighbour is p + width.
    fn width(&self) -> usize;
    /// Rows and columns that have a value.
    fn extent(&self) -> (usize, usize);
    /// Edges up to this key are flat.
    fn flat(&self) -> u16;
    /// The key at which a pixel is tied to the sea, which has 0; `None`: it is sea itself.
    fn tie(&self, at: usize) -> Option<u16>;
    /// Which counts the pixel may have.
    fn interval(&self, at: usize) -> (Quad, Quad);
    /// How much changes to the neighbour.
    fn key(&self, to: Direction, at: usize) -> u16;
    /// By how much the count changes to the neighbour.
    fn step(&self, to: Direction, at: usize) -> Quad;
    /// Whether there is a sea.
    fn has_sea(&self) -> bool;
}

/// The regions, and each pixel's place in them.
#[derive(Default)]
pub(in crate::unwrap) struct Forest {
    pub regions: Regions,
    /// The node of each pixel.
    pub run_of: Vec<u32>,
    /// Each pixel's count minus its node's.
    pub offset: Vec<Quad>,
    order: Order,
}

impl Forest {
    /// Joins what can be joined.
    pub fn grow<G: Ground>(&mut self, ground: &G) {
        let (rows, _) = ground.extent();
        self.regions.clear();
        let level = [0; 4];
        self.regions.push(Region { low: level, high: level, size: if ground.has_sea() { LARGE } else { 0 } });
        // What is not reached below is never read.
        self.run_of.resize(ground.width() * rows, SEA);
        self.offset.resize(ground.width() * rows, [0; 4]);
        for row in 0..rows {
            self.run_along(ground, row);
            if row > 0 {
                self.join_to_row_above(ground, row);
            }
        }
        self.regions.flatten();
        self.collect(ground);
        self.join_in_order(ground);
    }

    fn run_along<G: Ground>(&mut self, ground: &G, row: usize) {
        let (_, columns) = ground.extent();
        let start = row * ground.width();
        let mut current: Option<(u32, Region, Quad)> = None;
        for at in start..start + columns {
            if ground.tie(at).is_none() && ground.has_sea() {
                self.finish(&mut current);
                self.run_of[at] = SEA;
                self.offset[at] = [0; 4];
                continue;
            }
            let (low, high) = ground.interval(at);
            let pixel = Region { low, high, size: 1 };
            let longer = current.filter(|_| ground.key(Direction::Right, at - 1) <= ground.flat()).and_then(
                |(run, region, offset)| {
                    let offset = add(offset, ground.step(Direction::Right, at - 1));
                    region.and(&pixel, offset).map(|region| (run, region, offset))
                },
            );
            let longer = longer.unwrap_or_else(|| {
                self.finish(&mut current);
                (self.regions.push(pixel), pixel, [0; 4])
            });
            (self.run_of[at], self.offset[at]) = (longer.0, longer.2);
            current = Some(longer);
        }
        self.finish(&mut current);
    }

    fn finish(&mut self, current: &mut Option<(u32, Region, Quad)>) {
        if let Some((run, region, _)) = current.take() {
            self.regions.set(run, region);
        }
    }

    fn join_to_row_above<G: Ground>(&mut self, ground: &G, row: usize) {
        let (_, columns) = ground.extent();
        let start = row * ground.width();
        let mut last = (SEA, SEA);
        for below in start..start + columns {
            let above = below - ground.width();
            let pair = (self.run_of[above], self.run_of[below]);
            let land = pair.0 != SEA && pair.1 != SEA;
            if pair != last && land && ground.key(Direction::Down, above) <= ground.flat() {
                last = pair;
                self.join(ground, Direction::Down, above, below);
            }
        }
    }

    #[inline(always)]
    fn join<G: Ground>(&mut self, ground: &G, direction: Direction, from: usize, to: usize) {
        let (below, above) = (self.offset[from], self.offset[to]);
        let step = || subtract(add(below, ground.step(direction, from)), above);
        self.regions.join(self.run_of[from], self.run_of[to], step);
    }

    /// Edges between different regions, and each run's shortest tie to the sea.
    fn collect<G: Ground>(&mut self, ground: &G) {
        let (rows, columns) = ground.extent();
        self.order.clear();
        for row in 0..rows {
            let start = row * ground.width();
            let mut tie: Option<(u16, usize)> = None;
            for at in start..start + columns {
                let last = at + 1 == start + columns;
                if !last {
                    self.push_between(ground, Direction::Right, at, at + 1);
                }
                if row + 1 < rows {
                    self.push_between(ground, Direction::Down, at, at + ground.width());
                }
                if let Some(key) = ground.tie(at) {
                    tie = tie.filter(|&(least, _)| least <= key).or(Some((key, at)));
                    if last || self.run_of[at + 1] != self.run_of[at] {
                        tie.take().into_iter().for_each(|(key, at)| self.push(key, Kind::Tie, at));
                    }
                }
            }
        }
    }

    #[inline(always)]
    fn push_between<G: Ground>(&mut self, ground: &G, direction: Direction, from: usize, to: usize) {
        let (a, b) = (self.run_of[from], self.run_of[to]);
        if a != b && self.regions.root(a) != self.regions.root(b) {
            let kind = if direction == Direction::Right { Kind::Right } else { Kind::Down };
            self.push(ground.key(direction, from), kind, from);
        }
    }

    fn push(&mut self, key: u16, kind: Kind, at: usize) {
        self.order.push(Edge { key, kind, at: at as u32 });
    }

    fn join_in_order<G: Ground>(&mut self, ground: &G) {
        let mut order = std::mem::take(&mut self.order);
        order.each(ground.flat(), |edge| {
            let at = edge.at as usize;
            match edge.kind {
                Kind::Right => self.join(ground, Direction::Right, at, at + 1),
                Kind::Down => self.join(ground, Direction::Down, at, at + ground.width()),
                Kind::Tie => {
                    let offset = self.offset[at];
                    self.regions.join(SEA, self.run_of[at], || subtract([0; 4], offset));
                }
            }
        });
        self.order = order;
    }
}
