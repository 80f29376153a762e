//! Regions condensed to one node each: the order of keys jumps over the image, which is too large for the cache.

use super::{RegionNode, Regions};
use crate::unwrap::tree::pixels::{Quad, add};

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

    /// Makes a node of each region of `fine`, which must be flat.
    pub fn condense(&mut self, fine: &Regions) {
        self.regions.clear();
        self.roots.clear();
        self.nodes.resize(fine.nodes.len(), 0);
        for (root, &region) in (0..).zip(&fine.regions).filter(|&(root, _)| fine.root(root) == root) {
            self.nodes[root as usize] = self.regions.push(region);
            self.roots.push(root);
        }
    }

    /// Returns the node of `root`.
    #[inline(always)]
    pub fn node(&self, root: u32) -> u32 {
        self.nodes[root as usize]
    }

    /// Joins two nodes as [`Regions::join`] does.
    #[inline(always)]
    pub fn join(&mut self, from: u32, to: u32, step: impl FnOnce() -> Quad) {
        self.regions.join(from, to, step);
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
    use super::super::tests::of_nodes;
    use super::*;

    #[test]
    fn what_joins_coarsely_joins_as_finely() {
        let values = [3, 5, -2, 0, 7, 1];
        let step = |from: usize, to: usize| [values[to] - values[from]; 4];
        let (mut whole, mut fine, mut condensed) =
            (of_nodes(6, -9, 9), of_nodes(6, -9, 9), CondensedRegions::default());
        for (from, to) in [(0, 1), (3, 2), (1, 4)] {
            for regions in [&mut whole, &mut fine] {
                regions.join(from, to, || step(from as usize, to as usize));
            }
        }
        fine.flatten();
        condensed.condense(&fine);
        let [from, to] = [4, 2].map(|node| fine.root(node));
        let between_roots = step(from as usize, to as usize);
        condensed.join(condensed.node(from), condensed.node(to), || between_roots);
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
