//! Writes the result row by row, and counts its second differences above one peak and near half of it while the rows are in the cache.

use super::layout::{CodeRows, LANES, RowLayout};
use crate::unwrap::Range;
use crate::unwrap::edges::NEAR_HALF;
use crate::unwrap::wrapped::Word;

/// The numbers of second differences of the result above one peak, and above [`NEAR_HALF`].
#[derive(Clone, Copy, Default)]
pub(super) struct SecondDifferences {
    pub jumps: u64,
    pub near_half: u64,
}

/// The radiance of the last three rows of the result, the new one first; all are longer than their lanes by two pixels.
#[derive(Default)]
pub(super) struct Output<W: Word> {
    rows: [Vec<W::Radiance>; 3],
}

impl<W: Word> Output<W> {
    /// Writes row `i`, whose counts are `k`, to `counts`, and to `x` unless it is left out. Counts the second differences that it completes.
    #[inline(always)]
    pub fn write<S: Copy + Into<u16>>(
        &mut self,
        i: usize,
        samples: &CodeRows<'_, S>,
        k: impl Iterator<Item = W>,
        range: Range,
        (x, counts): (Option<&mut [f32]>, &mut [u8]),
        differences: &mut SecondDifferences,
    ) {
        counts.iter_mut().zip(k).for_each(|(count, k)| *count = k.into() as u8);
        self.rows.rotate_right(1);
        let row = &mut self.rows[0];
        row.resize(counts.len(), W::Radiance::default());
        let samples_of_row = row.iter_mut().zip(samples.row(i)).zip(&*counts);
        samples_of_row.for_each(|((x, &y), &k)| *x = W::radiance(y.into(), k, range.bits()));
        if let Some(x) = x {
            x.iter_mut().zip(&*row).for_each(|(x, &radiance)| *x = radiance.into() as f32);
        }
        samples.layout.fill_up(row);
        self.count_differences(i, samples.layout, range.bits(), differences);
    }

    /// Counts the second differences along row `i`, the last one, and across the row above.
    #[inline(always)]
    fn count_differences(&self, i: usize, layout: RowLayout, bits: u8, differences: &mut SecondDifferences) {
        let RowLayout { width, channels, .. } = layout;
        let ([here, up, upper], lanes, last) = (&self.rows, layout.lanes(), layout.last(0));
        let limits = [NEAR_HALF, 8].map(|eighths| W::eighths(eighths, bits));
        differences.add::<W>([0, 1, 2].map(|pixel| &here[pixel * channels..][..lanes]), limits);
        if width > 1 {
            // The difference between the last pixel and its copy was taken for one of the image.
            let from = last - channels;
            let pixels = [0, 1, 2].map(|pixel| &here[from + pixel * channels..][..channels]);
            differences.remove::<W>(pixels, limits, 1);
        }
        if i > 1 {
            differences.add::<W>([upper, up, here].map(|row| &row[..lanes]), limits);
            let pixels = [upper, up, here].map(|row| &row[last..][..channels]);
            differences.remove::<W>(pixels, limits, layout.copies() as u64);
        }
    }
}

impl SecondDifferences {
    /// Adds those between three lines that are above the limits of `near_half` and of `jumps`.
    #[inline(always)]
    fn add<W: Word>(&mut self, lines: [&[W::Radiance]; 3], [near_half, jump]: [W::Radiance; 2]) {
        let [before, here, after] = lines.map(|line| line.as_chunks::<LANES>().0);
        for ((before, here), after) in before.iter().zip(here).zip(after) {
            let (near, greatest) = W::bends([before, here, after], near_half);
            self.near_half += near;
            // Hardly a block has a jump.
            if greatest > jump {
                self.jumps += W::bends([before, here, after], jump).0;
            }
        }
    }

    /// Removes those between three short lines, so many times.
    fn remove<W: Word>(&mut self, lines: [&[W::Radiance]; 3], limits: [W::Radiance; 2], times: u64) {
        let [before, here, after] = lines;
        for ((&before, &here), &after) in before.iter().zip(here).zip(after) {
            let [near, jumps] = limits.map(|limit| W::bends([&[before], &[here], &[after]], limit).0);
            self.near_half -= times * near;
            self.jumps -= times * jumps;
        }
    }
}
