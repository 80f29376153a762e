//! Evaluation in lockstep: every frame of a source goes once, in order, through the same nodes as in a live run, and the
//! detected boxes are scored against the ground truth.
//!
//! There are two kinds: the nodes of a launch file ([`launch_file`]), and a [`grid`] of settings over labelled frames,
//! whose results are stored ([`store`]), drawn ([`chart`]) and reported ([`report`]). Nothing here uses a transport. The
//! same frames and parameters give the same files, except for durations.

pub mod budget;
pub mod chart;
pub mod classes;
pub mod grid;
mod labels;
pub mod launch_file;
mod messages;
/// The metrics of detections, one file each. The reports print the definition of each metric.
pub mod metric {
    pub mod bootstrap;
    pub mod latency;
    pub mod paper;
}
pub mod report;
pub mod results;
pub mod store;
pub mod video;

use std::path::{Path, PathBuf};

use modulo_bags::FileError;
use modulo_bags::source::SourceError;
use modulo_core::SensorError;
use modulo_detector::DetectorError;
pub use modulo_draw::below_100;
use modulo_runtime::ParameterError;
use modulo_runtime::lockstep::LockstepError;

/// Error of a grid run. The message names the value and the possible ones.
#[derive(Debug, thiserror::Error)]
pub enum GridError {
    /// A list without an entry.
    #[error("{0} is empty; at least one entry is needed")]
    Empty(&'static str),
    /// An impossible value.
    #[error("{what} is {value}, but must be {possible}")]
    Value {
        /// Name of the option.
        what: &'static str,
        /// The value.
        value: String,
        /// The possible values.
        possible: String,
    },
    /// A grid without a cell. The texts name the combinations of options, each with the reason.
    #[error("the grid has no cell: {list}", list = .0.join("; "))]
    NoCell(Vec<String>),
    /// Results cannot be written into a folder.
    #[error("no result can be written into {path}, so that another folder is needed: {1}", path = .0.display())]
    Output(PathBuf, #[source] std::io::Error),
    /// No frame of the data can be scored.
    #[error("{source_name}: none of the {frames} frames can be scored: {why}")]
    Nothing {
        /// The data as it was given.
        source_name: String,
        /// Number of frames.
        frames: usize,
        /// The reason.
        why: String,
    },
    /// A file is not a class mapping. The text names the line and the expected form.
    #[error("{path}: {1}", path = .0.display())]
    Table(PathBuf, String),
    /// A file holds results of another request. The text names the difference.
    #[error("{path}: holds results that cannot be shown with those of this command: {1}; choose another folder, or start anew with --fresh", path = .0.display())]
    OtherSetup(PathBuf, String),
    /// A file holds other figures for a cell than an earlier file.
    #[error("{path}: cell {1} was measured before with other figures", path = .0.display())]
    Contradiction(PathBuf, String),
    /// A file or folder cannot be read or written.
    #[error(transparent)]
    Io(#[from] FileError),
    /// A file is not JSON of results.
    #[error("{path}: {1}", path = .0.display())]
    Json(PathBuf, #[source] serde_json::Error),
    /// The file of results is missing.
    #[error("{}: there are no results; modulo eval --out writes them", .0.display())]
    NoResults(PathBuf),
    /// A chart could not be drawn.
    #[error("chart {0}: {1}")]
    Chart(String, #[source] modulo_draw::ChartError),
    /// The data cannot be read.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The captures cannot be merged.
    #[error(transparent)]
    Bracket(#[from] modulo_core::BracketError),
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
    fn io(path: &Path, source: std::io::Error) -> Self {
        FileError::new(path, source).into()
    }
}
