//! Sorts edges by their keys: a counting sort.

use super::pixels::Quad;

/// The bits of a key that the order ignores: keys of one bucket, 1/512 of a peak, count as equal.
const SHIFT: u32 = 5;
const BUCKETS: usize = (u16::MAX >> SHIFT) as usize + 1;

/// An edge from region to region, by number.
#[derive(Clone, Copy)]
pub(super) struct RegionEdge {
    pub from: u32,
    pub to: u32,
    /// The value of the root of `to` minus that of the root of `from`.
    step: [i16; 3],
    key: u16,
}

impl RegionEdge {
    pub fn new(key: u16, from: u32, to: u32, [r, g, b, _]: Quad) -> Self {
        Self { from, to, step: [r, g, b], key }
    }

    #[inline(always)]
    pub fn step(&self) -> Quad {
        let [r, g, b] = self.step;
        [r, g, b, 0]
    }
}

/// The edges that are to be sorted.
#[derive(Default)]
pub(super) struct EdgeQueue {
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

    /// Visits the edges by key, those of one bucket in the order in which they came; all keys up to `flat` share
    /// one bucket.
    #[inline(always)]
    pub fn visit_sorted(&mut self, flat: u16, visit: impl FnMut(&RegionEdge)) {
        let Self { edges, sorted, next } = self;
        let Some(&filler) = edges.first() else { return };
        let bucket = |edge: &RegionEdge| usize::from(edge.key.max(flat) >> SHIFT);
        // A counting sort is linear and stable: edges of one bucket stay in the order of the image.
        next.fill(0);
        edges.iter().for_each(|edge| next[bucket(edge) + 1] += 1);
        for i in 1..next.len() {
            next[i] += next[i - 1];
        }
        sorted.resize(edges.len(), filler);
        for edge in &*edges {
            let place = &mut next[bucket(edge)];
            sorted[*place as usize] = *edge;
            *place += 1;
        }
        sorted.iter().for_each(visit);
    }
}
