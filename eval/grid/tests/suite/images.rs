//! `simulate` and `unwrap` on synthetic images.

use std::cell::RefCell;
use std::path::Path;

use clap::Parser;
use modulo_core::unwrap::METHODS;
use modulo_core::{Frame, Mosaic};
use modulo_eval::GridError;
use modulo_eval::images::recover::{self, UnwrapRequest};
use modulo_eval::images::runner::{Row, Simulated};
use modulo_eval::images::simulate::{self, SimulationRequest};
use modulo_eval::progress::GridEvent;
use modulo_eval::results::RESULTS;
use modulo_images::{FileFormat, encode, read_image, save_exr, save_png};
use modulo_scene::{Preset, Scene};
use ndarray::{Array3, s};

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

/// What is known of a simulated image.
fn truth(row: &Row) -> &Simulated {
    row.simulated.as_ref().expect("it was simulated")
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
        let with = request_with(
            &format!("--psf-sigma 0 --optical-black 0 --headroom {headroom}"),
            &simulated,
            &[&file],
        );
        let rows = simulate::simulate(&with, &|_| ()).unwrap().rows;
        assert!(truth(&rows[0]).exact_k == 1.0, "headroom {headroom}: {rows:?}");
        let modulo = simulated.join("slope_alpha4_modulo.png");
        let words = ["unwrap", "--alpha", "4", "--headroom", headroom, "-o"].map(Path::new);
        let words = words.into_iter().chain([out.as_path(), modulo.as_path()]);
        recover::unwrap_files(&UnwrapRequest::parse_from(words), &|_| ()).unwrap();
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

/// Radiance returns within half a code, in the unit of its file, and the pictures of it are encoded for the eye.
#[test]
fn radiance_goes_in_and_comes_out() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("slope.exr"), folder.path().join("out"));
    let radiance = Array3::from_shape_fn((40, 128, 3), |(i, j, c)| (2 * j + i + c) as f32 * 0.1);
    save_exr(&file, &radiance).expect("a writable folder");
    let options = "--psf-sigma 1.4 --optical-black 0 --headroom 1 --white 64 --exr";
    let rows = simulate::simulate(&request_with(options, &out, &[&file]), &|_| ()).unwrap().rows;
    assert_eq!((rows[0].trusted, truth(&rows[0]).exact_k), (Some(false), 1.0), "{rows:?}");
    assert_eq!(rows[0].reason, Some("the absolute level is unknown: no dark reference"));
    let recovered = read_image(&out.join("slope_alpha4_auto.exr")).expect("an EXR image").to_f32();
    let code = 64.0 / 1024.0;
    // The lens sees no further than the border.
    let inside = s![8..32, 8..120, ..];
    let pairs = recovered.slice(inside).into_iter().zip(radiance.slice(inside));
    let apart = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(apart <= 0.501 * code, "{apart} of {code}");
    // 25.1 of 64, which codes in proportion to radiance would show as 100.
    let shown = pixels(&out.join("slope_alpha4_auto.png"))[(20, 115, 1)];
    assert_eq!(shown, pixels(&out.join("slope_alpha4_ideal.png"))[(20, 115, 1)]);
    assert!((167..=169).contains(&shown), "{shown}");
}

#[test]
fn two_gains_have_a_method_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("street.png"), folder.path().join("out"));
    street(&file);
    let request = request_with("--psf-sigma 0 --gains checkerboard", &out, &[&file]);
    let rows = simulate::simulate(&request, &|_| ()).unwrap().rows;
    let [row] = &rows[..] else { panic!("one alpha, one method: {rows:?}") };
    assert_eq!((row.sensor.gains, row.method.as_str()), (true, "checkerboard_gains"));
    assert!(truth(row).exact_k > 0.95, "{row:?}");
    assert!(out.join("street_alpha4_checkerboard_gains.png").is_file());
}

#[test]
fn a_mosaic_is_unwrapped_and_demosaiced() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("street.png"), folder.path().join("out"));
    street(&file);
    let request = request_with("--psf-sigma 0 --mosaic gbrg --alpha 2", &out, &[&file]);
    let rows = simulate::simulate(&request, &|_| ()).unwrap().rows;
    let [row] = &rows[..] else { panic!("one alpha, one method: {rows:?}") };
    assert_eq!(row.sensor.mosaic.map(Mosaic::word), Some("gbrg"));
    assert!(truth(row).exact_k > 0.99, "{row:?}");
    assert_eq!(pixels(&out.join("street_alpha2_modulo.png")).dim().2, 1);
    assert_eq!(pixels(&out.join("street_alpha2_auto.png")).dim().2, 3);
}

#[test]
fn every_file_alpha_and_method_has_a_row_and_a_picture() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("street.png"), folder.path().join("out"));
    street(&file);
    let methods: Vec<String> = METHODS.iter().map(|&name| name.to_owned()).collect();
    let request = request_with("--psf-sigma 0 --alpha 1,2.5 --method all", &out, &[&file]);
    let steps = RefCell::default();
    let outcome = simulate::simulate(&request, &|event| {
        if let GridEvent::Cell { frames, .. } = event {
            RefCell::<Vec<_>>::borrow_mut(&steps).push(frames);
        }
    })
    .unwrap();
    assert_eq!(steps.into_inner(), [(0, 2), (1, 2)]);
    let written: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.join(RESULTS)).unwrap()).unwrap();
    assert_eq!(written, serde_json::to_value(&outcome.rows).unwrap());
    assert_eq!(outcome.rows.len(), 2 * methods.len());
    for (index, row) in outcome.rows.iter().enumerate() {
        assert_eq!(row.method, methods[index % methods.len()]);
        assert_eq!(row.file, file.display().to_string());
        let alpha = [1.0, 2.5][index / methods.len()];
        assert_eq!(row.sensor.alpha, alpha);
        let picture = |stream: &str| pixels(&out.join(format!("street_alpha{alpha}_{stream}.png")));
        let (ideal, recovered) = (picture("ideal"), picture(&row.method));
        assert_eq!(truth(row).psnr_db.is_none(), ideal == recovered, "{row:?}");
        assert_eq!(truth(row).exact_k == 1.0, ideal == recovered, "{row:?}");
        assert_eq!(truth(row).ssim.unwrap() > 1.0 - 1e-12, ideal == recovered, "{row:?}");
        // At alpha 1 nothing wraps, and the sensor's codes are the picture.
        assert!(alpha > 1.0 || picture("modulo") == picture("saturated"), "{row:?}");
        assert!(alpha > 1.0 || truth(row).exact_k == 1.0, "{row:?}");
        // The exposure of the normal camera has settled.
        let normal = picture("auto_exposed");
        let mean = normal.iter().map(|&code| f64::from(code)).sum::<f64>() / normal.len() as f64;
        assert!((mean / 255.0 - 0.18).abs() < 0.02, "{mean}");
    }
}

#[test]
fn a_file_that_cannot_be_read_is_named_and_the_others_go_on() {
    let folder = tempfile::tempdir().unwrap();
    let (good, bad) = (folder.path().join("good.png"), folder.path().join("bad.png"));
    street(&good);
    std::fs::write(&bad, b"no picture").unwrap();
    let out = folder.path().join("out");
    let request = |files: &[&Path]| request_with("--psf-sigma 0 --method spud", &out, files);
    let wanted = RefCell::default();
    let outcome = simulate::simulate(&request(&[&bad, &good]), &|event| {
        if let GridEvent::Warning(skipped) = event {
            RefCell::<Vec<_>>::borrow_mut(&wanted).push(skipped.trim_start_matches("skipped: ").to_owned());
        }
    })
    .unwrap();
    let wanted = wanted.into_inner();
    assert_eq!(outcome.rows.len(), 1);
    assert_eq!(outcome.skipped, wanted);
    assert!(wanted[0].contains("bad.png"), "{}", wanted[0]);
    std::fs::remove_dir_all(&out).unwrap();
    let alone = simulate::simulate(&request(&[&bad]), &|_| ()).unwrap_err();
    assert!(!out.exists(), "a single picture that is refused leaves nothing behind");
    assert!(matches!(&alone, GridError::Image(_)) && alone.to_string().contains("bad.png"), "{alone}");
}

#[test]
fn a_wrong_simulation_is_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let with = |options: &str, change: &dyn Fn(&mut SimulationRequest)| {
        let mut request = request_with(options, &out, &[Path::new("x.png")]);
        change(&mut request);
        simulate::simulate(&request, &|_| ()).unwrap_err().to_string()
    };
    let request = |change| with("", change);
    assert!(request(&|r| r.run.method = vec!["best".into()]).contains("method \"best\" is unknown"));
    assert!(request(&|r| r.coding.white = -1.0).starts_with("white = -1"));
    for (option, values, wanted) in [
        ("--alpha", "0", "'alpha' = 0"),
        ("--gains", "chess", "checkerboard"),
        // The names of the images have no lens.
        ("--psf-sigma", "0,1", "'psf_sigma' = 0,1"),
    ] {
        let words = ["simulate", "-o", "out", "x.png", option, values];
        let why = SimulationRequest::try_parse_from(words).unwrap_err().to_string();
        assert!(why.contains(wanted) && why.contains(values), "{why}");
    }
    let low = with("--gains checkerboard --gain-ratio 0.5", &|_| ());
    assert!(low.contains("'gain_ratio' = 0.5: must be at most 0.25"), "{low}");
    // The gains decide the method: one that was asked for would be ignored.
    let ignored = with("--gains checkerboard", &|r| r.run.method = vec!["spud".into()]);
    for wanted in ["--method spud", "--gains checkerboard", "checkerboard_gains"] {
        assert!(ignored.contains(wanted), "{wanted}: {ignored}");
    }
    let published = request(&|r| r.run.method = vec!["spud_as_published".into()]);
    assert!(published.contains("modulo eval") && published.contains("spud is the same"), "{published}");
    let wide = with("--bits 16", &|r| r.counts = true);
    assert!(wide.contains("--counts") && wide.contains("65536"), "{wide}");
    assert!(!out.exists());
}

/// Neither the number of calls nor that of the threads changes a result.
#[test]
fn repeated_calls_give_the_result_of_one() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("street.png");
    street(&file);
    let run = |more: &str| {
        let out = folder.path().join("out");
        let with = format!("--method all --hot-pixels 0.0002 --optical-black 8 {more}");
        let mut rows = simulate::simulate(&request_with(&with, &out, &[&file]), &|_| ()).unwrap().rows;
        assert_eq!(rows.len(), METHODS.len());
        assert!(rows.iter().all(|row| row.ms > 0.0), "{rows:?}");
        rows.iter_mut().for_each(|row| row.ms = 0.0);
        let (modulo, unwrapped) = (out.join("street_alpha4_modulo.png"), out.join("unwrapped"));
        let words = ["unwrap", "--alpha", "4", "--psf-sigma", "1.4", "--optical-black", "8", "-o"];
        let words = words.map(Path::new).into_iter().chain([&*unwrapped]);
        let words = words.chain(more.split_whitespace().map(Path::new));
        let words = words.chain([modulo.as_path()]);
        recover::unwrap_files(&UnwrapRequest::parse_from(words), &|_| ()).unwrap();
        let k = std::fs::read(unwrapped.join("street_alpha4_modulo_auto_k.png")).unwrap();
        std::fs::remove_dir_all(&out).unwrap();
        (rows, k)
    };
    let once = run("");
    assert!(run("--repeats 3") == once, "repeats");
    assert!(run("--threads 2") == once, "threads");
}

#[test]
fn rows_of_different_sensors_differ() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("street.png"), folder.path().join("out"));
    street(&file);
    let request = request_with("--read-noise 3 --seed 9 --prnu 0.01", &out, &[&file]);
    simulate::simulate(&request, &|_| ()).unwrap();
    let text = std::fs::read_to_string(out.join(RESULTS)).unwrap();
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
    let expected = simulate::simulate(&with, &|_| ()).unwrap().rows;
    let path = |what: &str| simulated.join(format!("street_alpha4_{what}.png"));
    let (y, k, x) = (pixels(&path("modulo")), pixels(&path("k")), read_image(&path("x")).unwrap());
    assert!(k.iter().any(|&k| k > 0), "the scene must wrap");
    let sum = y.iter().zip(&k).map(|(&y, &k)| f32::from(y) + 256.0 * f32::from(k));
    assert_eq!((x.depth(), sum.collect::<Vec<_>>()), (16, x.to_f32().into_iter().collect()));

    let modulo = path("modulo");
    let words = ["unwrap", "--alpha", "4", "--optical-black", "8", "-o"].map(Path::new);
    let words = words.into_iter().chain([out.as_path(), modulo.as_path()]);
    let rows = recover::unwrap_files(&UnwrapRequest::parse_from(words), &|_| ()).unwrap().rows;
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
            Ok(request) => recover::unwrap_files(&request, &|_| ()).unwrap_err().to_string(),
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
    simulate::simulate(&with, &|_| ()).unwrap();
    let good = simulated.join("street_alpha4_modulo.png");
    let jpeg = folder.path().join("jpeg.png");
    std::fs::write(&jpeg, encode(&read_image(&good).unwrap(), FileFormat::Jpeg).unwrap()).unwrap();
    let unwrap = |files: &[&Path], bits: &str| {
        let words = ["unwrap", "--alpha", "4", "--optical-black", "8", "--bits", bits, "-o"].map(Path::new);
        let words = words.into_iter().chain([out.as_path()]).chain(files.iter().copied());
        recover::unwrap_files(&UnwrapRequest::parse_from(words), &|_| ())
    };
    for (file, bits, wanted) in
        [(&jpeg, "8", "destroys the wraps"), (&good, "10", "not the codes of a sensor of 10 bits")]
    {
        let why = unwrap(&[file], bits).expect_err("no codes");
        let name = file.display().to_string();
        assert!(matches!(&why, GridError::NotCodes(..)), "{why}");
        assert!(why.to_string().contains(wanted) && why.to_string().contains(&name), "{why}");
        assert!(!out.exists(), "{why}");
    }
    let outcome = unwrap(&[&jpeg, &good], "8").unwrap();
    assert_eq!((outcome.rows.len(), outcome.skipped.len()), (1, 1));
}

/// A folder stands for the images in it; hidden files are none, and images of other formats are counted.
#[test]
fn a_folder_stands_for_its_images() {
    let folder = tempfile::tempdir().unwrap();
    let [pictures, simulated, out] = ["pictures", "simulated", "out"].map(|name| folder.path().join(name));
    std::fs::create_dir(&pictures).unwrap();
    ["b.png", "a.png"].iter().for_each(|name| street(&pictures.join(name)));
    for other in ["notes.txt", "old.bmp", "new.webp", "._a.png"] {
        std::fs::write(pictures.join(other), "no picture").unwrap();
    }
    let wanted = RefCell::default();
    let rows = simulate::simulate(&request(&simulated, &[&pictures]), &|event| {
        if let GridEvent::Warning(warning) = event {
            RefCell::<Vec<_>>::borrow_mut(&wanted).push(warning.to_owned());
        }
    });
    let wanted = wanted.into_inner();
    let files: Vec<_> = rows.unwrap().rows.into_iter().map(|row| row.file).collect();
    assert_eq!(files, ["a.png", "b.png"].map(|name| pictures.join(name).display().to_string()));
    assert!(
        wanted.len() == 1
            && wanted[0].contains("2 images of other formats")
            && wanted[0].contains("new.webp"),
        "{wanted:?}"
    );
    let codes = folder.path().join("codes");
    std::fs::create_dir(&codes).unwrap();
    std::fs::copy(simulated.join("a_alpha4_modulo.png"), codes.join("a.png")).unwrap();
    let words = ["unwrap", "--alpha", "4", "-o"].map(Path::new).into_iter().chain([out.as_path(), &codes]);
    let rows = recover::unwrap_files(&UnwrapRequest::parse_from(words), &|_| ()).unwrap().rows;
    assert_eq!(rows.len(), 1);
    std::fs::remove_file(codes.join("a.png")).unwrap();
    let none = simulate::simulate(&request(&codes.join("none"), &[&codes]), &|_| ()).unwrap_err();
    assert!(none.to_string().contains("no image in this folder"), "{none}");
}
