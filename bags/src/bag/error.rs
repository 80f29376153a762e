//! [`BagError`]: a bag cannot be used. [`BagWarning`]: something of a usable bag is missing.

use std::path::{Path, PathBuf};

use crate::FileError;

/// Error: a bag cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum BagError {
    /// The system does not read or write a file.
    #[error(transparent)]
    Io(#[from] FileError),
    /// The file is not a bag.
    #[error("{file}: not a bag, its first bytes are not those of MCAP, SQLite or ROS 1", file = .0.display())]
    NotBag(PathBuf),
    /// The folder contains no bag.
    #[error("{file}: no bag here, a metadata.yaml or a .mcap, .db3 or .bag file is needed", file = .0.display())]
    NoBag(PathBuf),
    /// The metadata file describes a bag of a form that is not supported.
    #[error("{file}: {1}", file = .0.display())]
    Unsupported(PathBuf, String),
    /// The file is not a readable `metadata.yaml`.
    #[error("{file}: {1}", file = .0.display())]
    Metadata(PathBuf, String),
    /// The file is damaged or was not closed. The last field names a remedy.
    #[error("{file}: {1}; {2}", file = .0.display())]
    Damaged(PathBuf, String, &'static str),
    /// One message cannot be read; the messages after it can.
    #[error("{}: a message of topic '{topic}' cannot be read: {why}", path.display())]
    BadMessage {
        /// The file.
        path: PathBuf,
        /// Name of the topic.
        topic: String,
        /// Time of the recording, ns since the epoch.
        log_time: u64,
        /// Description of the fault.
        why: String,
    },
    /// The folder exists; a bag is never overwritten.
    #[error("{file}: is already there; a bag is never overwritten, choose another name", file = .0.display())]
    Exists(PathBuf),
    /// The path cannot be the name of a bag.
    #[error("{file}: cannot be the name of a bag, a plain folder name is needed", file = .0.display())]
    Name(PathBuf),
    /// One topic has two types.
    #[error("topic '{topic}' is already {known}, cannot also be {given}")]
    TypeConflict {
        /// Name of the topic.
        topic: String,
        /// Its type in this bag.
        known: String,
        /// The other type.
        given: String,
    },
    /// The topic number was made by another bag. The second field is the number of topics of this bag.
    #[error("topic number {0} is not of this bag, it has {1}")]
    UnknownTopic(usize, usize),
    /// The MCAP file could not be written.
    #[error("{file}: {1}", file = .0.display())]
    Write(PathBuf, #[source] mcap::McapError),
}

impl BagError {
    /// Returns the error of a damaged MCAP file.
    pub(super) fn damaged(path: &Path, why: impl std::fmt::Display) -> Self {
        Self::Damaged(path.to_owned(), why.to_string(), "`modulo bag recover` may save the rest")
    }
}

/// Something that is missing in a bag that can still be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BagWarning {
    /// The folder has no `metadata.yaml`: its recorder was stopped before it wrote one.
    #[error("{file}: no metadata.yaml, all files are read by their start time", file = .0.display())]
    NoMetadata(PathBuf),
    /// The file is not a readable `metadata.yaml`.
    #[error("{file}: {1}; all files of its folder are read by their start time", file = .0.display())]
    BadMetadata(PathBuf, String),
    /// The file is complete, but has no index.
    #[error("{file}: no index, the whole file was scanned", file = .0.display())]
    NoIndex(PathBuf),
    /// The file ends too early; everything up to the last complete chunk is read.
    #[error("{}: cut at byte {byte} ({why}); {messages} messages before it are read", path.display())]
    Truncated {
        /// The file.
        path: PathBuf,
        /// End of the last complete record.
        byte: u64,
        /// The error of the reader at this byte.
        why: String,
        /// Number of messages before this byte.
        messages: u64,
    },
    /// A record had to be skipped.
    #[error("{}: record at byte {byte} is skipped: {why}", path.display())]
    Skipped {
        /// The file.
        path: PathBuf,
        /// Start of the record.
        byte: u64,
        /// Description of the fault.
        why: String,
    },
    /// Messages of a topic are left out.
    #[error("{}: {messages} messages of topic '{topic}' are left out: {why}", path.display())]
    LeftOut {
        /// The file.
        path: PathBuf,
        /// Name of the topic.
        topic: String,
        /// Number of the messages.
        messages: u64,
        /// Description of their fault, or of the fault of the first one.
        why: String,
    },
    /// The type of a topic is defined neither by the bag nor by the suite.
    #[error("{}: topic '{topic}': the bag does not define {type_name}, nor does this suite", path.display())]
    NoDefinition {
        /// The file.
        path: PathBuf,
        /// Name of the topic.
        topic: String,
        /// Name of its type.
        type_name: String,
    },
}

impl BagWarning {
    /// Returns whether recorded messages cannot be read.
    pub fn is_loss(&self) -> bool {
        matches!(self, Self::Truncated { .. } | Self::Skipped { .. } | Self::LeftOut { .. })
    }
}
