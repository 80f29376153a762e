//! [`GridError`]: why a grid could not be worked on.

use std::path::{Path, PathBuf};

use modulo_bags::FileError;
use modulo_bags::source::SourceError;
use modulo_core::SensorError;
use modulo_detector::DetectorError;
use modulo_runtime::Refusal;
use modulo_runtime::driver::RunError;

/// Names the thing, its value and what is possible.
#[derive(Debug, thiserror::Error)]
pub enum GridError {
    /// Nothing to do.
    #[error("{what} is empty, at least one is needed")]
    Empty {
        /// The list.
        what: &'static str,
    },
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
    /// A class map that is none.
    #[error("{}: {why}", path.display())]
    Table {
        /// The file.
        path: PathBuf,
        /// The line, and what is needed.
        why: String,
    },
    /// Results of another setup.
    #[error("{}: holds results of another setup: {what} differs; choose another folder, or remove it", path.display())]
    OtherSetup {
        /// The file.
        path: PathBuf,
        /// What is not the same.
        what: String,
    },
    /// Results that contradict each other.
    #[error("{}: cell {cell} was measured before with other figures", path.display())]
    Contradiction {
        /// The file.
        path: PathBuf,
        /// Where in the grid.
        cell: String,
    },
    /// The system refused.
    #[error(transparent)]
    Io(#[from] FileError),
    /// A file of results that is none.
    #[error("{}: {source}", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// Where it stops making sense.
        source: serde_json::Error,
    },
    /// A folder without results.
    #[error("{}: there are no results; modulo eval --out makes them", path.display())]
    NoResults {
        /// The file that is missing.
        path: PathBuf,
    },
    /// A chart that could not be drawn.
    #[error("chart {name}: {source}")]
    Chart {
        /// Its name.
        name: String,
        /// Why.
        source: modulo_charts::ChartError,
    },
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
    Parameter(#[from] Refusal),
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
