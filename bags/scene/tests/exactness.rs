//! The share of exact wrap counts on rendered scenes, and on KITTI frames if they are available.

// Helpers of tests may unwrap as tests do.
#![allow(clippy::unwrap_used)]

#[path = "../../../tests/harness/data.rs"]
mod data;

use std::time::Instant;

use modulo_core::unwrap::{METHODS, Options, by_name};
use modulo_core::{Exposure, Psf, Recovered, Sensor, SensorConfig};
use modulo_scene::{Preset, Scene};
use ndarray::Array3;

fn expose(radiance: &Array3<f32>, alpha: f64, psf: Psf) -> Exposure {
    let config = SensorConfig { bits: 8, alpha, psf, read_noise: 0.0, shot_noise: 0.0 };
    Sensor::new(config).unwrap().expose(radiance.view(), 0).unwrap()
}

/// Returns the share of exact wrap counts, and the duration of the unwrapping in ms.
fn score(method: &str, exposure: &Exposure) -> (f64, f64) {
    let (y, truth) = (exposure.modulo(), exposure.wraps());
    let (mut unwrap, mut out) = (by_name(method, &Options::default()).unwrap(), Recovered::default());
    let mut fastest = f64::INFINITY;
    for _ in 0..3 {
        let start = Instant::now();
        unwrap.unwrap(&y, exposure.range(), &mut out).unwrap();
        fastest = fastest.min(start.elapsed().as_secs_f64() * 1e3);
    }
    let exact = out.k.iter().zip(&truth).filter(|(k, truth)| k == truth).count();
    (exact as f64 / truth.len() as f64, fastest)
}

/// Prints and returns the mean share over exposures; also prints the mean duration and the number of images
/// without an error.
fn report(title: &str, method: &str, exposures: &[Exposure]) -> f64 {
    let scores: Vec<_> = exposures.iter().map(|exposure| score(method, exposure)).collect();
    let mean = |of: fn(&(f64, f64)) -> f64| scores.iter().map(of).sum::<f64>() / scores.len() as f64;
    let (share, exact) = (mean(|s| s.0), scores.iter().filter(|s| s.0 == 1.0).count());
    println!(
        "{title} {method}: {:.3} % exact k, {exact}/{} whole images, {:.1} ms",
        share * 100.0,
        scores.len(),
        mean(|s| s.1)
    );
    share
}

fn read(path: &std::path::Path) -> Array3<f32> {
    let image = image::open(path).unwrap().to_rgb8();
    let dim = (image.height() as usize, image.width() as usize, 3);
    let samples = image.into_raw().iter().map(|&sample| f32::from(sample) / 255.0).collect();
    Array3::from_shape_vec(dim, samples).unwrap()
}

#[test]
fn rendered_scenes() {
    for preset in Preset::ALL {
        let exposures: Vec<_> = (0..3)
            .map(|seed| Scene::new(preset, seed).render(0, 96, 320).radiance)
            .map(|radiance| expose(&radiance, 4.0, Psf::Gaussian { sigma: 1.0 }))
            .collect();
        for method in METHODS {
            let share = report(preset.name(), method, &exposures);
            if *method == "lines" {
                assert_eq!(share, 1.0, "{method} on {}", preset.name());
            }
        }
    }
}

#[test]
fn kitti_under_the_papers_lens() {
    let Some(folder) = data::shared("data/kitti_object/image_2") else { return };
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let exposures: Vec<_> = files.iter().map(|file| expose(&read(file), 4.0, Psf::Paper7)).collect();
    for method in METHODS {
        let share = report("kitti, alpha 4,", method, &exposures);
        if *method == "lines" {
            assert_eq!(share, 1.0, "{method}");
        }
    }
}
