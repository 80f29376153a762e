//! Bags of several files: written split, read as one.

use std::path::Path;
use std::time::Duration;

use modulo_bags::bag::{BagReader, BagWarning, Selection, WriteOptions};
use modulo_bags::source::{SourceOptions, open};
use proptest::prelude::*;

use crate::{COMPRESSIONS, Line, read_all, temporary, topic, write_bag};

/// Messages every 100 ms on two topics by turns.
fn lines(count: usize, length: usize) -> Vec<Line> {
    (0..count).map(|i| (i % 2, i as u64 * 100_000_000, vec![(i * 7) as u8; length])).collect()
}

fn split(max_bytes: Option<u64>, max_duration: Option<Duration>) -> WriteOptions {
    WriteOptions { max_bytes, max_duration, ..WriteOptions::default() }
}

fn names(bag: &BagReader) -> Vec<String> {
    bag.files().map(|path| path.file_name().expect("a name").to_string_lossy().into_owned()).collect()
}

fn messages_of(path: &Path) -> u64 {
    BagReader::open(path).expect("a whole file").message_count()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn no_file_is_larger_than_it_may(max in 1000_u64..40_000, length in 1..5_000_usize, which in 0..3_usize) {
        let (_folder, path) = temporary("bag");
        let lines = lines(40, length);
        let options = WriteOptions { compression: COMPRESSIONS[which], ..split(Some(max), None) };
        write_bag(&path, options, &lines);
        let bag = BagReader::open(&path).expect("a bag");
        prop_assert!(bag.warnings().is_empty(), "{:?}", bag.warnings());
        let expected: Vec<_> = (0..bag.files().count()).map(|i| format!("bag_{i}.mcap")).collect();
        prop_assert_eq!(names(&bag), expected);
        for file in bag.files() {
            // The index comes on top: its size does not depend on that of the messages.
            let size = std::fs::metadata(file).expect("a file").len();
            prop_assert!(messages_of(file) == 1 || size <= max + 8_000, "{} of {}", size, max);
        }
        let read: Vec<_> = read_all(&bag, &Selection::default()).into_iter().map(|m| (m.log_time, m.data)).collect();
        prop_assert_eq!(read, lines.iter().map(|l| (l.1, l.2.clone())).collect::<Vec<_>>());
    }
}

#[test]
fn a_large_bag_has_few_files() {
    let (_folder, path) = temporary("bag");
    write_bag(&path, split(Some(100_000), None), &lines(100, 10_000));
    // Nine of 10 kB fit in 100 kB with what is beside them.
    assert_eq!(BagReader::open(&path).expect("a bag").files().count(), 12);
}

#[test]
fn a_bag_is_split_by_time_and_its_metadata_says_so() {
    let (_folder, path) = temporary("bag");
    write_bag(&path, split(None, Some(Duration::from_secs(1))), &lines(30, 5));
    let bag = BagReader::open(&path).expect("a bag");
    assert_eq!(bag.files().map(messages_of).collect::<Vec<_>>(), [11, 11, 8]);
    for file in bag.files() {
        assert_eq!(BagReader::open(file).expect("a file").topics().len(), 2, "each file has all topics");
    }
    let metadata = std::fs::read_to_string(path.join("metadata.yaml")).expect("readable");
    for text in [
        "relative_file_paths:\n    - bag_0.mcap\n    - bag_1.mcap\n    - bag_2.mcap\n",
        "    - path: bag_1.mcap\n      starting_time:\n        nanoseconds_since_epoch: 1100000000\n      \
         duration:\n        nanoseconds: 1000000000\n      message_count: 11\n",
        "  duration:\n    nanoseconds: 2900000000\n  starting_time:\n    nanoseconds_since_epoch: 0\n",
        "  message_count: 30\n",
    ] {
        assert!(metadata.contains(text), "{text}\nnot in\n{metadata}");
    }
}

/// A recorder that died between two files leaves no metadata.
#[test]
fn files_without_metadata_are_one_bag() {
    let (_folder, path) = temporary("bag");
    write_bag(&path, split(None, Some(Duration::from_secs(1))), &lines(30, 5));
    for broken in [None, Some(""), Some("rosbag2_bagfile_information:\n  version: 9\n  storage_id")] {
        let metadata = path.join("metadata.yaml");
        match broken {
            None => std::fs::remove_file(&metadata).expect("there"),
            Some(text) => std::fs::write(&metadata, text).expect("written"),
        }
        let bag = BagReader::open(&path).expect("a bag");
        let read = read_all(&bag, &Selection::default());
        assert_eq!(
            read.iter().map(|m| m.log_time / 100_000_000).collect::<Vec<_>>(),
            (0..30).collect::<Vec<_>>()
        );
        let missing = "no metadata.yaml, all files are read by their start time";
        let wanted = bag.warnings().iter().map(ToString::to_string).any(|text| match broken {
            None => text.contains(missing),
            Some(_) => text.contains("all files of its folder are read by their start time"),
        });
        assert!(wanted && !bag.warnings().iter().any(BagWarning::is_loss), "{:?}", bag.warnings());
    }
}

#[test]
fn metadata_names_no_file_outside_of_its_bag() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let [path, secret] = ["bag", "secret"].map(|name| folder.path().join(name));
    write_bag(&path, WriteOptions::default(), &lines(3, 5));
    write_bag(&secret, WriteOptions::default(), &lines(4, 5));
    let metadata = path.join("metadata.yaml");
    let ours = std::fs::read_to_string(&metadata).expect("readable");
    let absolute = secret.join("secret_0.mcap").display().to_string();
    // Relative, absolute, and through a folder that does not exist.
    for outside in ["../secret/secret_0.mcap", &absolute, "x/../../secret/secret_0.mcap"] {
        std::fs::write(&metadata, ours.replace("bag_0.mcap", outside)).expect("written");
        let error = BagReader::open(&path).expect_err(outside).to_string();
        assert!(error.contains(outside) && error.contains("inside the folder"), "{error}");
    }
    std::fs::write(&metadata, ours.replace("bag_0.mcap", "./bag_0.mcap")).expect("written");
    assert_eq!(BagReader::open(&path).expect("inside").message_count(), 3);
}

/// As a file, in a folder, as a source: the error names the file and the command that converts it.
#[test]
fn a_bag_of_ros_1_is_refused_with_a_remedy() {
    let (folder, path) = temporary("old.bag");
    std::fs::write(&path, b"#ROSBAG V2.0\nE\0\0\0").expect("written");
    let source = |path: &Path| open(&path.display().to_string(), &SourceOptions::default()).err();
    for given in [&path, folder.path()] {
        let errors = [
            BagReader::open(given).expect_err("ROS 1").to_string(),
            source(given).expect("ROS 1").to_string(),
        ];
        for error in errors {
            let remedy = format!("`rosbags-convert --src {} --dst FOLDER`", path.display());
            assert!(error.contains("a ROS 1 bag") && error.contains(&remedy), "{error}");
        }
    }
}

/// Times of several files may overlap: log time counts, not the file.
#[test]
fn overlapping_files_are_read_in_time() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let lines = lines(30, 5);
    let bag = folder.path().join("bag");
    std::fs::create_dir(&bag).expect("a folder");
    for file in 0..3 {
        let some: Vec<_> =
            lines.iter().enumerate().filter(|(i, _)| i % 3 == file).map(|(_, l)| l.clone()).collect();
        let own = folder.path().join(format!("own_{file}"));
        write_bag(&own, WriteOptions::default(), &some);
        // The latest by name begins first.
        let name = format!("part_{}.mcap", 9 - file);
        std::fs::rename(own.join(format!("own_{file}_0.mcap")), bag.join(name)).expect("moved");
    }
    let bag = BagReader::open(&bag).expect("a bag");
    let times = |selection: &Selection| -> Vec<u64> {
        read_all(&bag, selection).iter().map(|m| m.log_time / 100_000_000).collect()
    };
    assert_eq!(times(&Selection::default()), (0..30).collect::<Vec<_>>());
    let late = Selection { topics: Some(vec![topic(1).name]), start_ns: Some(2_500_000_000) };
    assert_eq!(times(&late), [25, 27, 29]);
}

#[test]
fn old_metadata_names_files_with_their_folder() {
    let (_folder, path) = temporary("bag");
    write_bag(&path, WriteOptions::default(), &lines(3, 5));
    let old = "rosbag2_bagfile_information:\n  version: 3\n  storage_identifier: mcap\n  \
               relative_file_paths:\n    - bag/bag_0.mcap\n  duration:\n    nanoseconds: 1\n  starting_time:\n    \
               nanoseconds_since_epoch: 1\n  message_count: 3\n  topics_with_message_count: []\n  \
               compression_format: \"\"\n  compression_mode: \"\"\n";
    std::fs::write(path.join("metadata.yaml"), old).expect("written");
    assert_eq!(BagReader::open(&path).expect("a bag").message_count(), 3);
}

/// Three files of one bag: ten messages, then eleven, then nine.
fn three_files() -> (tempfile::TempDir, std::path::PathBuf, String) {
    let (folder, path) = temporary("bag");
    write_bag(&path, split(None, Some(Duration::from_secs(1))), &lines(30, 5));
    let metadata = std::fs::read_to_string(path.join("metadata.yaml")).expect("readable");
    (folder, path, metadata)
}

fn wanted(bag: &BagReader) -> String {
    bag.warnings().iter().map(|w| format!("{w}\n")).collect()
}

fn is_lossy(bag: &BagReader) -> bool {
    bag.warnings().iter().any(BagWarning::is_loss)
}

/// Missing, of another format, compressed, empty: the other files are read, and the bad one is named.
#[test]
fn a_file_that_cannot_be_read_leaves_the_others() {
    let contents: [(Option<&[u8]>, &str); 4] = [
        (None, "No such file"),
        (Some(b"this is a text and no recording"), "not a bag"),
        (Some(b"\x28\xb5\x2f\xfd and so on"), "`zstd -d"),
        (Some(b""), "empty"),
    ];
    for (content, why) in contents {
        let (_folder, path, _) = three_files();
        let part = path.join("bag_1.mcap");
        std::fs::remove_file(&part).expect("there");
        content.into_iter().for_each(|content| std::fs::write(&part, content).expect("written"));
        let bag = BagReader::open(&path).expect("two files");
        assert_eq!(read_all(&bag, &Selection::default()).len(), 19, "{why}");
        assert!(
            is_lossy(&bag) && wanted(&bag).contains("bag_1.mcap") && wanted(&bag).contains(why),
            "{}",
            wanted(&bag)
        );
        for name in ["bag_0.mcap", "bag_2.mcap"] {
            std::fs::remove_file(path.join(name)).expect("there");
        }
        assert!(content.is_some_and(<[u8]>::is_empty) || BagReader::open(&path).is_err(), "nothing is left");
    }
}

/// Metadata that contradict the files: what the files say counts, and each message comes once.
#[test]
fn the_files_are_right_where_metadata_contradicts_them() {
    let list = "relative_file_paths:\n    - bag_0.mcap\n    - bag_1.mcap\n    - bag_2.mcap\n";
    for (ours, theirs, messages, why, lossy) in [
        ("storage_identifier: mcap", "storage_identifier: \"\"", 30, "its files are mcap", false),
        (
            "storage_identifier: mcap",
            "storage_identifier: sqlite3",
            30,
            "'sqlite3', its files are mcap",
            false,
        ),
        ("storage_identifier: mcap", "storage_identifier: lance", 30, "'lance'", false),
        ("  storage_identifier: mcap\n", "", 30, "its files are mcap", false),
        ("compression_mode: \"\"", "compression_mode: FILE", 30, "its files are not compressed", false),
        ("\n  message_count: 30", "\n  message_count: 31", 30, "31, its files have 30", false),
        ("    - bag_1.mcap\n", "    - bag_0.mcap\n", 19, "'bag_0.mcap' is listed more than once", true),
        ("    - bag_1.mcap\n", "", 19, "bag_1.mcap: is not listed", true),
        (list, "relative_file_paths: []\n", 30, "no file that it lists is here", false),
        (list, "relative_file_paths: [other.mcap]\n", 30, "no file that it lists is here", false),
    ] {
        let (_folder, path, metadata) = three_files();
        let changed = metadata.replacen(ours, theirs, 1);
        assert_ne!(changed, metadata, "{theirs}");
        std::fs::write(path.join("metadata.yaml"), changed).expect("written");
        let bag = BagReader::open(&path).expect(theirs);
        assert_eq!(read_all(&bag, &Selection::default()).len(), messages, "{theirs}");
        assert!(wanted(&bag).contains(why), "{theirs}: {}", wanted(&bag));
        assert_eq!(is_lossy(&bag), lossy, "{theirs}: {}", wanted(&bag));
    }
}

/// A file that is compressed as a whole names the remedy; beside it, the unpacked one is read once.
#[test]
fn a_compressed_file_names_the_program_that_unpacks_it() {
    let (folder, path, metadata) = three_files();
    let part = path.join("bag_0.mcap");
    let packed = path.join("bag_0.mcap.zstd");
    let bytes = zstd::encode_all(&std::fs::read(&part).expect("readable")[..], 0).expect("packed");
    std::fs::write(&packed, bytes).expect("written");
    let listed = metadata.replace("- bag_0.mcap\n", "- bag_0.mcap.zstd\n");
    std::fs::write(path.join("metadata.yaml"), listed).expect("written");
    assert_eq!(read_all(&BagReader::open(&path).expect("unpacked"), &Selection::default()).len(), 30);
    let alone = folder.path().join("alone");
    std::fs::create_dir(&alone).expect("a folder");
    std::fs::rename(&packed, alone.join("x.mcap.zstd")).expect("moved");
    for given in [alone.clone(), alone.join("x.mcap.zstd")] {
        let opened = open(&given.display().to_string(), &SourceOptions::default());
        for error in [
            BagReader::open(&given).expect_err("packed").to_string(),
            opened.err().expect("packed").to_string(),
        ] {
            assert!(error.contains("compressed as a whole") && error.contains("x.mcap.zstd`"), "{error}");
        }
    }
}
