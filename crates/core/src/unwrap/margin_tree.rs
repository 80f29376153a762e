//! Margin tree: sums the steps between the counts of green pixels along a spanning tree of the edges with the greatest margins.
//!
//! Nearly all edges have a large margin. They are joined from row to row; the others follow in the order of their margins. An edge is left
//! out if the counts of the parts at both its ends would not fit into the range together. Parts that no other edge joins are placed as near
//! as the range allows to what their best edge says.

use super::gradient_sums::{GradientSums, GreenCodes};
use crate::simd::widest;

/// Edges with at least this margin, two peaks, are joined first, in the order of the rows. With one peak, a wrong edge in fine branches tears a
/// part off that reaches to the border of the image.
const SURE: u8 = 128;

/// The pixels of a row that are appended together where all their edges are sure and come from one part.
const LANES: usize = 16;

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
    /// The edges between parts that are not sure.
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

/// An edge down to a pixel, and later one from part to part.
#[derive(Clone, Copy)]
struct Edge {
    from: u32,
    to: u32,
    /// How much greater the count at the lower end is.
    step: i16,
    margin: u8,
}

/// The steps and margins of the edges between the row above and a row, by direction.
struct EdgesAbove<'a> {
    of: [(&'a [i8], &'a [u8]); 2],
    /// The pixels before the row above, and those of a row.
    first: usize,
    width: usize,
    /// How much greater the index of the lower end is, for an edge down to the right.
    ahead: usize,
}

impl EdgesAbove<'_> {
    /// Returns the edges down to a pixel; `None` for one that comes from beyond the border.
    #[inline(always)]
    fn down_to(&self, at: usize) -> [Option<Edge>; 2] {
        [0, 1].map(|direction| {
            let from = (at + direction).checked_sub(self.ahead).filter(|from| *from < self.width)?;
            let (step, margin) = (self.of[direction].0[from].into(), self.of[direction].1[from]);
            let [from, to] = [self.first + from, self.first + self.width + at].map(|pixel| pixel as u32);
            Some(Edge { from, to, step, margin })
        })
    }

    /// Returns the steps and margins of the edges down to pixels from one on, by direction, if all are there and sure.
    #[inline(always)]
    fn sure_lanes(&self, at: usize) -> Option<[(&[i8; LANES], &[u8; LANES]); 2]> {
        let from = at.checked_sub(self.ahead).filter(|from| from + LANES < self.width)?;
        let lanes = [0, 1].map(|direction| {
            let (steps, margins) = self.of[direction];
            (steps[from + direction..].first_chunk(), margins[from + direction..].first_chunk())
        });
        let [(Some(right), Some(of_right)), (Some(left), Some(of_left))] = lanes else { return None };
        let least = of_right.iter().zip(of_left).fold(u8::MAX, |least, (a, b)| least.min(*a).min(*b));
        (least >= SURE).then_some([(right, of_right), (left, of_left)])
    }
}

impl MarginTree {
    /// Finds the counts of the pixels, up to a constant. They differ by at most `most`.
    pub fn grow(&mut self, codes: &GreenCodes, sums: &GradientSums, most: u8) {
        self.most = most.into();
        self.tree.clear();
        self.doubtful.clear();
        // Every pixel is written below.
        self.parts.resize(codes.height * codes.width, 0);
        self.counts.resize(codes.height * codes.width, 0);
        (0..codes.width).for_each(|at| self.append(at, [None; 2]));
        for row in 1..codes.height {
            let of = [0, 1].map(|direction| sums.row(direction, row - 1));
            let (width, ahead) = (codes.width, codes.shift(row - 1));
            widest!(self.append_row(&EdgesAbove { of, first: (row - 1) * width, width, ahead }));
        }
        let mut doubtful = std::mem::take(&mut self.doubtful);
        // Most of their ends have come to one part; in the order of the rows, that is found fast.
        doubtful.retain_mut(|edge| self.ascend(edge));
        // Edges of one margin stay in the order of the rows.
        doubtful.sort_by_key(|edge| u8::MAX - edge.margin);
        doubtful.retain(|edge| !self.join(*edge, false));
        doubtful.iter().for_each(|edge| _ = self.join(*edge, true));
        self.doubtful = doubtful;
        let mut counts = &mut self.counts[..];
        for parts in self.parts.chunk_by(|one, next| one == next) {
            let (run, rest) = std::mem::take(&mut counts).split_at_mut(parts.len());
            let offset = root(&mut self.tree, parts[0]).1;
            run.iter_mut().for_each(|count| *count += offset);
            counts = rest;
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
                wrong += widest!(ends.fold(0u32, |wrong, ((from, step), to)| {
                    wrong + u32::from(to - from != i32::from(*step))
                })) as usize;
            }
        }
        wrong as f64 / all.max(1) as f64
    }

    /// Appends a row. Nearly all of its pixels can be appended together.
    #[inline(always)]
    fn append_row(&mut self, edges: &EdgesAbove<'_>) {
        let first = edges.first + edges.width;
        for at in (0..edges.width).step_by(LANES) {
            if !self.append_lanes(edges, at) {
                (at..edges.width.min(at + LANES)).for_each(|at| self.append(first + at, edges.down_to(at)));
            }
        }
    }

    /// Appends pixels together, if they all belong to one part and fit into the range. Returns whether they do.
    #[inline(always)]
    fn append_lanes(&mut self, edges: &EdgesAbove<'_>, at: usize) -> bool {
        let Some([(right, of_right), (left, of_left)]) = edges.sure_lanes(at) else { return false };
        let Self { parts, counts, tree, .. } = self;
        let (above, to) = (edges.first + at - edges.ahead, edges.first + edges.width + at);
        let part = parts[above];
        if !parts[above..=above + LANES].iter().fold(true, |one, &next| one & (next == part)) {
            return false;
        }
        let (part, offset) = root(tree, part);
        let (from, mut here) = (&counts[above..=above + LANES], [0; LANES]);
        for lane in 0..LANES {
            let to_right = from[lane] + i32::from(right[lane]);
            let to_left = from[lane + 1] + i32::from(left[lane]);
            here[lane] = offset + if of_left[lane] > of_right[lane] { to_left } else { to_right };
        }
        let root = &mut tree[part as usize];
        let least = here.iter().fold(root.least, |least, &count| least.min(count));
        let largest = here.iter().fold(root.largest, |largest, &count| largest.max(count));
        let fits = largest - least <= self.most;
        if fits {
            (root.least, root.largest) = (least, largest);
            counts[to..to + LANES].copy_from_slice(&here);
            parts[to..to + LANES].fill(part);
        }
        fits
    }

    /// Appends a pixel with the edges down to it.
    fn append(&mut self, at: usize, [right, left]: [Option<Edge>; 2]) {
        let margin = |edge: Option<Edge>| edge.map_or(0, |edge| edge.margin);
        let (first, second) = if margin(left) > margin(right) { (left, right) } else { (right, left) };
        if !first.is_some_and(|edge| edge.margin >= SURE && self.extend(edge)) {
            let part = self.tree.len() as u32;
            self.tree.push(Part { parent: part, offset: 0, least: 0, largest: 0, size: 1 });
            (self.parts[at], self.counts[at]) = (part, 0);
            let edge = first.map(|edge| self.between_parts(edge));
            self.doubtful.extend(edge);
        }
        if let Some(edge) = second {
            let mut edge = self.between_parts(edge);
            let is_open = if edge.margin < SURE { self.ascend(&mut edge) } else { !self.join(edge, false) };
            if is_open {
                self.doubtful.push(edge);
            }
        }
    }

    /// Appends a pixel to the part at the other end of its edge, if its count fits into the range. Returns whether it does.
    #[inline]
    fn extend(&mut self, edge: Edge) -> bool {
        let [from, to] = [edge.from, edge.to].map(|at| at as usize);
        let (part, offset) = root(&mut self.tree, self.parts[from]);
        let count = self.counts[from] + offset + i32::from(edge.step);
        let root = &mut self.tree[part as usize];
        let (least, largest) = (root.least.min(count), root.largest.max(count));
        let fits = largest - least <= self.most;
        if fits {
            (root.least, root.largest) = (least, largest);
            (self.parts[to], self.counts[to]) = (part, count);
        }
        fits
    }

    /// Returns an edge down to a pixel as one between the parts of both.
    #[inline]
    fn between_parts(&self, edge: Edge) -> Edge {
        let [from, to] = [edge.from, edge.to].map(|at| at as usize);
        // All counts of a part are within the range, which has at most 256 of them.
        let step = edge.step + (self.counts[from] - self.counts[to]) as i16;
        Edge { from: self.parts[from], to: self.parts[to], step, ..edge }
    }

    /// Moves the ends of an edge to the roots of their parts. Returns whether these differ.
    #[inline]
    fn ascend(&mut self, edge: &mut Edge) -> bool {
        let (from, offset) = root(&mut self.tree, edge.from);
        let (to, ahead) = root(&mut self.tree, edge.to);
        *edge = Edge { from, to, step: edge.step + (offset - ahead) as i16, ..*edge };
        from != to
    }

    /// Joins the parts of both ends of an edge, if their counts fit into the range together. If it is `forced`, the step of the edge may
    /// change for this. Returns whether both ends belong to one part.
    #[inline]
    fn join(&mut self, mut edge: Edge, forced: bool) -> bool {
        if !self.ascend(&mut edge) {
            return true;
        }
        let (part, other, step) = (edge.from, edge.to, i32::from(edge.step));
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

/// Returns the root of a part, and the count of the part, less that of the root. The part then belongs to its root.
#[inline(always)]
fn root(tree: &mut [Part], part: u32) -> (u32, i32) {
    let Part { parent: mut root, mut offset, .. } = tree[part as usize];
    if root == part {
        return (part, 0);
    }
    while tree[root as usize].parent != root {
        offset += tree[root as usize].offset;
        root = tree[root as usize].parent;
    }
    (tree[part as usize].parent, tree[part as usize].offset) = (root, offset);
    (root, offset)
}
