//! [`Storage`]: one file of a bag in any form. The first bytes of a file determine its form.

use std::fmt::Debug;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::mcap_file::McapFile;
use super::ros1::Ros1File;
use super::sqlite::SqliteFile;
use super::{BagError, BagWarning, RawMessage, Selection, TopicCount};
use crate::FileError;

/// File name extensions of bags.
const EXTENSIONS: [&str; 3] = ["mcap", "db3", "bag"];

/// The summary of one file of a bag.
#[derive(Debug)]
pub(super) struct FileSummary {
    /// Name of the storage in rosbag2.
    pub(super) id: &'static str,
    /// Size in bytes.
    pub(super) size: u64,
    /// First and last log time, ns since the epoch; `None` without messages.
    pub(super) span: Option<(u64, u64)>,
    /// The topics with their counts, in the order of the file.
    pub(super) topics: Vec<TopicCount>,
    /// Problems of the file.
    pub(super) warnings: Vec<BagWarning>,
}

/// An open file with a known index.
pub(super) trait Storage: Debug + Send + Sync {
    /// Returns the summary of the file.
    fn summary(&self) -> &FileSummary;

    /// Returns the selected messages; `None` when no topic is selected.
    fn messages(self: Arc<Self>, selection: &Selection) -> Result<Option<Box<dyn Cursor>>, BagError>;
}

/// Whether the index of an MCAP file is taken as it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum IndexUse {
    /// The index is used when it is consistent.
    Trusted,
    /// The file is walked over, and whole chunks are read beside broken ones.
    Ignored,
}

/// Messages in log-time order.
pub(super) trait Cursor: Send {
    fn next(&mut self) -> Result<Option<RawMessage>, BagError>;
}

/// Opens the file `path`.
pub(super) fn open(path: &Path, index: IndexUse) -> Result<Arc<dyn Storage>, BagError> {
    let mut start = Vec::new();
    let file = File::open(path).map_err(|e| FileError::new(path, e))?;
    file.take(16).read_to_end(&mut start).map_err(|e| FileError::new(path, e))?;
    Ok(if start.starts_with(b"SQLite format 3\0") {
        Arc::new(SqliteFile::open(path)?)
    } else if start.starts_with(b"#ROSBAG V") {
        Arc::new(Ros1File::open(path)?)
    } else {
        Arc::new(McapFile::open(path, index)?)
    })
}

/// Returns whether `path` is called as a file of a bag is.
pub(super) fn is_storage(path: &Path) -> bool {
    path.extension().is_some_and(|e| EXTENSIONS.iter().any(|known| e.eq_ignore_ascii_case(known)))
}

/// Returns the files of a bag in `folder`, by name.
pub(super) fn files_in(folder: &Path) -> Result<Vec<PathBuf>, BagError> {
    let io = |e| FileError::new(folder, e);
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        if path.is_file() && is_storage(&path) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}
