//! `metadata.yaml` of a rosbag2 folder, version 9.
//!
//! The files take precedence: reading a bag takes only the list of its files and their form from here.

use std::collections::BTreeMap;
use std::path::Path;

use modulo_runtime::input::read_text;
use modulo_runtime::parameter::yaml_text::of_string as quoted;
use modulo_runtime::yaml::{self, Content, Item};

use super::{BagError, TopicCount, qos};
use crate::{FileError, stays_inside};

pub(super) const FILE_NAME: &str = "metadata.yaml";

/// No more of the file is read, bytes.
const LONGEST: u64 = 64 << 20;

/// Key of the mapping that holds all of the metadata.
const ROOT: &str = "rosbag2_bagfile_information";

/// Interface definitions and their hashes are those of this distribution.
const ROS_DISTRO: &str = "jazzy";

#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Metadata {
    pub(super) storage_identifier: String,
    pub(super) relative_file_paths: Vec<String>,
    pub(super) compression_mode: String,
    pub(super) compression_format: String,
    pub(super) message_count: Option<u64>,
    pub(super) ros_distro: Option<String>,
    pub(super) custom_data: CustomData,
}

/// What a user has noted of the recording, by its keys.
pub(super) type CustomData = BTreeMap<String, String>;

#[derive(Clone, Debug)]
pub(super) struct FileContents {
    pub(super) name: String,
    /// First and last log time; `None` for an empty file.
    pub(super) span: Option<(u64, u64)>,
    pub(super) messages: u64,
}

/// Reads a `metadata.yaml` of any version and checks that its files are of a form that is read here. What the files are, their
/// first bytes tell.
pub(super) fn read(path: &Path) -> Result<Metadata, BagError> {
    let text = read_text(path, LONGEST).map_err(|e| match e.kind() {
        std::io::ErrorKind::InvalidData => BagError::Metadata(path.to_owned(), e.to_string()),
        _ => FileError::new(path, e).into(),
    })?;
    let metadata = parse(&text).map_err(|why| BagError::Metadata(path.to_owned(), why))?;
    let refuse = |what, found: &str, possible| {
        let why = format!("{what} '{found}' is not supported, possible is {possible}");
        Err(BagError::File(path.to_owned(), why))
    };
    let is_by_message = metadata.compression_mode.eq_ignore_ascii_case("message");
    if is_by_message && !["", "zstd"].contains(&&*metadata.compression_format) {
        return refuse("compression_format of messages", &metadata.compression_format, "zstd");
    }
    if let Some(outside) = metadata.relative_file_paths.iter().find(|name| !stays_inside(Path::new(name))) {
        return refuse(
            "relative_file_paths",
            outside,
            "a path inside the folder of the bag, relative and without '..'; without metadata.yaml all files of \
             the folder are read",
        );
    }
    Ok(metadata)
}

fn parse(text: &str) -> Result<Metadata, String> {
    let file = yaml::read(text).map_err(|why| why.to_string())?;
    let root = file
        .entry(ROOT)
        .ok_or_else(|| format!("no value of '{ROOT}' at the top of the file, where it is needed"))?;
    let word = |key: &str| match root.entry(key) {
        None => Ok(None),
        Some(value) => value
            .text()
            .map(|text| Some(text.to_owned()))
            .ok_or_else(|| format!("{ROOT}.{key} is a list or a mapping, a word is needed")),
    };
    let files = root.entry("relative_file_paths").and_then(|files| match &files.content {
        Content::List(files) => files.iter().map(Item::text).collect::<Option<Vec<_>>>(),
        _ => None,
    });
    let files = files
        .ok_or_else(|| format!("{ROOT}.relative_file_paths is no list of file names, which is needed"))?;
    Ok(Metadata {
        storage_identifier: word("storage_identifier")?.unwrap_or_default(),
        relative_file_paths: files.into_iter().map(str::to_owned).collect(),
        compression_mode: word("compression_mode")?.unwrap_or_default(),
        compression_format: word("compression_format")?.unwrap_or_default(),
        message_count: word("message_count")?.and_then(|count| count.parse().ok()),
        ros_distro: word("ros_distro")?,
        custom_data: root.entry("custom_data").map_or_else(CustomData::new, custom_data),
    })
}

/// Returns the texts of a mapping.
fn custom_data(item: &Item) -> CustomData {
    let Content::Map(pairs) = &item.content else { return CustomData::new() };
    pairs.iter().filter_map(|(key, value)| Some((key.name.clone(), value.text()?.to_owned()))).collect()
}

pub(super) fn document(files: &[FileContents], topics: &[TopicCount], custom: &CustomData) -> String {
    format!("{ROOT}:\n{}", indented(&mapping(files, topics, custom), 2))
}

/// Returns the metadata without its root, as the MCAP metadata record holds it.
pub(super) fn mapping(files: &[FileContents], topics: &[TopicCount], custom: &CustomData) -> String {
    // A file without messages has no times, and must not move the start of the bag to 0.
    let spans = files.iter().filter_map(|file| file.span);
    let (start, end) = spans.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).unwrap_or_default();
    let messages: u64 = files.iter().map(|file| file.messages).sum();
    let paths: String = files.iter().map(|file| format!("  - {}\n", quoted(&file.name))).collect();
    let files: String = files.iter().map(file).collect();
    let topics: String = topics.iter().map(topic).collect();
    // A key without a value is null in YAML, which rosbag2 does not read as a list.
    let list = if topics.is_empty() { " []\n" } else { "\n" };
    let custom: String =
        custom.iter().map(|(key, value)| format!("\n  {}: {}", quoted(key), quoted(value))).collect();
    let custom = if custom.is_empty() { " ~".to_owned() } else { custom };
    format!(
        "version: 9\nstorage_identifier: mcap\nduration:\n  nanoseconds: {}\nstarting_time:\n  \
         nanoseconds_since_epoch: {start}\nmessage_count: {messages}\ntopics_with_message_count:{list}{topics}\
         compression_format: \"\"\ncompression_mode: \"\"\nrelative_file_paths:\n{paths}files:\n{files}\
         custom_data:{custom}\nros_distro: {ROS_DISTRO}\n",
        end - start
    )
}

fn file(file: &FileContents) -> String {
    let (start, end) = file.span.unwrap_or_default();
    format!(
        "  - path: {}\n    starting_time:\n      nanoseconds_since_epoch: {start}\n    duration:\n      \
         nanoseconds: {}\n    message_count: {}\n",
        quoted(&file.name),
        end - start,
        file.messages
    )
}

fn topic(counted: &TopicCount) -> String {
    let topic = &counted.topic;
    // The policies stand here as YAML itself, where older versions have a string with YAML in it.
    let profiles = qos::in_words(&topic.qos);
    let list = if profiles.trim().is_empty() { " []\n" } else { "\n" };
    format!(
        "  - topic_metadata:\n      name: {}\n      type: {}\n      serialization_format: cdr\n      \
         offered_qos_profiles:{list}{}      type_description_hash: {}\n    message_count: {}\n",
        quoted(&topic.name),
        quoted(&topic.type_name),
        indented(&profiles, 8),
        quoted(&topic.type_hash),
        counted.messages
    )
}

fn indented(text: &str, columns: usize) -> String {
    let lines = text.lines().filter(|line| !line.trim().is_empty());
    lines.map(|line| format!("{:columns$}{line}\n", "")).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use modulo_runtime::Qos;

    use super::super::BagTopic;
    use super::*;

    fn text_of(topics: &[TopicCount]) -> String {
        let name = "a \"b\"_0.mcap".to_owned();
        document(&[FileContents { name, span: Some((5, 9)), messages: 4 }], topics, &CustomData::new())
    }

    #[test]
    fn what_is_written_is_read() {
        let topic = BagTopic {
            name: "/a: b".into(),
            type_name: "std_msgs/msg/String".into(),
            qos: qos::yaml(Qos::Images),
            ..BagTopic::default()
        };
        let bare = BagTopic { name: "/c".into(), ..BagTopic::default() };
        let counted = [topic, bare].map(|topic| TopicCount { topic: Arc::new(topic), messages: 2 });
        for topics in [&counted[..], &[]] {
            let text = text_of(topics);
            let metadata = parse(&text).unwrap_or_else(|e| panic!("{e}\n{text}"));
            assert_eq!(metadata.relative_file_paths, ["a \"b\"_0.mcap"]);
            assert_eq!(metadata.storage_identifier, "mcap");
            assert_eq!(metadata.ros_distro.as_deref(), Some(ROS_DISTRO));
        }
    }

    #[test]
    fn a_fault_of_the_text_names_what_is_needed() {
        let document = |rest: &str| format!("{ROOT}:\n  {rest}\n");
        for (text, expected) in [
            (String::new(), ROOT),
            ("a: 1".to_owned(), ROOT),
            (document("storage_identifier: mcap"), "relative_file_paths is no list of file names"),
            (
                document("{storage_identifier: mcap, relative_file_paths: [[a]]}"),
                "relative_file_paths is no list",
            ),
            (document("{storage_identifier: [], relative_file_paths: [a]}"), "storage_identifier is a list"),
            (document("storage_identifier: 'mcap"), "line "),
            ("[".repeat(100_000), "line "),
            ("- ".repeat(100_000), "line 1: a nesting deeper than 64"),
            ("a: ".to_owned() + &"{a: ".repeat(100_000), "line "),
        ] {
            let why = parse(&text).expect_err(expected);
            assert!(why.contains(expected), "{why}");
        }
    }

    #[test]
    fn what_is_not_read_is_refused_by_name() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join(FILE_NAME);
        let none = "compression_format: \"\"\n  compression_mode: \"\"";
        let text = text_of(&[]);
        assert!(text.contains(none));
        let lz4 = text.replace(none, "compression_format: lz4\n  compression_mode: MESSAGE");
        std::fs::write(&path, lz4).expect("written");
        let error = read(&path).expect_err("lz4").to_string();
        assert!(error.contains("lz4") && error.contains("zstd"), "{error}");
    }
}
