//! Sums of the unwrapped gradient along rows, and rows joined to an image.

use super::majority::{Ballot, Doubt, STEEP, Vote};
use crate::unwrap::Range;
use crate::unwrap::wrapped::{raised, size, turns};

/// Buffers, and the wrap counts relative to the first pixel.
#[derive(Default)]
pub(super) struct Rows {
    /// Of this row, of the row above and of the one above that.
    k: [Vec<i16>; 3],
    /// By column: what joins this row to the one above.
    line: Vec<i16>,
    ballot: Ballot,
    out: Vec<i32>,
}

impl Rows {
    /// k of `codes`, H x W, up to a constant, from `n`, H x (W-1), of its horizontal gradient.
    pub(super) fn integrate(&mut self, codes: &[u16], n: &[i16], width: usize, range: Range) -> &[i32] {
        self.out.clear();
        let mut doubt = Doubt::new(range);
        let mut last = 0;
        for (i, y) in codes.chunks_exact(width).enumerate() {
            self.k.rotate_right(1);
            sum(y, &n[i * (width - 1)..(i + 1) * (width - 1)], &mut self.k[0]);
            if i > 0 {
                let above = &codes[..i * width];
                last = self.join(y, above, last, &mut doubt);
                self.k[0].iter_mut().for_each(|k| *k = k.wrapping_add(last));
            }
            self.out.extend(self.k[0].iter().map(|&k| i32::from(k)));
        }
        &self.out
    }

    /// What to add to this row's k so that it continues the rows `above` it: what most
    /// columns say if `|d_y x|` is small, or in doubt if `|d_y d_y x|` is.
    fn join(&mut self, y: &[u16], above: &[u16], last: i16, doubt: &mut Doubt) -> i16 {
        let width = y.len();
        let (further, up) = above.split_at(above.len() - width);
        first_opinion(y, up, &self.k, &mut self.line);
        let majority = self.majority(last);
        let steep = y.iter().zip(up).filter(|&(&y, &up)| size(raised(up, y)) > STEEP).count();
        if !doubt.arises(majority.count, steep, width) || further.is_empty() {
            return majority.value;
        }
        second_opinion(y, up, &further[further.len() - width..], &self.k, &mut self.line);
        let opinion = self.ballot.count(&self.line);
        // Noise blurs second differences more than first ones.
        let chosen = if opinion.count * 10 > majority.count * 9 { opinion } else { majority };
        doubt.settle(majority.value, chosen.value);
        chosen.value
    }

    /// Of what the columns say; mostly it is what it was a row above.
    fn majority(&mut self, last: i16) -> Vote {
        let count = self.line.iter().filter(|&&value| value == last).count();
        if count * 2 > self.line.len() { Vote { value: last, count } } else { self.ballot.count(&self.line) }
    }
}

/// k along one row, 0 at its start.
fn sum(y: &[u16], n: &[i16], k: &mut Vec<i16>) {
    k.clear();
    k.push(0);
    k.extend(y.iter().zip(&y[1..]).zip(n).map(|((&left, &right), &n)| turns(left, right).wrapping_add(n)));
    let mut total = 0i16;
    for k in k {
        total = total.wrapping_add(*k);
        *k = total;
    }
}

/// By column: what joins row `y` to the row `up`, if `|d_y x|` is below half a peak.
fn first_opinion(y: &[u16], up: &[u16], [k, k_up, _]: &[Vec<i16>; 3], line: &mut Vec<i16>) {
    line.clear();
    let counts = k.iter().zip(k_up);
    line.extend(
        y.iter()
            .zip(up)
            .zip(counts)
            .map(|((&y, &up), (k, k_up))| turns(up, y).wrapping_add(*k_up).wrapping_sub(*k)),
    );
}

/// Adds to that, by column, the n of `d_y x = M_b(d_y y) + n * 2^b`, if `|d_y d_y x|` is below
/// half a peak: the n one row above, and one more where the difference itself wraps.
fn second_opinion(y: &[u16], up: &[u16], upper: &[u16], k: &[Vec<i16>; 3], line: &mut [i16]) {
    let [_, k_up, k_upper] = k;
    let codes = y.iter().zip(up).zip(upper);
    let counts = k_up.iter().zip(k_upper);
    for ((value, ((&y, &up), &upper)), (&k_up, &k_upper)) in line.iter_mut().zip(codes).zip(counts) {
        let n_up = k_up.wrapping_sub(k_upper).wrapping_sub(turns(upper, up));
        let n = n_up.wrapping_add(turns(raised(upper, up), raised(up, y)));
        *value = value.wrapping_add(n);
    }
}
