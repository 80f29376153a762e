//! What most of a line vote, and when a second opinion is due.

use crate::unwrap::Range;
use crate::unwrap::wrapped::Word;

/// Differences of more than this, a quarter of the peak, are steep; in eighths.
pub(super) const STEEP: u16 = 2;

/// How many values of a line say the same.
#[derive(Clone, Copy)]
pub(super) struct Vote<W> {
    /// What they say.
    pub value: W,
    /// How many they are.
    pub count: usize,
}

/// A counter for every value, all zero between two counts.
#[derive(Default)]
pub(super) struct VoteCounter {
    counts: Vec<u32>,
}

impl VoteCounter {
    /// Makes room for values of `W`.
    pub(super) fn start<W: Word>(&mut self) {
        self.counts.resize(1 << W::BITS, 0);
    }

    /// The most frequent of `values`; of equals, the one that is first complete.
    pub(super) fn count<W: Word>(&mut self, values: &[W]) -> Vote<W> {
        let mut best = Vote { value: W::default(), count: 0 };
        for &value in values {
            let count = &mut self.counts[usize::from(value.into())];
            *count += 1;
            if *count as usize > best.count {
                best = Vote { value, count: *count as usize };
            }
        }
        values.iter().for_each(|&value| self.counts[usize::from(value.into())] = 0);
        best
    }
}

/// Whether lines follow their majority. An edge along a whole line is unanimous and wrong; it is
/// steep, or the line before it is, and once entered it holds until the second opinion leaves it.
#[derive(Clone, Copy)]
pub(super) struct MajorityCheck {
    longest: usize,
    departed: bool,
    lasted: usize,
    steep_before: bool,
}

impl MajorityCheck {
    /// Half a peak a line leaves the range after 2 alpha lines: no departure lasts longer.
    pub fn new(range: Range) -> Self {
        let longest = 2 * usize::from(range.max_wraps()) + 2;
        Self { longest, departed: false, lasted: 0, steep_before: false }
    }

    /// Whether the next line, of `length`, needs a second opinion: below 80 % agree, more than a
    /// quarter is steep here or in the line before, or that departed from its majority.
    pub fn needs_second_opinion(&mut self, agree: usize, steep: usize, length: usize) -> bool {
        let steep_here = steep * 4 > length;
        let steep = std::mem::replace(&mut self.steep_before, steep_here) || steep_here;
        agree * 5 < length * 4 || steep || self.departed
    }

    /// Takes note of whether the second opinion `departs` from the majority.
    pub fn record(&mut self, departs: bool) {
        self.lasted = if departs { self.lasted + 1 } else { 0 };
        self.departed = (1..=self.longest).contains(&self.lasted);
    }
}
