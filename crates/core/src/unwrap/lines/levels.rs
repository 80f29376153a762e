//! Finds the count that stands for k = 0, and writes the result.

use super::layout::{Block, COUNTABLE, CodeRows, LANES, RowLayout, by_channel, tiled};
use super::rows::Rows;
use crate::unwrap::wrapped::Word;
use crate::unwrap::{Range, Recovered, congruence, jumps};

/// Up to so many levels, counting one level at a time is faster than a histogram.
const FEW_LEVELS: usize = 12;

/// A histogram has so many counters for each level, which take turns: neighbours are mostly at one level, and a counter
/// waits for its last sum.
const TURNS: usize = 4;

/// The k of the image as a sum of terms by pixel, by row and by column.
pub(super) struct Levels<'a, W> {
    pub layout: RowLayout,
    pub rows: &'a Rows<W>,
    /// The terms of the columns, by lane.
    pub constants: &'a [W],
}

/// The level that stands for k = 0, biased, by channel, and the number of samples that it leaves out of range.
pub(super) struct BaseLevel<W> {
    level: [W; 3],
    pub outside: usize,
}

/// The least and the greatest k by channel, biased by half a peak.
struct Extent<W> {
    low: [W; 3],
    high: [W; 3],
}

impl<W: Word> Levels<'_, W> {
    /// Finds the base level, below which a share of `outliers` may be; `sums` and `counts` are buffers.
    #[inline(always)]
    pub fn zero(
        &self,
        range: Range,
        outliers: f64,
        sums: &mut Vec<W>,
        counts: &mut Vec<usize>,
    ) -> BaseLevel<W> {
        let most = range.max_wraps();
        counts.clear();
        counts.reserve(TURNS << W::BITS);
        let extent = self.extent(sums);
        // Differences of biased words are right modulo a word, whatever the first pixel was.
        let span = |channel: usize| extent.high[channel].minus(extent.low[channel]).into();
        let mut zero = BaseLevel { level: extent.low, outside: 0 };
        // If all levels fit the range, those above the base level need not be counted.
        if (0..self.layout.channels).all(|channel| span(channel) <= u16::from(most)) {
            self.raise_level(&mut zero, outliers, sums);
        } else {
            let most_levels = (0..self.layout.channels).map(|channel| usize::from(span(channel)) + 1).max();
            let few = most_levels.filter(|&levels| levels <= FEW_LEVELS);
            let table = few.map(|levels| self.table(levels, &extent.low, sums));
            for (channel, level) in zero.level[..self.layout.channels].iter_mut().enumerate() {
                counts.clear();
                counts.resize(usize::from(span(channel)) + 1, 0);
                match &table {
                    Some(table) => counts.iter_mut().zip(table).for_each(|(count, of)| *count = of[channel]),
                    None => self.histogram(channel, extent.low[channel], sums, counts),
                }
                let index = congruence::base_level_index(counts, range, outliers);
                let inside = counts[index..].iter().take(usize::from(most) + 1);
                zero.outside += counts.iter().sum::<usize>() - inside.sum::<usize>();
                *level = level.plus(W::low(index as u16));
            }
        }
        zero
    }

    /// Raises the base level while few enough samples are below it; every k is in range.
    #[inline(always)]
    fn raise_level(&self, zero: &mut BaseLevel<W>, outliers: f64, sums: &mut Vec<W>) {
        let RowLayout { height, width, channels } = self.layout;
        let pixels = height * width;
        let mut below = [0; 3];
        // A range has at most 256 levels, so this loop ends without another condition.
        for _ in 0..=u8::MAX {
            let counts = self.count(&zero.level, sums);
            let before = zero.level;
            for channel in 0..channels {
                let enough = congruence::is_enough(
                    pixels - below[channel] - counts[channel],
                    pixels,
                    pixels,
                    outliers,
                );
                below[channel] += if enough { counts[channel] } else { 0 };
                zero.level[channel] = zero.level[channel].plus(W::one_if(enough));
            }
            if before == zero.level {
                break;
            }
        }
        zero.outside = below.iter().sum();
    }

    #[inline(always)]
    fn extent(&self, sums: &mut Vec<W>) -> Extent<W> {
        // The first pixel of the image has k = 0, which is half a word when biased, so it is a valid start
        // for both ends.
        let first = W::HALF;
        let (mut low, mut high) = ([first; LANES], [first; LANES]);
        for i in 0..self.layout.height {
            self.offsets(i, [W::HALF; 3], sums);
            let blocks = self.rows.k(i).as_chunks::<LANES>().0.iter().zip(sums.as_chunks().0);
            for (k, sums) in blocks {
                let k = add(k, sums);
                low.iter_mut().zip(&k).for_each(|(low, &k)| *low = k.min(*low));
                high.iter_mut().zip(&k).for_each(|(high, &k)| *high = k.max(*high));
            }
        }
        let mut extent = Extent { low: [first; 3], high: [first; 3] };
        for lane in 0..LANES {
            let channel = lane % self.layout.channels;
            extent.low[channel] = extent.low[channel].min(low[lane]);
            extent.high[channel] = extent.high[channel].max(high[lane]);
        }
        extent
    }

    /// Returns the number of pixels of each channel at `level`.
    #[inline(always)]
    fn count(&self, level: &[W; 3], sums: &mut Vec<W>) -> [usize; 3] {
        let RowLayout { channels, .. } = self.layout;
        let level = tiled(*level, channels);
        let mut total = [0; 3];
        for i in 0..self.layout.height {
            self.offsets(i, [W::HALF; 3], sums);
            let (k, sums) = (self.rows.k(i).as_chunks::<LANES>().0, sums.as_chunks::<LANES>().0);
            for (k, sums) in k.chunks(COUNTABLE).zip(sums.chunks(COUNTABLE)) {
                let mut count = [W::default(); LANES];
                for (k, sums) in k.iter().zip(sums) {
                    let k = add(k, sums);
                    for l in 0..LANES {
                        count[l] = count[l].plus(W::one_if(k[l] == level[l]));
                    }
                }
                by_channel(&count, channels, &mut total);
            }
            // The copies that fill up the row were counted as well; all of them equal the last pixel.
            for channel in 0..channels {
                let lane = self.layout.last(channel);
                let is = self.rows.k(i)[lane].plus(sums[lane / LANES][lane % LANES]) == level[channel];
                total[channel] -= self.layout.copies() * usize::from(is);
            }
        }
        total
    }

    /// Returns the number of pixels of each channel at each of the first `levels` from `low` on.
    #[inline(always)]
    fn table(&self, levels: usize, low: &[W; 3], sums: &mut Vec<W>) -> [[usize; 3]; FEW_LEVELS] {
        let at = |level: usize| low.map(|low| low.plus(W::low(level as u16)));
        std::array::from_fn(|level| if level < levels { self.count(&at(level), sums) } else { [0; 3] })
    }

    /// Counts the pixels of `channel` at each level from `low` on, of which `counts` has as many as there are.
    fn histogram(&self, channel: usize, low: W, sums: &mut Vec<W>, counts: &mut Vec<usize>) {
        let levels = counts.len();
        counts.resize(TURNS * levels, 0);
        for i in 0..self.layout.height {
            self.offsets(i, [W::HALF; 3], sums);
            let k = self.rows.k(i).iter().zip(&*sums).take(self.layout.samples());
            for (at, (&k, &sum)) in k.skip(channel).step_by(self.layout.channels).enumerate() {
                counts[TURNS * usize::from(k.plus(sum).minus(low).into()) + at % TURNS] += 1;
            }
        }
        (0..levels).for_each(|level| counts[level] = counts[TURNS * level..][..TURNS].iter().sum());
        counts.truncate(levels);
    }

    /// Writes to `sums`, by lane, the sum of the terms of row `i` and of the columns, from `start` on.
    #[inline(always)]
    fn offsets(&self, i: usize, start: [W; 3], sums: &mut Vec<W>) {
        // Most rows are joined without a step, and the sums of the row above still hold.
        if i > 0 && self.rows.row_offsets[i] == self.rows.row_offsets[i - 1] {
            return;
        }
        let mut pixel = start;
        pixel.iter_mut().zip(self.rows.row_offsets[i]).for_each(|(start, join)| *start = start.plus(join));
        let pixel = tiled(pixel, self.layout.channels);
        sums.resize(self.layout.lanes(), W::default());
        let blocks = sums.as_chunks_mut::<LANES>().0.iter_mut().zip(self.constants.as_chunks().0);
        blocks.for_each(|(sums, constants)| *sums = add(constants, &pixel));
    }

    /// Writes `out` with `zero` as k = 0; counts out of range are clamped. Returns the second differences of x above one peak, which are
    /// counted while the rows are in the cache.
    #[inline(always)]
    pub fn write<S>(
        &self,
        samples: &CodeRows<'_, S>,
        zero: &BaseLevel<W>,
        range: Range,
        sums: &mut Vec<W>,
        out: &mut Recovered,
    ) -> u64
    where
        S: Copy + Into<u16>,
    {
        let (x, counts) = out.buffers();
        let (bits, most) = (range.bits(), W::low(range.max_wraps().into()));
        let length = self.layout.samples();
        // Half a turn of the word stands for k = 0.
        let start = zero.level.map(W::bias).map(|zero| W::HALF.minus(zero));
        let mut jumps = 0;
        for (i, counts) in counts.chunks_exact_mut(length).enumerate() {
            self.offsets(i, start, sums);
            let k = self.rows.k(i).iter().zip(&*sums);
            let row = x[i * length..][..length].iter_mut().zip(counts);
            for (((x, count), &y), (&k, &sum)) in row.zip(samples.row(i)).zip(k) {
                // Words have no sign: below half a word means k < 0, so the clamp comes before the bias is removed.
                let k: u16 = k.plus(sum).max(W::HALF).minus(W::HALF).min(most).into();
                *x = (i32::from(y.into()) + (i32::from(k) << bits)) as f32;
                *count = k as u8;
            }
            let written = &x[..(i + 1) * length];
            jumps::lines_of_last_row(written, length, self.layout.channels, |before, here, after| {
                jumps += jumps::steep(before, here, after, range.peak());
            });
        }
        jumps
    }
}

#[inline(always)]
fn add<W: Word>(a: &Block<W>, b: &Block<W>) -> Block<W> {
    let mut sum = *a;
    sum.iter_mut().zip(b).for_each(|(sum, &b)| *sum = sum.plus(b));
    sum
}
