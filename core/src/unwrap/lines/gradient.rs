//! The horizontal gradient, unwrapped down its columns.

use super::majority::{Ballot, Doubt, STEEP, Vote};
use crate::unwrap::Range;
use crate::unwrap::wrapped::{raised, size, turns};

/// Buffers, and n of `d_x x = g + n * 2^b`.
#[derive(Default)]
pub(super) struct Gradient {
    /// g of this row and of the one above, raised by half a peak.
    here: Vec<u16>,
    above: Vec<u16>,
    /// H x (W-1).
    n: Vec<i16>,
    /// By column: what most of it may say, and how much of it is steep.
    candidates: Vec<Candidate>,
    anchors: Vec<i16>,
    line: Vec<i16>,
    ballot: Ballot,
}

/// A column's majority while it is being counted.
#[derive(Clone, Copy, Default)]
struct Candidate {
    value: i16,
    lead: i32,
    agree: u32,
    steep: u32,
}

impl Gradient {
    /// n, H x (W-1), for `codes`, H x W.
    pub(super) fn unwrap(&mut self, codes: &[u16], width: usize, range: Range) -> &[i16] {
        let columns = width - 1;
        self.n.clear();
        if columns == 0 {
            return &self.n;
        }
        self.candidates.clear();
        self.candidates.resize(columns, Candidate::default());
        self.follow_columns(codes, width);
        self.count();
        self.anchor(codes, width, Doubt::new(range));
        for row in self.n.chunks_exact_mut(columns) {
            row.iter_mut().zip(&self.anchors).for_each(|(n, anchor)| *n = n.wrapping_sub(*anchor));
        }
        &self.n
    }

    /// n up to a constant a column, 0 in the first row.
    fn follow_columns(&mut self, codes: &[u16], width: usize) {
        let columns = width - 1;
        let mut n = vec![0i16; columns];
        for (i, row) in codes.chunks_exact(width).enumerate() {
            self.here.clear();
            self.here.extend(row.iter().zip(&row[1..]).map(|(&left, &right)| raised(left, right)));
            if i > 0 {
                let pairs = self.above.iter().zip(&self.here);
                n.iter_mut()
                    .zip(pairs)
                    .for_each(|(n, (&above, &here))| *n = n.wrapping_add(turns(above, here)));
            }
            let votes = self.candidates.iter_mut().zip(&n).zip(&self.here);
            votes.for_each(|((candidate, &n), &g)| candidate.vote(n, g));
            self.n.extend_from_slice(&n);
            std::mem::swap(&mut self.here, &mut self.above);
        }
    }

    /// How many of each column agree with its candidate.
    fn count(&mut self) {
        for row in self.n.chunks_exact(self.candidates.len()) {
            let votes = self.candidates.iter_mut().zip(row);
            votes.for_each(|(candidate, &n)| candidate.agree += u32::from(n == candidate.value));
        }
    }

    /// The relative n that stands for 0 in each column: its majority, or in doubt what
    /// follows from the column to the left and `d_x d_x x`.
    fn anchor(&mut self, codes: &[u16], width: usize, mut doubt: Doubt) {
        self.anchors.clear();
        let height = codes.len() / width;
        for (column, candidate) in self.candidates.iter().enumerate() {
            let (agree, steep) = (candidate.agree as usize, candidate.steep as usize);
            let mut anchor = candidate.value;
            if agree * 2 <= height {
                anchor = self
                    .ballot
                    .count(column_of(&self.n, column, self.candidates.len(), &mut self.line))
                    .value;
            }
            if doubt.arises(agree, steep, height)
                && let Some(&left) = self.anchors.last()
            {
                let opinion = second_opinion(codes, width, &self.n, column, left, &mut self.line);
                let Vote { value, .. } = self.ballot.count(opinion);
                doubt.settle(anchor, value);
                anchor = value;
            }
            self.anchors.push(anchor);
        }
    }
}

impl Candidate {
    /// Boyer and Moore's majority vote: a value that more than half of a column has ends as candidate.
    fn vote(&mut self, n: i16, g: u16) {
        self.value = if self.lead == 0 { n } else { self.value };
        self.lead += if n == self.value { 1 } else { -1 };
        self.steep += u32::from(size(g) > STEEP);
    }
}

fn column_of<'a>(n: &[i16], column: usize, columns: usize, line: &'a mut Vec<i16>) -> &'a [i16] {
    line.clear();
    line.extend(n.chunks_exact(columns).map(|row| row[column]));
    line
}

/// By row: the anchor of `column` (> 0) if `M_b(d_x d_x y) = d_x d_x x` there.
fn second_opinion<'a>(
    codes: &[u16],
    width: usize,
    n: &[i16],
    column: usize,
    left_anchor: i16,
    line: &'a mut Vec<i16>,
) -> &'a [i16] {
    line.clear();
    line.extend(codes.chunks_exact(width).zip(n.chunks_exact(width - 1)).map(|(y, n)| {
        let (left, here) = (raised(y[column - 1], y[column]), raised(y[column], y[column + 1]));
        let want = n[column - 1].wrapping_sub(left_anchor).wrapping_add(turns(left, here));
        n[column].wrapping_sub(want)
    }));
    line
}
