//! [`FileError`]: the system does not read or write a file.

use std::path::{Path, PathBuf};

/// The system does not read or write a file or folder.
#[derive(Debug, thiserror::Error)]
#[error("{}: {source}", path.display())]
pub struct FileError {
    /// The file or folder.
    pub path: PathBuf,
    /// The error of the system.
    pub source: std::io::Error,
}

impl FileError {
    /// The error `source` of the file or folder `path`.
    pub fn new(path: &Path, source: std::io::Error) -> Self {
        Self { path: path.to_owned(), source }
    }
}
