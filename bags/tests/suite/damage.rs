//! Damaged bags: read up to the last whole chunk, and never a panic.

use std::path::Path;
use std::sync::LazyLock;

use modulo_bags::bag::{BagReader, BagWarning, BagWriter, Compression, Selection, copy};
use proptest::prelude::*;

use crate::{COMPRESSIONS, Line, read_all, temporary, topic, write_bag};

/// Twelve messages, three a second: several chunks.
fn lines() -> Vec<Line> {
    (0..12).map(|i| (i % 2, i as u64 * 333_333_333, vec![i as u8; 20 + i])).collect()
}

/// The bytes of a whole bag file with [`lines`].
fn whole(compression: Compression) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write_bag(&folder.path().join("bag"), compression, &lines());
    std::fs::read(folder.path().join("bag/bag_0.mcap")).expect("a file")
}

fn open(path: &Path, bytes: &[u8]) -> BagReader {
    std::fs::write(path, bytes).expect("written");
    BagReader::open(path).expect("a bag, however short")
}

#[test]
fn a_bag_cut_anywhere_has_its_whole_chunks() {
    let (_folder, path) = temporary("cut.mcap");
    for compression in COMPRESSIONS {
        let bytes = whole(compression);
        let chunks = mcap::Summary::read(&bytes).expect("whole").expect("indexed").chunk_indexes;
        assert!(chunks.len() >= 3, "{} chunks are no test", chunks.len());
        // Every byte where they are quick to read, every fifth where not.
        let step = if compression == Compression::None { 1 } else { 5 };
        for cut in (0..bytes.len()).step_by(step) {
            let ends = chunks.iter().filter(|c| c.chunk_start_offset + c.chunk_length <= cut as u64);
            let last = ends.map(|c| c.message_end_time).max();
            let expected = lines().iter().filter(|l| last.is_some_and(|last| l.1 <= last)).count();
            let bag = open(&path, &bytes[..cut]);
            let times: Vec<_> = read_all(&bag, &Selection::default()).iter().map(|m| m.log_time).collect();
            let all: Vec<_> = lines().iter().map(|l| l.1).collect();
            assert_eq!(times, all[..expected], "{compression:?} cut at {cut}");
            assert_eq!(bag.message_count(), expected as u64);
            assert!(!bag.warnings().is_empty(), "{compression:?} cut at {cut}");
            assert!(expected == all.len() || bag.warnings().iter().any(BagWarning::is_loss));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn wrong_bytes_never_panic(which in 0..3_usize, changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
        static WHOLE: LazyLock<[Vec<u8>; 3]> = LazyLock::new(|| COMPRESSIONS.map(whole));
        let mut bytes = WHOLE[which].clone();
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        let (_folder, path) = temporary("wrong.mcap");
        std::fs::write(&path, &bytes).expect("written");
        if let Ok(bag) = BagReader::open(&path) {
            prop_assert!(bag.messages(&Selection::default()).count() <= 1000);
        }
    }
}

#[test]
fn a_power_cut_leaves_what_was_flushed() {
    let (_folder, path) = temporary("bag");
    let mut bag = BagWriter::create(&path, Compression::None).expect("new");
    let id = bag.topic(&topic(0)).expect("new");
    for i in 0..25 {
        bag.write(id, i * 100_000_000, i, &[1, 2, 3]).expect("written");
        bag.settle(i * 100_000_000).expect("flushed");
    }
    // The process dies here: nothing of it runs any more.
    std::mem::forget(bag);
    let bag = BagReader::open(&path).expect("a bag");
    let found = read_all(&bag, &Selection::default()).len();
    assert!((21..=25).contains(&found), "{found} of 25, the last flush was at message 21");
    assert!(bag.warnings().iter().any(|w| matches!(w, BagWarning::NoMetadata(_))));
    assert!(bag.warnings().iter().any(BagWarning::is_loss));
}

#[test]
fn recovery_makes_a_whole_bag_of_what_is_left() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let bytes = whole(Compression::Zstd);
    // Some zeros behind the cut, as a file system leaves them.
    let cut = [&bytes[..bytes.len() / 2], &[0; 100]].concat();
    let damaged = open(&folder.path().join("cut.mcap"), &cut);
    let out = folder.path().join("saved");
    copy(&damaged, &out, Compression::Lz4).expect("recovered");
    let saved = BagReader::open(&out).expect("a bag");
    assert!(saved.warnings().is_empty(), "{:?}", saved.warnings());
    let messages = read_all(&saved, &Selection::default());
    assert!(!messages.is_empty());
    assert_eq!(messages, read_all(&damaged, &Selection::default()));
    assert_eq!(saved.topics(), damaged.topics());
}

#[test]
fn a_broken_chunk_is_read_around() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for compression in COMPRESSIONS {
        let mut bytes = whole(compression);
        let chunks = mcap::Summary::read(&bytes).expect("whole").expect("indexed").chunk_indexes;
        let broken = &chunks[1];
        // Opcode and length of the record, then what the chunk says of itself.
        let head = 9 + 40 + broken.compression.len();
        let data = usize::try_from(broken.chunk_start_offset).expect("small") + head;
        bytes[data..data + 9].fill(0xff);
        let path = folder.path().join("broken.mcap");
        std::fs::write(&path, &bytes).expect("written");

        let salvaged = BagReader::salvage(&path).expect("a bag");
        let left = read_all(&salvaged, &Selection::default()).len();
        let inside = |l: &&Line| (broken.message_start_time..=broken.message_end_time).contains(&l.1);
        assert_eq!(left, lines().len() - lines().iter().filter(inside).count(), "{compression:?}");
        assert!(salvaged.warnings().iter().any(|w| matches!(w, BagWarning::Skipped { .. })));
        assert!(!salvaged.warnings().iter().any(|w| matches!(w, BagWarning::NoIndex(_))));

        // Without the scan, a copy ends at the break, and says so.
        let out = folder.path().join(format!("{compression:?}"));
        let copied = copy(&BagReader::open(&path).expect("a bag"), &out, compression).expect("copied");
        assert!(copied.broke.is_some());
        let first = lines().iter().filter(|l| l.1 < broken.message_start_time).count();
        assert_eq!(BagReader::open(&out).expect("a whole bag").message_count(), first as u64);
    }
}

#[test]
fn a_file_without_chunks_is_read_by_log_time() {
    let (_folder, path) = temporary("loose.mcap");
    let file = std::fs::File::create(&path).expect("a file");
    let mut mcap = mcap::WriteOptions::new().use_chunks(false).create(file).expect("a writer");
    let channel = mcap.add_channel(0, "/a", "cdr", &Default::default()).expect("a channel");
    for log_time in [5, 3, 9] {
        let header =
            mcap::records::MessageHeader { channel_id: channel, sequence: 0, log_time, publish_time: 1 };
        mcap.write_to_known_channel(&header, &[log_time as u8; 3]).expect("written");
    }
    mcap.finish().expect("finished");
    let bag = BagReader::open(&path).expect("a bag");
    let read: Vec<_> =
        read_all(&bag, &Selection::default()).into_iter().map(|m| (m.log_time, m.data)).collect();
    assert_eq!(read, [(3, vec![3; 3]), (5, vec![5; 3]), (9, vec![9; 3])]);
    assert!(!bag.warnings().iter().any(BagWarning::is_loss), "{:?}", bag.warnings());
}
