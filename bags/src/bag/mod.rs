//! Bags: MCAP read, written and repaired; rosbag2's SQLite read.
//!
//! Payloads pass through unchanged. A damaged bag is read as far as possible, and each loss is reported by a
//! [`BagWarning`].

mod bag_file;
mod chunk;
mod definition;
mod extra;
mod mcap_file;
mod metadata;
pub mod qos;
mod reader;
mod scan;
#[cfg(feature = "sqlite")]
mod sqlite;
mod storage;
mod writer;

use std::collections::BTreeMap;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use modulo_images::open_regular;
use modulo_runtime::Qos;
use modulo_runtime::output::OutputError;

use crate::FileError;
pub use bag_file::Compression;
pub use extra::{Extra, ExtraKind};
pub use reader::{BagInfo, BagReader};
use storage::Storage;
pub use storage::{Merge as Messages, Selection};
pub use writer::{BagWriter, Copied, TopicId, WriteOptions, copy};

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
    /// What a recorder has noted of it beside that.
    pub metadata: BTreeMap<String, String>,
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
            metadata: BTreeMap::new(),
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

fn open(path: &Path) -> Result<Arc<dyn Storage>, BagError> {
    let mut start = Vec::new();
    let file = open_regular(path).map_err(|e| FileError::new(path, e))?;
    // The longest of the signatures, that of SQLite, has 16 bytes.
    file.take(16).read_to_end(&mut start).map_err(|e| FileError::new(path, e))?;
    Ok(if start.starts_with(b"SQLite format 3\0") {
        #[cfg(feature = "sqlite")]
        return Ok(Arc::new(sqlite::SqliteFile::open(path)?));
        #[cfg(not(feature = "sqlite"))]
        return Err(BagError::File(path.to_owned(), NO_SQLITE.to_owned()));
    } else if start.starts_with(b"#ROSBAG V") {
        let why = "this is a ROS 1 bag, of which `rosbags-convert --src";
        let remedy =
            "--dst FOLDER` (from the Python package `rosbags`) makes a ROS 2 bag that can be read here";
        return Err(BagError::File(path.to_owned(), format!("{why} {} {remedy}", path.display())));
    } else if start.starts_with(&ZSTD) {
        let why = format!("is compressed as a whole; unpack it with `zstd -d {}`", path.display());
        return Err(BagError::File(path.to_owned(), why));
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

#[cfg(not(feature = "sqlite"))]
const NO_SQLITE: &str = "this build does not read bags of SQLite; `modulo bag convert FILE FOLDER` of a build with the feature `sqlite` \
                         makes a bag of MCAP, which can be read here";

/// Error: a bag cannot be read or written.
#[derive(Debug, thiserror::Error)]
pub enum BagError {
    /// The system does not read or write a file.
    #[error(transparent)]
    Io(#[from] FileError),
    /// The file or the folder is no bag of a form that is read, or cannot be written. The text says why, with a remedy.
    #[error("{file}: {1}", file = .0.display())]
    File(PathBuf, String),
    /// The file is not a readable `metadata.yaml`.
    #[error("{file}: {1}", file = .0.display())]
    Metadata(PathBuf, String),
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
    /// One topic has two types: its name, its type in this bag and the other type.
    #[error("topic '{0}' is already {1}, cannot also be {2}")]
    TypeConflict(String, String, String),
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
}

/// Something that is missing in a bag that can still be read.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BagWarning {
    /// No message is lost: metadata or an index is missing or wrong, or a type has no definition or another hash.
    #[error("{file}: {1}", file = .0.display())]
    Remark(PathBuf, String),
    /// A file of the bag is left out, for the reason of the text.
    #[error("{0}; the other files of the bag are read")]
    Part(String),
    /// A part of the file cannot be read, or may be damaged where nobody knows it.
    #[error("{file}: {1}", file = .0.display())]
    Damage(PathBuf, String),
    /// Messages are left out.
    #[error(transparent)]
    LeftOut(#[from] LeftOut),
}

impl BagWarning {
    /// Returns the warning of a record at `byte` that had to be skipped.
    fn skipped(path: &Path, byte: u64, why: &str) -> Self {
        Self::Damage(path.to_owned(), format!("record at byte {byte} is skipped: {why}"))
    }

    /// Returns the warning of a file that has changed since it was written.
    fn contradiction(path: &Path, why: &str) -> Self {
        Self::Damage(path.to_owned(), format!("{why}; any of its messages may be damaged or missing"))
    }

    /// Returns the warning of a file that ends too early, behind `messages` complete messages.
    fn truncated(path: &Path, byte: u64, why: &str, messages: u64) -> Self {
        let rest = format!("or still being recorded; {messages} messages before it are read");
        Self::Damage(path.to_owned(), format!("cut at byte {byte} ({why}), {rest}"))
    }

    /// Returns whether recorded messages cannot be read.
    pub fn is_loss(&self) -> bool {
        !matches!(self, Self::Remark(..))
    }

    /// Returns whether recorded messages cannot be read, of which nobody knows that they are all of one topic.
    pub fn is_loss_of_any_topic(&self) -> bool {
        self.is_loss() && !matches!(self, Self::LeftOut(left_out) if left_out.place.starts_with(TOPIC))
    }
}
