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
    candidates: Candidates,
    anchors: Vec<i16>,
    line: Vec<i16>,
    ballot: Ballot,
}

/// The columns' majorities while they are being counted; apart, so that a row is one loop of the machine's vectors.
#[derive(Default)]
struct Candidates {
    value: Vec<i16>,
    lead: Vec<i32>,
    agree: Vec<u32>,
    steep: Vec<u32>,
}

impl Gradient {
    /// n, H x (W-1), for `codes`, H x W.
    pub(super) fn unwrap(&mut self, codes: &[u16], width: usize, range: Range) -> &[i16] {
        let columns = width - 1;
        self.n.clear();
        if columns == 0 {
            return &self.n;
        }
        self.candidates.reset(columns);
        self.follow_columns(codes, width);
        self.n.chunks_exact(columns).for_each(|n| self.candidates.count(n));
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
            self.candidates.vote(&n, &self.here);
            self.n.extend_from_slice(&n);
            std::mem::swap(&mut self.here, &mut self.above);
        }
    }

    /// The relative n that stands for 0 in each column: its majority, or in doubt what
    /// follows from the column to the left and `d_x d_x x`.
    fn anchor(&mut self, codes: &[u16], width: usize, mut doubt: Doubt) {
        self.anchors.clear();
        let height = codes.len() / width;
        let columns = width - 1;
        for column in 0..columns {
            let Candidates { value, agree, steep, .. } = &self.candidates;
            let (mut anchor, agree, steep) = (value[column], agree[column] as usize, steep[column] as usize);
            if agree * 2 <= height {
                anchor = self.ballot.count(column_of(&self.n, column, columns, &mut self.line)).value;
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

impl Candidates {
    fn reset(&mut self, columns: usize) {
        *self = Self {
            value: vec![0; columns],
            lead: vec![0; columns],
            agree: vec![0; columns],
            steep: vec![0; columns],
        };
    }

    /// Boyer and Moore's majority vote: a value that more than half of a column has ends as candidate.
    fn vote(&mut self, n: &[i16], g: &[u16]) {
        for ((value, lead), &n) in self.value.iter_mut().zip(&mut self.lead).zip(n) {
            *value = if *lead == 0 { n } else { *value };
            *lead += if n == *value { 1 } else { -1 };
        }
        self.steep.iter_mut().zip(g).for_each(|(steep, &g)| *steep += u32::from(size(g) > STEEP));
    }

    /// Counts who agrees with the candidates, once they are chosen.
    fn count(&mut self, n: &[i16]) {
        let votes = self.agree.iter_mut().zip(&self.value).zip(n);
        votes.for_each(|((agree, value), n)| *agree += u32::from(value == n));
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
