//! What most of a line says, and when a second opinion is due.

use crate::unwrap::Range;

/// Differences of more than this, a quarter of the peak, are steep.
pub(super) const STEEP: u16 = 1 << 14;

/// How many values of a line say the same.
#[derive(Clone, Copy)]
pub(super) struct Vote {
    /// What they say.
    pub value: i16,
    /// How many they are.
    pub count: usize,
}

/// A counter for every value, all zero between two counts.
pub(super) struct Ballot {
    counts: Vec<u32>,
}

impl Default for Ballot {
    fn default() -> Self {
        Self { counts: vec![0; 1 << 16] }
    }
}

impl Ballot {
    /// The most frequent of `values`; of equals, the one that is first complete.
    pub(super) fn count(&mut self, values: &[i16]) -> Vote {
        let mut best = Vote { value: 0, count: 0 };
        for &value in values {
            let count = &mut self.counts[usize::from(value as u16)];
            *count += 1;
            if *count as usize > best.count {
                best = Vote { value, count: *count as usize };
            }
        }
        values.iter().for_each(|&value| self.counts[usize::from(value as u16)] = 0);
        best
    }
}

/// Whether lines follow their majority. An edge along a whole line is unanimous and wrong; it is
/// steep, or the line before it is, and once entered it holds until the second opinion leaves it.
pub(super) struct Doubt {
    longest: usize,
    departed: bool,
    lasted: usize,
    steep_before: bool,
}

impl Doubt {
    /// Half a peak a line leaves the range after 2 alpha lines: no departure lasts longer.
    pub fn new(range: Range) -> Self {
        let longest = 2 * usize::from(range.most_wraps()) + 2;
        Self { longest, departed: false, lasted: 0, steep_before: false }
    }

    /// Whether the next line, of `length`, needs a second opinion: below 80 % agree, more than a
    /// quarter is steep here or in the line before, or that departed from its majority.
    pub fn arises(&mut self, agree: usize, steep: usize, length: usize) -> bool {
        let steep_here = steep * 4 > length;
        let steep = std::mem::replace(&mut self.steep_before, steep_here) || steep_here;
        agree * 5 < length * 4 || steep || self.departed
    }

    /// Takes note of what the second opinion was.
    pub fn settle(&mut self, majority: i16, opinion: i16) {
        self.lasted = if majority == opinion { 0 } else { self.lasted + 1 };
        self.departed = (1..=self.longest).contains(&self.lasted);
    }
}
