//! `bench unwrap` on synthetic frames.

use std::path::Path;

use clap::Parser;
use modulo_bench::benchmark::{META, Meta, RESULTS, Request, Row, unwrap};
use modulo_bench::{BenchError, Event};
use modulo_core::Frame;
use modulo_core::unwrap::METHODS;
use modulo_images::save_png;
use ndarray::Array3;

/// Writes a slope that every method can unwrap.
fn slope(path: &Path, width: usize) {
    let codes = Array3::from_shape_fn((24, width, 3), |(i, j, c)| (i + 2 * j + 5 * c) as u8);
    save_png(path, &Frame::from_u8(codes).expect("an image")).expect("a writable folder");
}

#[test]
fn rows_are_written_as_they_come() {
    let folder = tempfile::tempdir().unwrap();
    let (frames, out) = (folder.path().join("frames"), folder.path().join("out"));
    std::fs::create_dir(&frames).unwrap();
    slope(&frames.join("a.png"), 40);
    slope(&frames.join("b.PNG"), 32);
    std::fs::write(frames.join("broken.jpg"), b"").unwrap();
    std::fs::write(frames.join("notes.txt"), b"").unwrap();
    let words = ["bench", "--alpha", "2,4", "--threads", "1,2", "--repeats", "2", "--out"].map(Path::new);
    let request = Request::parse_from(words.iter().chain([&&*out, &Path::new("--frames"), &&*frames]));
    let read = || -> Vec<Row> {
        std::fs::read(out.join(RESULTS)).map_or(vec![], |text| serde_json::from_slice(&text).unwrap())
    };
    let outcome = unwrap(&request, &mut |event| {
        if let Event::Step { done, total, .. } = event {
            assert_eq!((read().len(), total), (done, 4 * METHODS.len()));
        }
    })
    .unwrap();
    assert_eq!(read(), outcome.rows);
    assert_eq!(outcome.rows.len(), 4 * METHODS.len());
    assert_eq!(outcome.skipped.len(), 1);
    assert!(outcome.skipped[0].why.contains("broken.jpg"), "{:?}", outcome.skipped);
    let samples = (24 * 40 + 24 * 32) * 3;
    for (row, &name) in outcome.rows.iter().zip(METHODS.iter().cycle()) {
        assert_eq!((row.method.as_str(), row.frames, row.samples), (name, 2, Some(samples)));
        assert!(row.ms_p5 <= Some(row.ms_p50) && Some(row.ms_p50) <= row.ms_p95 && row.ms_p50 > 0.0);
        assert!(row.exact_k < 1.0 || row.psnr_db.is_none(), "{row:?}");
    }
    // The threads that a method is given change no result.
    for rows in outcome.rows.chunks(2 * METHODS.len()) {
        for (one, two) in rows[..METHODS.len()].iter().zip(&rows[METHODS.len()..]) {
            assert_eq!((one.threads, two.threads), (1, 2));
            assert_eq!((one.exact_k, one.psnr_db), (two.exact_k, two.psnr_db));
        }
    }
    let meta: Meta = serde_json::from_slice(&std::fs::read(out.join(META)).unwrap()).unwrap();
    assert_eq!(meta, outcome.meta);
    assert_eq!(meta.sizes.iter().map(|size| size.frames).sum::<usize>(), 2);
}

#[test]
fn the_list_has_the_fields_that_peers_merge_with() {
    let peer = r#"{"method": "numpy_spud", "alpha": 4, "psf_sigma": 1.4, "threads": 1, "ms_p50": 60.5,
                   "exact_k": 0.5, "psnr_db": null, "frames": 20}"#;
    let row: Row = serde_json::from_str(peer).unwrap();
    let value = serde_json::to_value(&row).unwrap();
    assert_eq!(value, serde_json::from_str::<serde_json::Value>(&peer.replace(": 4,", ": 4.0,")).unwrap());
}

#[test]
fn a_wrong_request_is_refused_before_anything_is_measured() {
    let folder = tempfile::tempdir().unwrap();
    let empty = folder.path().to_owned();
    let fails = |change: &dyn Fn(&mut Request)| {
        let mut request = Request::parse_from(["bench", "--out", empty.join("out").to_str().expect("UTF-8")]);
        request.frames = Some(empty.clone());
        change(&mut request);
        unwrap(&request, &mut |_| ()).unwrap_err()
    };
    assert!(matches!(fails(&|_| ()), BenchError::NoFrames { .. }));
    assert!(matches!(fails(&|r| r.frames = Some(empty.join("nowhere"))), BenchError::Io { .. }));
    assert_eq!(fails(&|r| r.repeats = 0).to_string(), "repeats is 0, but must be 1 or more");
    assert!(matches!(fails(&|r| r.threads = vec![0]), BenchError::Unwrap(_)));
    assert!(matches!(fails(&|r| r.method.clear()), BenchError::Empty { .. }));
}
