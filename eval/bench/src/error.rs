//! [`BenchError`]: the error of a simulation, benchmark or stability run.

use std::path::PathBuf;

use modulo_charts::ChartError;
use modulo_core::metric::ShapesDiffer;
use modulo_core::{SensorError, UnwrapError};
use modulo_images::{ImageError, SaveError};

/// Error of a simulation, benchmark or stability run. The message names the value and the possible ones.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// A list without an entry.
    #[error("{0} is empty; at least one entry is needed")]
    Empty(&'static str),
    /// A number out of its range.
    #[error("{what} is {value}, but must be {possible}")]
    Number {
        /// Name of the number.
        what: &'static str,
        /// The value.
        value: usize,
        /// The possible values.
        possible: &'static str,
    },
    /// A folder without a readable image.
    #[error("{}: there is no readable image (.png, .jpg, .jpeg, .exr, .hdr)", .0.display())]
    NoFrames(PathBuf),
    /// A file or folder cannot be read or written.
    #[error("{path}: {1}", path = .0.display())]
    Io(PathBuf, #[source] std::io::Error),
    /// A file is not a list of results.
    #[error("{path}: {1}", path = .0.display())]
    Json(PathBuf, #[source] serde_json::Error),
    /// The chart cannot be drawn.
    #[error(transparent)]
    Chart(#[from] ChartError),
    /// An image cannot be read, or the white point is impossible.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// An image cannot be written.
    #[error(transparent)]
    Save(#[from] SaveError),
    /// The sensor is impossible, or cannot be exposed to the image.
    #[error(transparent)]
    Sensor(#[from] SensorError),
    /// The method does not exist, or refuses the image.
    #[error(transparent)]
    Unwrap(#[from] UnwrapError),
    /// Images have different shapes.
    #[error(transparent)]
    Shapes(#[from] ShapesDiffer),
}
