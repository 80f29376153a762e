//! `simulate` on synthetic images.

use std::path::Path;

use clap::Parser;
use modulo_bench::simulate::{RESULTS, Request, Row, simulate};
use modulo_bench::{BenchError, Event};
use modulo_core::Frame;
use modulo_core::unwrap::METHODS;
use modulo_images::{read_image, save_png};
use modulo_scene::{Preset, Scene};
use ndarray::Array3;

/// The request of a command line for `files` with a perfect lens.
fn request(out: &Path, files: &[&Path]) -> Request {
    let words = ["simulate", "--psf-sigma", "0", "--out"].map(Path::new);
    Request::parse_from(words.iter().chain([&out]).chain(files))
}

/// Writes a frame of a procedural scene as 8-bit PNG.
fn street(path: &Path) {
    let codes = Scene::new(Preset::Glare, 1).render(0, 60, 100).radiance.mapv(|v| (v * 256.0) as u8);
    save_png(path, &Frame::from_u8(codes).expect("an image")).expect("a writable folder");
}

fn pixels(path: &Path) -> Array3<u8> {
    read_image(path).expect("a picture").as_u8().expect("8 bits").clone()
}

#[test]
fn every_file_alpha_and_method_has_a_row_and_a_picture() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("street.png"), folder.path().join("out"));
    street(&file);
    let methods: Vec<String> = METHODS.iter().map(|&name| name.to_owned()).collect();
    let request = Request { alpha: vec![1.0, 2.5], method: methods.clone(), ..request(&out, &[&file]) };
    let mut steps = Vec::new();
    let outcome = simulate(&request, &mut |event| {
        if let Event::Step { done, total, .. } = event {
            steps.push((done, total));
        }
    })
    .unwrap();
    assert_eq!(steps, [(0, 2), (1, 2)]);
    let written: Vec<Row> = serde_json::from_slice(&std::fs::read(out.join(RESULTS)).unwrap()).unwrap();
    assert_eq!(written, outcome.rows);
    assert_eq!(written.len(), 2 * methods.len());
    for (index, row) in written.iter().enumerate() {
        assert_eq!(row.method, methods[index % methods.len()]);
        assert_eq!(row.file, file.display().to_string());
        let alpha = [1.0, 2.5][index / methods.len()];
        assert_eq!(row.alpha, alpha);
        let picture = |stream: &str| pixels(&out.join(format!("street_alpha{alpha}_{stream}.png")));
        let (ideal, recovered) = (picture("ideal"), picture(&row.method));
        assert_eq!(row.psnr_db.is_none(), ideal == recovered, "{row:?}");
        assert_eq!(row.exact_k == 1.0, ideal == recovered, "{row:?}");
        assert_eq!(row.ssim.unwrap() > 1.0 - 1e-12, ideal == recovered, "{row:?}");
        // At alpha 1 nothing wraps, and the sensor's codes are the picture.
        assert!(alpha > 1.0 || picture("modulo") == picture("saturated"), "{row:?}");
        assert!(alpha > 1.0 || row.exact_k == 1.0, "{row:?}");
    }
}

#[test]
fn a_file_that_cannot_be_read_is_named_and_the_others_go_on() {
    let folder = tempfile::tempdir().unwrap();
    let (good, bad) = (folder.path().join("good.png"), folder.path().join("bad.png"));
    street(&good);
    std::fs::write(&bad, b"no picture").unwrap();
    let request = |files: &[&Path]| Request {
        method: vec!["spud".to_owned()],
        ..request(&folder.path().join("out"), files)
    };
    let mut told = Vec::new();
    let outcome = simulate(&request(&[&bad, &good]), &mut |event| {
        if let Event::Skipped(skipped) = event {
            told.push(skipped.clone());
        }
    })
    .unwrap();
    assert_eq!(outcome.rows.len(), 1);
    assert_eq!(outcome.skipped, told);
    assert_eq!(told[0].file, bad.display().to_string());
    assert!(told[0].why.contains("bad.png"), "{}", told[0].why);
    let alone = simulate(&request(&[&bad]), &mut |_| ()).unwrap_err();
    assert!(matches!(&alone, BenchError::Image(_)) && alone.to_string().contains("bad.png"), "{alone}");
}

#[test]
fn a_wrong_request_is_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let request = |change: &dyn Fn(&mut Request)| {
        let mut request = request(&out, &[Path::new("x.png")]);
        change(&mut request);
        simulate(&request, &mut |_| ()).unwrap_err().to_string()
    };
    assert_eq!(request(&|r| r.images.clear()), "the list of files is empty; at least one entry is needed");
    assert!(request(&|r| r.alpha = vec![0.0]).starts_with("alpha is 0"));
    assert!(request(&|r| r.method = vec!["best".into()]).contains("method \"best\" is unknown"));
    assert!(request(&|r| r.white = -1.0).starts_with("white = -1"));
    assert!(!out.exists());
}
