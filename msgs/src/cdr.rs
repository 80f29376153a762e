//! CDR as ROS 2 puts it on the wire: a 4-byte encapsulation, then XCDR1 plain data ("DDS_CDR"), each primitive aligned
//! to its size counted from byte 4.
//!
//! Messages are written in little endian with zero padding, and read in both byte orders. A length from the wire is
//! compared with the number of remaining bytes before memory is allocated. Bytes behind the message are ignored, since
//! shared memory hands out whole blocks.
//!
//! Source: OMG DDS-RTPS 2.5, 10.2 and DDS-XTypes 1.3, 7.4.1 (XCDR version 1).

mod decode;

use std::marker::PhantomData;

use re_cdr::{BigEndian, ByteOrder, CdrSerializer, LittleEndian};
use serde::Serialize;
use serde::de::{DeserializeOwned, DeserializeSeed};

use decode::Decoder;

/// Error of bytes that are not a message, or of a message that cannot be written as CDR.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CdrError {
    /// The bytes are not a message of the expected type: the number of bytes before the error, with the encapsulation, that of all
    /// bytes, and the fault that was found there.
    #[error("CDR, read up to byte {0} of {1}: {2}")]
    Read(usize, usize, String),
    /// The message is too long to be written.
    #[error("a message of {0} bytes cannot be written as CDR, which has at most {max}", max = u32::MAX)]
    Long(usize),
    /// The Rust type is not one of a ROS message.
    #[error("CDR: {0}; use numbers, bool, String, Vec, arrays and structs of these")]
    Unsupported(String),
}

/// Bytes before the message: representation identifier and options.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// Returns `message` as little-endian CDR with its encapsulation.
///
/// # Errors
/// [`CdrError`] when the message has more bytes than 32 bits can count, or its type is not one of a ROS message.
pub fn to_vec<T: Serialize + ?Sized>(message: &T) -> Result<Vec<u8>, CdrError> {
    let mut out = ENCAPSULATION.to_vec();
    let written = message.serialize(&mut CdrSerializer::<LittleEndian>::new(&mut out));
    written.map_err(|why| CdrError::Unsupported(why.to_string()))?;
    // Lengths are cut to 32 bits as they are written. No length is cut in a message that is shorter itself.
    u32::try_from(out.len()).map_err(|_| CdrError::Long(out.len()))?;
    Ok(out)
}

/// Reads the message in `bytes`, which begin with the encapsulation.
///
/// # Errors
/// [`CdrError`] with the offset and the reason.
pub fn from_slice<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, CdrError> {
    from_slice_seed(PhantomData, bytes)
}

/// Reads the message in `bytes`, which begin with the encapsulation, with `seed`.
pub(crate) fn from_slice_seed<'b, S: DeserializeSeed<'b>>(
    seed: S,
    bytes: &'b [u8],
) -> Result<S::Value, CdrError> {
    match bytes {
        [0, 0, _, _, body @ ..] => read(seed, Decoder::<BigEndian>::new(body)),
        [0, 1, _, _, body @ ..] => read(seed, Decoder::<LittleEndian>::new(body)),
        _ => {
            let why =
                "an encapsulation of 4 bytes is needed, 00 00 (CDR_BE) or 00 01 (CDR_LE) first".to_owned();
            Err(CdrError::Read(0, bytes.len(), why))
        }
    }
}

fn read<'b, S: DeserializeSeed<'b>, O: ByteOrder>(
    seed: S,
    mut decoder: Decoder<'b, O>,
) -> Result<S::Value, CdrError> {
    seed.deserialize(&mut decoder).map_err(|why| {
        let [offset, length] = [decoder.at(), decoder.length].map(|count| ENCAPSULATION.len() + count);
        CdrError::Read(offset, length, why.to_string())
    })
}

/// `#[serde(with = "crate::cdr::bytes")]`: byte sequences as one copy instead of one call for each byte. This makes image
/// messages cheap.
pub(crate) mod bytes {
    use std::fmt;

    use serde::de::Visitor;
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

        fn visit_byte_buf<E>(self, bytes: Vec<u8>) -> Result<Self::Value, E> {
            Ok(bytes)
        }
    }
}
