//! Finds the constant of each column by a majority vote: the n that stands for 0.

use super::gradient::Gradient;
use super::layout::{CodeRows, RowLayout};
use super::majority::{MajorityCheck, VoteCounter};
use super::rows::Rows;
use crate::simd::widest;
use crate::unwrap::Range;
use crate::unwrap::wrapped::{Word, wrap_step};

/// The lanes of a row that are read at once, those of them whose right neighbour is among them, and those whose right neighbour also has one.
const WINDOW: usize = 80;
const INNER: usize = WINDOW - 16;
const REACH: usize = INNER - 16;

/// The codes of an image, and its k, whose rows have been summed.
type Summed<'a, S, W> = (&'a CodeRows<'a, S>, &'a Rows<W>);

/// The constants of the columns, with buffers.
#[derive(Default)]
pub(super) struct ColumnConstants<W> {
    constants: Vec<W>,
    /// The sum of the constants up to each lane, which is to be added to k of every row.
    pub sums: Vec<W>,
    near: NearColumns<W>,
    votes: VoteCounter,
}

/// Some neighbouring columns.
#[derive(Default)]
struct NearColumns<W> {
    /// The first lane, none before any was read.
    first: Option<usize>,
    /// By row and lane, n from the lane to its right neighbour.
    n: Vec<[W; INNER]>,
    /// By row and lane, the constant of the right neighbour that `M_b(d_x d_x y) = d_x d_x x` implies if that of the lane is 0.
    second: Vec<[W; REACH]>,
}

impl<W: Word> ColumnConstants<W> {
    /// Finds the constant of each column: the majority of its n, or, where the majority is in doubt, the value
    /// that follows from the column to the left and `d_x d_x x`.
    pub fn find<S: Copy + Into<u16>>(
        &mut self,
        gradient: &Gradient<W>,
        summed: Summed<'_, S, W>,
        range: Range,
    ) {
        let RowLayout { height, channels, .. } = summed.0.layout;
        self.near.start(height);
        self.votes.start::<W>();
        let mut checks = [MajorityCheck::new(range); 3];
        self.constants.clear();
        for lane in 0..summed.0.layout.last(0) {
            let (agree, steep) = (gradient.zeros[lane] as usize, gradient.steep[lane] as usize);
            let (mut constant, mut count) = (W::default(), agree);
            // If more than half of the rows agree on 0, no other value can have the majority.
            if agree * 2 <= height {
                let l = self.near.reach(lane, summed);
                let majority = self.votes.count(self.near.n.iter().map(|n| n[l]));
                (constant, count) = (majority.value, majority.count);
            }
            let check = &mut checks[lane % channels];
            // The first column has no column to its left that could predict it.
            if check.needs_second_vote(count, steep, height) && lane >= channels {
                let l = self.near.reach(lane, summed);
                let second = self.votes.count(self.near.second.iter().map(|second| second[l - channels]));
                // The left column is already known, so its second difference predicts this one.
                let predicted = second.value.plus(self.constants[lane - channels]);
                check.record(constant != predicted);
                constant = predicted;
            }
            self.constants.push(constant);
        }
        self.sum(summed.0.layout);
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

impl<W: Word> NearColumns<W> {
    /// Starts an image.
    fn start(&mut self, height: usize) {
        self.first = None;
        self.n.resize(height, [W::default(); INNER]);
        self.second.resize(height, [W::default(); REACH]);
    }

    /// Returns the place of a lane among the columns, which are read anew if it is not among them.
    fn reach<S: Copy + Into<u16>>(&mut self, lane: usize, (samples, rows): Summed<'_, S, W>) -> usize {
        let channels = samples.layout.channels;
        // The left neighbour is read as well, where there is one.
        let first = lane.saturating_sub(channels);
        match self.first {
            Some(first) if lane < first + REACH => lane - first,
            _ => {
                self.first = Some(first);
                let rows_of_votes = self.n.iter_mut().zip(&mut self.second);
                widest!(for (i, (n, second)) in rows_of_votes.enumerate() {
                    let row = (&samples.row(i)[first..], &rows.k(i)[first..]);
                    (*n, *second) = votes(row, |sample| samples.word(sample), channels);
                });
                lane - first
            }
        }
    }
}

/// Returns the votes of the first lanes of a row of samples and k, as [`NearColumns`] has them.
#[inline(always)]
fn votes<S: Copy, W: Word>(
    (samples, counts): (&[S], &[W]),
    word: impl Fn(S) -> W,
    channels: usize,
) -> ([W; INNER], [W; REACH]) {
    let (mut y, mut k) = ([W::default(); WINDOW], [W::default(); WINDOW]);
    match (samples.first_chunk::<WINDOW>(), counts.first_chunk()) {
        (Some(samples), Some(counts)) => {
            y.iter_mut().zip(samples).for_each(|(y, &sample)| *y = word(sample));
            k = *counts;
        }
        _ => {
            y.iter_mut().zip(samples).for_each(|(y, &sample)| *y = word(sample));
            k.iter_mut().zip(counts).for_each(|(k, &count)| *k = count);
        }
    }
    let (mut n, mut across, mut second) =
        ([W::default(); INNER], [W::default(); INNER], [W::default(); REACH]);
    let (y_right, k_right) = (&y[channels..][..INNER], &k[channels..][..INNER]);
    for l in 0..INNER {
        n[l] = k_right[l].minus(k[l]).minus(wrap_step(y[l], y_right[l]));
        across[l] = y_right[l].minus(y[l]);
    }
    let (n_right, across_right) = (&n[channels..][..REACH], &across[channels..][..REACH]);
    for l in 0..REACH {
        second[l] = n_right[l].minus(n[l]).minus(wrap_step(across[l], across_right[l]));
    }
    (n, second)
}
