//! Compares three merged captures with one capture, on scenes with known truth.

use std::path::Path;

use modulo_detector::EngineChoice;
use modulo_eval::data::Data;
use modulo_eval::grid::{Axes, Deblur, Event, GridError, Options, Request, Suite, draw_pictures, run};
use modulo_eval::report;
use modulo_eval::results::{Cell, Results, Stream};
use modulo_runtime::SystemClock;

fn request(data: Data, streams: &[Stream], out: &Path) -> Request {
    let axes = Axes {
        stream: streams.to_vec(),
        method: vec!["auto".to_owned()],
        deblur: Deblur::Off,
        alpha: vec![4.0],
        ..Axes::default()
    };
    let options = Options { axes, engine: EngineChoice::Rten, jobs: 2, ..Options::default() };
    Request { data, options, processor: String::new(), out: out.to_owned() }
}

fn results(request: &Request) -> Result<Results, GridError> {
    run(request, &Suite, &SystemClock::default(), &|_: Event<'_>| {}).map(|outcome| outcome.results)
}

fn cell(results: &Results, stream: Stream) -> &Cell {
    results.cells.iter().rev().find(|cell| cell.point.stream == stream).expect("the cell")
}

#[test]
fn what_moves_has_ghosts_in_three_captures_and_none_in_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let streams = [Stream::Ideal, Stream::Recovered, Stream::MultiExposure, Stream::MultiExposureStill];
    let scene = "scene://glare?seed=3&frames=6&width=480&height=144";
    let request = request(Data::Any(scene.to_owned()), &streams, folder.path());
    let results = results(&request).expect("results");
    let psnr = |stream| cell(&results, stream).psnr_db.unwrap_or(f64::INFINITY);
    let [one, moving, still] =
        [Stream::Recovered, Stream::MultiExposure, Stream::MultiExposureStill].map(psnr);
    assert!(still > 45.0, "merged captures of a still scene are nearly ideal: {still} dB");
    assert!(moving < still - 10.0, "the ghosts: {moving} dB against {still} dB");
    assert!(one > moving + 10.0, "one capture has none: {one} dB against {moving} dB");
    let merged = cell(&results, Stream::MultiExposure);
    assert_eq!((merged.frames, merged.exact_k), (6, None));
    assert!(merged.latency_ms.contains_key("merge"));

    let pictures = draw_pictures(&request, &Suite, &SystemClock::default(), &results).expect("pictures");
    report::save_pictures(folder.path(), &pictures).expect("kept");
    let page = std::fs::read_to_string(report::write(folder.path()).expect("a page")).expect("readable");
    assert!(page.contains("multi_exposure_still") && page.contains("data:image/jpeg;base64,"));
    assert!(folder.path().join("charts/pictures_streams.png").is_file());
    // The page is the same if it is written again from the files.
    assert_eq!(
        page,
        std::fs::read_to_string(report::write(folder.path()).expect("a page")).expect("readable")
    );
}

#[test]
fn frames_that_do_not_follow_each_other_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let data = Data::Kitti { folder: folder.path().to_owned(), list: None };
    let why = results(&request(data, &[Stream::MultiExposure], folder.path())).expect_err("refused");
    assert!(why.to_string().contains("multi_exposure_still"), "{why}");
}
