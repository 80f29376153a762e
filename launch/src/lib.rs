//! ROS 2 YAML launch files: parser, plan and process supervisor.
//!
//! Data flows one way: the actions of a file are evaluated one after the other
//! into a [`Plan`], and a plan is run, printed, or translated for one process.
//!
//! The dialect is a subset of ROS 2's own: what is accepted here means the same
//! to `ros2 launch`, and what is not supported is refused by name. What is wrong is a
//! [`LaunchError`] of one line that names the place, the thing and the possible values.

mod package;
pub mod plan;
pub mod substitution;
pub mod summary;
pub mod supervisor;
mod trace;

use std::path::{Path, PathBuf};

pub use package::{FoundFile, SUITE, copy, launch_file, launch_files};
pub use plan::{
    DeclaredArgument, NodeParameter, NodePlan, Plan, compose, declared_arguments, resolve, ros_arguments,
};
pub use summary::{NodeReport, SUMMARY_BEGIN, Summary, reports_so_far};
pub use supervisor::{Ending, Outcome, Supervision, run};
pub use trace::{TRACE_BEGIN, TraceCounts};

/// Why a launch file cannot be read, resolved or run.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LaunchError {
    /// Something in a launch file, at this line of it, from 1; with the mistake and the possible values.
    #[error("{file}:{1}: {2}", file = .0.display())]
    At(PathBuf, usize, String),
    /// A file that cannot be read or written, with the system's reason.
    #[error("{file}: {1}", file = .0.display())]
    File(PathBuf, String),
    /// An undeclared argument, a process that cannot be started or cannot run inside another one; in words.
    #[error("{0}")]
    Other(String),
}

impl LaunchError {
    /// An error at a line of a launch file.
    pub fn at(file: &Path, line: usize, message: impl Into<String>) -> Self {
        Self::At(file.to_owned(), line, message.into())
    }

    /// An error of the file system.
    pub fn file(file: &Path, why: impl ToString) -> Self {
        Self::File(file.to_owned(), why.to_string())
    }
}

/// Returns the files in `folder` by their paths: a folder is listed in any order, and the same run must give the same results.
pub(crate) fn files_in(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut files: Vec<_> = std::fs::read_dir(folder)?.flatten().map(|entry| entry.path()).collect();
    files.sort();
    Ok(files)
}
