//! Finds the count that stands for k = 0.

use super::layout::{COUNTABLE, CodeRows, LANES, RowLayout, by_channel, tiled};
use super::output::{Output, SecondDifferences};
use super::rows::Rows;
use crate::unwrap::wrapped::Word;
use crate::unwrap::{Range, Recovered, congruence};

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
        let most = usize::from(range.max_wraps()) + 1;
        let mut zero = Base { level: low, outside: 0 };
        // If all levels fit the range, the base level is the first one as soon as this has too many pixels for outliers.
        let share = (outliers * (height * width) as f64) as usize + height * self.layout.copies();
        if (0..channels).all(|channel| levels(channel) <= most) && self.has_more_at(low, share) {
            return zero;
        }
        for (channel, level) in zero.level[..channels].iter_mut().enumerate() {
            self.histogram(channel, low[channel], levels(channel), counts);
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

    /// Returns whether in each channel more than `share` pixels, with the copies that fill up the rows, are at the level `low`.
    #[inline(always)]
    fn has_more_at(&self, low: [W; 3], share: usize) -> bool {
        let channels = self.layout.channels;
        let (low, mut totals) = (tiled(low, channels), [0; 3]);
        for i in 0..self.layout.height {
            // A counter of 8 bits holds 255 blocks.
            let [k, constants] =
                [self.rows.k(i), self.constants].map(|row| row.as_chunks::<LANES>().0.chunks(COUNTABLE));
            for (k, constants) in k.zip(constants) {
                let mut counts = [W::default(); LANES];
                for (k, constants) in k.iter().zip(constants) {
                    for l in 0..LANES {
                        counts[l] = counts[l].plus(W::one_if(k[l].plus(constants[l]) == low[l]));
                    }
                }
                by_channel(&mut counts, channels, &mut totals);
            }
            if totals[..channels].iter().all(|&total| total > share) {
                return true;
            }
        }
        false
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
        let term = |(lane, constant): (usize, &W)| constant.minus(zero.level[lane % self.layout.channels]);
        sums.clear();
        sums.extend(self.constants.iter().enumerate().map(term));
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
