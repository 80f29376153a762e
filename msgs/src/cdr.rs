//! CDR as ROS 2 puts it on the wire: a 4-byte encapsulation, then XCDR1 plain
//! data ("DDS_CDR"), each primitive aligned to its size counted from byte 4.
//!
//! Written little endian with zero padding; read in both byte orders. A length
//! from the wire is compared with the bytes that are left before anything is
//! allocated. Bytes behind the message (shared memory hands out whole blocks)
//! are ignored.
//!
//! Source: OMG DDS-RTPS 2.5, 10.2 and DDS-XTypes 1.3, 7.4.1 (XCDR version 1).

mod decode;
mod encode;
mod error;

use serde::Serialize;
use serde::de::{DeserializeOwned, DeserializeSeed};

pub use self::error::CdrError;

/// Bytes before the message: representation identifier and options.
pub(crate) const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// `message` as little-endian CDR with its encapsulation.
///
/// # Errors
/// [`CdrError`] when a length does not fit in 32 bits, or the type holds
/// something that CDR messages cannot (an option, a map, an enum with data).
pub fn to_vec<T: Serialize + ?Sized>(message: &T) -> Result<Vec<u8>, CdrError> {
    let mut encoder = encode::Encoder::new();
    message.serialize(&mut encoder)?;
    Ok(encoder.finish())
}

/// The message in `bytes`, which begin with the encapsulation.
///
/// # Errors
/// [`CdrError`] with the offset, what was expected there and what was found.
pub fn from_slice<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, CdrError> {
    T::deserialize(&mut decode::Decoder::new(bytes)?)
}

/// What `seed` makes of the message in `bytes`, which begin with the encapsulation.
///
/// # Errors
/// As [`from_slice`].
pub(crate) fn from_slice_seed<'b, S: DeserializeSeed<'b>>(
    seed: S,
    bytes: &'b [u8],
) -> Result<S::Value, CdrError> {
    seed.deserialize(&mut decode::Decoder::new(bytes)?)
}
