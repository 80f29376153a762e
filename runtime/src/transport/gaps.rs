//! [`Gaps`]: counts samples lost on the way, by the sequence numbers of their publishers.

use std::collections::BTreeMap;

use super::attachment::Attachment;

/// Publishers of one topic that are remembered; more only come from restarts.
const PUBLISHERS: usize = 1024;

/// Counts the holes in the sequence numbers of each publisher.
#[derive(Debug, Default)]
pub struct Gaps {
    greatest: BTreeMap<[u8; 16], i64>,
}

impl Gaps {
    /// Returns the number of samples that are missing before this one. The first sample of a publisher starts its
    /// count: earlier ones were not for this reader. A number below the greatest one is a sample that came late or
    /// twice, and counts as no gap. A publisher that restarts has another gid.
    pub fn step(&mut self, attachment: &Attachment) -> u64 {
        let Attachment { gid, sequence, .. } = *attachment;
        if self.greatest.len() >= PUBLISHERS && !self.greatest.contains_key(&gid) {
            self.greatest.pop_first();
        }
        let greatest = self.greatest.entry(gid).or_insert(sequence);
        let missing = sequence.saturating_sub(*greatest).saturating_sub(1);
        *greatest = sequence.max(*greatest);
        u64::try_from(missing).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_holes_of_each_publisher_from_its_first_sample_on() {
        let mut gaps = Gaps::default();
        let mut step =
            |publisher, sequence| gaps.step(&Attachment { sequence, stamp_ns: 0, gid: [publisher; 16] });
        assert_eq!(
            [step(1, 40), step(1, 41), step(1, 44), step(2, 7), step(1, 45), step(2, 9)],
            [0, 0, 2, 0, 0, 1]
        );
        // A late sample, the one after the greatest, and the extremes.
        assert_eq!([step(1, 3), step(1, 46), step(1, i64::MIN), step(1, 47)], [0, 0, 0, 0]);
        assert_eq!(step(1, i64::MAX), i64::MAX as u64 - 48);
    }

    #[test]
    fn remembers_a_bounded_number_of_publishers() {
        let mut gaps = Gaps::default();
        for publisher in 0..2 * PUBLISHERS as u128 {
            let gid = publisher.to_be_bytes();
            assert_eq!(gaps.step(&Attachment { sequence: 9, stamp_ns: 0, gid }), 0);
        }
        assert_eq!(gaps.greatest.len(), PUBLISHERS);
    }
}
