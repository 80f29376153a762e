//! Majority votes along a line, and the check whether a second vote is needed.

use crate::unwrap::Range;
use crate::unwrap::wrapped::Word;

/// The limit of a steep difference in sixteenths of the peak: a quarter of the peak.
pub(super) const STEEP: u16 = 4;

/// The result of a vote.
#[derive(Clone, Copy)]
pub(super) struct Vote<W> {
    /// The most frequent value.
    pub value: W,
    /// The number of votes for it.
    pub count: usize,
}

/// A vote counter for every value, all zero between two votes.
#[derive(Default)]
pub(super) struct VoteCounter {
    counts: Vec<u32>,
}

impl VoteCounter {
    /// Makes room for the values of `W`.
    pub(super) fn start<W: Word>(&mut self) {
        self.counts.resize(1 << W::BITS, 0);
    }

    /// Returns the most frequent of `values`; of equally frequent ones, the value that reached the count first.
    #[inline(always)]
    pub(super) fn count<W: Word>(&mut self, values: impl ExactSizeIterator<Item = W> + Clone) -> Vote<W> {
        // A value that more than half of the values have is the most frequent one. Nearly always the value in the middle or at a quarter of the
        // line is that one, and to count one value is faster than to count all of them.
        let total = values.len();
        for place in [2, 4].map(|part| total / part) {
            let Some(value) = values.clone().nth(place) else { break };
            let count = values.clone().filter(|&other| other == value).count();
            if count * 2 > total {
                return Vote { value, count };
            }
        }
        // The winner is known while counting, so the counters need no second pass.
        let mut best = Vote { value: W::default(), count: 0 };
        for value in values.clone() {
            let count = &mut self.counts[usize::from(value.unsigned())];
            *count += 1;
            if *count as usize > best.count {
                best = Vote { value, count: *count as usize };
            }
        }
        // Only the counters that were used are cleared: there may be 65,536 of them.
        values.for_each(|value| self.counts[usize::from(value.unsigned())] = 0);
        best
    }
}

/// Whether a line follows its majority. An edge that spans a whole line makes every vote agree on the wrong value. Such
/// an edge is steep in this line or in the one before, and it lasts until the second vote returns to the majority.
#[derive(Clone, Copy)]
pub(super) struct MajorityCheck {
    longest: usize,
    departed: bool,
    lasted: usize,
    steep_before: bool,
}

impl MajorityCheck {
    /// Makes the check for a range. At half a peak a line, x leaves the range after 2 alpha lines, so a departure
    /// from the majority lasts no longer.
    pub fn new(range: Range) -> Self {
        // The largest count is one less than alpha rounded up, so this is 2 alpha lines.
        let longest = 2 * usize::from(range.max_wraps()) + 2;
        Self { longest, departed: false, lasted: 0, steep_before: false }
    }

    /// Returns whether the next line, of `length`, needs a second vote: below 80 % agree, more than a quarter is
    /// steep here or in the line before, or the line before departed from its majority.
    pub fn needs_second_vote(&mut self, agree: usize, steep: usize, length: usize) -> bool {
        let steep_here = steep * 4 > length;
        // The state is updated even if another reason decides.
        let steep = std::mem::replace(&mut self.steep_before, steep_here) || steep_here;
        agree * 5 < length * 4 || steep || self.departed
    }

    /// Records whether the second vote `departs` from the majority.
    pub fn record(&mut self, departs: bool) {
        self.lasted = if departs { self.lasted + 1 } else { 0 };
        self.departed = (1..=self.longest).contains(&self.lasted);
    }
}
