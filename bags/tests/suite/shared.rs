//! Recordings of others; skipped where the data folder is absent.

#[path = "../../../tests/harness/data.rs"]
mod data;

use std::path::Path;

use modulo_bags::bag::{BagReader, Compression, Selection};
use modulo_bags::import::import_kitti;
use modulo_bags::source::{SourceOptions, open};

use crate::read_all;

/// Opens the source, reads it whole, returns (frames, labelled objects).
fn walk(path: &Path, topic: Option<&str>) -> (usize, usize) {
    let options = SourceOptions { white: 0.0, topic: topic.map(str::to_owned) };
    let mut source = open(&path.display().to_string(), &options).unwrap_or_else(|e| panic!("{e}"));
    let (mut frames, mut objects) = (0, 0);
    while let Some(frame) = source.next() {
        let frame = frame.unwrap_or_else(|e| panic!("{e}"));
        assert!(frame.radiance.iter().all(|v| (0.0..1.0).contains(v)), "{}", frame.name);
        assert!(frame.radiance.iter().any(|v| *v > 0.1), "{} is dark", frame.name);
        let labels = frame.ground_truth.unwrap_or_default();
        frames += 1;
        objects += labels.iter().filter(|label| label.class != "dontcare").count();
    }
    assert_eq!(source.len(), Some(frames));
    (frames, objects)
}

#[test]
fn recordings_of_others_are_read_whole() {
    let Some(data) = data::shared("data") else { return };
    for (name, messages) in [
        ("rerun_rosbag2_2025_09_10-13_03_56_0.mcap", 194),
        ("rosbag2/rosbag2_py/test/resources/mcap/talker", 20),
        ("rosbag2/rosbag2_tests/resources/mcap/cdr_test", 7),
        ("rosbags-rs/test_bag_mcap", 188),
        ("derived_kitti/drive_0011_5f_png_mcap", 5),
        ("rosbag2/rosbag2_py/test/resources/sqlite3/talker", 20),
        ("rosbag2/rosbag2_tests/resources/sqlite3/cdr_test", 7),
        ("rosbags-rs/test_bag_sqlite3", 188),
        ("rosbags-rs/test_bag_sqlite3/test_bag_sqlite3.db3", 188),
    ] {
        let bag = BagReader::open(&data.join("bags").join(name)).unwrap_or_else(|e| panic!("{e}"));
        let read = read_all(&bag, &Selection::default());
        assert_eq!(read.len(), messages, "{name}");
        assert_eq!(bag.message_count(), messages as u64, "{name}");
        assert!(read.is_sorted_by_key(|m| m.log_time), "{name}");
        assert!(read.iter().all(|m| m.data.starts_with(&[0, 1, 0, 0])), "{name}");
        assert!(!bag.warnings().iter().any(|w| w.is_loss()), "{name}: {:?}", bag.warnings());
    }
}

/// The same recording in both storages.
#[test]
fn both_storages_hold_the_same() {
    let Some(data) = data::shared("data") else { return };
    for (mcap, sqlite) in [
        ("rosbag2/rosbag2_tests/resources/mcap/cdr_test", "rosbag2/rosbag2_tests/resources/sqlite3/cdr_test"),
        ("rosbag2/rosbag2_py/test/resources/mcap/talker", "rosbag2/rosbag2_py/test/resources/sqlite3/talker"),
    ] {
        let [mcap, sqlite] = [mcap, sqlite].map(|name| {
            let bag = BagReader::open(&data.join("bags").join(name)).unwrap_or_else(|e| panic!("{e}"));
            let mut all: Vec<_> = read_all(&bag, &Selection::default())
                .into_iter()
                .map(|m| (m.log_time, m.topic.name.clone(), m.topic.type_name.clone(), m.data))
                .collect();
            all.sort();
            all
        });
        assert!(!mcap.is_empty() && mcap == sqlite);
    }
}

#[test]
fn images_of_recordings_are_frames() {
    let Some(data) = data::shared("data") else { return };
    let rerun = data.join("bags/rerun_rosbag2_2025_09_10-13_03_56_0.mcap");
    let error = open(&rerun.display().to_string(), &SourceOptions::default()).err().expect("two topics");
    assert!(error.to_string().contains("/compressed_image, /image"), "{error}");
    for topic in ["/compressed_image", "/image"] {
        assert!(walk(&rerun, Some(topic)).0 > 0, "{topic}");
    }
    assert_eq!(walk(&data.join("bags/derived_kitti/drive_0011_5f_png_mcap"), None), (5, 0));
}

#[test]
fn kitti_folders_are_read_and_imported_whole() {
    let Some(data) = data::shared("data") else { return };
    for (name, frames, objects) in
        [("kitti_object", 20, 105), ("kitti_object_crop", 3, 12), ("kitti_seq/drive_0011", 21, 37)]
    {
        let folder = data.join(name);
        let found = walk(&folder, None);
        assert_eq!(found, (frames, objects), "{name}");
        let out = tempfile::tempdir().expect("a temporary folder");
        let bag = out.path().join("bag");
        let report = import_kitti(&folder, &bag, Compression::None).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(report.frames, frames);
        assert_eq!(walk(&bag, None), found, "{name}");
    }
}

#[test]
fn high_dynamic_range_files_load() {
    let Some(data) = data::shared("data") else { return };
    assert_eq!(walk(&data.join("hdr/polyhaven"), None), (4, 0));
    assert_eq!(walk(&data.join("hdr/openexr_images/ScanLines_Desk.exr"), None), (1, 0));
    assert_eq!(walk(&data.join("bdd/unlabelled"), None), (3, 0));
}
