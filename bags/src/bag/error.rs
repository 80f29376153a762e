//! [`BagError`], why a bag cannot be used, and [`BagWarning`], what a usable bag
//! lacks.

use std::path::{Path, PathBuf};

use crate::FileError;

/// Why a bag cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum BagError {
    /// The system refused.
    #[error(transparent)]
    Io(#[from] FileError),
    /// A file that never was a bag.
    #[error("{}: not a bag, its first bytes are not those of MCAP, SQLite or ROS 1", path.display())]
    NotBag {
        /// The file.
        path: PathBuf,
    },
    /// A folder that holds no bag.
    #[error("{}: no bag here, a metadata.yaml or a .mcap, .db3 or .bag file is needed", path.display())]
    NoBag {
        /// The folder.
        path: PathBuf,
    },
    /// A bag in a form that is not read here.
    #[error("{}: {what} '{found}' is not supported, possible is {possible}", path.display())]
    Unsupported {
        /// The metadata file.
        path: PathBuf,
        /// What of the bag.
        what: &'static str,
        /// Its value.
        found: String,
        /// What can be read.
        possible: &'static str,
    },
    /// A `metadata.yaml` that is not one.
    #[error("{}: {why}", path.display())]
    Metadata {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// The bytes of an indexed file are not what its index says.
    #[error("{}: {why}; `modulo bag recover` may save the rest", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// An SQLite file that is not one of rosbag2, or broken.
    #[error("{}: {why}; `sqlite3 FILE .recover` may save what is in a broken file", path.display())]
    Sqlite {
        /// The file.
        path: PathBuf,
        /// What SQLite says.
        why: String,
    },
    /// A ROS 1 bag that cannot be read on.
    #[error("{}: {why}; `rosbag reindex` of ROS 1 may save a bag that was not closed", path.display())]
    Ros1 {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// One message that cannot be read; the messages after it can.
    #[error("{}: a message of topic '{topic}' cannot be read: {why}", path.display())]
    BadMessage {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// When it was recorded, ns since the epoch.
        log_time: u64,
        /// What is wrong.
        why: String,
    },
    /// Bags are never overwritten.
    #[error("{}: is already there; a bag is never overwritten, choose another name", path.display())]
    Exists {
        /// The folder.
        path: PathBuf,
    },
    /// A folder name that cannot name a bag.
    #[error("{}: cannot be the name of a bag, a plain folder name is needed", path.display())]
    Name {
        /// The path that was given.
        path: PathBuf,
    },
    /// One topic with two types.
    #[error("topic '{topic}' is already {known}, cannot also be {given}")]
    TypeConflict {
        /// The topic.
        topic: String,
        /// Its type in this bag.
        known: String,
        /// The other type.
        given: String,
    },
    /// A topic that this bag did not hand out.
    #[error("topic number {number} is not of this bag, it has {known}")]
    UnknownTopic {
        /// The number.
        number: usize,
        /// How many topics there are.
        known: usize,
    },
    /// The MCAP file could not be written.
    #[error("{}: {source}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the writer said.
        source: mcap::McapError,
    },
}

impl BagError {
    pub(super) fn damaged(path: &Path, why: impl std::fmt::Display) -> Self {
        Self::Damaged { path: path.to_owned(), why: why.to_string() }
    }
}

/// What a bag lacks that could be read all the same.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BagWarning {
    /// A recorder that was stopped before it wrote `metadata.yaml`.
    #[error("{}: no metadata.yaml, all files are read by their start time", path.display())]
    NoMetadata {
        /// The folder.
        path: PathBuf,
    },
    /// A `metadata.yaml` that is not one.
    #[error("{}: {why}; all files of its folder are read by their start time", path.display())]
    BadMetadata {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// A whole file without an index.
    #[error("{}: no index, the whole file was scanned", path.display())]
    NoIndex {
        /// The file.
        path: PathBuf,
    },
    /// A file that ends too early: everything up to the last whole chunk is read.
    #[error("{}: cut at byte {byte} ({why}); {messages} messages before it are read", path.display())]
    Truncated {
        /// The file.
        path: PathBuf,
        /// Where the last whole record ends.
        byte: u64,
        /// What the reader found there.
        why: String,
        /// Messages up to there.
        messages: u64,
    },
    /// A record that had to be skipped.
    #[error("{}: record at byte {byte} is skipped: {why}", path.display())]
    Skipped {
        /// The file.
        path: PathBuf,
        /// Where the record begins.
        byte: u64,
        /// What is wrong with it.
        why: String,
    },
    /// Messages of a topic that are not given out.
    #[error("{}: {messages} messages of topic '{topic}' are left out: {why}", path.display())]
    LeftOut {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// How many of its messages.
        messages: u64,
        /// What is wrong with them, or with the first of them.
        why: String,
    },
    /// A topic of a type that neither the bag nor the suite defines.
    #[error("{}: topic '{topic}': the bag does not define {type_name}, nor does this suite", path.display())]
    NoDefinition {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Its type.
        type_name: String,
    },
}

impl BagWarning {
    /// Whether messages that were recorded cannot be read.
    pub fn is_loss(&self) -> bool {
        matches!(self, Self::Truncated { .. } | Self::Skipped { .. } | Self::LeftOut { .. })
    }
}
