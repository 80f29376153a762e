//! Sums the wraps of the gradient along each row, and joins the rows by majority votes of their columns.

use super::layout::{Block, COUNTABLE, LANES, RowLayout, by_channel, tiled};
use super::majority::{MajorityCheck, STEEP, Vote, VoteCounter};
use crate::unwrap::Range;
use crate::unwrap::wrapped::{Word, biased, exceeds, wrap_step};

/// Wrap counts relative to the first pixel of each row, and the offsets that join the rows.
#[derive(Default)]
pub(super) struct Rows<W> {
    layout: RowLayout,
    /// A row of zeros, then the rows of the image.
    k: Vec<W>,
    /// The offset of k by row and channel.
    pub row_offsets: Vec<[W; 3]>,
    checks: Vec<MajorityCheck>,
    line: Vec<W>,
    votes: VoteCounter,
}

/// A row of codes, the one above, and the one above that.
pub(super) type Neighbours<'a, W> = [&'a [W]; 3];

/// By channel: the number of columns that agree with the guess, and of columns that are steep.
struct RowCounts {
    agree: [usize; 3],
    steep: [usize; 3],
}

impl<W: Word> Rows<W> {
    /// Starts an image, before its first row.
    pub fn start(&mut self, layout: RowLayout, range: Range) {
        self.layout = layout;
        // Counts of the last frame stay in the other rows, each of which is written before it is read.
        self.k.resize((layout.height + 1) * layout.lanes(), W::default());
        self.k[..layout.lanes()].fill(W::default());
        self.row_offsets.clear();
        self.checks.clear();
        self.checks.resize(layout.channels, MajorityCheck::new(range));
        self.line.clear();
        self.line.reserve(layout.width);
        self.votes.start::<W>();
    }

    /// Returns k of row `i`, which is 0 in its first pixel.
    #[inline(always)]
    pub fn k(&self, i: usize) -> &[W] {
        &self.k[(i + 1) * self.layout.lanes()..][..self.layout.lanes()]
    }

    /// Sums the next row, `codes[0]`, and joins it to the rows above.
    #[inline(always)]
    pub fn append(&mut self, sums: &PrefixSums<W>, codes: Neighbours<'_, W>) {
        let [y, up, _] = codes;
        let i = self.row_offsets.len();
        let mut guess = [W::default(); 3];
        let channels = self.layout.channels;
        // The first pixel's k is 0 in every row.
        guess.iter_mut().zip(up.iter().zip(y)).for_each(|(guess, (&up, &y))| *guess = wrap_step(up, y));
        let counts = self.sum(i, sums, [y, up], &tiled(guess, channels));
        let mut offsets = self.row_offsets.last().copied().unwrap_or_default();
        // The first row has no row above that it could be joined to.
        if i > 0 {
            for channel in 0..channels {
                let vote = Vote { value: guess[channel], count: counts.agree[channel] };
                let vote = self.join(i, codes, channel, vote, counts.steep[channel]);
                offsets[channel] = offsets[channel].plus(vote.value);
            }
        }
        self.row_offsets.push(offsets);
    }

    /// Writes k of row `i`, and counts the columns in which it continues the row above by `guess`.
    #[inline(always)]
    fn sum(&mut self, i: usize, sums: &PrefixSums<W>, [y, up]: [&[W]; 2], guess: &Block<W>) -> RowCounts {
        let lanes = self.layout.lanes();
        let (above, here) = self.k[i * lanes..].split_at_mut(lanes);
        let mut counts = RowCounts { agree: [0; 3], steep: [0; 3] };
        let mut sum = [W::default(); LANES];
        // A counter of 8 bits holds 255 blocks; then it is added to the totals.
        for first in (0..lanes).step_by(COUNTABLE * LANES) {
            let (mut agree, mut steep) = ([W::default(); LANES], [W::default(); LANES]);
            for at in (first..lanes.min(first + COUNTABLE * LANES)).step_by(LANES) {
                sums.advance(at, &mut sum);
                let (y, up, above) = (&y[at..][..LANES], &up[at..][..LANES], &above[at..][..LANES]);
                let here = &mut here[at..][..LANES];
                for l in 0..LANES {
                    here[l] = sum[l];
                    let vote = wrap_step(up[l], y[l]).plus(above[l]).minus(sum[l]);
                    agree[l] = agree[l].plus(W::one_if(vote == guess[l]));
                    steep[l] = steep[l].plus(W::one_if(exceeds(biased(up[l], y[l]), STEEP)));
                }
            }
            by_channel(&agree, self.layout.channels, &mut counts.agree);
            by_channel(&steep, self.layout.channels, &mut counts.steep);
        }
        counts.discount_copies(self.layout, [y, up, above, here], guess);
        counts
    }

    /// Returns the step of `channel` from row `i - 1` to `i` by a majority vote of the columns, which holds if
    /// most `|d_y x|` are small; in doubt by a second vote, which holds if most `|d_y d_y x|` are. `guess` is an
    /// expected step with its votes.
    fn join(
        &mut self,
        i: usize,
        codes: Neighbours<'_, W>,
        channel: usize,
        guess: Vote<W>,
        steep: usize,
    ) -> Vote<W> {
        let width = self.layout.width;
        let mut majority = guess;
        // If more than half of the columns agree with the guess, it is the majority without a full count.
        let counted = guess.count * 2 <= width;
        if counted {
            self.first_difference_votes(i, codes, channel);
            majority = self.votes.count(&self.line);
        }
        // Row 1 has only one row above it, and a second difference needs two.
        if !self.checks[channel].needs_second_vote(majority.count, steep, width) || i == 1 {
            return majority;
        }
        if !counted {
            self.first_difference_votes(i, codes, channel);
        }
        self.second_difference_votes(i, codes, channel);
        let second = self.votes.count(&self.line);
        // Noise blurs second differences more than first ones.
        let chosen = if second.count * 10 > majority.count * 9 { second } else { majority };
        self.checks[channel].record(chosen.value != majority.value);
        chosen
    }

    /// Writes, by column, the step from row `i - 1` to `i` if `|d_y x|` is below half a peak.
    fn first_difference_votes(&mut self, i: usize, [y, up, _]: Neighbours<'_, W>, channel: usize) {
        let (above, here) = self.k[i * self.layout.lanes()..].split_at(self.layout.lanes());
        let lanes = (channel..self.layout.samples()).step_by(self.layout.channels);
        self.line.clear();
        self.line.extend(lanes.map(|l| wrap_step(up[l], y[l]).plus(above[l]).minus(here[l])));
    }

    /// Adds, by column, the n of `d_y x = M_b(d_y y) + n * 2^b` if `|d_y d_y x|` is below half a peak: the n one
    /// row above, and one more where the difference itself wraps.
    fn second_difference_votes(&mut self, i: usize, [y, up, upper]: Neighbours<'_, W>, channel: usize) {
        let (k_upper, k_up) = self.k[(i - 1) * self.layout.lanes()..].split_at(self.layout.lanes());
        let step = self.row_offsets[i - 1][channel].minus(self.row_offsets[i - 2][channel]);
        let lanes = (channel..self.layout.samples()).step_by(self.layout.channels);
        for (value, l) in self.line.iter_mut().zip(lanes) {
            let n_up = k_up[l].minus(k_upper[l]).plus(step).minus(wrap_step(upper[l], up[l]));
            let n = n_up.plus(wrap_step(biased(upper[l], up[l]), biased(up[l], y[l])));
            *value = value.plus(n);
        }
    }
}

impl RowCounts {
    /// Removes the votes of the copies of the last pixel.
    fn discount_copies<W: Word>(
        &mut self,
        layout: RowLayout,
        [y, up, above, k]: [&[W]; 4],
        guess: &Block<W>,
    ) {
        for (channel, &guess) in guess.iter().enumerate().take(layout.channels) {
            let l = layout.last(channel);
            let vote = wrap_step(up[l], y[l]).plus(above[l]).minus(k[l]);
            self.agree[channel] -= layout.copies() * usize::from(vote == guess);
            self.steep[channel] -= layout.copies() * usize::from(exceeds(biased(up[l], y[l]), STEEP));
        }
    }
}

/// The zeros before a row, as many as the largest shift.
const BEFORE: usize = LANES;

/// The number of pixels that `wide` sums over.
const WIDE: usize = 16;

/// The increments of a row, and their prefix sums, each channel separately, in whole vectors. Sums over 4, then over 16
/// pixels are sums of shifted rows, so only one sum for each lane is carried from block to block.
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
        // A block holds a whole number of these sums: 96 lanes are 6 sums of one channel or 2 of three.
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
    // Four shifted rows are added instead of a running sum, whose every step would wait for the one before.
    let back = |times: usize| &from[BEFORE - times * stride..][..length];
    let near = back(0).iter().zip(back(1));
    let far = back(2).iter().zip(back(3));
    for (to, ((&a, &b), (&c, &d))) in to[BEFORE..].iter_mut().zip(near.zip(far)) {
        *to = a.plus(b).plus(c.plus(d));
    }
}
