//! Finds the constant of each column by a majority vote: the n that stands for 0.

use super::gradient::Gradient;
use super::layout::{CodeRows, RowLayout};
use super::majority::{MajorityCheck, VoteCounter};
use super::rows::Rows;
use crate::unwrap::Range;
use crate::unwrap::wrapped::{Word, biased, wrap_step};

/// The constants of the columns, with buffers.
#[derive(Default)]
pub(super) struct ColumnConstants<W> {
    constants: Vec<W>,
    /// The sum of the constants up to each lane, which is to be added to k of every row.
    pub sums: Vec<W>,
    line: Vec<W>,
    votes: VoteCounter,
}

/// An image whose rows have been summed.
pub(super) struct SummedImage<'a, S, W> {
    pub samples: &'a CodeRows<'a, S>,
    pub layout: RowLayout,
    pub rows: &'a Rows<W>,
}

impl<W: Word> ColumnConstants<W> {
    /// Finds the constant of each column: the majority of its n, or, where the majority is in doubt, the value
    /// that follows from the column to the left and `d_x d_x x`.
    pub fn find<S: Copy + Into<u16>>(
        &mut self,
        gradient: &Gradient<W>,
        summed: &SummedImage<'_, S, W>,
        range: Range,
    ) {
        let RowLayout { height, channels, .. } = summed.layout;
        self.line.clear();
        // Reserved even if no vote is counted, so that no later frame of this size allocates.
        self.line.reserve(height);
        self.votes.start::<W>();
        let mut checks = [MajorityCheck::new(range); 3];
        self.constants.clear();
        for lane in 0..summed.layout.last(0) {
            let (agree, steep) = (gradient.zeros[lane] as usize, gradient.steep[lane] as usize);
            let (mut constant, mut count) = (W::default(), agree);
            // If more than half of the rows agree on 0, no other value can have the majority.
            if agree * 2 <= height {
                summed.column(lane, &mut self.line);
                let majority = self.votes.count(&self.line);
                (constant, count) = (majority.value, majority.count);
            }
            let check = &mut checks[lane % channels];
            // The first column has no column to its left that could predict it.
            if check.needs_second_vote(count, steep, height) && lane >= channels {
                summed.second_difference_votes(lane, self.constants[lane - channels], &mut self.line);
                let second = self.votes.count(&self.line);
                check.record(constant != second.value);
                constant = second.value;
            }
            self.constants.push(constant);
        }
        self.sum(summed.layout);
    }

    fn sum(&mut self, layout: RowLayout) {
        self.sums.clear();
        self.sums.resize(layout.lanes(), W::default());
        for lane in layout.channels..layout.lanes() {
            let left = lane - layout.channels;
            // Copies of the last pixel come after the last constant; they change no sum.
            let constant = self.constants.get(left).copied().unwrap_or_default();
            self.sums[lane] = self.sums[left].minus(constant);
        }
    }
}

impl<S: Copy + Into<u16>, W: Word> SummedImage<'_, S, W> {
    /// Returns the rows of samples and of k; k lacks a constant for each column.
    fn rows(&self) -> impl Iterator<Item = (&[S], &[W])> {
        (0..self.layout.height).map(|row| (self.samples.row(row), self.rows.k(row)))
    }

    /// Returns n from lane `from` of a row to its right neighbour, and their biased difference.
    #[inline(always)]
    fn across(&self, (y, k): (&[S], &[W]), from: usize) -> (W, W) {
        let to = from + self.layout.channels;
        let [left, right] = [y[from], y[to]].map(|sample| self.samples.shifted::<W>(sample));
        (k[to].minus(k[from]).minus(wrap_step(left, right)), biased(left, right))
    }

    /// Writes n at `lane` by row.
    fn column(&self, lane: usize, line: &mut Vec<W>) {
        line.clear();
        line.extend(self.rows().map(|row| self.across(row, lane).0));
    }

    /// Writes, by row, the constant at `lane` (not in the first column) that `M_b(d_x d_x y) = d_x d_x x` implies.
    fn second_difference_votes(&self, lane: usize, left_constant: W, line: &mut Vec<W>) {
        line.clear();
        line.extend(self.rows().map(|row| {
            let (n_left, left) = self.across(row, lane - self.layout.channels);
            let (n, here) = self.across(row, lane);
            // The left column is already known, so its second difference predicts this one.
            let want = n_left.minus(left_constant).plus(wrap_step(left, here));
            n.minus(want)
        }));
    }
}
