//! Bags are read as they were written.

use modulo_bags::bag::{
    BagError, BagInfo, BagReader, BagTopic, BagWarning, BagWriter, Compression, RawMessage, Selection,
    TopicCount, copy,
};
use modulo_runtime::Qos;
use proptest::prelude::*;

use crate::{COMPRESSIONS, Line, read_all, temporary, topic, write_bag};

/// Several topics and chunks, times in any order.
fn lines() -> impl Strategy<Value = Vec<Line>> {
    let line = (0..3_usize, 0..5_000_000_000_u64, proptest::collection::vec(any::<u8>(), 0..64));
    proptest::collection::vec(line, 0..24)
}

fn comparable(messages: &[RawMessage]) -> Vec<(u64, String, Vec<u8>)> {
    let mut all: Vec<_> =
        messages.iter().map(|m| (m.log_time, m.topic.name.clone(), m.data.clone())).collect();
    all.sort();
    all
}

fn expected(lines: &[Line]) -> Vec<(u64, String, Vec<u8>)> {
    let mut all: Vec<_> = lines.iter().map(|(i, time, data)| (*time, topic(*i).name, data.clone())).collect();
    all.sort();
    all
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn messages_return_in_log_time_order(lines in lines(), from in 0..5_000_000_000_u64) {
        for compression in COMPRESSIONS {
            let (_folder, path) = temporary("bag");
            write_bag(&path, compression, &lines);
            let bag = BagReader::open(&path).expect("a bag");
            prop_assert!(bag.warnings().is_empty(), "{:?}", bag.warnings());
            prop_assert_eq!(bag.message_count(), lines.len() as u64);

            let all = read_all(&bag, &Selection::default());
            prop_assert!(all.is_sorted_by_key(|m| m.log_time));
            prop_assert!(all.iter().all(|m| m.publish_time == m.log_time.saturating_sub(7)));
            prop_assert!(all.iter().all(|m| (0..3).any(|i| *m.topic == topic(i))));
            prop_assert_eq!(comparable(&all), expected(&lines));

            let some = Selection { topics: Some(vec![topic(1).name, "/none".into()]), start_ns: Some(from) };
            let kept: Vec<_> = lines.iter().filter(|l| l.0 == 1 && l.1 >= from).cloned().collect();
            prop_assert_eq!(comparable(&read_all(&bag, &some)), expected(&kept));
            prop_assert!(read_all(&bag, &Selection::of(["/none"])).is_empty());
        }
    }
}

#[test]
fn the_same_messages_are_the_same_bytes() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let lines: Vec<Line> = (0..50).map(|i| (i % 2, i as u64 * 100_000_000, vec![i as u8; 500])).collect();
    for compression in COMPRESSIONS {
        let files = ["a", "b"].map(|parent| {
            let path = folder.path().join(format!("{compression:?}")).join(parent).join("bag");
            write_bag(&path, compression, &lines);
            let read = |name| std::fs::read(path.join(name)).expect("a file");
            [read("bag_0.mcap"), read("metadata.yaml")]
        });
        assert!(files[0] == files[1], "{compression:?}");
    }
}

#[test]
fn a_bag_is_never_overwritten() {
    let (_folder, path) = temporary("bag");
    write_bag(&path, Compression::None, &[(0, 1, vec![2])]);
    let again = BagWriter::create(&path, Compression::None);
    assert!(matches!(again, Err(BagError::Exists(_))));
    assert_eq!(BagReader::open(&path).expect("still whole").message_count(), 1);
}

#[test]
fn a_topic_has_one_type() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut bag = BagWriter::create(&folder.path().join("bag"), Compression::None).expect("new");
    let image = BagTopic::new("/a", "sensor_msgs/msg/Image", Qos::Images);
    let id = bag.topic(&image).expect("new");
    assert_eq!(bag.topic(&image).expect("known"), id);
    let text = BagTopic::new("/a", "std_msgs/msg/String", Qos::Images);
    let error = bag.topic(&text).expect_err("another type").to_string();
    assert!(error.contains("/a") && error.contains("Image") && error.contains("String"), "{error}");
}

/// A foreign recorder may write one topic with two types: the first stays, the second is counted.
#[test]
fn a_copy_leaves_out_the_second_type_of_a_topic() {
    let (folder, path) = temporary("two.mcap");
    let mut mcap = mcap::Writer::new(std::fs::File::create(&path).expect("a file")).expect("a writer");
    for (log_time, name) in
        [(1, "std_msgs/msg/String"), (2, "sensor_msgs/msg/Image"), (3, "std_msgs/msg/String")]
    {
        let schema = mcap.add_schema(name, "ros2msg", b"").expect("a schema");
        let channel_id = mcap.add_channel(schema, "/a", "cdr", &Default::default()).expect("a channel");
        let header = mcap::records::MessageHeader { channel_id, sequence: 0, log_time, publish_time: 0 };
        mcap.write_to_known_channel(&header, &[log_time as u8]).expect("written");
    }
    mcap.finish().expect("finished");
    drop(mcap);
    let out = folder.path().join("out");
    let copied = copy(&BagReader::open(&path).expect("a bag"), &out, Compression::None).expect("copied");
    let [left_out] = &copied.left_out[..] else { panic!("{:?}", copied.left_out) };
    let wanted = left_out.to_string();
    let is_told = ["1 messages of topic '/a'", "Image"].iter().all(|part| wanted.contains(part));
    assert!(left_out.is_loss() && is_told, "{wanted}");
    let whole = BagReader::open(&out).expect("a bag");
    assert!(whole.warnings().is_empty(), "{:?}", whole.warnings());
    let read = read_all(&whole, &Selection::default());
    assert_eq!(read.iter().map(|m| m.log_time).collect::<Vec<_>>(), [1, 3]);
}

#[test]
fn info_prints_what_ros2_prints() {
    let (_folder, path) = temporary("bag");
    // As `date -u -d @4107542399` prints it: 2100 is no leap year.
    let start = 4_107_542_399_000_000_000;
    write_bag(&path, Compression::None, &[(0, start, vec![]), (0, start + 1_500_000_000, vec![])]);
    let info = BagInfo(&BagReader::open(&path).expect("a bag")).to_string();
    for line in [
        "Files:             bag_0.mcap",
        "Storage id:        mcap",
        "Duration:          1.500000000s",
        "Start:             2100-02-28 23:59:59.000000000 UTC (4107542399.000000000)",
        "End:               2100-03-01 00:00:00.500000000 UTC (4107542400.500000000)",
        "Messages:          2",
        "Topic information: Topic: /topic_0 | Type: std_msgs/msg/String | Count: 2 | Serialization Format: cdr",
    ] {
        assert!(info.lines().any(|l| l == line), "{line}\nnot in\n{info}");
    }
}

#[test]
fn what_is_no_bag_says_so() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let error = BagReader::open(folder.path()).expect_err("empty").to_string();
    assert!(error.contains("metadata.yaml"), "{error}");
    let text = folder.path().join("text.mcap");
    std::fs::write(&text, "this is a text and no recording").expect("written");
    let why = BagReader::open(&text).expect_err("a text").to_string();
    assert!(why.contains("not a bag"), "{why}");
}

/// Readers since ROS 2 Iron find a topic only by the hash of its type, which Humble and the Python package `mcap` do not record.
#[test]
fn a_type_gets_the_hash_of_its_definition() {
    let (folder, path) = temporary("bag");
    let image = BagTopic::new("/image", "sensor_msgs/msg/Image", Qos::Images);
    let text = |schema: &str| ("ros2msg".to_owned(), schema.as_bytes().to_vec());
    let with =
        |name: &str, type_name: &str, type_hash: &str, (schema_encoding, schema): (String, Vec<u8>)| {
            let (name, type_name, type_hash) = (name.to_owned(), type_name.to_owned(), type_hash.to_owned());
            BagTopic { name, type_name, type_hash, schema_encoding, schema, ..BagTopic::default() }
        };
    let own = modulo_msgs::type_hash_of_schema("a/msg/B", "int8 c").expect("a definition");
    let other = format!("RIHS01_{:064}", 7);
    let whole = || ("ros2msg".to_owned(), image.schema.clone());
    let (image_name, none) = (&*image.type_name, || (String::new(), Vec::new()));
    let topics = [
        (with("/whole", image_name, "", whole()), &*image.type_hash),
        (with("/short", "sensor_msgs/Image", "", whole()), &*image.type_hash),
        // As a writer of ROS 1 texts has it: not readable, but the type is known.
        (with("/old", image_name, "", text("time stamp\n")), &*image.type_hash),
        (with("/bare", image_name, "", none()), &*image.type_hash),
        (with("/zeros", image_name, &format!("RIHS01_{:064}", 0), whole()), &*image.type_hash),
        (with("/wrong", image_name, &other, whole()), &*image.type_hash),
        (with("/own", "a/msg/B", "", text("int8 c\n")), &*own),
        (with("/recorded", "a/msg/B", &other, none()), &*other),
        (with("/unknown", "a/msg/B", "", none()), ""),
    ];
    let mut bag = BagWriter::create(&path, Compression::None).expect("a new folder");
    for (topic, _) in &topics {
        bag.topic(topic).expect("a topic");
    }
    bag.finish().expect("finished");
    let read = BagReader::open(&path).expect("a bag");
    let hashes = |bag: &BagReader| {
        let hash = |counted: TopicCount| (counted.topic.name.clone(), counted.topic.type_hash.clone());
        bag.topics().into_iter().map(hash).collect::<Vec<_>>()
    };
    let expected: Vec<_> =
        topics.iter().map(|(topic, hash)| (topic.name.clone(), (*hash).to_owned())).collect();
    assert_eq!(hashes(&read), expected);
    assert!(read.topics().iter().all(|counted| counted.topic.type_name.split('/').count() == 3));
    let warned = |warning: &BagWarning| {
        let text = warning.to_string();
        let is_hash =
            text.contains(&format!("hash {other} is recorded, but its definition has {}", image.type_hash));
        assert!(is_hash || text.contains("the bag does not define"), "{text}");
        text.split('\'').nth(1).expect("the name of a topic").to_owned()
    };
    let mut warned: Vec<String> = read.warnings().iter().map(warned).collect();
    warned.sort();
    assert_eq!(warned, ["/recorded", "/unknown", "/wrong"]);

    let out = folder.path().join("out");
    copy(&read, &out, Compression::None).expect("copied");
    let metadata = std::fs::read_to_string(out.join("metadata.yaml")).expect("written");
    assert_eq!(metadata.matches(&image.type_hash).count(), 6, "{metadata}");
    assert_eq!(hashes(&BagReader::open(&out).expect("a bag")), expected);
}
