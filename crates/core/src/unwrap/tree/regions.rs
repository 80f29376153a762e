//! Regions that grow together: a union-find with the wrap counts of each node relative to the root of its region,
//! and the interval of the root's own counts.

use std::hint::black_box;
use std::ops::Range;

use super::pixels::{Quad, add, subtract};

/// The largest region (hot pixels, noise) that does not constrain one of [`LARGE`] or more pixels.
const SMALL: u32 = 6;
pub(in crate::unwrap) const LARGE: u32 = 64;

/// The number of edges that are looked at together before they join.
const BLOCK: usize = 64;

/// The nodes 0 to n-1, each in one region.
#[derive(Default)]
pub(in crate::unwrap) struct Regions {
    nodes: Vec<RegionNode>,
    regions: Vec<Region>,
}

#[derive(Clone, Copy)]
struct RegionNode {
    parent: u32,
    /// The value of this node minus that of its parent.
    offset: Quad,
}

/// A region; it is valid at the index of a root.
#[derive(Clone, Copy)]
pub(in crate::unwrap) struct Region {
    /// The least and the greatest value that the root may have.
    pub low: Quad,
    pub high: Quad,
    /// The number of pixels.
    pub size: u32,
}

impl Region {
    /// Makes a region of the first pixels, at least one, that can have one value; `interval` is the least and
    /// greatest value of each.
    #[inline(always)]
    pub fn of_equal(pixels: Range<usize>, interval: impl Fn(usize) -> (Quad, Quad)) -> Self {
        let pixel = |at: usize| {
            let (low, high) = interval(at);
            Self { low, high, size: 1 }
        };
        let mut region = pixel(pixels.start);
        for at in pixels.skip(1) {
            match region.intersect(&pixel(at), [0; 4]) {
                Some(joint) => region = joint,
                // The segment ends where no count suits all of its pixels; the rest becomes another one.
                None => break,
            }
        }
        region
    }

    /// Returns whether no value is left in a channel.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        (0..4).fold(false, |empty, lane| empty | (self.low[lane] > self.high[lane]))
    }

    /// Returns the intersection with a part that is `step` above, if a value is left for both.
    #[inline(always)]
    pub fn intersect(&self, part: &Region, step: Quad) -> Option<Region> {
        let joint = self.narrow(part, step);
        (!joint.is_empty()).then_some(joint)
    }

    /// Returns the intersection with a part that is `step` above, which may be empty.
    #[inline(always)]
    fn narrow(&self, part: &Region, step: Quad) -> Region {
        let mut joint = Region { size: self.size.saturating_add(part.size), ..*self };
        for (lane, step) in step.into_iter().enumerate() {
            // Bounds saturate, so that a large step never wraps to the other end of the interval.
            joint.low[lane] = self.low[lane].max(part.low[lane].saturating_sub(step));
            joint.high[lane] = self.high[lane].min(part.high[lane].saturating_sub(step));
        }
        joint
    }

    /// Returns [`intersect`](Self::intersect), but a small part does not constrain a large region.
    #[inline(always)]
    fn merge(&self, part: &Region, step: Quad) -> Option<Region> {
        // A hot pixel would otherwise stop the growth of a whole region.
        let free = (self.size >= LARGE) & (part.size <= SMALL);
        let joint = self.narrow(part, step);
        let (low, high) = if free { (self.low, self.high) } else { (joint.low, joint.high) };
        // Sizes follow no order, so that a branch for each would be slow.
        (free | !joint.is_empty()).then_some(Region { low, high, ..joint })
    }
}

impl Regions {
    /// Removes all nodes.
    pub fn clear(&mut self) {
        self.nodes.clear();
        self.regions.clear();
    }

    /// Reserves memory for so many nodes; there must be none yet.
    pub fn reserve(&mut self, nodes: usize) {
        self.nodes.reserve(nodes);
        self.regions.reserve(nodes);
    }

    /// Adds a node that is a region of its own, and returns its number.
    pub fn push(&mut self, region: Region) -> u32 {
        let node = self.nodes.len() as u32;
        self.nodes.push(RegionNode { parent: node, offset: [0; 4] });
        self.regions.push(region);
        node
    }

    /// Makes the root the parent of every node.
    pub fn flatten(&mut self) {
        for node in 0..self.count() {
            let (parent, offset) = self.find(node);
            self.nodes[node as usize] = RegionNode { parent, offset };
        }
    }

    /// Returns the root of `node`'s region, after [`flatten`](Self::flatten).
    pub fn root(&self, node: u32) -> u32 {
        self.nodes[node as usize].parent
    }

    /// Returns the value of `node` minus that of its root, after [`flatten`](Self::flatten).
    pub fn offset_from_root(&self, node: u32) -> Quad {
        self.nodes[node as usize].offset
    }

    /// Returns the number of nodes.
    pub fn count(&self) -> u32 {
        self.nodes.len() as u32
    }

    /// Returns the root of `node`'s region, and the value of the node minus that of the root, and halves the path.
    #[inline(always)]
    pub fn find(&mut self, mut node: u32) -> (u32, Quad) {
        let mut total = [0; 4];
        loop {
            let RegionNode { parent, offset } = self.nodes[node as usize];
            if parent == node {
                return (node, total);
            }
            let above = self.nodes[parent as usize];
            total = add(total, add(offset, above.offset));
            // The parent is a root, so there is no path left to halve.
            if above.parent == parent {
                return (parent, total);
            }
            self.nodes[node as usize] =
                RegionNode { parent: above.parent, offset: add(offset, above.offset) };
            node = above.parent;
        }
    }

    /// Returns a node at most two steps towards the root, and the value of `node` minus its own, and shortens the path.
    #[inline(always)]
    fn ascend(&mut self, node: u32) -> (u32, Quad) {
        // A root is its own parent at offset 0, so no step needs a branch.
        let below = self.nodes[node as usize];
        let above = self.nodes[below.parent as usize];
        let (parent, offset) = (above.parent, add(below.offset, above.offset));
        self.nodes[node as usize] = RegionNode { parent, offset };
        (parent, offset)
    }

    /// Returns the region at `root`.
    pub fn region(&self, root: u32) -> Region {
        self.regions[root as usize]
    }

    /// Returns the root of the region with most pixels.
    pub fn largest(&self) -> u32 {
        let roots = self.nodes.iter().enumerate().filter(|(index, node)| node.parent as usize == *index);
        let sizes = roots.map(|(index, _)| (self.regions[index].size, index as u32));
        // Of equal sizes the first region wins, which makes the choice the same on every run.
        sizes.max_by_key(|&(size, index)| (size, std::cmp::Reverse(index))).expect("there is a node").1
    }

    /// Joins the regions of two nodes, `to` being `step` above `from`, unless no value of the joint root would be
    /// left. An edge within one region is ignored. Returns whether both are in one region then.
    #[inline(always)]
    pub fn join(&mut self, from: u32, to: u32, step: impl FnOnce() -> Quad) -> bool {
        let ((from, below), (to, above)) = (self.find(from), self.find(to));
        // The step is the root `to` minus the root `from`.
        from == to || self.attach(from, to, subtract(add(below, step()), above))
    }

    fn attach(&mut self, from: u32, to: u32, step: Quad) -> bool {
        let [a, b] = [from, to].map(|root| self.regions[root as usize].size);
        // The smaller region goes under the larger one, which keeps the paths short.
        let (parent, child, step) =
            if a >= b { (from, to, step) } else { (to, from, subtract([0; 4], step)) };
        let joint = self.regions[parent as usize].merge(&self.regions[child as usize], step);
        if let Some(joint) = joint {
            self.regions[parent as usize] = joint;
            self.nodes[child as usize] = RegionNode { parent, offset: step };
        }
        joint.is_some()
    }
}

/// An edge from region to region, by number.
#[derive(Clone, Copy, Default)]
pub(super) struct RegionEdge {
    from: u32,
    to: u32,
    /// The value of the root of `to` minus that of the root of `from`, and the key in the last lane. There all steps
    /// are 0, so that no sum of steps changes the key.
    step: Quad,
}

impl RegionEdge {
    pub fn new(key: u16, from: u32, to: u32, [r, g, b, _]: Quad) -> Self {
        Self { from, to, step: [r, g, b, key.cast_signed()] }
    }

    /// Moves the ends of `edges` to nodes nearer to the root; `above` returns this node, and the value of the given one minus its own.
    /// Edges within a node are left out. Returns how many are left, at the front, in their order.
    #[inline(always)]
    fn ascend(edges: &mut [Self], mut above: impl FnMut(u32) -> (u32, Quad)) -> usize {
        let mut open = 0;
        for at in 0..edges.len() {
            let Self { from, to, step } = edges[at];
            let ((from, of_from), (to, of_to)) = (above(from), above(to));
            edges[open] = Self { from, to, step: subtract(add(of_from, step), of_to) };
            // Chance decides which edges lie within a node, so that a branch would be slow.
            open += usize::from(from != to);
        }
        open
    }

    #[inline(always)]
    pub fn key(&self) -> u16 {
        self.step[3].cast_unsigned()
    }
}

/// The regions of another union-find, each as one node, so that joins touch little memory.
#[derive(Default)]
pub(in crate::unwrap) struct CondensedRegions {
    regions: Regions,
    /// The node by root of a region, and the root by node.
    nodes: Vec<u32>,
    roots: Vec<u32>,
}

impl CondensedRegions {
    /// Reserves memory for so many nodes.
    pub fn reserve(&mut self, nodes: usize) {
        self.regions.clear();
        self.regions.reserve(nodes);
        self.nodes.reserve(nodes.saturating_sub(self.nodes.len()));
        self.roots.clear();
        self.roots.reserve(nodes);
    }

    /// Makes a node of each region of `fine`, which must be flat, and edges between these nodes of its edges.
    pub fn condense(&mut self, fine: &Regions, edges: &mut Vec<RegionEdge>) {
        self.regions.clear();
        self.roots.clear();
        self.nodes.resize(fine.nodes.len(), 0);
        for (root, &region) in (0..).zip(&fine.regions).filter(|&(root, _)| fine.root(root) == root) {
            self.nodes[root as usize] = self.regions.push(region);
            self.roots.push(root);
        }
        let node = |node| (self.nodes[fine.root(node) as usize], fine.offset_from_root(node));
        let open = RegionEdge::ascend(edges, node);
        edges.truncate(open);
    }

    /// Joins along `edges`, in their order, as [`Regions::join`] does; the edges are changed.
    pub fn join_in_order(&mut self, edges: &mut [RegionEdge]) {
        for block in edges.chunks_mut(BLOCK) {
            // Edges in the order of keys jump over memory. Loops without branches wait for many places of it at once.
            let nodes = &self.regions.nodes;
            let parent = |node: u32| nodes[node as usize].parent;
            black_box(block.iter().fold(0, |sum, edge| sum ^ parent(edge.from) ^ parent(edge.to)));
            let open = RegionEdge::ascend(block, |node| self.regions.ascend(node));
            let block = &block[..open];
            let size = |node: u32| self.regions.regions[node as usize].size;
            black_box(block.iter().fold(0, |sum, edge| sum ^ size(edge.from) ^ size(edge.to)));
            for &RegionEdge { from, to, step: [r, g, b, _] } in block {
                self.regions.join(from, to, || [r, g, b, 0]);
            }
        }
    }

    /// Joins the regions of `fine` as their nodes were joined.
    pub fn refine(&mut self, fine: &mut Regions) {
        self.regions.flatten();
        // `fine` is flat, so every node has its root as parent, and one step over the condensed root suffices.
        for node in &mut fine.nodes {
            let above = self.regions.nodes[self.nodes[node.parent as usize] as usize];
            *node = RegionNode {
                parent: self.roots[above.parent as usize],
                offset: add(node.offset, above.offset),
            };
        }
        for (&root, &region) in self.roots.iter().zip(&self.regions.regions) {
            fine.regions[root as usize] = region;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Returns so many regions of one node, all with the same bounds.
    fn of_nodes(count: usize, low: i16, high: i16) -> Regions {
        let mut regions = Regions::default();
        (0..count).for_each(|_| {
            regions.push(Region { low: [low; 4], high: [high; 4], size: 1 });
        });
        regions
    }

    proptest! {
        /// Values are known: in any order, joined nodes have the right differences.
        #[test]
        fn differences_follow_from_any_order(
            values in proptest::collection::vec(-9i16..9, 2..40),
            pairs in proptest::collection::vec((any::<prop::sample::Index>(), any::<prop::sample::Index>()), 1..80),
        ) {
            let n = values.len();
            let mut regions = of_nodes(n, -99, 99);
            let mut label: Vec<usize> = (0..n).collect();
            for (from, to) in pairs.iter().map(|(a, b)| (a.index(n), b.index(n))) {
                regions.join(from as u32, to as u32, || [values[to] - values[from]; 4]);
                let (old, new) = (label[to], label[from]);
                label.iter_mut().filter(|label| **label == old).for_each(|label| *label = new);
            }
            regions.flatten();
            for (a, b) in (0..n).flat_map(|a| (0..n).map(move |b| (a, b))) {
                let [root_a, root_b] = [a, b].map(|node| regions.root(node as u32));
                prop_assert_eq!(root_a == root_b, label[a] == label[b]);
                if root_a == root_b {
                    let [low, high] = [a, b].map(|node| regions.offset_from_root(node as u32)[0]);
                    prop_assert_eq!(high - low, values[b] - values[a]);
                }
            }
        }
    }

    #[test]
    fn refuses_what_leaves_the_interval() {
        let mut regions = of_nodes(3, 0, 1);
        regions.join(0, 1, || [1; 4]);
        regions.join(1, 2, || [1; 4]);
        let ((a, _), (b, _), (c, _)) = (regions.find(0), regions.find(1), regions.find(2));
        assert!(a == b && b != c, "0, 1, 2 do not fit in 0 to 1");
        assert_eq!((regions.region(a).low, regions.region(a).high), ([0; 4], [0; 4]));
        assert_eq!(regions.largest(), a);
    }

    #[test]
    fn what_joins_coarsely_joins_as_finely() {
        let values = [3, 5, -2, 0, 7, 1];
        let step = |from: usize, to: usize| {
            let step = values[to] - values[from];
            [step, step, step, 0]
        };
        // The same joins, once in one step and once on both sides of the condensation.
        let (mut whole, mut fine, mut condensed) =
            (of_nodes(6, -9, 9), of_nodes(6, -9, 9), CondensedRegions::default());
        for (from, to) in [(0, 1), (3, 2), (1, 4)] {
            for regions in [&mut whole, &mut fine] {
                regions.join(from, to, || step(from as usize, to as usize));
            }
        }
        fine.flatten();
        let mut edges = [(4, 1), (4, 2)]
            .map(|(from, to)| RegionEdge::new(7, from, to, step(from as usize, to as usize)))
            .to_vec();
        condensed.condense(&fine, &mut edges);
        assert_eq!(edges.len(), 1, "the other edge lies within a region");
        assert_eq!(edges[0].key(), 7);
        condensed.join_in_order(&mut edges);
        whole.join(4, 2, || step(4, 2));
        whole.flatten();
        condensed.refine(&mut fine);
        for node in 0..6 {
            assert_eq!(
                (fine.root(node), fine.offset_from_root(node)),
                (whole.root(node), whole.offset_from_root(node))
            );
        }
        assert_eq!(fine.region(fine.largest()).low, whole.region(whole.largest()).low);
        assert_ne!(fine.root(5), fine.root(0));
    }
}
