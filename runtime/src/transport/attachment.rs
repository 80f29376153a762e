//! [`Attachment`]: the 33 bytes that go with every sample of rmw_zenoh.

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
}
