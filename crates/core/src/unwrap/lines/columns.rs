//! Finds the constant of each column by a majority vote: the n that stands for 0.

use super::gradient::Gradient;
use super::layout::{CodeRows, LANES, RowLayout};
use super::majority::{MajorityCheck, Vote, VoteCounter};
use crate::simd::widest;
use crate::unwrap::Range;
use crate::unwrap::wrapped::{Word, wrap_step};

/// The constants of the columns, with buffers.
#[derive(Default)]
pub(super) struct ColumnConstants<W> {
    constants: Vec<W>,
    /// The sum of the constants up to each lane, which is to be added to k of every row.
    pub sums: Vec<W>,
    /// By row, n from a lane to its right neighbour.
    n: Vec<W>,
    /// By row, n from its left neighbour to a lane, then the constant that `M_b(d_x d_x y) = d_x d_x x` implies if that of the left neighbour is 0.
    second: Vec<W>,
    votes: VoteCounter,
}

impl<W: Word> ColumnConstants<W> {
    /// Finds the constant of each column: the majority of its n, or, where the majority is in doubt, the value
    /// that follows from the column to the left and `d_x d_x x`.
    pub fn find<S: Copy + Into<u16>>(
        &mut self,
        gradient: &Gradient<W>,
        samples: &CodeRows<'_, S>,
        range: Range,
    ) {
        let RowLayout { height, channels, .. } = samples.layout;
        self.votes.start::<W>();
        self.n.resize(height, W::default());
        self.second.resize(height, W::default());
        let mut checks = [MajorityCheck::new(range); 3];
        let mut agree = [0; LANES];
        self.constants.clear();
        // Copies of the last pixel come after the last constant; they change no sum.
        self.constants.resize(samples.layout.lanes(), W::default());
        for pixel in (0..samples.layout.last(0)).step_by(channels) {
            if pixel % LANES == 0 {
                agree = widest!(gradient.zeros(pixel / LANES, height));
            }
            for (lane, check) in (pixel..pixel + channels).zip(&mut checks) {
                self.constants[lane] =
                    self.constant(lane, agree[lane % LANES] as usize, check, gradient, samples);
            }
        }
        self.sums.clear();
        self.sums.resize(channels, W::default());
        for lane in channels..samples.layout.lanes() {
            self.sums.push(self.sums[lane - channels].minus(self.constants[lane - channels]));
        }
    }

    /// Returns the constant of a lane, in so many rows of which n is 0.
    #[inline(always)]
    fn constant<S: Copy + Into<u16>>(
        &mut self,
        lane: usize,
        agree: usize,
        check: &mut MajorityCheck,
        gradient: &Gradient<W>,
        samples: &CodeRows<'_, S>,
    ) -> W {
        let RowLayout { height, channels, .. } = samples.layout;
        let mut majority = Vote { value: W::default(), count: agree };
        // If more than half of the rows agree on 0, no other value can have the majority.
        if agree * 2 <= height {
            write_column(lane, gradient, &mut self.n);
            majority = self.votes.count(self.n.iter().copied());
        }
        // The first column has no column to its left that could predict it.
        if !check.needs_second_vote(majority.count, gradient.steep[lane] as usize, height) || lane < channels
        {
            return majority.value;
        }
        write_column(lane, gradient, &mut self.n);
        write_column(lane - channels, gradient, &mut self.second);
        for ((second, &n), row) in self.second.iter_mut().zip(&self.n).zip(samples.rows_from(lane - channels))
        {
            let [right, here, left] = [2, 1, 0].map(|pixel| samples.word::<W>(row[pixel * channels]));
            *second = n.minus(*second).minus(wrap_step(here.minus(left), right.minus(here)));
        }
        // The left column is already known, so its second difference predicts this one.
        let predicted =
            self.votes.count(self.second.iter().copied()).value.plus(self.constants[lane - channels]);
        check.record(majority.value != predicted);
        predicted
    }
}

/// Writes n of a lane, row by row.
fn write_column<W: Word>(lane: usize, gradient: &Gradient<W>, column: &mut [W]) {
    for (rows, n) in gradient.runs(lane / LANES, column.len()) {
        column[rows].fill(n[lane % LANES]);
    }
}
