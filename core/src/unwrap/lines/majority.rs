//! What most of a line says, and when a second opinion is due.

/// Lines that a departure from the majority may last: no scene is steep for longer.
const LONGEST: usize = 12;

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

/// Whether lines follow their majority. An edge along a whole line is unanimous and wrong;
/// it is steep, and once entered it holds until the second opinion leaves it.
#[derive(Default)]
pub(super) struct Doubt {
    departed: bool,
    lasted: usize,
}

impl Doubt {
    /// Whether a line of `length` needs a second opinion: below 80 % agree,
    /// more than a quarter is steep, or the line before departed from its majority.
    pub(super) fn arises(&self, agree: usize, steep: usize, length: usize) -> bool {
        agree * 5 < length * 4 || steep * 4 > length || self.departed
    }

    /// Takes note of what the second opinion was.
    pub(super) fn settle(&mut self, majority: i16, opinion: i16) {
        self.lasted = if majority == opinion { 0 } else { self.lasted + 1 };
        self.departed = (1..=LONGEST).contains(&self.lasted);
    }
}
