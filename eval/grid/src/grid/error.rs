//! [`GridError`]: why a grid could not be worked on.

use std::path::{Path, PathBuf};

use modulo_bags::FileError;
use modulo_bags::source::SourceError;
use modulo_core::SensorError;
use modulo_detector::DetectorError;
use modulo_runtime::ParameterError;
use modulo_runtime::driver::RunError;

/// Names the thing, its value and what is possible.
#[derive(Debug, thiserror::Error)]
pub enum GridError {
    /// Nothing to do.
    #[error("{0} is empty, at least one is needed")]
    Empty(&'static str),
    /// A value that is none of the possible ones.
    #[error("{what} is {value}, {possible} is possible")]
    Value {
        /// The option.
        what: &'static str,
        /// Found.
        value: String,
        /// What is possible.
        possible: String,
    },
    /// Data without a single frame that can be scored.
    #[error("{source_name}: none of {frames} frames can be scored: {why}")]
    Nothing {
        /// As it was given.
        source_name: String,
        /// Frames found.
        frames: usize,
        /// What is wrong with them.
        why: String,
    },
    /// A file is not a class map; the line, and what is needed.
    #[error("{path}: {1}", path = .0.display())]
    Table(PathBuf, String),
    /// A file holds results of another setup; what differs.
    #[error("{path}: holds results of another setup: {1} differs; choose another folder, or remove it", path = .0.display())]
    OtherSetup(PathBuf, &'static str),
    /// The results of a file contradict others in a cell.
    #[error("{path}: cell {1} was measured before with other figures", path = .0.display())]
    Contradiction(PathBuf, String),
    /// A file or folder cannot be read or written.
    #[error(transparent)]
    Io(#[from] FileError),
    /// A file does not hold results.
    #[error("{path}: {1}", path = .0.display())]
    Json(PathBuf, #[source] serde_json::Error),
    /// The file of the results is missing.
    #[error("{}: there are no results; modulo eval --out makes them", .0.display())]
    NoResults(PathBuf),
    /// The chart of this name could not be drawn.
    #[error("chart {0}: {1}")]
    Chart(String, #[source] modulo_charts::ChartError),
    /// The data.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// Captures that cannot be merged.
    #[error(transparent)]
    Bracket(#[from] modulo_core::BracketError),
    /// A sensor that does not exist.
    #[error(transparent)]
    Sensor(#[from] SensorError),
    /// An image that cannot be unwrapped.
    #[error(transparent)]
    Unwrap(#[from] modulo_core::UnwrapError),
    /// A parameter that a node refuses.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// A model that does not run.
    #[error(transparent)]
    Detector(#[from] DetectorError),
    /// A driver that could not start.
    #[error(transparent)]
    Run(#[from] RunError),
}

impl GridError {
    pub(crate) fn io(path: &Path, source: std::io::Error) -> Self {
        FileError::new(path, source).into()
    }
}
