//! Evaluation in lockstep: every frame of a source goes once, in order, through the same nodes as in a live run, and the
//! detected boxes are scored against the ground truth.
//!
//! There are two kinds: the nodes of a launch file ([`launch_file`]), and a [`grid`] of settings over labelled frames,
//! whose results are stored ([`store`]), drawn ([`chart`]) and reported ([`report`]). Nothing here uses a transport. The
//! same frames and parameters give the same files, except for durations.

pub mod chart;
pub mod classes;
pub mod grid;
mod labels;
pub mod launch_file;
pub mod messages;
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

use std::fmt::Display;
use std::path::Path;

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
    /// The request is impossible, or its folder holds results of another one or takes none. The sentence names the possible
    /// values or the remedy.
    #[error("{0}")]
    Request(String),
    /// No frame of the data can be scored: the data as it was given, the number of its frames, and the reason.
    #[error("{0}: none of the {1} frames can be scored: {2}")]
    Nothing(String, usize, String),
    /// A file or folder cannot be read or written.
    #[error(transparent)]
    Io(#[from] FileError),
    /// Stored results are missing, are no JSON of results, or contradict each other, or a chart of them cannot be drawn.
    #[error("{0}")]
    Results(String),
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
    fn value(what: &str, value: impl Display, possible: impl Display) -> Self {
        Self::Request(format!("{what} is {value}, but must be {possible}"))
    }

    fn empty(list: &str) -> Self {
        Self::Request(format!("{list} is empty; at least one entry is needed"))
    }

    fn of_file(path: &Path, why: impl Display) -> Self {
        Self::Request(format!("{}: {why}", path.display()))
    }

    fn io(path: &Path, source: std::io::Error) -> Self {
        FileError::new(path, source).into()
    }
}
