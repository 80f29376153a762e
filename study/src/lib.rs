//! What the unwrapping methods do with pictures: one's own, a folder of frames,
//! and the scenes on which methods fail.
//!
//! Nothing here knows a node, a message or a topic; every figure is measured on
//! the same `core` that the nodes run.

pub mod bench;
mod error;
mod event;
pub mod frontier;
mod shown;
pub mod simulate;
pub mod stability;
mod stopwatch;
mod store;

pub use error::StudyError;
pub use event::{Event, Skipped};

/// Refuses an empty list.
fn need<T>(what: &'static str, list: &[T]) -> Result<(), StudyError> {
    if list.is_empty() { Err(StudyError::Empty { what }) } else { Ok(()) }
}
