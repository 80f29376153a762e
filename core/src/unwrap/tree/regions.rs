//! Regions that grow together: a union-find that knows each node's wrap counts
//! relative to its region's root, and in which interval the root's may lie.

use super::edges::Edge;

/// One number for each of red, green, blue.
pub(in crate::unwrap) type Triple = [i16; 3];

/// Regions up to this many nodes (hot pixels, noise) do not constrain one of [`LARGE`] or more.
const SMALL: u32 = 6;
pub(in crate::unwrap) const LARGE: u32 = 64;

/// Nodes 0 to n-1, each in one region.
#[derive(Default)]
pub(in crate::unwrap) struct Regions {
    nodes: Vec<Node>,
    regions: Vec<Region>,
}

#[derive(Clone, Copy)]
struct Node {
    parent: u32,
    /// This node's value minus its parent's.
    offset: Triple,
}

/// Valid at the index of a root.
#[derive(Clone, Copy)]
pub(in crate::unwrap) struct Region {
    /// Least and greatest value that the root may have.
    pub low: Triple,
    pub high: Triple,
    /// Number of nodes.
    pub size: u32,
}

impl Regions {
    /// Starts anew with one region a node.
    pub fn reset(&mut self, regions: impl Iterator<Item = Region>) {
        self.regions.clear();
        self.regions.extend(regions);
        self.nodes.clear();
        self.nodes.extend((0..self.regions.len() as u32).map(|parent| Node { parent, offset: [0; 3] }));
    }

    /// Joins along `edges`, in their order; an edge whose ends are joined already says nothing.
    pub fn join_all(&mut self, edges: &[Edge]) {
        edges.iter().for_each(|edge| self.join(edge));
    }

    /// Root of `node`'s region, and the node's value minus the root's. Halves the path.
    pub fn find(&mut self, mut node: u32) -> (u32, Triple) {
        let mut total = [0; 3];
        loop {
            let Node { parent, offset } = self.nodes[node as usize];
            if parent == node {
                return (node, total);
            }
            let above = self.nodes[parent as usize];
            total = add(total, add(offset, above.offset));
            self.nodes[node as usize] = Node { parent: above.parent, offset: add(offset, above.offset) };
            node = above.parent;
        }
    }

    /// The region at `root`.
    pub fn region(&self, root: u32) -> Region {
        self.regions[root as usize]
    }

    /// Root of the region with most nodes.
    pub fn largest(&self) -> u32 {
        let roots = self.nodes.iter().enumerate().filter(|(index, node)| node.parent as usize == *index);
        let sizes = roots.map(|(index, _)| (self.regions[index].size, index as u32));
        sizes.max_by_key(|&(size, index)| (size, std::cmp::Reverse(index))).map_or(0, |(_, index)| index)
    }

    /// Joins the two ends' regions, unless no value of the joint root would be possible.
    fn join(&mut self, edge: &Edge) {
        let ((from, from_offset), (to, to_offset)) = (self.find(edge.from), self.find(edge.to));
        if from == to {
            return;
        }
        // The root `to` minus the root `from`.
        let step = subtract(add(from_offset, edge.step), to_offset);
        let (a, b) = (self.regions[from as usize], self.regions[to as usize]);
        if a.size >= b.size {
            self.attach(from, to, step);
        } else {
            self.attach(to, from, subtract([0; 3], step));
        }
    }

    /// Hangs root `child` under root `parent`, `step` above it.
    fn attach(&mut self, parent: u32, child: u32, step: Triple) {
        let (a, b) = (self.regions[parent as usize], self.regions[child as usize]);
        let size = a.size.saturating_add(b.size);
        let mut joint = Region { size, ..a };
        if a.size < LARGE || b.size > SMALL {
            for (lane, step) in step.into_iter().enumerate() {
                joint.low[lane] = a.low[lane].max(b.low[lane].saturating_sub(step));
                joint.high[lane] = a.high[lane].min(b.high[lane].saturating_sub(step));
            }
        }
        if joint.low.iter().zip(&joint.high).all(|(low, high)| low <= high) {
            self.regions[parent as usize] = joint;
            self.nodes[child as usize] = Node { parent, offset: step };
        }
    }
}

fn add(a: Triple, b: Triple) -> Triple {
    [a[0].wrapping_add(b[0]), a[1].wrapping_add(b[1]), a[2].wrapping_add(b[2])]
}

/// a - b.
pub(in crate::unwrap) fn subtract(a: Triple, b: Triple) -> Triple {
    [a[0].wrapping_sub(b[0]), a[1].wrapping_sub(b[1]), a[2].wrapping_sub(b[2])]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// Against known values: whatever is joined in whatever order has the right differences.
        #[test]
        fn differences_follow_from_any_order(
            values in proptest::collection::vec(-9i16..9, 2..40),
            pairs in proptest::collection::vec((any::<prop::sample::Index>(), any::<prop::sample::Index>()), 1..80),
        ) {
            let n = values.len();
            let mut regions = Regions::default();
            regions.reset((0..n).map(|_| Region { low: [-99; 3], high: [99; 3], size: 1 }));
            let mut label: Vec<usize> = (0..n).collect();
            for (from, to) in pairs.iter().map(|(a, b)| (a.index(n), b.index(n))) {
                let step = [values[to] - values[from]; 3];
                regions.join_all(&[Edge { key: 0, from: from as u32, to: to as u32, step }]);
                let (old, new) = (label[to], label[from]);
                label.iter_mut().filter(|label| **label == old).for_each(|label| *label = new);
            }
            for (a, b) in (0..n).flat_map(|a| (0..n).map(move |b| (a, b))) {
                let ((root_a, offset_a), (root_b, offset_b)) = (regions.find(a as u32), regions.find(b as u32));
                prop_assert_eq!(root_a == root_b, label[a] == label[b]);
                if root_a == root_b {
                    prop_assert_eq!(offset_b[0] - offset_a[0], values[b] - values[a]);
                }
            }
        }
    }

    #[test]
    fn refuses_what_leaves_the_interval() {
        let mut regions = Regions::default();
        regions.reset((0..3).map(|_| Region { low: [0; 3], high: [1; 3], size: 1 }));
        let edge = |from, to, step| Edge { key: 0, from, to, step: [step; 3] };
        regions.join_all(&[edge(0, 1, 1), edge(1, 2, 1)]);
        let ((a, _), (b, _), (c, _)) = (regions.find(0), regions.find(1), regions.find(2));
        assert!(a == b && b != c, "0, 1, 2 do not fit in 0 to 1");
        assert_eq!((regions.region(a).low, regions.region(a).high), ([0; 3], [0; 3]));
        assert_eq!(regions.largest(), a);
    }
}
