//! A spanning forest over a grid of pixels, grown along its edges from the flattest on (Kruskal).
//!
//! 1. Segments: neighbours along a row with a flat change and the same count are one node from the start, and
//!    flat edges join segments along rows and between them, in the order of the image.
//! 2. For each pair of segments that touch and are not joined, the flattest edge is offered. The offers between regions are
//!    sorted by key, and join in that order. They are stored with the step between the roots of the regions: the
//!    order of keys jumps over the image, which is too large for the cache.
//!
//! Nothing is stored by pixel, because most of an image is long segments.

use std::ops::Range;

use super::pixels::{EdgeDirection, Quad};
use super::regions::{CondensedRegions, LARGE, Region, RegionEdge, Regions};
use super::segments::{Segment, each_contact, each_set};

/// The node of the background; edges join the other regions to it.
pub(in crate::unwrap) const BACKGROUND: u32 = 0;

/// The edges of a source, by pixel, to the right neighbour and to the one below.
#[derive(Clone, Copy)]
pub(in crate::unwrap) struct Edges<'a> {
    /// The keys, which measure the change to the neighbour.
    pub keys: [&'a [u16]; 2],
    /// 1 where the edge is not flat or the count changes, else 0. To the right it is 1 at the border of the
    /// background and 0 in it.
    pub breaks: [&'a [u8]; 2],
}

/// The values that a forest grows over, which are known up to multiples of the peak.
pub(in crate::unwrap) trait EdgeSource {
    /// Returns the columns of the image; the lower neighbour of pixel p is p + width.
    fn width(&self) -> usize;
    /// Returns the rows and columns that have a value.
    fn extent(&self) -> (usize, usize);
    /// The largest key of a flat edge.
    const FLAT: u16;
    /// Returns the edges.
    fn edges(&self) -> &Edges<'_>;
    /// Returns a mask by pixel, 0 in the background, whose count is 0; `None` if there is no background.
    fn mask(&self) -> Option<&[u8]>;
    /// Returns the key of the edge from a pixel outside the background to the background.
    fn background_key(&self, at: usize) -> u16;
    /// Returns the interval of the counts of the first of `pixels` that can have one count together.
    fn interval(&self, pixels: Range<usize>) -> Region;
    /// Returns the change of the count to the neighbour.
    fn step(&self, to: EdgeDirection, at: usize) -> Quad;

    /// Returns the [`Edges::breaks`] in one direction.
    #[inline(always)]
    fn breaks(&self, to: EdgeDirection) -> &[u8] {
        self.edges().breaks[to as usize]
    }

    /// Returns the [`Edges::keys`] of one edge.
    #[inline(always)]
    fn key(&self, to: EdgeDirection, at: usize) -> u16 {
        self.edges().keys[to as usize][at]
    }
}

/// The regions, and the pixels in them.
#[derive(Default)]
pub(in crate::unwrap) struct Forest {
    pub regions: Regions,
    /// The segments row by row; each has a node of its own unless it is background.
    pub segments: Vec<Segment>,
    queue: EdgeQueue,
    /// The regions after the flat edges.
    condensed: CondensedRegions,
    /// A buffer for those who read the result.
    pub levels: Vec<usize>,
}

impl Forest {
    /// Joins all regions that can be joined.
    pub fn grow<G: EdgeSource>(&mut self, source: &G) {
        let (rows, columns) = source.extent();
        self.make_room((rows, columns));
        // The background counts as large, so that hot pixels cannot constrain it.
        let (level, size) = ([0; 4], if source.mask().is_some() { LARGE } else { 0 });
        self.regions.push(Region { low: level, high: level, size });
        let mut above = 0..0;
        for row in (0..rows).filter(|_| columns > 0) {
            let first = self.segments.len();
            self.split(source, row * source.width(), columns);
            let here = first..self.segments.len();
            self.join_along(source, here.clone());
            self.join_rows(source, above.clone(), here.clone());
            self.offer_background(source, above);
            self.offer_along(source, here.clone());
            above = here;
        }
        self.offer_background(source, above);
        // Flat edges need no order among themselves; only the regions that they leave are sorted.
        self.regions.flatten();
        let Self { condensed, queue, .. } = self;
        condensed.condense(&self.regions, &mut queue.edges);
        condensed.join_in_order(queue.sort(G::FLAT));
        self.condensed.refine(&mut self.regions);
    }

    /// Reserves the most memory that images of this size can need, so that no later image needs more; unused
    /// parts are never touched.
    pub fn make_room(&mut self, (rows, columns): (usize, usize)) {
        let pixels = rows * columns;
        self.regions.clear();
        self.segments.clear();
        self.regions.reserve(pixels + 1);
        self.segments.reserve(pixels);
        self.condensed.reserve(pixels + 1);
        // One edge to the right, one down, and one to the background for each pixel.
        self.queue.start(3 * pixels);
        self.levels.clear();
        self.levels.reserve(4 << i16::BITS);
    }

    /// Finds the segments of the row that starts at `start`.
    fn split<G: EdgeSource>(&mut self, source: &G, start: usize, columns: usize) {
        let mut from = start;
        let end = start + columns;
        // The last pixel of a row has no right neighbour.
        each_set(&source.breaks(EdgeDirection::Right)[start..end - 1], |column| {
            self.push(source, from..start + column + 1);
            from = start + column + 1;
        });
        self.push(source, from..end);
    }

    #[inline(always)]
    fn push<G: EdgeSource>(&mut self, source: &G, pixels: Range<usize>) {
        let (mut start, end) = (pixels.start, pixels.end);
        if source.mask().is_some_and(|mask| mask[start] == 0) {
            self.segments.push(Segment { start: start as u32, end: end as u32, node: BACKGROUND });
            return;
        }
        // The range may forbid one count for all pixels of a segment, which then becomes several.
        while start < end {
            let region = source.interval(start..end);
            let next = start + region.size as usize;
            let node = self.regions.push(region);
            self.segments.push(Segment { start: start as u32, end: next as u32, node });
            start = next;
        }
    }

    fn join_along<G: EdgeSource>(&mut self, source: &G, row: Range<usize>) {
        for pair in self.segments[row].windows(2) {
            let at = pair[0].end as usize - 1;
            let joinable = pair[0].node != BACKGROUND && pair[1].node != BACKGROUND;
            if joinable && source.key(EdgeDirection::Right, at) <= G::FLAT {
                self.regions.join(pair[0].node, pair[1].node, || source.step(EdgeDirection::Right, at));
            }
        }
    }

    /// Joins the segments of two rows that touch along a flat edge, and offers the flattest edge of other contacts.
    fn join_rows<G: EdgeSource>(&mut self, source: &G, above: Range<usize>, below: Range<usize>) {
        let Self { regions, segments, queue, .. } = self;
        let breaks = source.breaks(EdgeDirection::Down);
        each_contact(&segments[above], &segments[below], source.width(), |a, b, pixels| {
            // Only segments of the background share a node.
            if a.node == b.node {
                return;
            }
            let joinable = a.node != BACKGROUND && b.node != BACKGROUND;
            let is_flat = |&at: &usize| source.key(EdgeDirection::Down, at) <= G::FLAT;
            // An edge that is not broken joins equal counts, and one such edge is enough for the whole contact.
            let joined = if joinable && breaks[pixels.clone()].contains(&0) {
                regions.join(a.node, b.node, || [0; 4])
            } else if let Some(at) = pixels.clone().find(is_flat).filter(|_| joinable) {
                regions.join(a.node, b.node, || source.step(EdgeDirection::Down, at))
            } else {
                false
            };
            let flattest = || pixels.map(|at| (source.key(EdgeDirection::Down, at), at)).min();
            if let Some((key, at)) = (!joined).then(flattest).flatten() {
                queue.push(RegionEdge::new(key, a.node, b.node, source.step(EdgeDirection::Down, at)));
            }
        });
    }

    /// Offers the edges along a row.
    fn offer_along<G: EdgeSource>(&mut self, source: &G, row: Range<usize>) {
        for pair in self.segments[row].windows(2) {
            let at = pair[0].end as usize - 1;
            let (key, step) = (source.key(EdgeDirection::Right, at), source.step(EdgeDirection::Right, at));
            self.queue.push(RegionEdge::new(key, pair[0].node, pair[1].node, step));
        }
    }

    /// Offers the flattest edge of each segment of a row to the background.
    fn offer_background<G: EdgeSource>(&mut self, source: &G, row: Range<usize>) {
        if source.mask().is_none() {
            return;
        }
        for segment in self.segments[row].iter().filter(|segment| segment.node != BACKGROUND) {
            // The flattest pixel of a segment is the most likely one to continue the background.
            if let Some(key) = segment.pixels().map(|at| source.background_key(at)).min() {
                self.queue.push(RegionEdge::new(key, BACKGROUND, segment.node, [0; 4]));
            }
        }
    }
}

/// The bits of a key that the order ignores: keys of one bucket, 1/512 of a peak, count as equal.
const SHIFT: u32 = 5;
const BUCKETS: usize = (u16::MAX >> SHIFT) as usize + 1;

/// The edges that are to be sorted by their keys, by a counting sort.
#[derive(Default)]
struct EdgeQueue {
    edges: Vec<RegionEdge>,
    sorted: Vec<RegionEdge>,
    /// The position of the next edge of each bucket.
    next: Vec<u32>,
}

impl EdgeQueue {
    /// Starts anew with room for `count` edges.
    pub fn start(&mut self, count: usize) {
        self.edges.clear();
        self.edges.reserve(count);
        self.sorted.reserve(count.saturating_sub(self.sorted.len()));
        self.next.resize(BUCKETS + 1, 0);
    }

    #[inline(always)]
    pub fn push(&mut self, edge: RegionEdge) {
        self.edges.push(edge);
    }

    /// Returns the edges by key, those of one bucket in the order in which they came; all keys up to `flat` share
    /// one bucket.
    pub fn sort(&mut self, flat: u16) -> &mut [RegionEdge] {
        let Self { edges, sorted, next } = self;
        let bucket = |edge: &RegionEdge| usize::from(edge.key().max(flat) >> SHIFT);
        // A counting sort is linear and stable: edges of one bucket stay in the order of the image.
        next.fill(0);
        edges.iter().for_each(|edge| next[bucket(edge) + 1] += 1);
        for i in 1..next.len() {
            next[i] += next[i - 1];
        }
        sorted.resize(edges.len(), RegionEdge::default());
        for edge in &*edges {
            let place = &mut next[bucket(edge)];
            sorted[*place as usize] = *edge;
            *place += 1;
        }
        sorted
    }
}
