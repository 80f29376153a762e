//! [`CdrError`].

use std::fmt::Display;

/// Why bytes are not a message, or a message cannot become bytes. Offsets count
/// from the first byte of the encapsulation.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CdrError {
    /// The message ends too early, or a length in it is too large.
    #[error("CDR ends too early: at byte {offset}, {expected} bytes expected, got {got}")]
    Short {
        /// Where.
        offset: usize,
        /// Bytes needed.
        expected: usize,
        /// Bytes left.
        got: usize,
    },
    /// The bytes are there but mean nothing.
    #[error("CDR at byte {offset}: expected {expected}, got {got}")]
    Value {
        /// Where.
        offset: usize,
        /// What can stand there.
        expected: &'static str,
        /// What does.
        got: String,
    },
    /// A string or sequence is too long to be written.
    #[error("CDR at byte {offset}: length of at most {max} expected, got {got}", max = u32::MAX)]
    Long {
        /// Where.
        offset: usize,
        /// Its length.
        got: usize,
    },
    /// The Rust type is not one of a ROS message.
    #[error("CDR messages cannot hold {0}; use numbers, bool, String, Vec, arrays and structs of these")]
    Unsupported(&'static str),
    /// What serde or a type's own code objects to.
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
