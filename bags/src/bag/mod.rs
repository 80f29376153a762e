//! Bags: MCAP read, written and repaired; rosbag2's SQLite read.
//!
//! Payloads pass through unchanged. A damaged bag is read as far as possible, and each loss is reported by a
//! [`BagWarning`].

mod bag_file;
mod chunk;
mod definition;
mod mcap_file;
mod metadata;
pub mod qos;
mod reader;
mod scan;
#[cfg(feature = "sqlite")]
mod sqlite;
mod storage;
mod writer;

use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use modulo_images::open_regular;
use modulo_runtime::Qos;
use modulo_runtime::output::OutputError;

use crate::FileError;
pub use bag_file::Compression;
pub use reader::{BagInfo, BagReader, Messages};
pub use storage::Selection;
use storage::Storage;
pub use writer::{BagWriter, Copied, Split, TopicId, WriteOptions, copy};

/// A topic of a bag, from its channel and its schema.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct BagTopic {
    /// Name of the topic, such as `/camera/image_raw`.
    pub name: String,
    /// Name of the type, such as `sensor_msgs/msg/Image`.
    pub type_name: String,
    /// `RIHS01_` and 64 hexadecimal digits, by the definition, else as recorded, else of the suite; empty without any.
    pub type_hash: String,
    /// Offered quality of service, a YAML list as rosbag2 writes it; may be empty.
    pub qos: String,
    /// `ros2msg` or `ros2idl`; empty without a definition.
    pub schema_encoding: String,
    /// The message definition with all that it uses; may be empty.
    pub schema: Vec<u8>,
}

impl BagTopic {
    /// Creates a topic of this process: hash and definition where the suite has them.
    pub fn new(name: &str, type_name: &str, qos: Qos) -> Self {
        let schema = modulo_msgs::ros2msg(type_name).unwrap_or_default();
        Self {
            name: name.to_owned(),
            type_name: type_name.to_owned(),
            type_hash: modulo_msgs::type_hash(type_name).unwrap_or_default(),
            qos: qos::yaml(qos),
            schema_encoding: if schema.is_empty() { String::new() } else { "ros2msg".to_owned() },
            schema: schema.into_bytes(),
        }
    }
}

/// A topic and how many messages the bag has of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TopicCount {
    /// The topic.
    pub topic: Arc<BagTopic>,
    /// Number of messages.
    pub messages: u64,
}

/// One message of a bag.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RawMessage {
    /// Topic of the message.
    pub topic: Arc<BagTopic>,
    /// Time of the recording, ns since the epoch.
    pub log_time: u64,
    /// Time of the publication, ns since the epoch.
    pub publish_time: u64,
    /// CDR with its 4-byte encapsulation.
    pub data: Vec<u8>,
}

/// Returns whether `path` is to be opened as a bag: a `.mcap`, `.db3` or `.bag` file, or a folder with `metadata.yaml` or
/// with such files. Opening a `.bag` file of ROS 1, or a file that is compressed (`.mcap.zstd`), gives an error that names the
/// remedy.
pub fn is_bag(path: &Path) -> bool {
    if path.is_dir() {
        return path.join(metadata::FILE_NAME).is_file()
            || storage::files_in(path).is_ok_and(|files| !files.is_empty());
    }
    storage::is_storage(path)
}

/// Opens the file `path`.
fn open(path: &Path) -> Result<Arc<dyn Storage>, BagError> {
    let mut start = Vec::new();
    let file = open_regular(path).map_err(|e| FileError::new(path, e))?;
    // The longest of the signatures, that of SQLite, has 16 bytes.
    file.take(16).read_to_end(&mut start).map_err(|e| FileError::new(path, e))?;
    Ok(if start.starts_with(b"SQLite format 3\0") {
        open_sqlite(path)?
    } else if start.starts_with(b"#ROSBAG V") {
        return Err(BagError::Ros1(path.to_owned()));
    } else if start.starts_with(&ZSTD) {
        return Err(BagError::Compressed(path.to_owned()));
    } else {
        // Anything else is read as MCAP, whose reader names the error.
        Arc::new(mcap_file::McapFile::open(path)?)
    })
}

/// The first bytes of what zstd has compressed. CDR never begins so: its first byte is 0.
const ZSTD: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// Returns the payload of a message, which is compressed on its own in bags of the `compression_mode` message.
fn unpacked(payload: Vec<u8>) -> Result<Vec<u8>, String> {
    if !payload.starts_with(&ZSTD) {
        return Ok(payload);
    }
    let mut message = Vec::new();
    // A broken length must not decide how much memory is allocated.
    let most = chunk::MAX_CHUNK as u64;
    let read =
        zstd::Decoder::new(&payload[..]).and_then(|zstd| zstd.take(most + 1).read_to_end(&mut message));
    read.map_err(|why| format!("its zstd compression is broken: {why}"))?;
    if message.len() as u64 > most {
        return Err(format!("it has more than {most} bytes when it is unpacked"));
    }
    Ok(message)
}

#[cfg(feature = "sqlite")]
fn open_sqlite(path: &Path) -> Result<Arc<dyn Storage>, BagError> {
    Ok(Arc::new(sqlite::SqliteFile::open(path)?))
}

#[cfg(not(feature = "sqlite"))]
fn open_sqlite(path: &Path) -> Result<Arc<dyn Storage>, BagError> {
    let why = "this build does not read bags of SQLite; `modulo bag convert FILE FOLDER` of a build with the feature `sqlite` \
               makes a bag of MCAP, which can be read here";
    Err(BagError::Unsupported(path.to_owned(), why.to_owned()))
}

/// Error: a bag cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum BagError {
    /// The system does not read or write a file.
    #[error(transparent)]
    Io(#[from] FileError),
    /// The file is not a bag.
    #[error("{file}: not a bag, its first bytes are not those of MCAP or SQLite", file = .0.display())]
    NotBag(PathBuf),
    /// The folder contains no bag.
    #[error("{file}: no bag here, a metadata.yaml or a .mcap or .db3 file is needed", file = .0.display())]
    NoBag(PathBuf),
    /// The file is a bag of ROS 1.
    #[error(
        "{file}: this is a ROS 1 bag, of which `rosbags-convert --src {file} --dst FOLDER` (from the Python package \
         `rosbags`) makes a ROS 2 bag that can be read here", file = .0.display()
    )]
    Ros1(PathBuf),
    /// The whole file is compressed.
    #[error("{file}: is compressed as a whole; unpack it with `zstd -d {file}`", file = .0.display())]
    Compressed(PathBuf),
    /// The metadata file describes a bag of a form that is not supported.
    #[error("{file}: {1}", file = .0.display())]
    Unsupported(PathBuf, String),
    /// The file is not a readable `metadata.yaml`.
    #[error("{file}: {1}", file = .0.display())]
    Metadata(PathBuf, String),
    /// The file is damaged or was not closed. The last field names a remedy.
    #[error("{file}: {1}; {2}", file = .0.display())]
    Damaged(PathBuf, String, &'static str),
    /// Messages cannot be read; those after them can.
    #[error(transparent)]
    LeftOut(#[from] LeftOut),
    /// The folder of a new bag cannot be made.
    #[error(transparent)]
    Output(#[from] OutputError),
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
    /// Returns whether a new bag has no place: nothing was written then.
    pub fn is_without_place(&self) -> bool {
        matches!(self, Self::Output(_) | Self::Exists(_) | Self::Name(_))
    }
}

/// Messages of a bag that cannot be read, while those after them can.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}: {}messages of {place} are left out: {why}", path.display(), .messages.map_or(String::new(), |n| format!("{n} ")))]
pub struct LeftOut {
    /// The file.
    pub path: PathBuf,
    /// The topic of the messages, or the part of the file that holds them.
    pub place: String,
    /// Number of the messages; `None` when the damage hides it.
    pub messages: Option<u64>,
    /// Description of their fault, or of the fault of the first one.
    pub why: String,
}

/// The first word of a [`LeftOut::place`] that is a topic.
const TOPIC: &str = "topic";

impl LeftOut {
    fn of_topic(path: &Path, topic: &str, messages: u64, why: String) -> Self {
        Self { path: path.to_owned(), place: format!("{TOPIC} '{topic}'"), messages: Some(messages), why }
    }

    fn one(path: &Path, topic: &BagTopic, why: String) -> Self {
        Self::of_topic(path, &topic.name, 1, why)
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
    /// The file is complete, but has no index, or a damaged one.
    #[error("{file}: no index that is whole, the whole file was scanned", file = .0.display())]
    NoIndex(PathBuf),
    /// `metadata.yaml` and the files contradict each other, and the files are right.
    #[error("{file}: {1}", file = .0.display())]
    Metadata(PathBuf, String),
    /// A file of the bag is left out, for the reason of the text.
    #[error("{0}; the other files of the bag are read")]
    Part(String),
    /// The file has changed since it was written, and nobody knows which messages are damaged or missing.
    #[error("{file}: {1}; any of its messages may be damaged or missing", file = .0.display())]
    Contradiction(PathBuf, String),
    /// The file ends too early; everything up to the last complete chunk is read.
    #[error("{}: cut at byte {byte} ({why}), or still being recorded; {messages} messages before it are read", path.display())]
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
    /// Messages are left out.
    #[error(transparent)]
    LeftOut(#[from] LeftOut),
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
    /// The recorded hash of a type is not that of its definition.
    #[error(
        "{}: topic '{topic}': the type hash {recorded} is recorded, but its definition has {defined}, which is used",
        path.display()
    )]
    OtherHash {
        /// The file.
        path: PathBuf,
        /// Name of the topic.
        topic: String,
        /// The recorded hash.
        recorded: String,
        /// The hash of the definition.
        defined: String,
    },
}

impl BagWarning {
    /// Returns whether recorded messages cannot be read.
    pub fn is_loss(&self) -> bool {
        match self {
            Self::Truncated { .. }
            | Self::Skipped { .. }
            | Self::LeftOut(_)
            | Self::Part(_)
            | Self::Contradiction(..) => true,
            Self::NoMetadata(_) | Self::BadMetadata(..) | Self::NoIndex(_) | Self::Metadata(..) => false,
            Self::NoDefinition { .. } | Self::OtherHash { .. } => false,
        }
    }

    /// Returns whether recorded messages cannot be read, of which nobody knows that they are all of one topic.
    pub fn is_loss_of_any_topic(&self) -> bool {
        self.is_loss() && !matches!(self, Self::LeftOut(left_out) if left_out.place.starts_with(TOPIC))
    }
}
