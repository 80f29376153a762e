//! Prefix sums along rows, each channel separately, in whole vectors.
//!
//! Sums over 4, then over 16 pixels are sums of shifted rows, so only one sum for each lane is carried from block
//! to block.

use super::layout::{Block, LANES, RowLayout};
use crate::unwrap::wrapped::Word;

/// The zeros before a row, as many as the largest shift.
const BEFORE: usize = LANES;

/// The number of pixels that `wide` sums over.
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

    /// Returns the buffer for the change of each pixel to its right neighbour.
    pub fn steps(&mut self) -> &mut [W] {
        &mut self.steps[BEFORE + self.channels..]
    }

    /// Computes the sums over the 16 pixels up to each pixel.
    #[inline(always)]
    pub fn widen(&mut self) {
        // Two steps of four give 16: a running sum would depend on the previous lane and defeat the vectors.
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

/// Adds to every lane the three before it, `stride` lanes apart.
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
