//! What the unwrapping methods do with pictures: one's own, a folder of frames,
//! and the scenes on which methods fail.
//!
//! Nothing here knows a node, a message or a topic; every figure is measured on
//! the same `core` that the nodes run.

pub mod bench;
mod error;
pub mod frontier;
pub mod simulate;
pub mod stability;
mod stopwatch;
mod store;

pub use error::StudyError;

use modulo_core::{Frame, Samples, Sensor, SensorConfig};
use ndarray::Array3;
use serde::Serialize;

/// Handed to the caller's closure as it happens.
#[derive(Clone, Debug, PartialEq)]
pub enum Event<'a> {
    /// `done` of `total` steps are over; `next` says what comes now.
    Step {
        /// Steps that are over.
        done: usize,
        /// All steps.
        total: usize,
        /// For people: file or method, and alpha.
        next: &'a str,
    },
    /// A file was left out; the others go on.
    Skipped(&'a Skipped),
    /// A measurement to be careful with.
    Warning(&'a str),
}

/// A file that was left out.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Skipped {
    /// As it was given.
    pub file: String,
    /// What was wrong with it; names the file.
    pub why: String,
}

/// Refuses an empty list.
fn need<T>(what: &'static str, list: &[T]) -> Result<(), StudyError> {
    if list.is_empty() { Err(StudyError::Empty(what)) } else { Ok(()) }
}

/// A sensor for each of `alphas`, as `config` in all else.
fn sensors(alphas: &[f64], config: SensorConfig) -> Result<Vec<Sensor>, StudyError> {
    need("the list of alphas", alphas)?;
    alphas.iter().map(|&alpha| Ok(Sensor::new(SensorConfig { alpha, ..config })?)).collect()
}

/// The samples of an ideal or toned picture, which the metrics compare.
fn shown(frame: Frame) -> Array3<u8> {
    match frame.into_samples() {
        Samples::U8(samples) => samples,
        Samples::U16(_) | Samples::F32(_) => unreachable!("ideal and toned pictures have 8 bits"),
    }
}
