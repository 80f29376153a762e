//! [`Attachment`]: the 33 bytes that go with every sample of rmw_zenoh, and [`Gaps`], which counts the samples that
//! were lost on the way by their sequence numbers.

use std::collections::BTreeMap;

/// The attachment of a sample; readers drop samples without one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Attachment {
    /// Counts from 1 per publisher; a gap is a loss.
    pub sequence: i64,
    /// Source time, nanoseconds since the epoch.
    pub stamp_ns: i64,
    /// Global id of the publisher.
    pub gid: [u8; 16],
}

impl Attachment {
    /// Length on the wire.
    pub const LEN: usize = 33;

    /// Returns the bytes on the wire: two little-endian integers, the length 16, and the gid.
    pub fn to_bytes(&self) -> [u8; Self::LEN] {
        let mut bytes = [0; Self::LEN];
        bytes[..8].copy_from_slice(&self.sequence.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.stamp_ns.to_le_bytes());
        // rmw_zenoh writes the id as a sequence, whose length comes before its bytes.
        bytes[16] = 16;
        bytes[17..].copy_from_slice(&self.gid);
        bytes
    }

    /// Reads it; `None` when it is not 33 bytes of that shape.
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        let (sequence, rest) = bytes.split_first_chunk::<8>()?;
        let (stamp, rest) = rest.split_first_chunk::<8>()?;
        let (&length, gid) = rest.split_first()?;
        Some(Self {
            sequence: i64::from_le_bytes(*sequence),
            stamp_ns: i64::from_le_bytes(*stamp),
            gid: (length == 16).then_some(gid)?.try_into().ok()?,
        })
    }
}

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
            // Any entry may go: a publisher that still sends starts its count anew.
            self.greatest.pop_first();
        }
        let greatest = self.greatest.entry(gid).or_insert(sequence);
        // The numbers come from the wire and may be anything.
        let missing = sequence.saturating_sub(*greatest).saturating_sub(1);
        *greatest = sequence.max(*greatest);
        u64::try_from(missing).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Sent by a real ROS 2 Jazzy node under rmw_zenoh_cpp 0.2.10.
    #[test]
    fn equals_those_of_a_real_node() {
        let golden = "1b000000000000009b044c0adbd3e9181001d577b5cefae79ff06ef90b046c84b7";
        let bytes: Vec<u8> = (0..golden.len() / 2)
            .map(|i| u8::from_str_radix(&golden[2 * i..2 * i + 2], 16).expect("hex"))
            .collect();
        let attachment = Attachment::parse(&bytes).expect("a real attachment parses");
        assert_eq!(attachment.sequence, 27);
        assert_eq!(attachment.to_bytes().as_slice(), bytes);
    }

    proptest! {
        #[test]
        fn no_bytes_panic(bytes: Vec<u8>) {
            if let Some(attachment) = Attachment::parse(&bytes) {
                prop_assert_eq!(attachment.to_bytes().to_vec(), bytes);
            }
        }
    }

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
