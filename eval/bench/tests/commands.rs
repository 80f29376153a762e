//! `bench unwrap` and its chart, and `simulate`, on synthetic images. The labels of the chart must be readable.

use std::path::Path;

use clap::Parser;
use modulo_bench::benchmark::{self, BenchmarkRequest, BenchmarkRow, META, Meta};
use modulo_bench::frontier::{draw_frontier, frontier_from};
use modulo_bench::recover::{self, UnwrapRequest};
use modulo_bench::simulate::{self, SimulationRequest, SimulationRow};
use modulo_bench::{BenchError, BenchEvent};
use modulo_core::unwrap::METHODS;
use modulo_core::{Frame, Mosaic};
use modulo_draw::PageWidth;
use modulo_images::{FileFormat, decode, encode, read_image, save_png};
use modulo_scene::{Preset, Scene};
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
    let request =
        BenchmarkRequest::parse_from(words.iter().chain([&&*out, &Path::new("--frames"), &&*frames]));
    let read = || -> Vec<BenchmarkRow> {
        std::fs::read(out.join(benchmark::RESULTS))
            .map_or(vec![], |text| serde_json::from_slice(&text).unwrap())
    };
    let outcome = benchmark::unwrap(&request, &mut |event| {
        if let BenchEvent::Step { done, total, .. } = event {
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
    let row: BenchmarkRow = serde_json::from_str(peer).unwrap();
    let value = serde_json::to_value(&row).unwrap();
    assert_eq!(value, serde_json::from_str::<serde_json::Value>(&peer.replace(": 4,", ": 4.0,")).unwrap());
}

#[test]
fn a_wrong_benchmark_is_refused_before_anything_is_measured() {
    let folder = tempfile::tempdir().unwrap();
    let empty = folder.path().to_owned();
    let fails = |change: &dyn Fn(&mut BenchmarkRequest)| {
        let mut request =
            BenchmarkRequest::parse_from(["bench", "--out", empty.join("out").to_str().expect("UTF-8")]);
        request.frames = Some(empty.clone());
        change(&mut request);
        benchmark::unwrap(&request, &mut |_| ()).unwrap_err()
    };
    assert!(matches!(fails(&|_| ()), BenchError::NoFrames { .. }));
    assert!(matches!(fails(&|r| r.frames = Some(empty.join("nowhere"))), BenchError::Io { .. }));
    assert_eq!(fails(&|r| r.repeats = 0).to_string(), "repeats is 0, but must be 1 or more");
    assert!(matches!(fails(&|r| r.threads = vec![0]), BenchError::Unwrap(_)));
    assert!(matches!(fails(&|r| r.method.clear()), BenchError::Empty { .. }));
}

/// Text and left, top, right, bottom of each horizontal text of an SVG.
fn texts(svg: &str) -> Vec<(String, [f64; 4])> {
    let attribute = |line: &str, name: &str| -> String {
        let (_, rest) = line.split_once(&format!(" {name}=\"")).unwrap_or_else(|| panic!("{name}: {line}"));
        rest.split('"').next().unwrap_or_default().to_owned()
    };
    let number = |line: &str, name: &str| attribute(line, name).parse::<f64>().expect("a number");
    let level = |line: &&str| line.starts_with("<text") && !line.contains("rotate");
    let area = |line: &str| {
        let (x, y, size) = (number(line, "x"), number(line, "y"), number(line, "font-size"));
        let width = number(line, "textLength");
        let left = match attribute(line, "text-anchor").as_str() {
            "start" => x,
            "middle" => x - width / 2.0,
            _ => x - width,
        };
        // Capitals and digits of the font are 0.73 of its size high.
        let text = line.split('>').nth(1).and_then(|rest| rest.split('<').next()).unwrap_or_default();
        (text.to_owned(), [left, y - 0.73 * size, left + width, y])
    };
    svg.lines().filter(level).map(area).collect()
}

/// Rows of many methods with equal times and accuracies, which are hard to label.
fn crowded() -> Vec<BenchmarkRow> {
    let mut rows = Vec::new();
    for (number, method) in ('a'..='p').enumerate() {
        for alpha in [1.5, 2.0, 3.0, 4.0, 8.0] {
            let wrong = if alpha > 4.0 { 0.1 * number as f64 / 16.0 } else { 0.0 };
            rows.push(BenchmarkRow {
                method: format!("method_{method}"),
                alpha,
                psf_sigma: 1.4,
                threads: 1,
                ms_p50: 20.0 + 3.0 * number as f64 + alpha,
                ms_p5: None,
                ms_p95: None,
                exact_k: 1.0 - wrong,
                psnr_db: None,
                frames: 20,
                samples: None,
            });
        }
    }
    rows
}

fn store(folder: &Path, rows: &[BenchmarkRow]) -> std::path::PathBuf {
    let path = folder.join("results.json");
    std::fs::write(&path, serde_json::to_vec(rows).expect("rows are JSON")).expect("a writable folder");
    path
}

#[test]
fn no_text_lies_on_another_or_leaves_the_picture() {
    let folder = tempfile::tempdir().unwrap();
    let svg = frontier_from(&store(folder.path(), &crowded())).unwrap().svg(PageWidth::Wide).unwrap();
    let found = texts(&svg);
    assert!(found.len() > 16 + 16 * 2, "only {} texts", found.len());
    for (i, (text, a)) in found.iter().enumerate() {
        assert!(a[0] >= 0.0 && a[1] >= 0.0 && a[2] <= 1200.0, "{text} at {a:?}");
        for (other, b) in &found[..i] {
            let apart = a[0] >= b[2] || b[0] >= a[2] || a[1] >= b[3] || b[1] >= a[3];
            assert!(apart, "{text:?} at {a:?} lies on {other:?} at {b:?}");
        }
    }
    for letter in 'a'..='p' {
        assert_eq!(svg.matches(&format!(">method_{letter}<")).count(), 1);
    }
}

#[test]
fn both_pictures_are_written_and_the_same_each_time() {
    let folder = tempfile::tempdir().unwrap();
    let results = store(folder.path(), &crowded());
    let [svg, png] = draw_frontier(&results).unwrap();
    let first = (std::fs::read(&svg).unwrap(), std::fs::read(&png).unwrap());
    draw_frontier(&results).unwrap();
    assert!(first == (std::fs::read(&svg).unwrap(), std::fs::read(&png).unwrap()));
    let picture = decode(&first.1, "frontier").unwrap();
    assert_eq!((picture.width(), picture.channels()), (2400, 3));
    let inked = picture.to_f32().iter().filter(|value| **value < 128.0).count();
    assert!(inked > 20_000, "{inked} dark samples");
}

#[test]
fn results_that_are_none_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("results.json");
    assert!(matches!(frontier_from(&path), Err(BenchError::Io { .. })));
    std::fs::write(&path, "[{\"method\": \"x\"}]").unwrap();
    let why = frontier_from(&path).unwrap_err().to_string();
    assert!(why.contains("results.json") && why.contains("alpha"), "{why}");
    std::fs::write(&path, "[]").unwrap();
    assert!(matches!(frontier_from(&path), Err(BenchError::Empty { .. })));
}

/// The request of a command line with `options` for `files`.
fn request_with(options: &str, out: &Path, files: &[&Path]) -> SimulationRequest {
    let words = ["simulate", "--out"].map(Path::new);
    let options = options.split_whitespace().map(Path::new);
    SimulationRequest::parse_from(words.into_iter().chain([out]).chain(options).chain(files.iter().copied()))
}

/// A request with a perfect lens.
fn request(out: &Path, files: &[&Path]) -> SimulationRequest {
    request_with("--psf-sigma 0", out, files)
}

/// Writes a frame of a procedural scene as 8-bit PNG.
fn street(path: &Path) {
    let codes = Scene::new(Preset::Glare, 1).render(0, 60, 100).radiance.mapv(|v| (v * 255.0).round() as u8);
    save_png(path, &Frame::from_u8(codes).expect("an image")).expect("a writable folder");
}

fn pixels(path: &Path) -> Array3<u8> {
    read_image(path).expect("a picture").as_u8().expect("8 bits").clone()
}

/// Headroom is taken away when an image is shown, by `simulate` and by `unwrap`: the picture returns within a code.
#[test]
fn a_picture_returns_from_the_sensor_whatever_its_headroom() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("slope.png");
    let codes = Array3::from_shape_fn((40, 128, 3), |(i, j, c)| (2 * j).min(255 - i - c) as u8);
    save_png(&file, &Frame::from_u8(codes.clone()).expect("an image")).expect("a writable folder");
    for headroom in ["1", "0.97", "0.6"] {
        let [simulated, out] = ["simulated", "out"].map(|name| folder.path().join(name).join(headroom));
        let with = request_with(&format!("--psf-sigma 0 --headroom {headroom}"), &simulated, &[&file]);
        let rows = simulate::simulate(&with, &mut |_| {}).unwrap().rows;
        assert!(rows[0].exact_k == 1.0, "headroom {headroom}: {rows:?}");
        let modulo = simulated.join("slope_alpha4_modulo.png");
        let words = ["unwrap", "--alpha", "4", "--headroom", headroom, "-o"].map(Path::new);
        let words = words.into_iter().chain([out.as_path(), modulo.as_path()]);
        recover::unwrap_files(&UnwrapRequest::parse_from(words), &mut |_| {}).unwrap();
        for shown in [
            simulated.join("slope_alpha4_ideal.png"),
            simulated.join("slope_alpha4_auto.png"),
            out.join("slope_alpha4_modulo_auto.png"),
        ] {
            let apart = pixels(&shown).iter().zip(&codes).map(|(a, b)| a.abs_diff(*b)).max();
            assert!(apart <= Some(1), "headroom {headroom}, {}: {apart:?} codes", shown.display());
        }
    }
}

#[test]
fn two_gains_have_a_method_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("street.png"), folder.path().join("out"));
    street(&file);
    let request = request_with("--psf-sigma 0 --gains checkerboard", &out, &[&file]);
    let rows = simulate::simulate(&request, &mut |_| {}).unwrap().rows;
    let [row] = &rows[..] else { panic!("one alpha, one method: {rows:?}") };
    assert_eq!((row.sensor.gains, row.method.as_str()), (true, "checkerboard_gains"));
    assert!(row.exact_k > 0.95, "{}", row.exact_k);
    assert!(out.join("street_alpha4_checkerboard_gains.png").is_file());
}

#[test]
fn a_mosaic_is_unwrapped_and_demosaiced() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("street.png"), folder.path().join("out"));
    street(&file);
    let request = request_with("--psf-sigma 0 --mosaic gbrg --alpha 2", &out, &[&file]);
    let rows = simulate::simulate(&request, &mut |_| {}).unwrap().rows;
    let [row] = &rows[..] else { panic!("one alpha, one method: {rows:?}") };
    assert_eq!(row.sensor.mosaic.map(Mosaic::word), Some("gbrg"));
    assert!(row.exact_k > 0.99, "{}", row.exact_k);
    assert_eq!(pixels(&out.join("street_alpha2_modulo.png")).dim().2, 1);
    assert_eq!(pixels(&out.join("street_alpha2_auto.png")).dim().2, 3);
}

#[test]
fn every_file_alpha_and_method_has_a_row_and_a_picture() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("street.png"), folder.path().join("out"));
    street(&file);
    let methods: Vec<String> = METHODS.iter().map(|&name| name.to_owned()).collect();
    let request = SimulationRequest {
        method: methods.clone(),
        ..request_with("--psf-sigma 0 --alpha 1,2.5", &out, &[&file])
    };
    let mut steps = Vec::new();
    let outcome = simulate::simulate(&request, &mut |event| {
        if let BenchEvent::Step { done, total, .. } = event {
            steps.push((done, total));
        }
    })
    .unwrap();
    assert_eq!(steps, [(0, 2), (1, 2)]);
    let written: Vec<SimulationRow> =
        serde_json::from_slice(&std::fs::read(out.join(simulate::RESULTS)).unwrap()).unwrap();
    assert_eq!(written, outcome.rows);
    assert_eq!(written.len(), 2 * methods.len());
    for (index, row) in written.iter().enumerate() {
        assert_eq!(row.method, methods[index % methods.len()]);
        assert_eq!(row.file, file.display().to_string());
        let alpha = [1.0, 2.5][index / methods.len()];
        assert_eq!(row.sensor.alpha, alpha);
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
    let request = |files: &[&Path]| SimulationRequest {
        method: vec!["spud".to_owned()],
        ..request(&folder.path().join("out"), files)
    };
    let mut told = Vec::new();
    let outcome = simulate::simulate(&request(&[&bad, &good]), &mut |event| {
        if let BenchEvent::Skipped(skipped) = event {
            told.push(skipped.clone());
        }
    })
    .unwrap();
    assert_eq!(outcome.rows.len(), 1);
    assert_eq!(outcome.skipped, told);
    assert_eq!(told[0].file, bad.display().to_string());
    assert!(told[0].why.contains("bad.png"), "{}", told[0].why);
    let alone = simulate::simulate(&request(&[&bad]), &mut |_| ()).unwrap_err();
    assert!(matches!(&alone, BenchError::Image(_)) && alone.to_string().contains("bad.png"), "{alone}");
}

#[test]
fn a_wrong_simulation_is_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let with = |options: &str, change: &dyn Fn(&mut SimulationRequest)| {
        let mut request = request_with(options, &out, &[Path::new("x.png")]);
        change(&mut request);
        simulate::simulate(&request, &mut |_| ()).unwrap_err().to_string()
    };
    let request = |change| with("", change);
    assert_eq!(request(&|r| r.images.clear()), "the list of files is empty; at least one entry is needed");
    assert!(request(&|r| r.method = vec!["best".into()]).contains("method \"best\" is unknown"));
    assert!(request(&|r| r.exposure.white = -1.0).starts_with("white = -1"));
    for (option, values, told) in [
        ("--alpha", "0", "'alpha' = 0"),
        ("--gains", "chess", "checkerboard"),
        // The names of the images have no lens.
        ("--psf-sigma", "0,1", "'psf_sigma' = 0,1"),
    ] {
        let words = ["simulate", "-o", "out", "x.png", option, values];
        let why = SimulationRequest::try_parse_from(words).unwrap_err().to_string();
        assert!(why.contains(told) && why.contains(values), "{why}");
    }
    let low = with("--gains checkerboard --gain-ratio 0.5", &|_| ());
    assert!(low.contains("'gain_ratio' = 0.5: must be at most 0.25"), "{low}");
    // The gains decide the method: one that was asked for would be ignored.
    let ignored = with("--gains checkerboard", &|r| r.method = vec!["spud".into()]);
    for told in ["--method spud", "--gains checkerboard", "checkerboard_gains"] {
        assert!(ignored.contains(told), "{told}: {ignored}");
    }
    let published = request(&|r| r.method = vec!["spud_as_published".into()]);
    assert!(published.contains("modulo eval") && published.contains("spud is the same"), "{published}");
    let wide = with("--bits 16", &|r| r.counts = true);
    assert!(wide.contains("--counts") && wide.contains("65536"), "{wide}");
    assert!(!out.exists());
}

#[test]
fn rows_of_different_sensors_differ() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("street.png"), folder.path().join("out"));
    street(&file);
    let request = request_with("--read-noise 3 --seed 9 --prnu 0.01", &out, &[&file]);
    simulate::simulate(&request, &mut |_| {}).unwrap();
    let text = std::fs::read_to_string(out.join(simulate::RESULTS)).unwrap();
    for field in ["bits", "psf", "psf_sigma", "shot_noise", "hot_pixels"] {
        assert!(text.contains(&format!("\"{field}\": ")), "{field}: {text}");
    }
    for value in ["\"read_noise\": 3.0", "\"seed\": 9", "\"prnu\": 0.01"] {
        assert!(text.contains(value), "{value}: {text}");
    }
}

/// y, the true k and the true x of `simulate` belong together, and `unwrap` finds them from y.
#[test]
fn a_modulo_image_is_unwrapped_as_the_simulation_did() {
    let folder = tempfile::tempdir().unwrap();
    let [file, simulated, out] = ["street.png", "simulated", "out"].map(|name| folder.path().join(name));
    street(&file);
    let with = request_with("--counts --psf-sigma 1.4 --optical-black 8", &simulated, &[&file]);
    let expected = simulate::simulate(&with, &mut |_| {}).unwrap().rows;
    let path = |what: &str| simulated.join(format!("street_alpha4_{what}.png"));
    let (y, k, x) = (pixels(&path("modulo")), pixels(&path("k")), read_image(&path("x")).unwrap());
    assert!(k.iter().any(|&k| k > 0), "the scene must wrap");
    let sum = y.iter().zip(&k).map(|(&y, &k)| f32::from(y) + 256.0 * f32::from(k));
    assert_eq!((x.depth(), sum.collect::<Vec<_>>()), (16, x.to_f32().into_iter().collect()));

    let modulo = path("modulo");
    let words = ["unwrap", "--alpha", "4", "--optical-black", "8", "-o"].map(Path::new);
    let words = words.into_iter().chain([out.as_path(), modulo.as_path()]);
    let rows = recover::unwrap_files(&UnwrapRequest::parse_from(words), &mut |_| {}).unwrap().rows;
    let [row] = &rows[..] else { panic!("one file, one method: {rows:?}") };
    assert_eq!((&row.method_used, row.trusted), (&expected[0].method_used, expected[0].trusted));
    for (ours, theirs) in [("auto", "auto"), ("auto_k", "auto_k"), ("auto_x", "auto_x")] {
        let ours = read_image(&out.join(format!("street_alpha4_modulo_{ours}.png"))).unwrap();
        assert_eq!(ours, read_image(&path(theirs)).unwrap(), "{theirs}");
    }
}

#[test]
fn what_is_no_image_of_the_sensor_is_not_unwrapped() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("street.png"), folder.path().join("out"));
    street(&file);
    let fails = |more: &[&str]| {
        let words = ["unwrap", file.to_str().unwrap(), "-o", out.to_str().unwrap()];
        match UnwrapRequest::try_parse_from(words.iter().chain(more)) {
            Ok(request) => recover::unwrap_files(&request, &mut |_| {}).unwrap_err().to_string(),
            Err(why) => why.to_string(),
        }
    };
    assert!(fails(&[]).contains("--alpha"), "it is required");
    assert!(fails(&["--alpha", "0"]).contains("'alpha' = 0"));
    assert!(fails(&["--alpha", "2", "--bits", "17"]).contains("'bits' = 17"));
    assert!(fails(&["--alpha", "8", "--bits", "14"]).contains("65536"));
    assert!(
        fails(&["--alpha", "2", "--gains", "checkerboard", "--method", "spud"])
            .contains("checkerboard_gains")
    );
    assert!(!out.exists());
    assert!(fails(&["--alpha", "2", "--bits", "4"]).contains("with 4 bits"), "codes above 15");
    assert!(fails(&["--alpha", "2", "--mosaic", "rggb"]).contains("channel"), "three channels");
}

/// A file that does not keep the codes of a sensor is refused by its content, whatever its name.
#[test]
fn only_files_that_keep_the_codes_are_unwrapped() {
    let folder = tempfile::tempdir().unwrap();
    let [file, simulated, out] = ["street.png", "simulated", "out"].map(|name| folder.path().join(name));
    street(&file);
    let with = request_with("--psf-sigma 1.4 --optical-black 8", &simulated, &[&file]);
    simulate::simulate(&with, &mut |_| {}).unwrap();
    let good = simulated.join("street_alpha4_modulo.png");
    let jpeg = folder.path().join("jpeg.png");
    std::fs::write(&jpeg, encode(&read_image(&good).unwrap(), FileFormat::Jpeg).unwrap()).unwrap();
    let unwrap = |files: &[&Path], bits: &str| {
        let words = ["unwrap", "--alpha", "4", "--optical-black", "8", "--bits", bits, "-o"].map(Path::new);
        let words = words.into_iter().chain([out.as_path()]).chain(files.iter().copied());
        recover::unwrap_files(&UnwrapRequest::parse_from(words), &mut |_| {})
    };
    for (file, bits, told) in
        [(&jpeg, "8", "destroys the wraps"), (&good, "10", "not the codes of a sensor of 10 bits")]
    {
        let why = unwrap(&[file], bits).expect_err("no codes");
        let name = file.display().to_string();
        assert!(matches!(&why, BenchError::NotCodes(..)), "{why}");
        assert!(why.to_string().contains(told) && why.to_string().contains(&name), "{why}");
        assert!(!out.exists(), "{why}");
    }
    let outcome = unwrap(&[&jpeg, &good], "8").unwrap();
    assert_eq!((outcome.rows.len(), outcome.skipped.len()), (1, 1));
}

/// A folder stands for the images in it; hidden files are none, and others are counted.
#[test]
fn a_folder_stands_for_its_images() {
    let folder = tempfile::tempdir().unwrap();
    let [pictures, simulated, out] = ["pictures", "simulated", "out"].map(|name| folder.path().join(name));
    std::fs::create_dir(&pictures).unwrap();
    ["b.png", "a.png"].iter().for_each(|name| street(&pictures.join(name)));
    for other in ["notes.txt", "labels.json", "._a.png"] {
        std::fs::write(pictures.join(other), "no picture").unwrap();
    }
    let mut told = Vec::new();
    let rows = simulate::simulate(&request(&simulated, &[&pictures]), &mut |event| {
        if let BenchEvent::Warning(warning) = event {
            told.push(warning.to_owned());
        }
    });
    let files: Vec<_> = rows.unwrap().rows.into_iter().map(|row| row.file).collect();
    assert_eq!(files, ["a.png", "b.png"].map(|name| pictures.join(name).display().to_string()));
    assert!(
        told.len() == 1 && told[0].contains("2 in number") && told[0].contains("labels.json"),
        "{told:?}"
    );
    let codes = folder.path().join("codes");
    std::fs::create_dir(&codes).unwrap();
    std::fs::copy(simulated.join("a_alpha4_modulo.png"), codes.join("a.png")).unwrap();
    let words = ["unwrap", "--alpha", "4", "-o"].map(Path::new).into_iter().chain([out.as_path(), &codes]);
    let rows = recover::unwrap_files(&UnwrapRequest::parse_from(words), &mut |_| {}).unwrap().rows;
    assert_eq!(rows.len(), 1);
    std::fs::remove_file(codes.join("a.png")).unwrap();
    let none = simulate::simulate(&request(&out, &[&codes]), &mut |_| ()).unwrap_err();
    assert!(matches!(none, BenchError::NoFrames(_)), "{none}");
}
