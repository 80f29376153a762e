//! Regions over a grid of pixels, grown along its edges from the flattest on (Kruskal).
//!
//! 1. Segments: neighbours along a row between which the change is flat and the count the same are one node
//!    from the start, and flat edges join segments along rows and between them, in the order of the image.
//! 2. Of the edges left between two segments that touch, the flattest are sorted by key, and join in that order.
//!    They are noted down as edges between regions, with the step between their roots: in the order of keys
//!    they jump about, and an image is too large for that.
//!
//! What is not known of a pixel is never stored by pixel: most of an image is long segments.

use std::ops::Range;

use super::order::{Edge, Order};
use super::pixels::{Direction, Quad, add, subtract};
use super::regions::{Coarse, LARGE, Region, Regions};
use super::segments::{Segment, each_contact, each_set};

/// The node of all that is sea; no region of the others knows of it unless it is joined.
pub(in crate::unwrap) const SEA: u32 = 0;

/// The edges of a ground, by pixel, to the right neighbour and to the one below.
#[derive(Clone, Copy)]
pub(in crate::unwrap) struct Edges<'a> {
    /// How much changes to the neighbour.
    pub keys: [&'a [u16]; 2],
    /// 1 where the edge is not flat or the count changes, else 0. To the right it is 1 at the shore and 0 in the sea.
    pub breaks: [&'a [u8]; 2],
}

/// What a forest grows over: values that are known but for whole peaks.
pub(in crate::unwrap) trait Ground {
    /// Columns of the image; pixel p's lower neighbour is p + width.
    fn width(&self) -> usize;
    /// Rows and columns that have a value.
    fn extent(&self) -> (usize, usize);
    /// Edges up to this key are flat.
    fn flat(&self) -> u16;
    /// Its edges.
    fn edges(&self) -> &Edges<'_>;
    /// By pixel, 0 in the sea, which has count 0; `None`: there is no sea.
    fn land(&self) -> Option<&[u8]>;
    /// The key at which a pixel on land is tied to the sea.
    fn tie(&self, at: usize) -> u16;
    /// Which counts the pixels may have if they have one: the first of `pixels` for which there is one.
    fn interval(&self, pixels: Range<usize>) -> Region;
    /// By how much the count changes to the neighbour.
    fn step(&self, to: Direction, at: usize) -> Quad;

    /// [`Edges::breaks`] to the neighbours in one direction.
    #[inline(always)]
    fn breaks(&self, to: Direction) -> &[u8] {
        self.edges().breaks[to as usize]
    }

    /// [`Edges::keys`] of one edge.
    #[inline(always)]
    fn key(&self, to: Direction, at: usize) -> u16 {
        self.edges().keys[to as usize][at]
    }
}

/// The regions, and which pixels are in them.
#[derive(Default)]
pub(in crate::unwrap) struct Forest {
    pub regions: Regions,
    /// Row by row; each has a node of its own unless it is sea.
    pub segments: Vec<Segment>,
    /// The first segment of each row, and the end of the last.
    rows: Vec<usize>,
    order: Order,
    /// The regions that flat edges leave.
    coarse: Coarse,
    /// A buffer for who reads off the result.
    pub levels: Vec<usize>,
}

impl Forest {
    /// Joins what can be joined.
    pub fn grow<G: Ground>(&mut self, ground: &G) {
        let (rows, columns) = ground.extent();
        self.make_room((rows, columns));
        self.rows.push(0);
        let (level, size) = ([0; 4], if ground.land().is_some() { LARGE } else { 0 });
        self.regions.push(Region { low: level, high: level, size });
        for row in (0..rows).filter(|_| columns > 0) {
            self.split(ground, row * ground.width(), columns);
            self.rows.push(self.segments.len());
            self.join_along(ground, row);
            if row > 0 {
                self.join_to_row_above(ground, row);
            }
        }
        self.regions.flatten();
        self.coarse.condense(&self.regions);
        self.collect(ground);
        let Self { coarse, order, .. } = self;
        order.each(ground.flat(), |edge| coarse.join(edge.from, edge.to, || edge.step()));
        self.coarse.refine(&mut self.regions);
    }

    /// For the most that images of this size can need, so that no later one needs more; what is not used of it is
    /// never touched.
    pub fn make_room(&mut self, (rows, columns): (usize, usize)) {
        let pixels = rows * columns;
        self.regions.clear();
        self.segments.clear();
        self.rows.clear();
        self.regions.reserve(pixels + 1);
        self.segments.reserve(pixels);
        self.rows.reserve(rows + 1);
        self.coarse.reserve(pixels + 1);
        // To the right, down, and to the sea.
        self.order.start(3 * pixels);
        self.levels.clear();
        self.levels.reserve(1 << i16::BITS);
    }

    /// The segments of the row that starts at `start`.
    fn split<G: Ground>(&mut self, ground: &G, start: usize, columns: usize) {
        let mut from = start;
        let end = start + columns;
        each_set(&ground.breaks(Direction::Right)[start..end - 1], |column| {
            self.push(ground, from..start + column + 1);
            from = start + column + 1;
        });
        self.push(ground, from..end);
    }

    #[inline(always)]
    fn push<G: Ground>(&mut self, ground: &G, pixels: Range<usize>) {
        let (mut start, end) = (pixels.start, pixels.end);
        if ground.land().is_some_and(|land| land[start] == 0) {
            self.segments.push(Segment { start: start as u32, end: end as u32, node: SEA });
            return;
        }
        while start < end {
            let region = ground.interval(start..end);
            let next = start + region.size as usize;
            let node = self.regions.push(region);
            self.segments.push(Segment { start: start as u32, end: next as u32, node });
            start = next;
        }
    }

    fn join_along<G: Ground>(&mut self, ground: &G, row: usize) {
        for pair in self.segments[self.rows[row]..self.rows[row + 1]].windows(2) {
            let at = pair[0].end as usize - 1;
            let land = pair[0].node != SEA && pair[1].node != SEA;
            if land && ground.key(Direction::Right, at) <= ground.flat() {
                self.regions.join(pair[0].node, pair[1].node, || ground.step(Direction::Right, at));
            }
        }
    }

    fn join_to_row_above<G: Ground>(&mut self, ground: &G, row: usize) {
        let Self { regions, segments, rows, .. } = self;
        let [above, below] = [row - 1, row].map(|row| &segments[rows[row]..rows[row + 1]]);
        let breaks = ground.breaks(Direction::Down);
        each_contact(above, below, ground.width(), |a, b, mut pixels| {
            if a.node == SEA || b.node == SEA {
                return;
            }
            if breaks[pixels.clone()].contains(&0) {
                regions.join(a.node, b.node, || [0; 4]);
            } else if let Some(at) = pixels.find(|&at| ground.key(Direction::Down, at) <= ground.flat()) {
                regions.join(a.node, b.node, || ground.step(Direction::Down, at));
            }
        });
    }

    /// The flattest edge of each contact of different regions, and each segment's shortest tie to the sea.
    fn collect<G: Ground>(&mut self, ground: &G) {
        let Self { regions, segments, rows, order, coarse, .. } = self;
        let differ = |a: &Segment, b: &Segment| regions.root(a.node) != regions.root(b.node);
        let edge = |key, from: u32, to: u32, step: Quad| {
            let step = subtract(add(regions.above_root(from), step), regions.above_root(to));
            Edge::new(key, coarse.node(regions.root(from)), coarse.node(regions.root(to)), step)
        };
        for row in 1..rows.len() {
            let here = &segments[rows[row - 1]..rows[row]];
            for pair in here.windows(2).filter(|pair| differ(&pair[0], &pair[1])) {
                let at = pair[0].end as usize - 1;
                let (key, step) = (ground.key(Direction::Right, at), ground.step(Direction::Right, at));
                order.push(edge(key, pair[0].node, pair[1].node, step));
            }
            let below = rows.get(row + 1).map_or(&[][..], |&end| &segments[rows[row]..end]);
            each_contact(here, below, ground.width(), |a, b, pixels| {
                if differ(a, b) {
                    let flattest = pixels.map(|at| (ground.key(Direction::Down, at), at)).min();
                    if let Some((key, at)) = flattest {
                        order.push(edge(key, a.node, b.node, ground.step(Direction::Down, at)));
                    }
                }
            });
            for segment in here.iter().filter(|segment| segment.node != SEA && ground.land().is_some()) {
                if let Some(key) = segment.pixels().map(|at| ground.tie(at)).min() {
                    order.push(edge(key, SEA, segment.node, [0; 4]));
                }
            }
        }
    }
}
