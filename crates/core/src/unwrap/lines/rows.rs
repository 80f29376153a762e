//! Continues k from row to row, and joins the rows by majority votes of their columns.

use super::gradient::{Corners, Gradient, SUSPECT};
use super::layout::{Block, COUNTABLE, LANES, RowLayout, by_channel, tiled};
use super::majority::{MajorityCheck, STEEP, Vote, VoteCounter};
use crate::unwrap::Range;
use crate::unwrap::wrapped::{Word, exceeds, wrap_step};

/// The wrap counts up to a constant for each column and channel.
#[derive(Default)]
pub(super) struct Rows<W> {
    layout: RowLayout,
    /// A row of zeros, then the rows of the image.
    k: Vec<W>,
    checks: Vec<MajorityCheck>,
    votes: VoteCounter,
}

/// Numbers of columns by channel.
type Counts = [usize; 3];

/// A row of codes, the one above, and the one above that.
pub(super) type Neighbours<'a, W> = [&'a [W]; 3];

impl<W: Word> Rows<W> {
    /// Starts an image, before its first row.
    pub fn start(&mut self, layout: RowLayout, range: Range) {
        self.layout = layout;
        // Counts of the last frame stay in the other rows, each of which is written before it is read.
        self.k.resize((layout.height + 1) * layout.lanes(), W::default());
        self.k[..layout.lanes()].fill(W::default());
        self.checks.clear();
        self.checks.resize(layout.channels, MajorityCheck::new(range));
        self.votes.start::<W>();
    }

    /// Returns k of row `i`, which is 0 in the first pixel of the image.
    #[inline(always)]
    pub fn k(&self, i: usize) -> &[W] {
        &self.k[(i + 1) * self.layout.lanes()..][..self.layout.lanes()]
    }

    /// Takes row `i`, `codes[0]`, and the loops above it; if it `sums`, joins the row to those above.
    #[inline(always)]
    pub fn append(&mut self, i: usize, codes: Neighbours<'_, W>, gradient: &mut Gradient<W>, sums: bool) {
        let channels = self.layout.channels;
        let [agree, steep] = self.sum(i, [codes[0], codes[1]], gradient, sums);
        gradient.end_row();
        if !sums {
            return;
        }
        let mut steps = [W::default(); 3];
        // The first row has no row above that it could be joined to.
        if i > 0 {
            for channel in 0..channels {
                let vote = Vote { value: W::default(), count: agree[channel] };
                steps[channel] = self.join(i, codes, channel, vote, steep[channel]);
            }
        }
        if steps != [W::default(); 3] {
            let steps = tiled(steps, channels);
            let row = &mut self.k[(i + 1) * self.layout.lanes()..][..self.layout.lanes()];
            for k in row.as_chunks_mut::<LANES>().0 {
                k.iter_mut().zip(&steps).for_each(|(k, &step)| *k = k.plus(step));
            }
        }
    }

    /// Writes k of row `i` as the vertical differences say, and adds the sums of the wraps of their differences if it `sums`. Returns by channel
    /// the number of columns in which these sums are 0, and of those whose vertical difference is steep.
    #[inline(always)]
    fn sum(&mut self, i: usize, [y, up]: [&[W]; 2], gradient: &mut Gradient<W>, sums: bool) -> [Counts; 2] {
        let (RowLayout { channels, width, .. }, lanes) = (self.layout, self.layout.lanes());
        let (above, here) = self.k[i * lanes..].split_at_mut(lanes);
        let k = above.as_chunks::<LANES>().0.iter().zip(here[..lanes].as_chunks_mut::<LANES>().0);
        let [up_left, up_right, left, right] =
            [up, &up[channels..], y, &y[channels..]].map(|row| row.as_chunks().0);
        let corners = up_left.iter().zip(up_right).zip(left.iter().zip(right));
        let (mut steep, mut apart) = ([W::default(); LANES], [W::default(); LANES]);
        let mut totals = [[0; 3]; 2];
        let mut carried = [W::default(); 3];
        for (at, ((above, here), ((up_left, up_right), (left, right)))) in k.zip(corners).enumerate() {
            let corners = [up_left, up_right, left, right];
            let is_smooth = step(corners, above, here, gradient.steep(at), &mut steep);
            // In most blocks of most images, no n changes and nothing is to be summed. The first row has no loops above it.
            let wraps = i == 0 || (!is_smooth && gradient.follow(i, at, corners));
            if sums && (wraps || carried != [W::default(); 3]) {
                let sums = if wraps {
                    sums_before(corners, channels, &mut carried)
                } else {
                    tiled(carried, channels)
                };
                raise(here, &mut apart, &sums);
            }
            // A counter of 8 bits holds 255 blocks; then it is added to the totals.
            if (at + 1) % COUNTABLE == 0 || (at + 1) * LANES == lanes {
                by_channel(&mut apart, channels, &mut totals[0]);
                by_channel(&mut steep, channels, &mut totals[1]);
            }
        }
        // The copies of the last pixel were counted as well.
        for (channel, &sum) in carried.iter().enumerate().take(channels) {
            let l = self.layout.last(channel);
            totals[0][channel] -= self.layout.copies() * usize::from(sum != W::default());
            totals[1][channel] -= self.layout.copies() * usize::from(exceeds(y[l].minus(up[l]), STEEP));
        }
        [totals[0].map(|apart| width - apart), totals[1]]
    }

    /// Returns what is to be added to `channel` of row `i` by a majority vote of the columns, which holds if
    /// most `|d_y x|` are small; in doubt by a second vote, which holds if most `|d_y d_y x|` are. `guess` is an
    /// expected value with its votes.
    fn join(
        &mut self,
        i: usize,
        [y, up, upper]: Neighbours<'_, W>,
        channel: usize,
        guess: Vote<W>,
        steep: usize,
    ) -> W {
        let Self { layout, k, checks, votes } = self;
        let columns = (channel..layout.samples()).step_by(layout.channels);
        let [above, here] = [i, i + 1].map(|row| &k[row * layout.lanes()..][..layout.lanes()]);
        // What the row lacks in a column if `|d_y x|` is below half a peak.
        let lacks = |l: usize| wrap_step(up[l], y[l]).plus(above[l]).minus(here[l]);
        // If more than half of the columns agree with the guess, it is the majority without a full count.
        let is_counted = guess.count * 2 <= layout.width;
        let majority = if is_counted { votes.count(columns.clone().map(lacks)) } else { guess };
        // Row 1 has only one row above it, and a second difference needs two.
        if !checks[channel].needs_second_vote(majority.count, steep, layout.width) || i == 1 {
            return majority.value;
        }
        let two_above = &k[(i - 1) * layout.lanes()..][..layout.lanes()];
        let second = votes.count(columns.map(|l| {
            // The n of `d_y x = M_b(d_y y) + n * 2^b` if `|d_y d_y x|` is below half a peak: that one row above, and one more where the
            // difference itself wraps.
            let n_above = above[l].minus(two_above[l]).minus(wrap_step(upper[l], up[l]));
            lacks(l).plus(n_above).plus(wrap_step(up[l].minus(upper[l]), y[l].minus(up[l])))
        }));
        // Noise blurs second differences more than first ones.
        let chosen = if second.count * 10 > majority.count * 9 { second } else { majority };
        checks[channel].record(chosen.value != majority.value);
        chosen.value
    }
}

/// Adds `sums` to k of a block, and counts by lane those that are not 0.
#[inline(always)]
fn raise<W: Word>(k: &mut Block<W>, apart: &mut Block<W>, sums: &Block<W>) {
    for l in 0..LANES {
        k[l] = k[l].plus(sums[l]);
        apart[l] = apart[l].plus(W::one_if(sums[l] != W::default()));
    }
}

/// Writes k of a block as its vertical differences say, from that `above`, and counts by lane the steep differences along the row and down to it.
/// Returns whether no mixed difference wraps, in one of both orders, or is above the limit.
#[inline(always)]
fn step<W: Word>(
    [up, up_right, left, right]: Corners<'_, W>,
    above: &Block<W>,
    k: &mut Block<W>,
    steep_along: &mut Block<W>,
    steep_down: &mut Block<W>,
) -> bool {
    let (mut least, mut greatest) = (W::default(), W::default());
    for l in 0..LANES {
        let (before, after) = (left[l].minus(up[l]), right[l].minus(up_right[l]));
        let (first, second) = (up_right[l].minus(up[l]), right[l].minus(left[l]));
        // A difference that wraps ends at the end of the range, which is above the limit.
        let mixed = [second.minus_within(first), after.minus_within(before)];
        least = least.min(mixed[0]).min(mixed[1]);
        greatest = greatest.max(mixed[0]).max(mixed[1]);
        steep_along[l] = steep_along[l].plus(W::one_if(exceeds(second, STEEP)));
        steep_down[l] = steep_down[l].plus(W::one_if(exceeds(before, STEEP)));
        k[l] = above[l].plus(wrap_step(up[l], left[l]));
    }
    let limit = W::sixteenths(SUSPECT);
    greatest <= limit && least >= W::default().minus(limit)
}

/// Returns the sums of the wraps of the differences of vertical differences before each lane of a block, and `carried` from the block before,
/// which becomes the sums behind the block.
#[inline(always)]
fn sums_before<W: Word>(
    [up, up_right, left, right]: Corners<'_, W>,
    channels: usize,
    carried: &mut [W; 3],
) -> Block<W> {
    let mut steps = [W::default(); LANES];
    let down = up.iter().zip(left).zip(up_right.iter().zip(right));
    for (step, ((&up, &left), (&up_right, &right))) in steps.iter_mut().zip(down) {
        *step = wrap_step(left.minus(up), right.minus(up_right));
    }
    let mut totals = [[W::default(); LANES], steps];
    let mut stride = channels;
    while stride < LANES {
        let mut next = [W::default(); LANES];
        // Four shifted blocks are added instead of a running sum, whose every step would wait for the one before.
        for times in 0..4 {
            let back = &totals.as_flattened()[LANES - times * stride..][..LANES];
            next.iter_mut().zip(back).for_each(|(next, &back)| *next = next.plus(back));
        }
        totals[1] = next;
        stride *= 4;
    }
    let before = tiled(*carried, channels);
    let last = &totals[1][LANES - channels..];
    carried.iter_mut().zip(last).for_each(|(carried, &last)| *carried = carried.plus(last));
    for l in 0..LANES {
        steps[l] = before[l].plus(totals[1][l]).minus(steps[l]);
    }
    steps
}
