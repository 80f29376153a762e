//! `auto` never trusts a wrong result, over real images and all alphas, blurs and noises.
//!
//! `MODULO_TRUST=all cargo test --release -p modulo-bench --test trust -- --nocapture` tests all
//! combinations; without the variable it tests every 23rd.

#[path = "../../../tests/harness/data.rs"]
mod data;

use std::path::{Path, PathBuf};

use modulo_core::unwrap::{Options, Recovered, Trust, by_name};
use modulo_core::{Psf, Sensor, SensorConfig};
use modulo_images::{EXTENSIONS, White, read_image};
use ndarray::Array3;

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
        let config = SensorConfig { bits: 8, alpha, psf, read_noise, shot_noise: 0.0 };
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
    let (mut tally, mut index) = (Tally::default(), 0);
    for file in &files {
        let Ok(pixels) = read_image(file) else {
            println!("skipped: {} cannot be decoded", file.display());
            continue;
        };
        let radiance = White::new(0.0).unwrap().radiance(&pixels);
        let name = file.file_name().unwrap().to_string_lossy();
        for condition in conditions() {
            index += 1;
            if index % stride == 0 {
                tally.take(&name, &radiance, condition);
            }
        }
    }
    println!("{} frames, {} trusted, {} of them wrong", tally.frames, tally.trusted, tally.wrong.len());
    assert!(tally.trusted > 0, "a ladder that trusts nothing is of no use");
    assert!(tally.wrong.is_empty(), "{:#?}", tally.wrong);
}
