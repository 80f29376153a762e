//! Edges in the order of their keys: a counting sort.

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

/// From the pixel `at`.
#[derive(Clone, Copy)]
pub(super) struct Edge {
    pub key: u16,
    pub kind: Kind,
    pub at: u32,
}

/// Edges to be sorted.
#[derive(Default)]
pub(super) struct Order {
    edges: Vec<Edge>,
    sorted: Vec<Edge>,
}

impl Order {
    pub fn clear(&mut self) {
        self.edges.clear();
    }

    pub fn push(&mut self, edge: Edge) {
        self.edges.push(edge);
    }

    /// Visits the edges by key, those of one bucket in the order in which they came; keys up to `flat` are one.
    pub fn each(&mut self, flat: u16, visit: impl FnMut(&Edge)) {
        let bucket = |edge: &Edge| usize::from(edge.key.max(flat) >> SHIFT);
        let mut next = vec![0usize; BUCKETS + 1];
        self.edges.iter().for_each(|edge| next[bucket(edge) + 1] += 1);
        for i in 1..next.len() {
            next[i] += next[i - 1];
        }
        let sorted = &mut self.sorted;
        sorted.clear();
        sorted.resize(self.edges.len(), Edge { key: 0, kind: Kind::Tie, at: 0 });
        for edge in &self.edges {
            let place = &mut next[bucket(edge)];
            sorted[*place] = *edge;
            *place += 1;
        }
        sorted.iter().for_each(visit);
    }
}
