//! Writes the result row by row, and counts its second differences above one peak and near half of it while the rows are in the cache.
//!
//! They are computed only beside great differences, which few blocks have: a second difference between two differences of half a limit is at
//! most that limit.

use super::layout::{CodeRows, LANES, RowLayout};
use crate::unwrap::Range;
use crate::unwrap::edges::NEAR_HALF;
use crate::unwrap::wrapped::{Word, biased, exceeds, wrap_step};

/// The numbers of second differences of the result above one peak, and above [`NEAR_HALF`].
#[derive(Clone, Copy, Default)]
pub(super) struct SecondDifferences {
    pub jumps: u64,
    pub near_half: u64,
}

/// The last two rows of the result, the new one first, with their codes; all are longer than their lanes by one pixel.
#[derive(Default)]
pub(super) struct Output<W> {
    codes: [Vec<W>; 2],
    k: [Vec<W>; 2],
    /// Whether a block of the last row has a great difference to the row above.
    apart: Vec<bool>,
}

impl<W: Word> Output<W> {
    /// Writes row `i`, whose counts are `k`, to `counts` and to the end of `x`, which holds the rows so far. Counts the
    /// second differences that it completes.
    #[inline(always)]
    pub fn write<S: Copy + Into<u16>>(
        &mut self,
        i: usize,
        samples: &CodeRows<'_, S>,
        k: impl Iterator<Item = W>,
        range: Range,
        (x, counts): (&mut [f32], &mut [u8]),
        differences: &mut SecondDifferences,
    ) {
        let (layout, length) = (samples.layout, counts.len());
        self.codes.swap(0, 1);
        self.k.swap(0, 1);
        samples.read(i, &mut self.codes[0]);
        self.k[0].clear();
        self.k[0].extend(k);
        self.k[0].extend_from_within(layout.last(0)..length);
        let row = x[i * length..].iter_mut().zip(counts).zip(samples.row(i)).zip(&self.k[0]);
        for (((x, count), &y), &k) in row {
            let k: u16 = k.into();
            *x = (i32::from(y.into()) + (i32::from(k) << range.bits())) as f32;
            *count = k as u8;
        }
        self.count_differences(i, layout, x, range.peak(), differences);
    }

    /// Counts the second differences along row `i`, the last one of `x`, and across the row above.
    #[inline(always)]
    fn count_differences(
        &mut self,
        i: usize,
        layout: RowLayout,
        x: &[f32],
        peak: f32,
        differences: &mut SecondDifferences,
    ) {
        let (channels, length, mut next_apart) = (layout.channels, layout.samples(), false);
        let Self { codes, k, apart } = self;
        // The first row is its own neighbour.
        let above = usize::from(i > 0);
        apart.resize(layout.lanes() / LANES, false);
        for (block, apart_above) in apart.iter_mut().enumerate().rev() {
            let at = block * LANES;
            let end = length.min(at + LANES);
            let is_apart = are_apart(
                [&codes[0][at..], &codes[0][at + channels..]],
                [&k[0][at..], &k[0][at + channels..]],
            );
            // A second difference that begins in this block may end in the next one, which comes first.
            let inner = at..end.min(length.saturating_sub(2 * channels));
            if (is_apart || next_apart) && !inner.is_empty() {
                let line = |shift: usize| &x[i * length + shift * channels..][inner.clone()];
                differences.add([line(0), line(1), line(2)], peak);
            }
            next_apart = is_apart;
            let is_apart = are_apart([&codes[above][at..], &codes[0][at..]], [&k[above][at..], &k[0][at..]]);
            if i > 1 && (is_apart || *apart_above) {
                let line = |row: usize| &x[(i - row) * length..][at..end];
                differences.add([line(2), line(1), line(0)], peak);
            }
            *apart_above = is_apart;
        }
    }
}

impl SecondDifferences {
    /// Counts those between three lines.
    #[inline(always)]
    fn add(&mut self, [before, here, after]: [&[f32]; 3], peak: f32) {
        let (near, mut counts) = (f32::from(NEAR_HALF) / 8.0 * peak, [0u32; 2]);
        for ((before, here), after) in before.iter().zip(here).zip(after) {
            let difference = (before + after - here - here).abs();
            counts[0] += u32::from(difference > peak);
            counts[1] += u32::from(difference > near);
        }
        self.jumps += u64::from(counts[0]);
        self.near_half += u64::from(counts[1]);
    }
}

/// Returns whether one of the differences between two blocks of codes, with their counts, is above half of [`NEAR_HALF`].
#[inline(always)]
fn are_apart<W: Word>([y, next_y]: [&[W]; 2], [k, next_k]: [&[W]; 2]) -> bool {
    let (y, next_y, k, next_k) = (&y[..LANES], &next_y[..LANES], &k[..LANES], &next_k[..LANES]);
    (0..LANES).fold(false, |any, i| {
        // Below half a peak, a difference is that of the codes, wrapped.
        let is_wrapped = next_k[i].minus(k[i]) == wrap_step(y[i], next_y[i]);
        any | !is_wrapped | exceeds(biased(y[i], next_y[i]), NEAR_HALF)
    })
}
