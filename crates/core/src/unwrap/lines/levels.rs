//! Finds the count that stands for k = 0.

use super::layout::{Block, COUNTABLE, CodeRows, LANES, RowLayout, by_channel, tiled};
use super::output::{Output, SecondDifferences};
use super::rows::Rows;
use crate::unwrap::wrapped::Word;
use crate::unwrap::{Range, Recovered, congruence};

/// Up to so many levels, comparing with each of them is faster than a histogram.
const FEW_LEVELS: usize = 12;

/// Half a block, of which the accumulators stay in registers.
const HALF: usize = LANES / 2;

/// The k of the image as a sum of terms by pixel and by column.
pub(super) struct Levels<'a, W> {
    pub layout: RowLayout,
    pub rows: &'a Rows<W>,
    /// The terms of the columns, by lane.
    pub constants: &'a [W],
}

/// The level that stands for k = 0, by channel, and the number of samples that it leaves out of range.
pub(super) struct Base<W> {
    level: [W; 3],
    pub outside: usize,
}

impl<W: Word> Levels<'_, W> {
    /// Finds the base level, below which a share of `outliers` may be; `counts` is a buffer.
    #[inline(always)]
    pub fn zero(&self, range: Range, outliers: f64, counts: &mut Vec<usize>) -> Base<W> {
        counts.clear();
        counts.reserve(congruence::TURNS << W::BITS);
        let (low, high) = self.extent();
        let levels = |channel: usize| usize::from(high[channel].minus(low[channel]).unsigned()) + 1;
        let RowLayout { height, width, channels } = self.layout;
        let most_levels = (0..channels).map(levels).max().unwrap_or_default();
        let most = usize::from(range.max_wraps()) + 1;
        // If all levels fit the range, the base level is the first one as soon as this has too many pixels for outliers.
        let share = (outliers * (height * width) as f64) as usize + height * self.layout.copies();
        let enough = if most_levels <= most { share } else { usize::MAX };
        let table = (most_levels <= FEW_LEVELS).then(|| self.table(most_levels, low, enough));
        let mut zero = Base { level: low, outside: 0 };
        for (channel, level) in zero.level[..channels].iter_mut().enumerate() {
            match &table {
                Some(table) => {
                    counts.clear();
                    counts.extend(table[..levels(channel)].iter().map(|of| of[channel]));
                }
                None => self.histogram(channel, low[channel], levels(channel), counts),
            }
            let index = congruence::base_level_index(counts, range, outliers);
            let inside = counts[index..].iter().take(most);
            zero.outside += counts.iter().sum::<usize>() - inside.sum::<usize>();
            *level = level.plus(W::low(index as u16));
        }
        zero
    }

    /// Returns the least and the greatest k by channel.
    #[inline(always)]
    fn extent(&self) -> ([W; 3], [W; 3]) {
        // The first pixel of the image has k = 0, so it is a valid start for both ends.
        let first = W::default();
        let (mut low, mut high) = ([first; HALF], [first; HALF]);
        for i in 0..self.layout.height {
            let blocks =
                self.rows.k(i).as_chunks::<HALF>().0.iter().zip(self.constants.as_chunks::<HALF>().0);
            for (k, constants) in blocks {
                for l in 0..HALF {
                    let k = k[l].plus(constants[l]);
                    (low[l], high[l]) = (low[l].min(k), high[l].max(k));
                }
            }
        }
        let (mut least, mut greatest) = ([first; 3], [first; 3]);
        for lane in 0..HALF {
            let channel = lane % self.layout.channels;
            least[channel] = least[channel].min(low[lane]);
            greatest[channel] = greatest[channel].max(high[lane]);
        }
        (least, greatest)
    }

    /// Returns the terms of all blocks, row by row: by pixel, and by column.
    #[inline(always)]
    fn blocks(&self) -> impl Iterator<Item = (&Block<W>, &Block<W>)> {
        let k = (0..self.layout.height).flat_map(|i| self.rows.k(i).as_chunks::<LANES>().0);
        k.zip(self.constants.as_chunks().0.iter().cycle())
    }

    /// Returns the number of pixels of each channel at each of the `levels` from `low` on, which are all; only of the first ones of the image
    /// if in each channel more than `enough` of them are at the first level.
    #[inline(always)]
    fn table(&self, levels: usize, low: [W; 3], enough: usize) -> [[usize; 3]; FEW_LEVELS] {
        let RowLayout { height, channels, .. } = self.layout;
        let (first, mut totals) = (tiled(low, channels), [[0; 3]; FEW_LEVELS]);
        let (mut blocks, all) = (self.blocks(), height * self.layout.lanes() / LANES);
        // A counter of 8 bits holds 255 blocks; then it is added to the totals.
        for _ in (0..all).step_by(COUNTABLE) {
            let mut counts = [[W::default(); LANES]; FEW_LEVELS];
            for (k, constants) in blocks.by_ref().take(COUNTABLE) {
                let k = add(k, constants);
                for (level, counts) in (0..).zip(&mut counts[..levels]) {
                    for l in 0..LANES {
                        counts[l] = counts[l].plus(W::one_if(k[l].minus(first[l]) == W::low(level)));
                    }
                }
            }
            counts.iter().zip(&mut totals).for_each(|(counts, total)| by_channel(counts, channels, total));
            if totals[0][..channels].iter().all(|&count| count > enough) {
                return totals;
            }
        }
        // The copies that fill up the rows were counted as well; all of them equal the last pixel.
        for (i, channel) in (0..height).flat_map(|i| (0..channels).map(move |channel| (i, channel))) {
            let lane = self.layout.last(channel);
            let level = self.rows.k(i)[lane].plus(self.constants[lane]).minus(low[channel]);
            totals[usize::from(level.unsigned())][channel] -= self.layout.copies();
        }
        totals
    }

    /// Counts the pixels of `channel` at each of the `levels` from `low` on.
    fn histogram(&self, channel: usize, low: W, levels: usize, counts: &mut Vec<usize>) {
        let RowLayout { height, channels, .. } = self.layout;
        let row = |i: usize| self.rows.k(i).iter().zip(self.constants).take(self.layout.samples());
        let k = (0..height).flat_map(|i| row(i).skip(channel).step_by(channels));
        let level = |(&k, &sum): (&W, &W)| usize::from(k.plus(sum).minus(low).unsigned());
        congruence::histogram(k.map(level), levels, counts);
    }

    /// Writes `out` with `zero` as k = 0; counts out of range are clamped. Returns the counts of second differences of x.
    #[inline(always)]
    pub fn write<S: Copy + Into<u16>>(
        &self,
        samples: &CodeRows<'_, S>,
        zero: &Base<W>,
        range: Range,
        (sums, output): (&mut Vec<W>, &mut Output<W>),
        out: &mut Recovered,
    ) -> SecondDifferences {
        let ((x, counts), most) = (out.buffers(), W::low(range.max_wraps().into()));
        let length = self.layout.samples();
        let start = tiled(zero.level.map(|zero| W::default().minus(zero)), self.layout.channels);
        sums.resize(self.layout.lanes(), W::default());
        let blocks = sums.as_chunks_mut::<LANES>().0.iter_mut().zip(self.constants.as_chunks().0);
        blocks.for_each(|(sums, constants)| *sums = add(constants, &start));
        let mut differences = SecondDifferences::default();
        let mut x = x.chunks_exact_mut(length);
        for (i, counts) in counts.chunks_exact_mut(length).enumerate() {
            let k = self.rows.k(i).iter().zip(&*sums);
            let k = k.map(|(k, &sum)| k.plus(sum).max(W::default()).min(most));
            output.write(i, samples, k, range.bits(), (x.next(), counts), &mut differences);
        }
        differences
    }
}

#[inline(always)]
fn add<W: Word>(a: &Block<W>, b: &Block<W>) -> Block<W> {
    let mut sum = *a;
    sum.iter_mut().zip(b).for_each(|(sum, &b)| *sum = sum.plus(b));
    sum
}
