//! Spike recordings as sources: frames that are sums of readings, and files that are none.

use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::DeflateEncoder;
use modulo_bags::source::{Source, SourceError, SourceOptions, open};
use modulo_images::Coding;

use crate::damaged_pictures::damage;
use crate::readings::{npy, packed_zip, readings, recording, resets, zip};

/// Readings, rows and columns.
const SHAPE: (usize, usize, usize) = (50, 6, 8);
const PIXELS: usize = SHAPE.1 * SHAPE.2;

fn example() -> Vec<u8> {
    readings(
        SHAPE,
        |row, column| if (row + column) % 7 == 0 { 1.0 } else { (8 * row + column) as f64 / 60.0 },
    )
}

/// The example with the compression of ZIP.
fn deflated() -> Vec<u8> {
    let content = npy("|b1", "False", "(50, 6, 8)", &example());
    let mut encoder = DeflateEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(&content).expect("no file");
    packed_zip("spk.npy", &content, 8, &encoder.finish().expect("no file"))
}

fn opened(path: &Path, window: &str, white: f32) -> Result<Source, SourceError> {
    let coding = Coding { white, ..Coding::default() };
    open(&format!("{}{window}", path.display()), &SourceOptions { coding, topic: None })
}

/// The resets of the next frame.
fn next(source: &mut Source) -> Option<Vec<u16>> {
    let frame = source.next()?.expect("a frame");
    let full = frame.full_resets.expect("counted");
    assert_eq!(frame.radiance.dim(), (6, 8, 1));
    Some(frame.radiance.iter().map(|share| (share * full) as u16).collect())
}

#[test]
fn a_frame_is_the_sum_of_a_window() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.npz");
    for whole in [recording(SHAPE, &example()), deflated()] {
        std::fs::write(&path, whole).expect("written");
        for (window, white) in [(1, 0.0), (7, 0.0), (25, 0.0), (50, 0.0), (7, 8.0), (50, 1e6)] {
            let mut source = opened(&path, &format!("?window={window}"), white).expect("a recording");
            assert_eq!(source.len, Some(50 / window));
            let expected: Vec<_> =
                (0..50 / window).map(|at| resets(&example(), PIXELS, at * window, window)).collect();
            for _ in 0..2 {
                let found: Vec<_> = std::iter::from_fn(|| next(&mut source)).collect();
                assert_eq!(found, expected, "window {window}, white {white}");
                source.rewind();
            }
            source.pass(3);
            assert_eq!(next(&mut source), expected.get(3).cloned());
            source.pass(u64::MAX);
            assert!(source.next().is_none());
            let told = source.warnings.concat();
            assert_eq!(told.is_empty(), 50 % window == 0, "{told}");
            assert!(told.is_empty() || told.contains("the last 1 of 50 readings"), "{told}");
        }
    }
    // A pixel resets at each reading.
    let why = opened(&path, "?window=25", 25.0).err().expect("too bright").to_string();
    assert!(why.contains("has 25 resets in a frame, but white is 25; give more, or 0"), "{why}");
    let brightest =
        opened(&path, "?window=25", 0.0).expect("a recording").next().expect("a frame").expect("a frame");
    assert_eq!(
        brightest.full_resets,
        Some(26.0),
        "without a white, the brightest pixel is just below full scale"
    );
}

#[test]
fn a_window_that_is_not_possible_is_named_with_those_that_are() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.NPZ");
    std::fs::write(&path, recording(SHAPE, &example())).expect("written");
    for window in
        ["", "?window=0", "?window=51", "?window=-1", "?window=1.5", "?readings=5", "?window=5&light=dusk"]
    {
        let why = opened(&path, window, 0.0).err().expect("refused").to_string();
        assert!(why.contains("a.NPZ?window=50") && why.contains("1 to 50,") || why.contains("dusk"), "{why}");
    }
    let relit = opened(&path, "?window=5&light=trees", 0.0).expect("a source").next().expect("a frame");
    assert_eq!(relit.expect("a frame").full_resets, Some(6.0), "resets in another light are resets");
    std::fs::write(&path, recording((70_000, 1, 1), &[1; 70_000])).expect("written");
    let why = opened(&path, "", 0.0).err().expect("refused").to_string();
    assert!(why.contains("has 70000 readings") && why.contains("1 to 65535"), "{why}");
    let frame =
        opened(&path, "?window=65535", 0.0).expect("a source").next().expect("a frame").expect("a frame");
    assert_eq!((frame.radiance[(0, 0, 0)] * 65536.0).floor(), 65535.0);
}

#[test]
fn what_is_no_recording_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.npz");
    let array = |kind: &str, order: &str, shape: &str, values: &[u8]| {
        zip("spk.npy", &npy(kind, order, shape, values))
    };
    let (whole, many) = (recording(SHAPE, &example()), "4294967296");
    let of_size = |shape: &str| array("|u1", "False", shape, &[1; 12]);
    for (bytes, words) in [
        (Vec::new(), &["a.npz: is cut, or no archive of numpy", "copy it again"][..]),
        (whole[..whole.len() - 1].to_vec(), &["copy it again"]),
        (whole[..1000].to_vec(), &["copy it again"]),
        (zip("label.npy", b"1"), &["has no array spk.npy", "savez_compressed(FILE, spk="]),
        (zip("spk.npy", b""), &["spk has 0 bytes"]),
        (zip("spk.npy", b"no array of numpy"), &["spk has 17 bytes"]),
        (packed_zip("spk.npy", b"1", 12, b"1"), &["is compressed by", "not stored or deflated"]),
        (array("<f4", "False", "(1, 1, 3)", &[0; 12]), &["'descr': '<f4'", "T x H x W bytes", "'uint8'"]),
        (array("|u1", "True", "(3, 2, 2)", &[1; 12]), &["'fortran_order': True", "order='C'"]),
        (of_size("(12,)"), &["12 bytes", "'shape': (12,)"]),
        (of_size("(3, 2, 2, 1)"), &["'shape': (3, 2, 2, 1)"]),
        (of_size("(0, 5, 4)"), &["'shape': (0, 5, 4)"]),
        (array("|u1", "False", "(0, 5, 4)", &[]), &["spk has 0 bytes"]),
        (of_size(&format!("({many}, {many}, {many})")), &["spk has 12 bytes", many]),
        (of_size("(3, 2, 3)"), &["spk has 12 bytes", "'shape': (3, 2, 3)"]),
        (of_size("(3, -2, -2)"), &["'shape': (3, -2, -2)"]),
        (
            array("|u1", "False", "(3, 2, 2)", &[0, 1, 1, 0, 1, 0, 1, 2, 0, 1, 1, 1]),
            &["value 7 of spk is 2, but 0 and 1"],
        ),
    ] {
        std::fs::write(&path, bytes).expect("written");
        let why = opened(&path, "?window=1", 0.0).err().expect("refused").to_string();
        assert!(why.contains("a.npz: ") && words.iter().all(|word| why.contains(word)), "{words:?}: {why}");
    }
    let why = opened(&folder.path().join("b.npz"), "?window=1", 0.0).err().expect("refused").to_string();
    assert!(why.contains("b.npz: No such file"), "{why}");
}

#[test]
fn damage_to_recordings_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.npz");
    let read = |bytes: &[u8]| {
        std::fs::write(&path, bytes).expect("written");
        let mut source = opened(&path, "?window=5", 0.0).ok()?;
        std::iter::from_fn(|| source.next()).collect::<Result<Vec<_>, _>>().ok()
    };
    damage("spikes", &deflated(), 1000, read, (0, "an archive of numpy has checksums"));
}
