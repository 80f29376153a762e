//! ROS 1 bags, made here record by record.

use std::path::Path;
use std::time::Duration;

use modulo_bags::bag::{BagReader, BagWarning, Compression, RawMessage, Selection, copy};
use modulo_bags::play::{PlayError, PlayOptions, Player};
use modulo_bags::source::{SourceOptions, open};
use modulo_msgs::cdr;
use modulo_msgs::sensor_msgs::{CameraInfo, CompressedImage, Image};
use proptest::prelude::*;

use crate::{frame, read_all, temporary};

const IMAGE: (&str, &str) = ("sensor_msgs/Image", "060021388200f6f0f447d0fcd9c64743");
const COMPRESSED: (&str, &str) = ("sensor_msgs/CompressedImage", "8f7a12909da2c9d3332d540a0977563f");
const INFO: (&str, &str) = ("sensor_msgs/CameraInfo", "c9a58c1b0b154e0e6da7578cb991d214");

fn sized(bytes: &[u8]) -> Vec<u8> {
    let length = u32::try_from(bytes.len()).expect("small");
    [&length.to_le_bytes()[..], bytes].concat()
}

fn fields(fields: &[(&str, &[u8])]) -> Vec<u8> {
    fields.iter().flat_map(|(name, value)| sized(&[name.as_bytes(), b"=", value].concat())).collect()
}

fn record(header: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    [sized(&fields(header)), sized(data)].concat()
}

fn time(ns: u64) -> [u8; 8] {
    let (sec, nsec) = ((ns / 1_000_000_000) as u32, (ns % 1_000_000_000) as u32);
    [sec.to_le_bytes(), nsec.to_le_bytes()].concat().try_into().expect("8 bytes")
}

/// (connection, time in ns, payload) of one chunk.
type Chunk = Vec<(u32, u64, Vec<u8>)>;

/// (topic, (type, MD5 sum)).
type Connection<'a> = (&'a str, (&'a str, &'a str));

fn connection(id: u32, (topic, (kind, md5)): Connection<'_>) -> Vec<u8> {
    let more: [(&str, &[u8]); 4] = [
        ("topic", topic.as_bytes()),
        ("type", kind.as_bytes()),
        ("md5sum", md5.as_bytes()),
        ("message_definition", b"as in ROS 1"),
    ];
    record(&[("op", &[7]), ("conn", &id.to_le_bytes()), ("topic", topic.as_bytes())], &fields(&more))
}

fn bag(connections: &[Connection<'_>], chunks: &[Chunk]) -> Vec<u8> {
    let all: Vec<u8> = (0..).zip(connections).flat_map(|(id, c)| connection(id, *c)).collect();
    let header = |index: u64| {
        let counts = [connections.len(), chunks.len()].map(|n| (n as u32).to_le_bytes());
        let index = index.to_le_bytes();
        let header: [(&str, &[u8]); 4] =
            [("op", &[3]), ("index_pos", &index), ("conn_count", &counts[0]), ("chunk_count", &counts[1])];
        let padding = 4096 - 8 - fields(&header).len();
        [b"#ROSBAG V2.0\n".to_vec(), record(&header, &vec![b' '; padding])].concat()
    };
    let (mut bytes, mut infos) = (header(0), Vec::new());
    for chunk in chunks {
        let messages = chunk.iter().flat_map(|(id, at, payload)| {
            record(&[("op", &[2]), ("conn", &id.to_le_bytes()), ("time", &time(*at))], payload)
        });
        let data: Vec<u8> = all.iter().copied().chain(messages).collect();
        let times = chunk.iter().map(|m| m.1);
        let (start, end) = (times.clone().min().expect("a message"), times.max().expect("a message"));
        let counts: Vec<u8> = (0..connections.len() as u32)
            .flat_map(|id| [id, chunk.iter().filter(|m| m.0 == id).count() as u32])
            .flat_map(u32::to_le_bytes)
            .collect();
        let place = (bytes.len() as u64).to_le_bytes();
        let info: [(&str, &[u8]); 6] = [
            ("op", &[6]),
            ("ver", &1_u32.to_le_bytes()),
            ("chunk_pos", &place),
            ("start_time", &time(start)),
            ("end_time", &time(end)),
            ("count", &(connections.len() as u32).to_le_bytes()),
        ];
        infos.extend(record(&info, &counts));
        let size = (data.len() as u32).to_le_bytes();
        bytes.extend(record(&[("op", &[5]), ("compression", b"none"), ("size", &size)], &data));
    }
    let begin = header(bytes.len() as u64);
    bytes[..begin.len()].copy_from_slice(&begin);
    [bytes, all, infos].concat()
}

/// Header of ROS 1: sequence number, time, frame.
fn header(at: u64) -> Vec<u8> {
    [&7_u32.to_le_bytes()[..], &time(at), &sized(b"camera")].concat()
}

/// The pixels of [`frame`] as ROS 1 packs them: 6 x 4, rgb8.
fn image(at: u64, seed: u8) -> Vec<u8> {
    let pixels = Image::from_frame(Default::default(), &frame(seed)).data;
    let size = [4_u32.to_le_bytes(), 6_u32.to_le_bytes()].concat();
    [header(at), size, sized(b"rgb8"), vec![0], 18_u32.to_le_bytes().to_vec(), sized(&pixels)].concat()
}

fn compressed(at: u64) -> Vec<u8> {
    [header(at), sized(b"png"), sized(&[1, 2, 3])].concat()
}

fn camera_info(at: u64) -> Vec<u8> {
    let doubles = |values: std::ops::Range<u8>| -> Vec<u8> {
        values.flat_map(|v| f64::from(v).to_le_bytes()).collect()
    };
    let numbers = |values: &[u32]| -> Vec<u8> { values.iter().flat_map(|v| v.to_le_bytes()).collect() };
    let parts =
        [header(at), numbers(&[4, 6]), sized(b"plumb_bob"), numbers(&[5]), doubles(0..5), doubles(10..31)];
    [parts.concat(), doubles(31..40), numbers(&[1, 2, 3, 4, 5, 6]), vec![1]].concat()
}

fn write(folder: &Path, connections: &[Connection<'_>], chunks: &[Chunk]) -> BagReader {
    let path = folder.join("old.bag");
    std::fs::write(&path, bag(connections, chunks)).expect("written");
    BagReader::open(&path).expect("a bag")
}

fn images(messages: &[RawMessage]) -> Vec<Image> {
    messages.iter().map(|m| cdr::from_slice(&m.data).expect("an image")).collect()
}

const S: u64 = 1_000_000_000;

#[test]
fn its_images_are_converted_and_all_else_is_told() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let connections = [
        ("/image", IMAGE),
        ("/tf", ("tf2_msgs/TFMessage", "94810edda583a504dfda3829e70d7eec")),
        ("/jpeg", COMPRESSED),
        ("/odd", ("sensor_msgs/Image", "00000000000000000000000000000000")),
        ("/info", INFO),
    ];
    // The second chunk begins before the first one ends.
    let chunks = [
        vec![
            (0, 5 * S, image(5 * S, 1)),
            (1, 5 * S + 1, vec![1]),
            (0, 7 * S, image(7 * S, 3)),
            (2, 8 * S, compressed(8 * S)),
        ],
        vec![
            (0, 6 * S, image(6 * S, 2)),
            (3, 6 * S, vec![2]),
            (3, 7 * S, vec![3]),
            (4, 9 * S, camera_info(9 * S)),
        ],
    ];
    let bag = write(folder.path(), &connections, &chunks);
    let read = read_all(&bag, &Selection::default());
    let order: Vec<_> = read.iter().map(|m| (m.log_time / S, m.topic.name.as_str())).collect();
    assert_eq!(order, [(5, "/image"), (6, "/image"), (7, "/image"), (8, "/jpeg"), (9, "/info")]);
    assert_eq!(bag.message_count(), 5);
    assert_eq!(bag.span(), Some((5 * S, 9 * S)));
    let found = images(&read[..3]);
    for (seed, image) in (1..).zip(&found) {
        assert_eq!(image.header.stamp.as_ns(), (4 + u64::from(seed)) * S);
        assert_eq!(
            (image.header.frame_id.as_str(), image.encoding.as_str(), image.step),
            ("camera", "rgb8", 18)
        );
        assert_eq!(image.clone().into_frame().expect("pixels"), frame(seed));
    }
    let jpeg: CompressedImage = cdr::from_slice(&read[3].data).expect("an image");
    assert_eq!((jpeg.format.as_str(), jpeg.data.as_slice()), ("png", &[1, 2, 3][..]));
    let info: CameraInfo = cdr::from_slice(&read[4].data).expect("a camera");
    assert_eq!((info.d.len(), info.k[0], info.r[0], info.p[11]), (5, 10.0, 19.0, 39.0));
    assert_eq!((info.binning_y, info.roi.width, info.roi.do_rectify), (2, 6, true));

    let told: Vec<_> = bag.warnings().iter().map(ToString::to_string).collect();
    assert_eq!(told.len(), 2, "{told:?}");
    assert!(
        told[0].contains("/tf") && told[0].contains("1 messages") && told[0].contains("tf2_msgs/TFMessage"),
        "{told:?}"
    );
    assert!(
        told[1].contains("/odd") && told[1].contains("2 messages") && told[1].contains("MD5"),
        "{told:?}"
    );
    assert!(bag.warnings().iter().all(BagWarning::is_loss));

    let some = Selection { topics: Some(vec!["/image".into()]), start_ns: Some(6 * S) };
    assert_eq!(read_all(&bag, &some).len(), 2);
}

#[test]
fn it_is_converted_and_read_as_a_source() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let chunk: Chunk = (0..4).map(|i| (0, i * S, image(i * S, i as u8))).collect();
    let old = write(folder.path(), &[("/image", IMAGE)], &[chunk]);
    let out = folder.path().join("new");
    copy(&old, &out, Compression::Lz4).expect("copied");
    for path in [folder.path().join("old.bag"), out] {
        let mut source = open(&path.display().to_string(), &SourceOptions::default()).expect("a source");
        for seed in 0..4 {
            let found = source.next().expect("a frame").expect("whole");
            assert_eq!(found.radiance.mapv(|v| (v * 255.0).round()), frame(seed).to_f32());
        }
        assert!(source.next().is_none());
    }
}

/// Two records of a chunk's index are swapped, as damage may leave them.
#[test]
fn a_chunk_that_ends_before_it_starts_is_read() {
    let (_folder, path) = temporary("swapped.bag");
    let mut bytes = bag(&[("/image", IMAGE)], &[(1..4).map(|i| (0, i * S, image(i * S, i as u8))).collect()]);
    let place = |name: &[u8]| bytes.windows(name.len()).position(|w| w == name).expect("there") + name.len();
    let (start, end) = (place(b"start_time="), place(b"end_time="));
    bytes[start..start + 8].copy_from_slice(&time(3 * S));
    bytes[end..end + 8].copy_from_slice(&time(S));
    std::fs::write(&path, &bytes).expect("written");
    let read = || BagReader::open(&path).expect("a bag");
    assert_eq!((read().span(), read_all(&read(), &Selection::default()).len()), (Some((S, 3 * S)), 3));
    let late = PlayOptions { start_offset: Duration::from_secs(9), ..PlayOptions::default() };
    let refused = Player::new(read(), &late).err().expect("beyond the end");
    let duration = Duration::from_secs(2);
    assert_eq!(refused, PlayError::StartOffset { offset: late.start_offset, duration });
    let mut player = Player::new(read(), &PlayOptions::default()).expect("possible");
    let due = std::iter::from_fn(|| player.next_message()).map(|due| due.expect("readable").position);
    assert_eq!(due.collect::<Vec<_>>(), [0, S, 2 * S]);
}

/// A few bytes of LZ4 can stand for any number of zeros.
#[test]
fn a_chunk_unpacks_to_the_size_of_its_header() {
    let (_folder, path) = temporary("packed.bag");
    let whole = bag(&[("/image", IMAGE)], &[vec![(0, S, image(S, 1))]]);
    let place = |name: &[u8]| whole.windows(name.len()).position(|w| w == name).expect("there");
    // The chunk begins with its operation, and goes on behind its data.
    let begin = place(b"op=\x05") - 8;
    let header = place(b"size=") + 9;
    let length = |at: usize| u32::from_le_bytes(whole[at..at + 4].try_into().expect("4 bytes")) as usize;
    let data = header + 4..header + 4 + length(header);
    let end = data.end;
    let first_error = |claimed: u32, data: &[u8]| {
        let mut encoder = lz4::EncoderBuilder::new().build(Vec::new()).expect("an encoder");
        std::io::Write::write_all(&mut encoder, data).expect("packed");
        let packed = encoder.finish().0;
        let fields: [(&str, &[u8]); 3] =
            [("op", &[5]), ("compression", b"lz4"), ("size", &claimed.to_le_bytes())];
        let chunk = record(&fields, &packed);
        let mut bytes = [&whole[..begin], &chunk, &whole[end..]].concat();
        let index = (place(b"index_pos=") + 10, length_of_index(&whole, begin, end, chunk.len()));
        bytes[index.0..index.0 + 8].copy_from_slice(&index.1.to_le_bytes());
        std::fs::write(&path, &bytes).expect("written");
        let bag = BagReader::open(&path).expect("its index is whole");
        let found = bag.messages(&Selection::default()).next().expect("a message or an error");
        found.map(|message| message.log_time).map_err(|why| why.to_string())
    };
    let data = &whole[data];
    assert_eq!(first_error(data.len() as u32, data), Ok(S));
    let zeros = [data, &vec![0; 8 << 20]].concat();
    let why = first_error(data.len() as u32, &zeros).expect_err("too much");
    assert!(why.contains(&format!("more than the {} bytes of its header", data.len())), "{why}");
    let why = first_error(3 << 30, data).expect_err("too much");
    assert!(why.contains("3221225472 bytes, more than 1073741824"), "{why}");
}

/// Where the index of `bag` begins when its only chunk, at `begin..end`, has another length.
fn length_of_index(bag: &[u8], begin: usize, end: usize, chunk: usize) -> u64 {
    let at = bag.windows(10).position(|w| w == b"index_pos=").expect("a header") + 10;
    let index = u64::from_le_bytes(bag[at..at + 8].try_into().expect("8 bytes"));
    index + chunk as u64 - (end - begin) as u64
}

#[test]
fn a_message_that_cannot_be_converted_is_left_out_and_counted() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let cut = |at: u64| image(at, 2)[..20].to_vec();
    let chunks = [
        vec![(0, S, image(S, 1)), (0, 2 * S, cut(2 * S)), (0, 5 * S, image(5 * S, 5))],
        vec![(0, 3 * S, cut(3 * S)), (0, 4 * S, image(4 * S, 4))],
    ];
    let old = write(folder.path(), &[("/image", IMAGE)], &chunks);
    let order: Vec<_> = old.messages(&Selection::default()).map(|m| m.map(|m| m.log_time / S).ok()).collect();
    assert_eq!(order, [Some(1), None, None, Some(4), Some(5)]);
    let out = folder.path().join("new");
    let copied = copy(&old, &out, Compression::None).expect("copied");
    let [left_out] = &copied.left_out[..] else { panic!("{:?}", copied.left_out) };
    assert!(left_out.is_loss() && copied.broke.is_none());
    let told = left_out.to_string();
    assert!(told.contains("2 messages of topic '/image'") && told.contains("20 bytes is cut"), "{told}");
    let new = BagReader::open(&out).expect("a bag");
    assert!(new.warnings().is_empty(), "{:?}", new.warnings());
    assert_eq!(new.message_count(), 3);
    let mut player = Player::new(old, &PlayOptions::default()).expect("possible");
    assert_eq!(std::iter::from_fn(|| player.next_message()).filter(Result::is_ok).count(), 3);
    assert_eq!(player.left_out(), 2);
}

#[test]
fn a_bag_that_was_not_closed_is_refused_with_the_remedy() {
    let (_folder, path) = temporary("open.bag");
    let whole = bag(&[("/image", IMAGE)], &[vec![(0, S, image(S, 1))]]);
    let mut open = whole.clone();
    let at = open.windows(10).position(|w| w == b"index_pos=").expect("a header") + 10;
    open[at..at + 8].fill(0);
    for (bytes, word) in [
        (&open[..], "never closed"),
        (&whole[..4200], "4200"),
        (&whole[..whole.len() - 5], "out of bounds"),
        (&whole[..30], "cut"),
        (b"#ROSBAG V1.2\n", "2.0"),
    ] {
        std::fs::write(&path, bytes).expect("written");
        let error = BagReader::open(&path).expect_err(word).to_string();
        assert!(error.contains(word) && error.contains("reindex"), "{error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(500))]

    #[test]
    fn wrong_bytes_never_panic(
        cut in any::<prop::sample::Index>(),
        near in 0..2_usize,
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
    ) {
        let messages = |i: u64| (0, i * S, image(i * S, i as u8));
        let mut bytes = bag(&[("/image", IMAGE), ("/info", INFO)], &[(0..3).map(messages).collect(), (3..6).map(messages).collect()]);
        if changes.len() % 3 == 0 {
            bytes.truncate(cut.index(bytes.len()));
        }
        for (at, value) in changes {
            // The 4 kB of padding in the header are no target.
            let targets = [0..bytes.len().min(100), bytes.len().min(4096)..bytes.len()];
            let target = targets[near].clone();
            if !target.is_empty() {
                bytes[target.start + at.index(target.len())] = value;
            }
        }
        let (_folder, path) = temporary("wrong.bag");
        std::fs::write(&path, &bytes).expect("written");
        if let Ok(bag) = BagReader::open(&path) {
            prop_assert!(bag.messages(&Selection::default()).count() <= 1000);
        }
    }
}
