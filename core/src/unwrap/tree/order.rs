//! Edges in the order of their keys: a counting sort.

use super::forest::SEA;
use super::segments::Segment;

/// Keys of one bucket count as equal: 1/512 of a peak.
const SHIFT: u32 = 5;
const BUCKETS: usize = (u16::MAX >> SHIFT) as usize + 1;

/// What an edge ties together.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Kind {
    /// A pixel and its right neighbour.
    Right,
    /// A pixel and the one below it.
    Down,
    /// The sea and a pixel.
    Tie,
}

/// From the pixel `at`; from node to node.
#[derive(Clone, Copy)]
pub(super) struct Edge {
    pub at: u32,
    pub from: u32,
    pub to: u32,
    pub key: u16,
    pub kind: Kind,
}

impl Edge {
    pub fn new(key: u16, kind: Kind, at: usize, from: &Segment, to: &Segment) -> Self {
        Self { at: at as u32, from: from.node, to: to.node, key, kind }
    }

    pub fn tie(key: u16, at: usize, segment: &Segment) -> Self {
        Self { at: at as u32, from: SEA, to: segment.node, key, kind: Kind::Tie }
    }
}

/// Edges to be sorted.
#[derive(Default)]
pub(super) struct Order {
    edges: Vec<Edge>,
    sorted: Vec<Edge>,
    /// By bucket, where its next edge goes.
    next: Vec<u32>,
}

impl Order {
    pub fn clear(&mut self) {
        self.edges.clear();
    }

    #[inline(always)]
    pub fn push(&mut self, edge: Edge) {
        self.edges.push(edge);
    }

    /// Visits the edges by key, those of one bucket in the order in which they came; keys up to `flat` are one.
    #[inline(always)]
    pub fn each(&mut self, flat: u16, visit: impl FnMut(&Edge)) {
        let Self { edges, sorted, next } = self;
        let Some(&filler) = edges.first() else { return };
        let bucket = |edge: &Edge| usize::from(edge.key.max(flat) >> SHIFT);
        next.clear();
        next.resize(BUCKETS + 1, 0);
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
