//! [`StudyError`]: why a study could not be made.

use std::path::PathBuf;

use modulo_charts::ChartError;
use modulo_core::{SensorError, UnwrapError};
use modulo_images::{ImageError, SaveError};

use modulo_core::metric::ShapesDiffer;

/// Names the thing, its value and what is possible.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// Nothing to do.
    #[error("{0} is empty, at least one is needed")]
    Empty(&'static str),
    /// A number out of its range.
    #[error("{what} is {value}, {possible} is possible")]
    Number {
        /// The number's name.
        what: &'static str,
        /// Found.
        value: usize,
        /// What is possible.
        possible: &'static str,
    },
    /// A folder without one image that can be read.
    #[error("{}: no image that can be read, one of .png .jpg .jpeg .exr .hdr is needed", .0.display())]
    NoFrames(PathBuf),
    /// A file or folder cannot be read or written.
    #[error("{path}: {1}", path = .0.display())]
    Io(PathBuf, #[source] std::io::Error),
    /// A file is not a list of results.
    #[error("{path}: {1}", path = .0.display())]
    Json(PathBuf, #[source] serde_json::Error),
    /// A chart that could not be drawn.
    #[error(transparent)]
    Chart(#[from] ChartError),
    /// A picture that could not be read, or a white that is none.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A picture that could not be written.
    #[error(transparent)]
    Save(#[from] SaveError),
    /// A sensor that does not exist.
    #[error(transparent)]
    Sensor(#[from] SensorError),
    /// A method that does not exist, or an image that it refuses.
    #[error(transparent)]
    Unwrap(#[from] UnwrapError),
    /// Results of different shapes.
    #[error(transparent)]
    Shapes(#[from] ShapesDiffer),
}
