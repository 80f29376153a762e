//! A spanning forest over a grid of pixels, grown along its edges from the flattest on (Kruskal).
//!
//! 1. Segments: neighbours along a row with a flat change and the same count are one node from the start, and
//!    flat edges join segments along rows and between them, in the order of the image.
//! 2. For each pair of segments that touch and are not joined, the flattest edge is sorted by key, and these
//!    edges join in that order. They are stored as edges between regions, with the step between their roots: the
//!    order of keys jumps over the image, which is too large for the cache.
//!
//! Nothing is stored by pixel, because most of an image is long segments.

use std::ops::Range;

use super::pixels::{EdgeDirection, Quad, add, subtract};
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
    /// The first segment of each row, and the end of the last.
    rows: Vec<usize>,
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
        self.rows.push(0);
        // The background counts as large, so that hot pixels cannot constrain it.
        let (level, size) = ([0; 4], if source.mask().is_some() { LARGE } else { 0 });
        self.regions.push(Region { low: level, high: level, size });
        for row in (0..rows).filter(|_| columns > 0) {
            self.split(source, row * source.width(), columns);
            self.rows.push(self.segments.len());
            self.join_along(source, row);
            if row > 0 {
                self.join_to_row_above(source, row);
            }
        }
        // Flat edges need no order among themselves; only the regions that they leave are sorted.
        self.regions.flatten();
        self.condensed.condense(&self.regions);
        self.collect(source);
        let Self { condensed, queue, .. } = self;
        condensed.join_in_order(queue.sort(G::FLAT));
        self.condensed.refine(&mut self.regions);
    }

    /// Reserves the most memory that images of this size can need, so that no later image needs more; unused
    /// parts are never touched.
    pub fn make_room(&mut self, (rows, columns): (usize, usize)) {
        let pixels = rows * columns;
        self.regions.clear();
        self.segments.clear();
        self.rows.clear();
        self.regions.reserve(pixels + 1);
        self.segments.reserve(pixels);
        self.rows.reserve(rows + 1);
        self.condensed.reserve(pixels + 1);
        // One edge to the right, one down, and one to the background for each pixel.
        self.queue.start(3 * pixels);
        self.levels.clear();
        self.levels.reserve(1 << i16::BITS);
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

    fn join_along<G: EdgeSource>(&mut self, source: &G, row: usize) {
        for pair in self.segments[self.rows[row]..self.rows[row + 1]].windows(2) {
            let at = pair[0].end as usize - 1;
            let joinable = pair[0].node != BACKGROUND && pair[1].node != BACKGROUND;
            if joinable && source.key(EdgeDirection::Right, at) <= G::FLAT {
                self.regions.join(pair[0].node, pair[1].node, || source.step(EdgeDirection::Right, at));
            }
        }
    }

    fn join_to_row_above<G: EdgeSource>(&mut self, source: &G, row: usize) {
        let Self { regions, segments, rows, .. } = self;
        let [above, below] = [row - 1, row].map(|row| &segments[rows[row]..rows[row + 1]]);
        let breaks = source.breaks(EdgeDirection::Down);
        each_contact(above, below, source.width(), |a, b, mut pixels| {
            if a.node == BACKGROUND || b.node == BACKGROUND {
                return;
            }
            // An edge that is not broken joins equal counts, and one such edge is enough for the whole contact.
            if breaks[pixels.clone()].contains(&0) {
                regions.join(a.node, b.node, || [0; 4]);
            } else if let Some(at) = pixels.find(|&at| source.key(EdgeDirection::Down, at) <= G::FLAT) {
                regions.join(a.node, b.node, || source.step(EdgeDirection::Down, at));
            }
        });
    }

    /// Collects the flattest edge of each contact of different regions, and the flattest edge of each segment to
    /// the background.
    fn collect<G: EdgeSource>(&mut self, source: &G) {
        let Self { regions, segments, rows, queue, condensed, .. } = self;
        let differ = |a: &Segment, b: &Segment| regions.root(a.node) != regions.root(b.node);
        let edge = |key, from: u32, to: u32, step: Quad| {
            // Stored between the roots, the step stays valid when regions are condensed to nodes.
            let step = subtract(add(regions.offset_from_root(from), step), regions.offset_from_root(to));
            RegionEdge::new(key, condensed.node(regions.root(from)), condensed.node(regions.root(to)), step)
        };
        for row in 1..rows.len() {
            let here = &segments[rows[row - 1]..rows[row]];
            for pair in here.windows(2).filter(|pair| differ(&pair[0], &pair[1])) {
                let at = pair[0].end as usize - 1;
                let (key, step) =
                    (source.key(EdgeDirection::Right, at), source.step(EdgeDirection::Right, at));
                queue.push(edge(key, pair[0].node, pair[1].node, step));
            }
            let below = rows.get(row + 1).map_or(&[][..], |&end| &segments[rows[row]..end]);
            each_contact(here, below, source.width(), |a, b, pixels| {
                if differ(a, b) {
                    let flattest = pixels.map(|at| (source.key(EdgeDirection::Down, at), at)).min();
                    if let Some((key, at)) = flattest {
                        queue.push(edge(key, a.node, b.node, source.step(EdgeDirection::Down, at)));
                    }
                }
            });
            for segment in here.iter().filter(|segment| segment.node != BACKGROUND && source.mask().is_some())
            {
                // The flattest pixel of a segment is the most likely one to continue the background.
                if let Some(key) = segment.pixels().map(|at| source.background_key(at)).min() {
                    queue.push(edge(key, BACKGROUND, segment.node, [0; 4]));
                }
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
