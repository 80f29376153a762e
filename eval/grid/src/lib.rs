//! Evaluation: every frame once, in order, through the nodes of a launch file in lockstep, for each combination of what varies; then the boxes
//! are scored against the labels.
//!
//! The data go one way, and running knows no score:
//!
//! ```text
//! variants (nodes) -> plan (cells) -> run -> frames -> engine (lockstep) -> store (boxes, a file a cell and slice) -> score -> report
//! ```
//!
//! The folder of the results is the database: what one process has finished there, others find. Nothing here uses a transport. The
//! same frames and parameters give the same files, except for durations.

mod chain;
pub mod chart;
mod classes;
pub mod coco;
pub mod data;
mod engine;
mod feeds;
mod frames;
pub mod images;
mod labels;
mod makers;
mod messages;
mod pictures;
pub mod plan;
pub mod progress;
mod quality;
pub mod recordings;
pub mod results;
mod rows;
pub mod run;
pub mod score;
pub mod stability;
pub mod store;
mod stored;
mod timing;
pub mod variants;
mod verdict;
/// The metrics of detections, one file each. The reports print the definition of each metric.
mod metric {
    pub mod bootstrap;
    pub mod latency;
}
pub mod report;

use std::fmt::Display;
use std::path::{Path, PathBuf};

use modulo_bags::FileError;
use modulo_bags::source::SourceError;
use modulo_core::SensorError;
use modulo_detector::DetectorError;
pub use modulo_draw::below_100;
use modulo_images::{ImageError, SaveError};
use modulo_runtime::ParameterError;
use modulo_runtime::lockstep::LockstepError;
use modulo_runtime::output::OutputError;
use modulo_video::VideoError;
pub use quality::up_to_offset;

/// Error of an evaluation. The message names the value and the possible ones.
#[derive(Debug, thiserror::Error)]
pub enum GridError {
    /// The request is impossible, or its folder holds results of another one or takes none. The sentence names the possible
    /// values or the remedy.
    #[error("{0}")]
    Request(String),
    /// A file or folder cannot be read or written.
    #[error(transparent)]
    Io(#[from] FileError),
    /// Stored results are missing, are no JSON of results, or contradict each other, or a chart of them cannot be drawn.
    #[error("{0}")]
    Results(String),
    /// The data cannot be read.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The folder takes no results.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A file cannot hold the codes of the sensor as they are. The text is the reason and the remedy.
    #[error("{path}: {1}", path = .0.display())]
    NotCodes(PathBuf, String),
    /// An image cannot be read, or the white point is impossible.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A video cannot be read.
    #[error(transparent)]
    Video(#[from] VideoError),
    /// An image cannot be written.
    #[error(transparent)]
    Save(#[from] SaveError),
    /// The sensor is impossible, or cannot be exposed to the image.
    #[error(transparent)]
    Sensor(#[from] SensorError),
    /// The image cannot be unwrapped.
    #[error(transparent)]
    Unwrap(#[from] modulo_core::UnwrapError),
    /// A node refuses a parameter.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// The model does not run.
    #[error(transparent)]
    Detector(#[from] DetectorError),
    /// A node failed.
    #[error(transparent)]
    Run(#[from] LockstepError),
}

impl GridError {
    fn value(what: &str, value: impl Display, possible: impl Display) -> Self {
        Self::Request(format!("{what} is {value}, but must be {possible}"))
    }

    fn of_file(path: &Path, why: impl Display) -> Self {
        Self::Request(format!("{}: {why}", path.display()))
    }

    fn io(path: &Path, source: std::io::Error) -> Self {
        FileError::new(path, source).into()
    }
}
