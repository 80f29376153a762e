//! [`Gaps`]: what was lost on the way, from the numbers that publishers give their samples.

use std::collections::BTreeMap;

use super::attachment::Attachment;

/// Counts the holes in the sequence numbers of each publisher.
#[derive(Debug, Default)]
pub struct Gaps {
    last: BTreeMap<[u8; 16], i64>,
}

impl Gaps {
    /// How many samples are missing before this one. The first sample of a
    /// publisher starts its count: what it sent earlier was not for us.
    pub fn step(&mut self, attachment: &Attachment) -> u64 {
        let last = self.last.insert(attachment.gid, attachment.sequence);
        let missing = last.map_or(0, |last| attachment.sequence.saturating_sub(last).saturating_sub(1));
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
        // One that starts anew, and numbers at the ends of what there is.
        assert_eq!([step(1, 1), step(1, i64::MIN), step(1, i64::MAX)], [0, 0, i64::MAX as u64 - 1]);
    }
}
