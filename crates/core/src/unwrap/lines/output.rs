//! Writes the result row by row, and counts its second differences above one peak and near half of it while the rows are in the cache.

use super::layout::{CodeRows, RowLayout};
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

/// The radiance of the last three rows of the result, the new one first. A pixel before and one behind a row continue it straight on, so that no second
/// difference is at its ends.
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
        bits: u8,
        (x, counts): (Option<&mut [f32]>, &mut [u8]),
        differences: &mut SecondDifferences,
    ) {
        let (length, pixel) = (counts.len(), samples.layout.channels);
        counts.iter_mut().zip(k).for_each(|(count, k)| *count = k.unsigned() as u8);
        self.rows.rotate_right(1);
        let padded = &mut self.rows[0];
        padded.resize(length + 2 * pixel, W::Radiance::default());
        let row = &mut padded[pixel..][..length];
        let samples_of_row = row.iter_mut().zip(samples.row(i)).zip(&*counts);
        samples_of_row.for_each(|((x, &y), &k)| *x = W::radiance(y.into(), k, bits));
        if let Some(x) = x {
            x.iter_mut().zip(&*row).for_each(|(x, &radiance)| *x = radiance.into() as f32);
        }
        let next = samples.layout.width.min(2) * pixel;
        for channel in 0..pixel {
            padded[channel] = W::straight_on(padded[next + channel], padded[pixel + channel]);
            let end = length + pixel + channel;
            padded[end] = W::straight_on(padded[end - next], padded[end - pixel]);
        }
        self.count_differences(i, samples.layout, bits, differences);
    }

    /// Counts the second differences that row `i`, the last one, completes: along the row above and across it, and along the last row of the
    /// image.
    #[inline(always)]
    fn count_differences(&self, i: usize, layout: RowLayout, bits: u8, differences: &mut SecondDifferences) {
        let limits = [NEAR_HALF, 8].map(|eighths| W::eighths(eighths, bits));
        let [below, here, above] = &self.rows;
        // Where there is no neighbour, a sample that is its own neighbour does not bend.
        if i > 0 {
            let beside = if i > 1 { [above, below] } else { [here, here] };
            differences.add::<W>(here, beside, layout.channels, limits);
        }
        if i + 1 == layout.height {
            differences.add::<W>(below, [below, below], layout.channels, limits);
        }
    }
}

impl SecondDifferences {
    /// Adds those along a row and across it, from the row above to that below, which are above the limits of `near_half` and of `jumps`.
    #[inline(always)]
    fn add<W: Word>(
        &mut self,
        row: &[W::Radiance],
        beside: [&Vec<W::Radiance>; 2],
        pixel: usize,
        [near_half, jump]: [W::Radiance; 2],
    ) {
        let length = row.len() - 2 * pixel;
        for from in (0..length).step_by(PART) {
            let part = |start: usize| from + start..(from + PART).min(length) + start;
            let here = &row[part(pixel)];
            let along = [&row[part(0)], &row[part(2 * pixel)]];
            let across = beside.map(|row| &row[part(pixel)]);
            let (near, greatest) = W::bends(here, [along, across], near_half);
            self.near_half += near;
            // Hardly a row has a jump.
            if greatest > jump {
                self.jumps += W::bends(here, [along, across], jump).0;
            }
        }
    }
}
