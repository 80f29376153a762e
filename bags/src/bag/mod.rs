//! Bags: MCAP read, written and repaired; rosbag2's SQLite and ROS 1 read.
//!
//! CDR payloads pass through unchanged; ROS 1 payloads, which are not CDR, are re-encoded. A damaged bag is read as far
//! as possible, and each loss is reported by a [`BagWarning`].

mod bag_file;
mod error;
mod mcap_file;
mod metadata;
pub mod qos;
mod reader;
mod ros1;
mod scan;
mod sqlite;
mod storage;
mod writer;

use std::path::Path;
use std::sync::Arc;

use modulo_runtime::Qos;

pub use error::{BagError, BagWarning};
pub use reader::{BagInfo, BagReader, Messages, Selection};
pub use writer::{BagWriter, Compression, Copied, Split, TopicId, WriteOptions, copy};

/// A topic of a bag, from its channel and its schema.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct BagTopic {
    /// Name of the topic, such as `/camera/image_raw`.
    pub name: String,
    /// Name of the type, such as `sensor_msgs/msg/Image`.
    pub type_name: String,
    /// `RIHS01_` and 64 hexadecimal digits, as recorded or by the definition; empty without either.
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

/// Returns the recorded hash of a type, or the hash of its definition when the bag records no hash.
fn type_hash(recorded: String, type_name: &str, schema: &[u8]) -> String {
    if recorded.starts_with("RIHS") {
        return recorded;
    }
    modulo_msgs::type_hash_of_schema(type_name, &String::from_utf8_lossy(schema)).unwrap_or_default()
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

/// Returns whether `path` is a bag: a `.mcap`, `.db3` or `.bag` file, or a folder with `metadata.yaml` or with such
/// files.
pub fn is_bag(path: &Path) -> bool {
    if path.is_dir() {
        return path.join(metadata::FILE_NAME).is_file()
            || storage::files_in(path).is_ok_and(|files| !files.is_empty());
    }
    storage::is_storage(path)
}
