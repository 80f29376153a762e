//! rosbag2's SQLite storage, made here with the tables of each of its versions.

use std::path::Path;

use modulo_bags::bag::{BagReader, BagWarning, Compression, Selection, copy};
use modulo_bags::source::{SourceOptions, open};
use modulo_msgs::image::encode_frame;
use modulo_msgs::std_msgs::Header;
use proptest::prelude::*;
use rusqlite::Connection;

use crate::{frame, read_all, temporary};

const QOS: &str = "- history: 1\n  depth: 7\n  reliability: 2\n  durability: 2\n";
const STRING: &str = "std_msgs/msg/String";
const UNKNOWN: &str = "nobody_msgs/msg/Knows";

/// Columns that the table of topics has from which version on.
fn columns(version: u32) -> String {
    let mut columns = "id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT".to_owned();
    if version >= 2 {
        columns += ", offered_qos_profiles TEXT";
    }
    if version >= 4 {
        columns += ", type_description_hash TEXT";
    }
    columns
}

/// A file with 20 messages of each topic, 3 ms apart.
pub fn write(path: &Path, version: u32, topics: &[(&str, &str, &str)], payload: &[u8]) {
    let file = Connection::open(path).expect("a new file");
    let tables = format!(
        "CREATE TABLE topics({});
         CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB);
         CREATE INDEX timestamp_idx ON messages (timestamp ASC);",
        columns(version)
    );
    file.execute_batch(&tables).expect("tables");
    if version >= 4 {
        let table = "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT, encoding TEXT,
                     encoded_message_definition TEXT, type_description_hash TEXT);
                     INSERT INTO message_definitions VALUES(1, 'nobody_msgs/msg/Knows', 'ros2msg', 'int8 a', '')";
        file.execute_batch(table).expect("a table");
    }
    for (id, (name, kind, format)) in (1..).zip(topics) {
        let more = [QOS, "RIHS01_1234"];
        let more = more.iter().take(if version >= 4 { 2 } else { usize::from(version >= 2) });
        let values: String = more.map(|text| format!(", '{text}'")).collect();
        let row = format!("INSERT INTO topics VALUES({id}, '{name}', '{kind}', '{format}'{values})");
        file.execute(&row, []).expect("a topic");
        for i in (0..20_i64).rev() {
            let row = (id, 1_000_000_000 + 3_000_000 * i + i64::from(id), payload);
            file.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES(?1, ?2, ?3)", row)
                .expect("a row");
        }
    }
}

#[test]
fn every_version_is_read() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let topics = [("/a", STRING, "cdr"), ("/b", UNKNOWN, "cdr"), ("/c", STRING, "other")];
    for version in 1..=4 {
        let path = folder.path().join(format!("{version}.db3"));
        write(&path, version, &topics, &[0, 1, 0, 0, 5]);
        let bag = BagReader::open(&path).expect("a bag");
        let read = read_all(&bag, &Selection::default());
        assert_eq!(read.len(), 40);
        assert!(read.is_sorted_by_key(|m| m.log_time));
        assert!(read.iter().all(|m| m.data == [0, 1, 0, 0, 5] && m.publish_time == m.log_time));
        assert_eq!(bag.span(), Some((1_000_000_001, 1_057_000_003)));
        let known = bag.topics();
        assert_eq!(
            known.iter().map(|t| (t.topic.name.as_str(), t.messages)).collect::<Vec<_>>(),
            [("/a", 20), ("/b", 20)]
        );
        let [a, b] = [&known[0].topic, &known[1].topic];
        assert_eq!(a.qos, if version >= 2 { QOS } else { "" });
        assert_eq!(a.schema, modulo_msgs::ros2msg(STRING).expect("known").into_bytes());
        let hash = modulo_msgs::type_hash(STRING).expect("known");
        // The one that version 4 records here is none.
        assert_eq!(a.type_hash, hash);
        assert_eq!(b.schema, if version >= 4 { "int8 a" } else { "" }.as_bytes());
        let warns = |f: fn(&BagWarning) -> bool| bag.warnings().iter().filter(|w| f(w)).count();
        assert_eq!(warns(|w| w.to_string().contains("does not define")), usize::from(version < 4));
        assert_eq!(warns(|w| matches!(w, BagWarning::LeftOut(left) if left.messages == Some(20))), 1);

        let some = Selection { topics: Some(vec!["/b".into()]), start_ns: Some(1_030_000_003) };
        assert_eq!(read_all(&bag, &some).len(), 9);
        assert!(read_all(&bag, &Selection::of(["/c"])).is_empty());
    }
}

#[test]
fn it_is_converted_payload_by_payload() {
    let (folder, path) = temporary("old.db3");
    write(&path, 4, &[("/a", STRING, "cdr"), ("/b", UNKNOWN, "cdr")], &[0, 1, 0, 0, 9, 9]);
    let old = BagReader::open(&path).expect("a bag");
    let out = folder.path().join("new");
    let copied = copy(&old, &out, Compression::Zstd).expect("copied");
    assert!(copied.broke.is_none());
    let new = BagReader::open(&out).expect("a bag");
    let comparable = |bag: &BagReader| -> Vec<_> {
        let all = read_all(bag, &Selection::default()).into_iter();
        all.map(|m| {
            (m.log_time, m.topic.name.clone(), m.topic.type_hash.clone(), m.topic.schema.clone(), m.data)
        })
        .collect()
    };
    assert_eq!(comparable(&new), comparable(&old));
    assert!(
        new.topics()[0].topic.qos.contains("reliability: best_effort"),
        "numbers are words from version 9 on"
    );
}

#[test]
fn its_images_are_a_source() {
    let (_folder, path) = temporary("images.db3");
    let image = encode_frame(&Header::default(), &frame(5)).expect("short");
    write(&path, 2, &[("/image", "sensor_msgs/msg/Image", "cdr")], &image);
    let mut source = open(&path.display().to_string(), &SourceOptions::default()).expect("a source");
    assert_eq!(source.len, Some(20));
    let first = source.next().expect("a frame").expect("whole");
    assert_eq!(first.radiance.mapv(|v| (v * 255.0).round()), frame(5).to_f32());
}

#[test]
fn another_database_is_refused_by_name() {
    let (_folder, path) = temporary("other.db3");
    Connection::open(&path).and_then(|file| file.execute_batch("CREATE TABLE t(a)")).expect("a file");
    let error = BagReader::open(&path).expect_err("no bag").to_string();
    assert!(error.contains("other.db3") && error.contains("messages"), "{error}");
}

/// Each message is compressed on its own (`compression_mode: message`), whatever says so or does not.
#[test]
fn compressed_messages_are_unpacked() {
    let (folder, path) = temporary("packed.db3");
    let payload = [&[0, 1, 0, 0][..], &[5; 900]].concat();
    let packed = zstd::encode_all(&payload[..], 0).expect("packed");
    write(&path, 4, &[("/a", STRING, "cdr")], &packed);
    let bag = BagReader::open(&path).expect("a bag");
    assert!(read_all(&bag, &Selection::default()).iter().all(|m| m.data == payload));
    // The compression breaks off: nothing of it is passed on.
    let broken = folder.path().join("broken.db3");
    write(&broken, 4, &[("/a", STRING, "cdr")], &packed[..packed.len() - 3]);
    let out = folder.path().join("out");
    let copied = copy(&BagReader::open(&broken).expect("a bag"), &out, Compression::None).expect("copied");
    let [expected] = &copied.left_out[..] else { panic!("{:?}", copied.left_out) };
    assert!(
        expected.to_string().contains("20 messages of topic '/a'") && expected.to_string().contains("zstd"),
        "{expected}"
    );
    assert_eq!(BagReader::open(&out).expect("a bag").message_count(), 0);
}

#[test]
fn what_is_no_cdr_is_left_out_and_counted() {
    let (_folder, path) = temporary("odd.db3");
    write(&path, 4, &[("/a", STRING, "cdr")], &[0, 1, 0, 0, 5]);
    let change =
        "UPDATE messages SET data = NULL WHERE id = 3; UPDATE messages SET data = x'0422' WHERE id = 4;
                  UPDATE messages SET topic_id = 7 WHERE id = 5";
    Connection::open(&path).and_then(|file| file.execute_batch(change)).expect("changed");
    let bag = BagReader::open(&path).expect("a bag");
    let expected: String = bag.warnings().iter().map(ToString::to_string).collect();
    assert!(expected.contains("1 messages of topic number 7"), "{expected}");
    let (good, bad): (Vec<_>, Vec<_>) = bag.messages(&Selection::default()).partition(Result::is_ok);
    assert_eq!((good.len(), bad.len()), (17, 2));
}

/// The time of a message is in the table and in its index; where they differ, nobody knows which is right.
#[test]
fn a_time_that_was_changed_is_told() {
    let (_folder, path) = temporary("time.db3");
    write(&path, 4, &[("/a", STRING, "cdr")], &[0, 1, 0, 0, 5]);
    let whole = std::fs::read(&path).expect("readable");
    let stored = 1_015_000_001_i32.to_be_bytes();
    let places: Vec<_> = (0..whole.len()).filter(|&at| whole[at..].starts_with(&stored)).collect();
    assert_eq!(places.len(), 2, "the table and the index");
    for place in places {
        let mut changed = whole.clone();
        changed[place + 3] ^= 1;
        std::fs::write(&path, changed).expect("written");
        let bag = BagReader::open(&path).expect("a bag");
        let [expected] = bag.warnings() else { panic!("{:?}", bag.warnings()) };
        assert!(expected.to_string().contains("may be damaged or missing"), "{expected}");
        assert!(expected.is_loss() && expected.to_string().contains("times"), "{expected}");
    }
}

#[test]
fn a_file_that_was_cut_is_read_up_to_the_cut() {
    let (folder, path) = temporary("whole.db3");
    let payload = [&[0, 1, 0, 0][..], &[5; 5000]].concat();
    write(&path, 4, &[("/a", STRING, "cdr")], &payload);
    let whole = std::fs::read(&path).expect("readable");
    let cut = folder.path().join("cut.db3");
    std::fs::write(&cut, &whole[..whole.len() * 2 / 3]).expect("written");
    let bag = BagReader::open(&cut).expect("a bag");
    let expected = bag.warnings()[0].to_string();
    let place = format!("cut at byte {}", whole.len() * 2 / 3);
    assert!(bag.warnings()[0].is_loss() && expected.contains(&place), "{expected}");
    let good = bag.messages(&Selection::default()).flatten().filter(|m| m.data == payload).count();
    assert!((8..20).contains(&good), "{good} of 20 messages");
}

/// The journal beside the file takes back what was half written; a reader that may not write cannot do it.
#[test]
fn a_hot_journal_names_the_remedy() {
    let (folder, path) = temporary("live.db3");
    write(&path, 4, &[("/a", STRING, "cdr")], &[0, 1, 0, 0, 5]);
    let writer = Connection::open(&path).expect("a file");
    let half =
        "PRAGMA cache_size = 1; PRAGMA cache_spill = 1; BEGIN; UPDATE messages SET data = zeroblob(9000)";
    writer.execute_batch(half).expect("a half");
    let copied = folder.path().join("copy.db3");
    for end in ["", "-journal"] {
        let from = format!("{}{end}", path.display());
        std::fs::copy(from, format!("{}{end}", copied.display())).expect("copied");
    }
    let why = BagReader::open(&copied).expect_err("half a transaction").to_string();
    assert!(why.contains("-journal") && why.contains("folder that can be written"), "{why}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn wrong_bytes_never_panic(
        cut in any::<prop::sample::Index>(),
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..8),
    ) {
        let (_folder, path) = temporary("wrong.db3");
        static WHOLE: std::sync::LazyLock<Vec<u8>> = std::sync::LazyLock::new(|| {
            let (_folder, path) = temporary("whole.db3");
            write(&path, 4, &[("/a", STRING, "cdr")], &[0; 600]);
            std::fs::read(path).expect("readable")
        });
        let mut bytes = WHOLE.clone();
        if changes.len() % 3 == 0 {
            bytes.truncate(cut.index(bytes.len()));
        }
        for (at, value) in changes {
            if !bytes.is_empty() {
                let at = at.index(bytes.len());
                bytes[at] = value;
            }
        }
        std::fs::write(&path, &bytes).expect("written");
        if let Ok(bag) = BagReader::open(&path) {
            prop_assert!(bag.messages(&Selection::default()).count() <= 1000);
        }
    }
}
