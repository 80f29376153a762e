//! Damaged bags: read up to the last whole chunk, and never a panic.

use std::path::Path;
use std::sync::LazyLock;
use std::time::Duration;

use modulo_bags::bag::{
    BagError, BagReader, BagWarning, BagWriter, Compression, LeftOut, RawMessage, Selection, WriteOptions,
    copy,
};
use proptest::prelude::*;

use crate::wounds::wounded;
use crate::{COMPRESSIONS, Line, mcap_file, read_all, temporary, topic, write_bag};

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
    assert!(bag.warnings().iter().any(|w| w.to_string().contains("no metadata.yaml")));
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
    // Bytes that break the structure, and one that only the CRC shows.
    for (compression, broken_bytes) in COMPRESSIONS.into_iter().flat_map(|c| [(c, 0..9), (c, 40..41)]) {
        let mut bytes = whole(compression);
        let chunks = mcap::Summary::read(&bytes).expect("whole").expect("indexed").chunk_indexes;
        let broken = &chunks[1];
        let data = usize::try_from(broken.compressed_data_offset().expect("small")).expect("small");
        bytes[data..][broken_bytes.clone()].iter_mut().for_each(|byte| *byte = !*byte);
        let path = folder.path().join("broken.mcap");
        std::fs::write(&path, &bytes).expect("written");

        let bag = BagReader::open(&path).expect("a bag");
        let (messages, left_out) = read_around(&bag);
        let inside = |l: &&Line| (broken.message_start_time..=broken.message_end_time).contains(&l.1);
        let lost = lines().iter().filter(inside).count();
        assert_eq!(messages.len(), lines().len() - lost, "{compression:?}");
        let [wanted] = &left_out[..] else { panic!("{left_out:?}") };
        let place = format!("{lost} messages of the chunk at byte {}", broken.chunk_start_offset);
        assert!(wanted.to_string().contains(&place), "{wanted}");

        // A copy has the same messages, says the same, and is whole.
        let out = folder.path().join(format!("{compression:?}{}", broken_bytes.len()));
        let copied = copy(&bag, &out, compression).expect("copied");
        assert!(copied.broke.is_none() && copied.left_out == [BagWarning::LeftOut(wanted.clone())]);
        let copied = BagReader::open(&out).expect("a whole bag");
        assert!(copied.warnings().is_empty());
        assert_eq!(read_all(&copied, &Selection::default()), messages);
    }
}

/// The messages that can be read, and the reports of those that cannot.
fn read_around(bag: &BagReader) -> (Vec<RawMessage>, Vec<LeftOut>) {
    let (mut messages, mut left_out) = (Vec::new(), Vec::new());
    for message in bag.messages(&Selection::default()) {
        match message {
            Ok(message) => messages.push(message),
            Err(BagError::LeftOut(one)) => left_out.push(one),
            Err(why) => panic!("{why}"),
        }
    }
    (messages, left_out)
}

#[test]
fn a_file_without_chunks_is_read_by_log_time() {
    let (_folder, path) = temporary("loose.mcap");
    let bag = open(&path, &mcap_file(mcap::WriteOptions::new().use_chunks(false), &[5, 3, 9], 3));
    let read: Vec<_> =
        read_all(&bag, &Selection::default()).into_iter().map(|m| (m.log_time, m.data)).collect();
    assert_eq!(read, [(3, vec![3; 3]), (5, vec![5; 3]), (9, vec![9; 3])]);
    assert!(!bag.warnings().iter().any(BagWarning::is_loss), "{:?}", bag.warnings());
}

/// One length in the data is wrong, and the index at the end is whole.
#[test]
fn the_index_finds_the_chunks_behind_a_broken_length() {
    let (_folder, path) = temporary("length.mcap");
    for compression in COMPRESSIONS {
        let bytes = whole(compression);
        let chunks = mcap::Summary::read(&bytes).expect("whole").expect("indexed").chunk_indexes;
        let places = chunks.iter().map(|chunk| usize::try_from(chunk.chunk_start_offset).expect("small"));
        // The lengths of the header and of each chunk.
        for place in [mcap::MAGIC.len()].into_iter().chain(places) {
            let mut broken = bytes.clone();
            broken[place + 4] = 7;
            let bag = open(&path, &broken);
            assert_eq!(read_all(&bag, &Selection::default()).len(), lines().len(), "{compression:?} {place}");
        }
    }
}

/// A file of nine messages in several chunks. Its index has no CRC.
fn nine_messages(options: mcap::WriteOptions) -> Vec<u8> {
    let options = options.chunk_size(Some(60)).calculate_summary_section_crc(false);
    mcap_file(options, &[0, 1, 2, 3, 4, 5, 6, 7, 8], 50)
}

/// An index that has no CRC, and leaves out a chunk or leads to a wrong place, hides nothing.
#[test]
fn a_wrong_index_is_not_believed() {
    let (_folder, path) = temporary("index.mcap");
    let bytes = nine_messages(mcap::WriteOptions::new().compression(None));
    let chunks = mcap::Summary::read(&bytes).expect("whole").expect("indexed").chunk_indexes;
    assert!(chunks.len() > 3);
    let starts = chunks[2].chunk_start_offset.to_le_bytes();
    // The record of the index: opcode, length, two times, and then the place of the chunk.
    let place = bytes.windows(8).rposition(|window| window == starts).expect("it is in the index");
    assert_eq!(bytes[place - 25], mcap::records::op::CHUNK_INDEX);
    for (what, at, value) in [("place", place, 1), ("opcode", place - 25, 0x77), ("length", place + 8, 1)] {
        let mut wrong = bytes.clone();
        wrong[at] ^= value;
        let bag = open(&path, &wrong);
        assert_eq!(read_all(&bag, &Selection::default()).len(), 9, "{what}: {:?}", bag.warnings());
    }
}

/// Counts that no file can have were added up, and printed.
#[test]
fn counts_that_contradict_each_other_are_not_believed() {
    let (_folder, path) = temporary("counts.mcap");
    let bytes = nine_messages(mcap::WriteOptions::new().compression(None));
    // The record of the statistics: opcode, length, messages, five other counts, two times, the length of the list, a channel, its messages.
    let place = bytes
        .windows(17)
        .rposition(|w| w[0] == mcap::records::op::STATISTICS && w[9..] == 9u64.to_le_bytes());
    let (all, of_channel) = (place.expect("there") + 9, place.expect("there") + 9 + 48);
    assert_eq!(bytes[of_channel..][..8], 9u64.to_le_bytes());
    for (what, counts) in [
        ("of a channel", [9, u64::MAX]),
        ("of all", [u64::MAX, 9]),
        ("that agree, but find no room", [u64::MAX, u64::MAX]),
    ] {
        let mut wrong = bytes.clone();
        for (at, count) in [all, of_channel].into_iter().zip(counts) {
            wrong[at..][..8].copy_from_slice(&count.to_le_bytes());
        }
        let bag = open(&path, &wrong);
        assert_eq!((bag.message_count(), bag.topics()[0].messages), (9, 9), "{what}");
        let told = |why: &BagWarning| why.is_loss() && why.to_string().contains("counts in its index");
        assert!(bag.warnings().iter().any(told), "{what}: {:?}", bag.warnings());
    }
    // A writer may leave out the counts of the channels: the length of their list is 0.
    let mut without = bytes[..of_channel - 6].to_vec();
    without.extend([0; 4]);
    without.extend(&bytes[of_channel + 8..]);
    let length = place.expect("there") + 1;
    without[length] -= 10;
    let bag = open(&path, &without);
    assert_eq!(bag.message_count(), 9, "{:?}", bag.warnings());
}

/// A chunk without a CRC, whose size is that of fewer messages in all places that tell it.
#[test]
fn a_size_that_hides_messages_is_told() {
    let (_folder, path) = temporary("size.mcap");
    let options = mcap::WriteOptions::new().compression(Some(mcap::Compression::Zstd));
    let mut bytes = nine_messages(options.calculate_chunk_crcs(false));
    let chunks = mcap::Summary::read(&bytes).expect("whole").expect("indexed").chunk_indexes;
    let size = chunks[0].uncompressed_size;
    // One record of a message: 31 bytes and the payload.
    let smaller = (size - 81).to_le_bytes();
    let places: Vec<_> =
        (0..bytes.len()).filter(|&at| bytes[at..].starts_with(&size.to_le_bytes())).collect();
    assert!(places.len() >= 2, "in the chunk and in the index");
    for place in [places[0], places[1]] {
        bytes[place..][..8].copy_from_slice(&smaller);
    }
    assert_eq!(
        mcap::Summary::read(&bytes).expect("whole").expect("indexed").chunk_indexes[0].uncompressed_size,
        size - 81
    );
    let (messages, left_out) = read_around(&open(&path, &bytes));
    assert!(messages.len() < 9 && left_out.len() == 1, "{left_out:?}");
}

#[test]
fn an_empty_file_says_that_it_is_empty() {
    let (_folder, path) = temporary("empty.mcap");
    let bag = open(&path, &[]);
    let (warning, wanted) = (&bag.warnings()[0], bag.warnings()[0].to_string());
    assert!(warning.is_loss() && wanted.contains("empty") && wanted.contains("recorder"), "{wanted}");
}

/// The result of reading a file: the messages, and all losses that the reader names.
struct Outcome {
    messages: Vec<RawMessage>,
    wanted: Vec<String>,
}

/// Reads a bag as far as possible. A bag that is refused tells its error.
fn outcome(path: &Path) -> Outcome {
    let bag = match BagReader::open(path) {
        Ok(bag) => bag,
        Err(why) => return Outcome { messages: Vec::new(), wanted: vec![why.to_string()] },
    };
    let mut outcome =
        Outcome { messages: Vec::new(), wanted: bag.warnings().iter().map(ToString::to_string).collect() };
    for message in bag.messages(&Selection::default()) {
        match message {
            Ok(message) => outcome.messages.push(message),
            Err(why) => outcome.wanted.push(why.to_string()),
        }
    }
    assert!(outcome.messages.is_sorted_by_key(|m| m.log_time) || !outcome.wanted.is_empty());
    outcome
}

/// The outcomes of a thousand damages.
struct Survey {
    whole: Vec<RawMessage>,
    /// The damage and the messages, where these differ from the whole ones without a word.
    unseen: Vec<(String, Vec<RawMessage>)>,
    /// The damage, where a message that was never written came with a word about the damage.
    forged: Vec<String>,
}

/// Damages the file `damaged` of the bag `path` a thousand times.
fn survey(path: &Path, damaged: &Path, what: &str) -> Survey {
    let bytes = std::fs::read(damaged).expect("readable");
    let whole = outcome(path);
    assert!(whole.wanted.is_empty() && !whole.messages.is_empty(), "{what}: {:?}", whole.wanted);
    let (mut equal, mut named, mut unseen, mut forged) = (0, 0, Vec::new(), Vec::new());
    for number in 0..1000 {
        let wound = wounded(&bytes, number);
        std::fs::write(damaged, &wound.bytes).expect("written");
        let Outcome { messages, wanted } = outcome(path);
        match (messages == whole.messages, wanted.is_empty()) {
            (true, _) => equal += 1,
            (false, false) => {
                named += 1;
                if !messages.iter().all(|message| whole.messages.contains(message)) {
                    forged.push(wound.how);
                }
            }
            (false, true) => unseen.push((wound.how, messages)),
        }
    }
    println!(
        "{what}: of 1000 damages {equal} change no message, {named} are named ({} of them with changed messages), {} are unseen",
        forged.len(),
        unseen.len()
    );
    Survey { whole: whole.messages, unseen, forged }
}

/// Chunks have CRCs, and so has the index: no damage changes a message without a word.
#[test]
fn no_damage_of_an_mcap_file_is_unseen() {
    let (folder, path) = temporary("whole.mcap");
    for compression in COMPRESSIONS {
        std::fs::write(&path, whole(compression)).expect("written");
        let Survey { unseen, forged, .. } = survey(&path, &path, &format!("MCAP, {compression:?}"));
        assert!(unseen.is_empty() && forged.is_empty(), "{compression:?}: {unseen:?} {forged:?}");
    }
    let loose = folder.path().join("loose.mcap");
    let options = mcap::WriteOptions::new().use_chunks(false);
    std::fs::write(&loose, mcap_file(options, &std::array::from_fn::<u8, 12, _>(|at| at as u8), 30))
        .expect("written");
    // One CRC tells that something is damaged, not what.
    let Survey { unseen, .. } = survey(&loose, &loose, "MCAP without chunks");
    assert!(unseen.is_empty(), "without chunks: {unseen:?}");
}

/// The list of files decides which of them are read.
#[test]
fn no_damage_of_the_metadata_is_unseen() {
    let (_folder, path) = temporary("bag");
    let max_duration = Some(Duration::from_secs(1));
    write_bag(&path, WriteOptions { max_duration, ..WriteOptions::default() }, &lines());
    let Survey { unseen, forged, .. } = survey(&path, &path.join("metadata.yaml"), "metadata.yaml");
    assert!(unseen.is_empty() && forged.is_empty(), "{unseen:?} {forged:?}");
}

/// SQLite has no checksums: the content of a message may change, its time and its number may not.
#[cfg(feature = "sqlite")]
#[test]
fn damage_of_sqlite_hides_no_message() {
    let (_folder, path) = temporary("whole.db3");
    let payload = [&[0, 1, 0, 0][..], &[9; 3000]].concat();
    crate::sqlite::write(&path, 4, &[("/a", "std_msgs/msg/String", "cdr")], &payload);
    let Survey { whole, unseen, .. } = survey(&path, &path, "SQLite");
    let times = |messages: &[RawMessage]| messages.iter().map(|m| m.log_time).collect::<Vec<_>>();
    for (how, messages) in unseen {
        assert_eq!(times(&messages), times(&whole), "{how}");
    }
}
