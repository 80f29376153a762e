//! Compares every method on every scene of the catalogue with the expected result, and tests over real images and all
//! alphas, blurs and noises that `auto` never trusts a wrong result.
//!
//! `MODULO_TRUST=all cargo test --release -p modulo-bench --test stability trusted -- --nocapture` tests all combinations
//! of the latter; without the variable it tests every 23rd.

// Helpers of tests may unwrap as tests do.
#![allow(clippy::unwrap_used)]

#[path = "../../../tests/harness/data.rs"]
mod data;

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use modulo_bench::stability::{Case, cases, measure, run};
use modulo_core::unwrap::{METHODS, Options, Trust, by_name};
use modulo_core::{Psf, Recovered, Sensor, SensorConfig, Transfer};
use modulo_images::{EXTENSIONS, White, read_image};
use ndarray::{Array3, Axis, Slice};

#[test]
fn nothing_is_worse_than_expected() {
    let outcome = measure(|_| {}).unwrap();
    outcome.better.iter().for_each(|line| println!("better than expected: {line}"));
    println!(
        "{} held; {} of {} recovered results vouched for",
        outcome.held, outcome.vouched, outcome.could_vouch
    );
    assert!(outcome.broken.is_empty(), "broken:\n{}", outcome.broken.join("\n"));
}

/// Largest absolute first difference, and largest absolute second or mixed difference, within a channel.
fn roughness(x: &Array3<f32>) -> (f32, f32) {
    let along = |x: &Array3<f32>, axis: usize| {
        let axis = Axis(axis);
        if x.len_of(axis) < 2 {
            return Array3::zeros((1, 1, 1));
        }
        &x.slice_axis(axis, Slice::from(1..)) - &x.slice_axis(axis, Slice::from(..-1))
    };
    let most = |x: &Array3<f32>| x.iter().fold(0.0f32, |most, x| most.max(x.abs()));
    let (down, right) = (along(x, 0), along(x, 1));
    let second = [along(&down, 0), along(&right, 0), along(&right, 1)];
    (most(&down).max(most(&right)), second.iter().map(most).fold(0.0, f32::max))
}

/// Whether a method has a wrong result that is as smooth as the truth, which proves that y does not determine the truth.
fn has_twin(case: &Case) -> bool {
    let exposure = case.expose().unwrap();
    let (y, limit) = (exposure.modulo(), exposure.range().limit());
    let truth = roughness(&exposure.x().mapv(f32::floor));
    METHODS.iter().any(|method| {
        let mut out = Recovered::default();
        by_name(method, &Options::default()).unwrap().unwrap(&y, exposure.range(), &mut out).unwrap();
        let twin = roughness(&out.x);
        let in_range = out.x.iter().all(|&x| x >= 0.0 && f64::from(x) < limit);
        out.k != exposure.wraps() && in_range && twin.0 <= truth.0 && twin.1 <= truth.1
    })
}

#[test]
fn what_is_called_unobservable_has_a_smoother_twin() {
    for case in cases().iter().filter(|case| !case.is_observable()) {
        assert!(has_twin(case), "{}: no method shows another scene that is as smooth", case.name());
    }
}

#[test]
fn names_are_unique_and_fit_for_files() {
    let cases = cases();
    let names: HashSet<_> = cases.iter().map(|case| case.name()).collect();
    assert_eq!(names.len(), cases.len());
    let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    assert!(names.iter().all(|name| name.chars().all(plain)), "{names:?}");
}

#[test]
fn page_stands_on_its_own() {
    let folder = tempfile::tempdir().unwrap();
    let mut steps = 0;
    let outcome = run(folder.path(), |_| steps += 1).unwrap();
    assert_eq!(steps, cases().len());
    let page = std::fs::read_to_string(folder.path().join("index.html")).unwrap();
    let pictures: Vec<_> = page.split("src=\"").skip(1).map(|rest| rest.split('"').next().unwrap()).collect();
    // The truth, the modulo image, and the result of each method.
    let expected: usize = cases().iter().map(|case| 2 + case.methods().len()).sum();
    assert_eq!(pictures.len(), expected);
    let missing: Vec<_> = pictures.iter().filter(|path| !folder.path().join(path).is_file()).collect();
    assert!(missing.is_empty(), "{missing:?}");
    assert!(!page.contains("http") && !page.contains("<script"), "nothing is fetched, nothing runs");
    let json = std::fs::read_to_string(folder.path().join("results.json")).unwrap();
    let results: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(results["outcome"]["held"], outcome.held);
    assert_eq!(results["scenes"].as_array().map(Vec::len), Some(cases().len()));
}

#[test]
fn documentation_names_every_method_and_unobservable_scene() {
    let text = include_str!("../../../docs/methods.md");
    for method in METHODS {
        assert!(text.contains(&format!("## {method}\n")), "docs/methods.md has no section {method}");
    }
    for case in cases().iter().filter(|case| !case.is_observable()) {
        assert!(
            text.contains(&format!("`{}`", case.name())),
            "docs/methods.md does not list {}",
            case.name()
        );
    }
}

const ALPHAS: [f64; 9] = [1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0];
const BLURS: [Psf; 4] = [Psf::None, Psf::Gaussian { sigma: 0.8 }, Psf::Gaussian { sigma: 1.1 }, Psf::Paper7];
const NOISES: [f64; 4] = [0.0, 2.0, 5.0, 10.0];
/// Step between tested combinations without `MODULO_TRUST=all`. It has no common factor with the numbers above.
const STRIDE: usize = 23;

fn images_below(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_lowercase();
        if path.is_dir() {
            images_below(&path, found);
        } else if EXTENSIONS.contains(&extension.as_str()) {
            found.push(path);
        }
    }
    found.sort();
}

/// All combinations of (alpha, lens, noise).
fn conditions() -> impl Iterator<Item = (f64, Psf, f64)> + Clone {
    ALPHAS.into_iter().flat_map(|alpha| {
        BLURS.into_iter().flat_map(move |psf| NOISES.into_iter().map(move |noise| (alpha, psf, noise)))
    })
}

#[derive(Default)]
struct Tally {
    frames: usize,
    trusted: usize,
    wrong: Vec<String>,
}

impl Tally {
    fn take(&mut self, name: &str, radiance: &Array3<f32>, (alpha, psf, read_noise): (f64, Psf, f64)) {
        let config = SensorConfig { alpha, psf, read_noise, ..SensorConfig::default() };
        let exposure = Sensor::new(config).expect("a sensor").expose(radiance.view(), 1).expect("an image");
        let mut out = Recovered::default();
        let mut auto = by_name("auto", &Options::default()).expect("listed");
        auto.unwrap(&exposure.modulo(), exposure.range(), &mut out).expect("codes of that sensor");
        let truth = exposure.wraps();
        let right = out.k.iter().zip(&truth).filter(|(k, truth)| k == truth).count();
        let exact = right as f64 / truth.len() as f64;
        self.frames += 1;
        if out.report.trust == Trust::Trusted {
            self.trusted += 1;
            if exact < 0.999 {
                let what =
                    format!("{name} alpha {alpha} {psf:?} noise {read_noise}: {exact:.5} {:?}", out.report);
                println!("trusted and wrong: {what}");
                self.wrong.push(what);
            }
        }
    }
}

#[test]
fn never_trusted_and_wrong() {
    let Some(folder) = data::shared("data") else { return };
    let mut files = Vec::new();
    images_below(&folder, &mut files);
    let stride = if std::env::var("MODULO_TRUST").is_ok_and(|all| all == "all") { 1 } else { STRIDE };
    let conditions: Vec<_> = conditions().collect();
    let next = AtomicUsize::new(0);
    let work = || {
        let mut tally = Tally::default();
        while let Some((number, file)) = files.iter().enumerate().nth(next.fetch_add(1, Ordering::Relaxed)) {
            let Ok(pixels) = read_image(file) else {
                println!("skipped: {} cannot be decoded", file.display());
                continue;
            };
            let radiance =
                White::new(0.0, Transfer::Linear).unwrap().radiance(&pixels, file.display()).unwrap();
            let name = file.file_name().unwrap().to_string_lossy();
            for (index, &condition) in (number * conditions.len()..).zip(&conditions) {
                if index % stride == 0 {
                    tally.take(&name, &radiance, condition);
                }
            }
        }
        tally
    };
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let tallies: Vec<Tally> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..cores).map(|_| scope.spawn(work)).collect();
        workers.into_iter().map(|worker| worker.join().expect("a worker does not panic")).collect()
    });
    let mut tally = Tally::default();
    for part in tallies {
        tally.frames += part.frames;
        tally.trusted += part.trusted;
        tally.wrong.extend(part.wrong);
    }
    println!("{} frames, {} trusted, {} of them wrong", tally.frames, tally.trusted, tally.wrong.len());
    assert!(tally.trusted > 0, "a ladder that trusts nothing is of no use");
    assert!(tally.wrong.is_empty(), "{:#?}", tally.wrong);
}
