//! Recorded frames of every kind: folders of images, KITTI, spike recordings, and rosbag2 MCAP bags, read and written.
//!
//! Nothing here reads a clock, opens a connection or knows of any node.

pub mod bag;
pub mod source;

use std::path::{Component, Path, PathBuf};

/// Topic of the labels in a bag: `vision_msgs/msg/Detection2DArray` with the stamps of the images.
pub const GROUND_TRUTH_TOPIC: &str = "/ground_truth";

/// Returns whether `path`, which a recording or a data set names, stays inside the folder that it is relative to.
fn stays_inside(path: &Path) -> bool {
    path.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir))
}

/// Error: the system does not read or write a file or folder.
#[derive(Debug, thiserror::Error)]
#[error("{}: {source}", path.display())]
pub struct FileError {
    /// The file or folder.
    pub path: PathBuf,
    /// The error of the system.
    pub source: std::io::Error,
}

impl FileError {
    /// Returns the error `source` of the file or folder `path`.
    pub fn new(path: &Path, source: std::io::Error) -> Self {
        Self { path: path.to_owned(), source }
    }
}
