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
    #[error("{what} is empty, at least one is needed")]
    Empty {
        /// The list.
        what: &'static str,
    },
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
    #[error("{}: no image that can be read, one of .png .jpg .jpeg .exr .hdr is needed", folder.display())]
    NoFrames {
        /// The folder.
        folder: PathBuf,
    },
    /// The system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file of results that is none.
    #[error("{}: {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// Where it stops making sense.
        source: serde_json::Error,
    },
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
