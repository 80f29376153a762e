//! Files of bags that others wrote, or that a crash cut.

use std::path::Path;
use std::sync::LazyLock;

use modulo_bags::bag::{BagReader, BagTopic, BagWriter, Compression, RawMessage, Selection, copy};
use modulo_bags::source::{SourceOptions, open};
use modulo_runtime::Qos;

/// No input of a fuzzer holds more.
const MOST: usize = 2000;

/// A file of rosbag2's MCAP storage.
pub fn mcap(data: &[u8]) {
    file("a.mcap", data);
}

/// A file of rosbag2's SQLite storage; without its magic bytes it would be taken for MCAP.
pub fn sqlite(data: &[u8]) {
    file("a.db3", &[b"SQLite format 3\0", data].concat());
}

/// A spike recording.
pub fn spikes(data: &[u8]) {
    let folder = super::folder(&[("a.npz", data)]);
    frames(&folder.path().join("a.npz?window=2"));
}

/// A `metadata.yaml` beside a whole file, in a folder beside a foreign one: nothing outside the folder is read.
pub fn metadata(data: &[u8]) {
    static WHOLE: LazyLock<Vec<u8>> = LazyLock::new(whole);
    let folder =
        super::folder(&[("bag/metadata.yaml", data), ("bag/a.mcap", &WHOLE), ("foreign.mcap", &WHOLE)]);
    let bag = folder.path().join("bag");
    if let Ok(reader) = BagReader::open(&bag) {
        let own = bag.canonicalize().expect("it is there");
        for file in reader.files() {
            let file = file.canonicalize().expect("it was opened");
            assert!(file.starts_with(&own), "{} is outside the bag", file.display());
        }
    }
}

/// A whole MCAP file with two messages.
fn whole() -> Vec<u8> {
    let folder = super::folder(&[]);
    let bag = folder.path().join("bag");
    let mut writer = BagWriter::create(&bag, Compression::None).expect("a new bag");
    let topic = writer.topic(&BagTopic::new("/a", "std_msgs/msg/Header", Qos::Results)).expect("a topic");
    for time in [1, 2] {
        writer.write(topic, time, time, &[0, 1, 0, 0]).expect("writable");
    }
    writer.finish().expect("writable");
    std::fs::read(bag.join("bag_0.mcap")).expect("it is there")
}

/// Copies the messages that can be read in `data` into a new bag, and checks that none is missing there.
fn file(name: &str, data: &[u8]) {
    let folder = super::folder(&[(name, data)]);
    let path = folder.path().join(name);
    // A bag that breaks off, or has too many messages, cannot be compared with its copy.
    let bag = BagReader::open(&path).ok();
    if let Some((bag, read)) = bag.and_then(|bag| messages(&bag).map(|read| (bag, read))) {
        let out = folder.path().join("out");
        if copy(&bag, &out, Compression::None).is_ok() {
            let copied = BagReader::open(&out).expect("a copy is a bag");
            assert!(copied.warnings().iter().all(|w| !w.is_loss()), "{:?}", copied.warnings());
            assert_eq!(messages(&copied), Some(read));
        }
    }
    frames(&path);
}

/// Time, topic and payload of all messages by time; `None` where the bag breaks off, or has too many.
fn messages(bag: &BagReader) -> Option<Vec<(u64, String, Vec<u8>)>> {
    let tuple = |m: RawMessage| (m.log_time, m.topic.name.clone(), m.data);
    let read = bag.messages(&Selection::default()).take(MOST).map(|m| m.map(tuple));
    let mut read = read.collect::<Result<Vec<_>, _>>().ok()?;
    assert!(read.is_sorted_by_key(|(time, ..)| *time), "messages come by their time");
    read.sort();
    (read.len() < MOST).then_some(read)
}

/// The file as a source of images.
fn frames(path: &Path) {
    let Ok(mut source) = open(path.to_str().expect("UTF-8"), &SourceOptions::default()) else { return };
    for _ in 0..MOST {
        match source.next() {
            Some(Ok(frame)) => {
                assert!(frame.radiance.iter().all(|v| (0.0..1.0).contains(v)), "{}", frame.name)
            }
            Some(Err(_)) => {}
            None => return,
        }
    }
}
