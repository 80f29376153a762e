//! Writes the result row by row, and counts its second differences above one peak and near half of it while the rows are in the cache.

use super::layout::CodeRows;
use crate::unwrap::Range;
use crate::unwrap::edges::NEAR_HALF;
use crate::unwrap::wrapped::Word;

/// The numbers of second differences of the result above one peak, and above [`NEAR_HALF`].
#[derive(Clone, Copy, Default)]
pub(super) struct SecondDifferences {
    pub jumps: u64,
    pub near_half: u64,
}

/// The samples whose second differences are counted at once, few enough that a number of radiance holds their count.
const PART: usize = 1 << 12;

/// The radiance of the last three rows of the result, the new one first.
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
        counts.iter_mut().zip(k).for_each(|(count, k)| *count = k.unsigned() as u8);
        self.rows.rotate_right(1);
        let row = &mut self.rows[0];
        row.resize(counts.len(), W::Radiance::default());
        let samples_of_row = row.iter_mut().zip(samples.row(i)).zip(&*counts);
        samples_of_row.for_each(|((x, &y), &k)| *x = W::radiance(y.into(), k, range.bits()));
        if let Some(x) = x {
            x.iter_mut().zip(&*row).for_each(|(x, &radiance)| *x = radiance.into() as f32);
        }
        self.count_differences(i, samples.layout.channels, range.bits(), differences);
    }

    /// Counts the second differences along row `i`, the last one, and across the row above.
    #[inline(always)]
    fn count_differences(&self, i: usize, channels: usize, bits: u8, differences: &mut SecondDifferences) {
        let [here, up, upper] = self.rows.each_ref().map(|row| &row[..]);
        let limits = [NEAR_HALF, 8].map(|eighths| W::eighths(eighths, bits));
        if let Some(inner) = here.len().checked_sub(2 * channels) {
            differences.add::<W>([0, 1, 2].map(|pixel| &here[pixel * channels..][..inner]), limits);
        }
        if i > 1 {
            differences.add::<W>([upper, up, here], limits);
        }
    }
}

impl SecondDifferences {
    /// Adds those between three lines of one length that are above the limits of `near_half` and of `jumps`.
    #[inline(always)]
    fn add<W: Word>(&mut self, lines: [&[W::Radiance]; 3], [near_half, jump]: [W::Radiance; 2]) {
        let [before, here, after] = lines.map(|line| line.chunks(PART));
        for ((before, here), after) in before.zip(here).zip(after) {
            let (near, greatest) = W::bends([before, here, after], near_half);
            self.near_half += near;
            // Hardly a row has a jump.
            if greatest > jump {
                self.jumps += W::bends([before, here, after], jump).0;
            }
        }
    }
}
