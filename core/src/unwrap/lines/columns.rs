//! Columns: which n of each stands for 0, by what most of it says.

use super::gradient::Gradient;
use super::lanes::{Layout, Samples};
use super::majority::{Ballot, Doubt};
use super::rows::Rows;
use crate::unwrap::Range;
use crate::unwrap::wrapped::{Word, raised, turn};

/// Buffers, and what the columns' anchors sum up to.
#[derive(Default)]
pub(super) struct Anchors<W> {
    anchors: Vec<W>,
    /// By lane: what to add to k of every row.
    pub sums: Vec<W>,
    line: Vec<W>,
    ballot: Ballot,
    /// Rows that agree at the column where fewest do, of one channel.
    pub weakest: usize,
}

/// An image whose rows are summed up.
pub(super) struct Summed<'a, S, W> {
    pub samples: &'a Samples<'a, S>,
    pub layout: Layout,
    pub rows: &'a Rows<W>,
}

impl<W: Word> Anchors<W> {
    /// The anchor of each column is its majority, or in doubt what follows from the column to
    /// the left and `d_x d_x x`.
    pub fn find<S: Copy + Into<u16>>(&mut self, seen: &Gradient<W>, summed: &Summed<'_, S, W>, range: Range) {
        let Layout { height, channels, .. } = summed.layout;
        self.line.clear();
        self.line.reserve(height);
        self.ballot.start::<W>();
        self.weakest = height;
        let mut doubts = [Doubt::new(range); 3];
        self.anchors.clear();
        for lane in 0..summed.layout.last(0) {
            let (agree, steep) = (seen.zeros[lane] as usize, seen.steep[lane] as usize);
            let (mut anchor, mut count) = (W::default(), agree);
            if agree * 2 <= height {
                summed.column(lane, &mut self.line);
                let majority = self.ballot.count(&self.line);
                (anchor, count) = (majority.value, majority.count);
            }
            let doubt = &mut doubts[lane % channels];
            if doubt.arises(count, steep, height) && lane >= channels {
                summed.second_opinion(lane, self.anchors[lane - channels], &mut self.line);
                let opinion = self.ballot.count(&self.line);
                doubt.settle(anchor != opinion.value);
                (anchor, count) = (opinion.value, opinion.count);
            }
            self.weakest = self.weakest.min(count);
            self.anchors.push(anchor);
        }
        self.sum(summed.layout);
    }

    fn sum(&mut self, layout: Layout) {
        self.sums.clear();
        self.sums.resize(layout.lanes(), W::default());
        for lane in layout.channels..layout.lanes() {
            let left = lane - layout.channels;
            let anchor = self.anchors.get(left).copied().unwrap_or_default();
            self.sums[lane] = self.sums[left].minus(anchor);
        }
    }
}

impl<S: Copy + Into<u16>, W: Word> Summed<'_, S, W> {
    /// Rows of samples and of k; k up to constants a row and a column.
    fn rows(&self) -> impl Iterator<Item = (&[S], &[W])> {
        (0..self.layout.height).map(|row| (self.samples.row(row), self.rows.k(row)))
    }

    /// n from lane `from` of a row to its right neighbour, and their difference raised.
    #[inline(always)]
    fn across(&self, (y, k): (&[S], &[W]), from: usize) -> (W, W) {
        let to = from + self.layout.channels;
        let [left, right] = [y[from], y[to]].map(|sample| self.samples.shifted::<W>(sample));
        (k[to].minus(k[from]).minus(turn(left, right)), raised(left, right))
    }

    /// n at `lane`, by row.
    fn column(&self, lane: usize, line: &mut Vec<W>) {
        line.clear();
        line.extend(self.rows().map(|row| self.across(row, lane).0));
    }

    /// By row: the anchor at `lane` (not in the first column) if `M_b(d_x d_x y) = d_x d_x x` there.
    fn second_opinion(&self, lane: usize, left_anchor: W, line: &mut Vec<W>) {
        line.clear();
        line.extend(self.rows().map(|row| {
            let (n_left, left) = self.across(row, lane - self.layout.channels);
            let (n, here) = self.across(row, lane);
            let want = n_left.minus(left_anchor).plus(turn(left, here));
            n.minus(want)
        }));
    }
}
