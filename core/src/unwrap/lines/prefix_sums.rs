//! PrefixSums along rows, every channel on its own, in whole vectors.
//!
//! PrefixSums over 4, then 16 pixels are sums of shifted rows; from one block to the next only
//! one sum a lane is carried.

use super::layout::{Block, LANES, RowLayout};
use crate::unwrap::wrapped::Word;

/// Zeros before a row, as far as any shift reaches.
const BEFORE: usize = LANES;

/// Pixels over which the second row sums.
const WIDE: usize = 16;

/// The increments of a row, and their sums over neighbours.
#[derive(Default)]
pub(super) struct PrefixSums<W> {
    steps: Vec<W>,
    narrow: Vec<W>,
    wide: Vec<W>,
    channels: usize,
}

impl<W: Word> PrefixSums<W> {
    /// Makes room for rows of `layout`.
    pub fn start(&mut self, layout: RowLayout) {
        for row in [&mut self.steps, &mut self.narrow, &mut self.wide] {
            row.clear();
            row.resize(BEFORE + layout.lanes() + layout.channels, W::default());
        }
        self.channels = layout.channels;
    }

    /// Where the change of each pixel to its right neighbour goes.
    pub fn steps(&mut self) -> &mut [W] {
        &mut self.steps[BEFORE + self.channels..]
    }

    /// PrefixSums over 16 pixels up to each pixel.
    #[inline(always)]
    pub fn widen(&mut self) {
        widen(&self.steps, self.channels, &mut self.narrow);
        widen(&self.narrow, 4 * self.channels, &mut self.wide);
    }

    /// Advances `sum` to the end of the block that starts at lane `at`.
    #[inline(always)]
    pub fn advance(&self, at: usize, sum: &mut Block<W>) {
        let stride = WIDE * self.channels;
        for back in (0..LANES).step_by(stride) {
            let from = &self.wide[BEFORE + at - back..][..LANES];
            sum.iter_mut().zip(from).for_each(|(sum, &w)| *sum = sum.plus(w));
        }
    }
}

/// Every lane plus the three before it, `stride` lanes apart.
#[inline(always)]
fn widen<W: Word>(from: &[W], stride: usize, to: &mut [W]) {
    let length = from.len() - BEFORE;
    let back = |times: usize| &from[BEFORE - times * stride..][..length];
    let near = back(0).iter().zip(back(1));
    let far = back(2).iter().zip(back(3));
    for (to, ((&a, &b), (&c, &d))) in to[BEFORE..].iter_mut().zip(near.zip(far)) {
        *to = a.plus(b).plus(c.plus(d));
    }
}
