//! Bags: MCAP read, written and repaired; rosbag2's SQLite and ROS 1 read.
//!
//! Payloads pass through as they are, CDR with its encapsulation; only those of
//! ROS 1, which are none, are written anew. A damaged bag is read as far as it goes and what is lost is
//! said in a [`BagWarning`], never in silence.

mod bag_file;
mod copy;
mod error;
mod info;
mod mcap_file;
mod merge;
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

pub use copy::{Copied, copy};
pub use error::{BagError, BagWarning};
pub use info::BagInfo;
pub use reader::{BagReader, Messages, Selection};
pub use writer::{BagWriter, Compression, Split, TopicId, WriteOptions};

/// A topic of a bag: what its channel and its schema say.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct BagTopic {
    /// Such as `/camera/image_raw`.
    pub name: String,
    /// Such as `sensor_msgs/msg/Image`.
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
    /// A topic of this process: hash and definition where the suite has them.
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

/// The hash of a type, by its definition where the recorder wrote down none.
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
    /// Messages.
    pub messages: u64,
}

/// One message of a bag.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RawMessage {
    /// Where it belongs.
    pub topic: Arc<BagTopic>,
    /// When it was recorded, ns since the epoch.
    pub log_time: u64,
    /// When it was sent, ns since the epoch.
    pub publish_time: u64,
    /// CDR with its 4-byte encapsulation.
    pub data: Vec<u8>,
}

/// Whether `path` is a bag: a `.mcap`, `.db3` or `.bag` file, or a folder with
/// `metadata.yaml` or with such files.
pub fn is_bag(path: &Path) -> bool {
    if path.is_dir() {
        return path.join(metadata::FILE_NAME).is_file()
            || storage::files_in(path).is_ok_and(|files| !files.is_empty());
    }
    storage::is_storage(path)
}
