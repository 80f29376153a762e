//! Margin tree: sums the steps between the counts of green pixels along a spanning tree of the edges with the greatest margins.
//!
//! Nearly all edges have a large margin. They are joined from row to row; the others follow in the order of their margins. An edge is left
//! out if the counts of the parts at both its ends would not fit into the range together. Parts that no other edge joins are placed as near
//! as the range allows to what their best edge says.

use super::gradient_sums::{GradientSums, GreenCodes};

/// Edges with at least this margin, two peaks, are joined first, in the order of the rows. With one peak, a wrong edge in fine branches tears a
/// part off that reaches to the border of the image.
const SURE: u8 = 128;

/// The tree with its buffers.
#[derive(Default)]
pub(super) struct MarginTree {
    /// The part that each pixel belongs to, and its count, less that of the part.
    parts: Vec<u32>,
    /// The counts of the pixels, up to a constant: [`GreenCodes::width`] values a row.
    pub counts: Vec<i32>,
    tree: Vec<Part>,
    /// The largest difference of two counts in range.
    most: i32,
    /// The edges that are not sure.
    doubtful: Vec<Edge>,
}

/// Pixels whose counts are known up to a constant.
#[derive(Clone, Copy)]
struct Part {
    /// The part that it belongs to, itself for a root, and its count, less that of the other part.
    parent: u32,
    offset: i32,
    /// For a root, the least and the largest count, less that of the part.
    least: i32,
    largest: i32,
    /// For a root, the number of parts that belong to it.
    size: u32,
}

/// An edge down to a pixel.
#[derive(Clone, Copy)]
struct Edge {
    from: u32,
    to: u32,
    /// How much greater the count of the lower pixel is.
    step: i8,
    margin: u8,
}

/// The edges of one direction between the row above and a row.
#[derive(Clone, Copy)]
struct EdgesAbove<'a> {
    steps: &'a [i8],
    margins: &'a [u8],
    /// How much greater the index of the lower end is, plus one.
    ahead: usize,
    /// The pixels before the row above, and those of a row.
    first: usize,
    width: usize,
}

impl<'a> EdgesAbove<'a> {
    fn new(codes: &GreenCodes, sums: &'a GradientSums, direction: usize, row: usize) -> Self {
        let ((steps, margins), width) = (sums.row(direction, row - 1), codes.width);
        let ahead = codes.ahead(direction, row - 1);
        Self { steps: &steps[..width], margins: &margins[..width], ahead, first: (row - 1) * width, width }
    }

    /// Returns the edge down to a pixel; `None` if it comes from beyond the border.
    fn down_to(self, at: usize) -> Option<Edge> {
        let from = (at + 1).checked_sub(self.ahead)?;
        (from < self.width).then(|| self.down_to_inner(at))
    }

    /// Returns the edge down to a pixel that is not the first or the last one of its row.
    #[inline]
    fn down_to_inner(self, at: usize) -> Edge {
        let from = at + 1 - self.ahead;
        let (step, margin) = (self.steps[from], self.margins[from]);
        Edge { from: (self.first + from) as u32, to: (self.first + self.width + at) as u32, step, margin }
    }
}

impl MarginTree {
    /// Finds the counts of the pixels, up to a constant. They differ by at most `most`.
    pub fn grow(&mut self, codes: &GreenCodes, sums: &GradientSums, most: u8) {
        self.most = most.into();
        let width = codes.width;
        self.parts.clear();
        self.counts.clear();
        self.tree.clear();
        self.doubtful.clear();
        (0..width).for_each(|_| self.append([None; 2]));
        for row in 1..codes.height {
            let edges = [0, 1].map(|direction| EdgesAbove::new(codes, sums, direction, row));
            self.append(edges.map(|edges| edges.down_to(0)));
            // All but those at both ends have two edges.
            for at in 1..width.saturating_sub(1) {
                self.append(edges.map(|edges| Some(edges.down_to_inner(at))));
            }
            if width > 1 {
                self.append(edges.map(|edges| edges.down_to(width - 1)));
            }
        }
        let mut doubtful = std::mem::take(&mut self.doubtful);
        // Edges of one margin stay in the order of the rows.
        doubtful.sort_by_key(|edge| u8::MAX - edge.margin);
        doubtful.retain(|edge| !self.join(*edge, false));
        doubtful.iter().for_each(|edge| _ = self.join(*edge, true));
        self.doubtful = doubtful;
        for at in 0..self.counts.len() {
            self.counts[at] += self.root(self.parts[at]).1;
        }
    }

    /// Returns the share of the edges whose steps contradict the counts.
    pub fn contradictions(&self, codes: &GreenCodes, sums: &GradientSums) -> f64 {
        let (mut wrong, mut all) = (0, 0);
        let rows = self.counts.chunks_exact(codes.width);
        for (row, (here, next)) in rows.clone().zip(rows.skip(1)).enumerate() {
            for direction in [0, 1] {
                let steps = sums.row(direction, row).0;
                let (first, second) = codes.ends_of_edges(direction, row);
                let ends = here[first..].iter().zip(&steps[first..]).zip(&next[second..]);
                all += ends.len();
                wrong += ends.filter(|((from, step), to)| **to - **from != i32::from(**step)).count();
            }
        }
        wrong as f64 / all.max(1) as f64
    }

    /// Appends a pixel with the edges down to it.
    #[inline]
    fn append(&mut self, [left, right]: [Option<Edge>; 2]) {
        let margin = |edge: Option<Edge>| edge.map_or(0, |edge| edge.margin);
        let (first, second) = if margin(right) > margin(left) { (right, left) } else { (left, right) };
        if !first.is_some_and(|edge| edge.margin >= SURE && self.extend(edge)) {
            let part = self.tree.len() as u32;
            self.tree.push(Part { parent: part, offset: 0, least: 0, largest: 0, size: 1 });
            self.parts.push(part);
            self.counts.push(0);
            self.doubtful.extend(first);
        }
        if let Some(edge) = second
            && (edge.margin < SURE || !self.join(edge, false))
        {
            self.doubtful.push(edge);
        }
    }

    /// Appends a pixel to the part at the other end of its edge, if its count fits into the range. Returns whether it does.
    #[inline]
    fn extend(&mut self, edge: Edge) -> bool {
        let from = edge.from as usize;
        let (part, offset) = self.root(self.parts[from]);
        let count = self.counts[from] + offset + i32::from(edge.step);
        let root = &mut self.tree[part as usize];
        let (least, largest) = (root.least.min(count), root.largest.max(count));
        let fits = largest - least <= self.most;
        if fits {
            (root.least, root.largest) = (least, largest);
            self.parts.push(part);
            self.counts.push(count);
        }
        fits
    }

    /// Returns the root of a part, and the count of the part, less that of the root. The part then belongs to its root.
    #[inline]
    fn root(&mut self, part: u32) -> (u32, i32) {
        let Part { parent: mut root, mut offset, .. } = self.tree[part as usize];
        if root == part {
            return (part, 0);
        }
        while self.tree[root as usize].parent != root {
            offset += self.tree[root as usize].offset;
            root = self.tree[root as usize].parent;
        }
        let part = &mut self.tree[part as usize];
        (part.parent, part.offset) = (root, offset);
        (root, offset)
    }

    /// Joins the parts of both ends of an edge, if their counts fit into the range together. If it is `forced`, the step of the edge may
    /// change for this. Returns whether both ends belong to one part.
    #[inline]
    fn join(&mut self, edge: Edge, forced: bool) -> bool {
        let [from, to] = [edge.from, edge.to].map(|at| at as usize);
        let (part, offset) = self.root(self.parts[from]);
        let (other, ahead) = self.root(self.parts[to]);
        if part == other {
            return true;
        }
        let step = self.counts[from] + offset + i32::from(edge.step) - self.counts[to] - ahead;
        let (one, two) = (self.tree[part as usize], self.tree[other as usize]);
        let possible = (one.largest - self.most - two.least, one.least + self.most - two.largest);
        let fitting = step.clamp(possible.0, possible.1);
        if fitting != step && !forced {
            return false;
        }
        // The larger one becomes the root of both, so that the ways to the roots stay short.
        let (root, child, offset) =
            if one.size >= two.size { (part, other, fitting) } else { (other, part, -fitting) };
        let below = self.tree[child as usize];
        self.tree[child as usize] = Part { parent: root, offset, ..below };
        let above = &mut self.tree[root as usize];
        above.least = above.least.min(below.least + offset);
        above.largest = above.largest.max(below.largest + offset);
        above.size += below.size;
        true
    }
}
