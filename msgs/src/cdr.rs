//! CDR as ROS 2 puts it on the wire: a 4-byte encapsulation, then XCDR1 plain data ("DDS_CDR"), each primitive aligned
//! to its size counted from byte 4.
//!
//! Messages are written in little endian with zero padding, and read in both byte orders. A length from the wire is
//! compared with the number of remaining bytes before memory is allocated. Bytes behind the message are ignored, since
//! shared memory hands out whole blocks.
//!
//! Source: OMG DDS-RTPS 2.5, 10.2 and DDS-XTypes 1.3, 7.4.1 (XCDR version 1).

mod decode;
mod encode;

use std::fmt::Display;

use serde::Serialize;
use serde::de::{DeserializeOwned, DeserializeSeed};

/// Error of bytes that are not a message, or of a message that cannot be written as CDR. Offsets count from the first byte
/// of the encapsulation.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CdrError {
    /// The message ends too early, or a length in it is too large.
    #[error("CDR ends too early: at byte {offset}, {expected} bytes expected, got {got}")]
    Short {
        /// Offset at which the bytes are needed.
        offset: usize,
        /// Number of bytes needed.
        expected: usize,
        /// Number of remaining bytes.
        got: usize,
    },
    /// The bytes do not encode a value of the expected type.
    #[error("CDR at byte {offset}: expected {expected}, got {got}")]
    Value {
        /// Offset of the value.
        offset: usize,
        /// The possible values.
        expected: &'static str,
        /// The value found.
        got: String,
    },
    /// A string or sequence is too long to be written.
    #[error("CDR at byte {offset}: length of at most {max} expected, got {got}", max = u32::MAX)]
    Long {
        /// Offset of the length.
        offset: usize,
        /// Length of the string or sequence.
        got: usize,
    },
    /// The Rust type is not one of a ROS message.
    #[error("CDR messages cannot hold {0}; use numbers, bool, String, Vec, arrays and structs of these")]
    Unsupported(&'static str),
    /// An error of serde or of the code of a type.
    #[error("CDR: {0}")]
    Message(String),
}

impl serde::ser::Error for CdrError {
    fn custom<T: Display>(message: T) -> Self {
        Self::Message(message.to_string())
    }
}

impl serde::de::Error for CdrError {
    fn custom<T: Display>(message: T) -> Self {
        Self::Message(message.to_string())
    }
}

/// Byte order of numbers.
#[derive(Clone, Copy)]
pub(crate) enum ByteOrder {
    Big,
    Little,
}

/// Bytes before the message: representation identifier and options.
pub(crate) const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// Returns `message` as little-endian CDR with its encapsulation.
///
/// # Errors
/// [`CdrError`] when a length does not fit in 32 bits, or the type contains an option, a map, or an enum with data,
/// which CDR messages cannot hold.
pub fn to_vec<T: Serialize + ?Sized>(message: &T) -> Result<Vec<u8>, CdrError> {
    let mut encoder = encode::Encoder::new();
    message.serialize(&mut encoder)?;
    Ok(encoder.finish())
}

/// Reads the message in `bytes`, which begin with the encapsulation.
///
/// # Errors
/// [`CdrError`] with the offset, the expected value and the found value.
pub fn from_slice<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, CdrError> {
    T::deserialize(&mut decode::Decoder::new(bytes)?)
}

/// Reads the message in `bytes`, which begin with the encapsulation, with `seed`.
pub(crate) fn from_slice_seed<'b, S: DeserializeSeed<'b>>(
    seed: S,
    bytes: &'b [u8],
) -> Result<S::Value, CdrError> {
    seed.deserialize(&mut decode::Decoder::new(bytes)?)
}

/// `#[serde(with = "crate::cdr::bytes")]`: byte sequences as one copy instead of one call for each byte. This makes image
/// messages cheap.
pub(crate) mod bytes {
    use std::fmt;

    use serde::de::{Error, Visitor};
    use serde::{Deserializer, Serializer};

    pub(crate) fn serialize<S: Serializer>(bytes: &[u8], serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_bytes(bytes)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<u8>, D::Error> {
        deserializer.deserialize_byte_buf(BytesVisitor)
    }

    struct BytesVisitor;

    impl Visitor<'_> for BytesVisitor {
        type Value = Vec<u8>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a sequence of bytes")
        }

        fn visit_bytes<E: Error>(self, bytes: &[u8]) -> Result<Self::Value, E> {
            Ok(bytes.to_vec())
        }
    }
}
