//! [`Profile`]: the quality of service of an endpoint, read from its token.

/// Whether samples are sent again until they have come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reliability {
    /// Lost samples are sent again.
    Reliable,
    /// Lost samples are not sent again.
    BestEffort,
}

/// The samples that a late reader gets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Durability {
    /// The last samples from before it came.
    TransientLocal,
    /// A late reader gets only new samples.
    Volatile,
}

/// The policies that decide how an endpoint is carried, and whether two endpoints fit together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Profile {
    /// Code 1 or, as here, 2; reliable when not given.
    pub reliability: Reliability,
    /// Code 1 or, as here, 2; volatile when not given.
    pub durability: Durability,
    /// Samples that are kept; all of them is `usize::MAX`, 42 when not given.
    pub depth: usize,
}

/// Depth of a token without one.
const DEFAULT_DEPTH: usize = 42;

impl Profile {
    /// Reads `<reliability>:<durability>:<history>,<depth>:...`. Missing or unknown fields get the defaults of rmw_zenoh.
    pub fn parse(text: &str) -> Self {
        let mut fields = text.split(':');
        let mut field = || fields.next().unwrap_or_default();
        let (reliability, durability, history) = (field(), field(), field());
        let (history, depth) = history.split_once(',').unwrap_or((history, ""));
        Self {
            reliability: if reliability == "2" { Reliability::BestEffort } else { Reliability::Reliable },
            durability: if durability == "1" { Durability::TransientLocal } else { Durability::Volatile },
            depth: if history == "2" { usize::MAX } else { depth.parse().unwrap_or(DEFAULT_DEPTH) },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_what_real_nodes_write() {
        let read = |text| {
            let Profile { reliability, durability, depth } = Profile::parse(text);
            (reliability == Reliability::Reliable, durability == Durability::TransientLocal, depth)
        };
        assert_eq!(read(":1:,1000:,:10,0:,,"), (true, true, 1000));
        assert_eq!(read("2::,5:,:,:,,"), (false, false, 5));
        assert_eq!(read("::2,:,:,:,,"), (true, false, usize::MAX));
        assert_eq!(read("1:2:1,7:1,2:3,4:5,6,7"), (true, false, 7));
        for text in ["", ":", "::,x:", "é:::::"] {
            assert_eq!(read(text), (true, false, 42), "{text}");
        }
    }
}
