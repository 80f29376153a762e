//! What the lens has blurred and the filter has to bring back.

// Helpers of tests may unwrap as tests do.
#![allow(clippy::unwrap_used)]

#[path = "../../tests/harness/data.rs"]
mod data;

use modulo_core::sensor::SensorConfig;
use modulo_core::unwrap::{Options, by_name};
use modulo_core::{Deblur, Frame, Psf, Range, Recovered, Sensor, tone};
use ndarray::Array3;

/// 8-bit frames, full scale 255.
fn psnr(a: &Frame, b: &Frame) -> f64 {
    let (a, b) = (a.to_f32(), b.to_f32());
    let squares: f64 = a.iter().zip(&b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    10.0 * (255.0f64.powi(2) * a.len() as f64 / squares).log10()
}

/// PSNR against the sharp ideal image: before and after the filter.
fn sharpness(radiance: &Array3<f32>, deblur: &mut Deblur) -> (f64, f64) {
    let range = Range::new(8, 4.0).unwrap();
    let config = SensorConfig { bits: 8, alpha: 4.0, psf: Psf::None, read_noise: 0.0, shot_noise: 0.0 };
    let ideal = Sensor::new(config).unwrap().expose(radiance.view(), 0).unwrap().ideal();
    let config = SensorConfig { psf: Psf::Paper7, ..config };
    let exposure = Sensor::new(config).unwrap().expose(radiance.view(), 0).unwrap();
    let mut recovered = Recovered::default();
    let mut lines = by_name("lines", &Options::default()).unwrap();
    lines.unwrap(&exposure.modulo(), range, &mut recovered).unwrap();
    let blurred = tone::linear8(&recovered.x, range).unwrap();
    let sharp = deblur.linear8(&recovered.x, range).unwrap();
    (psnr(&blurred, &ideal), psnr(&sharp, &ideal))
}

#[test]
fn kitti_comes_within_31_decibels_of_the_sharp_image() {
    let Some(folder) = data::shared("data/kitti_object/image_2") else { return };
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let mut deblur = Deblur::new(Psf::Paper7);
    let mut sums = (0.0, 0.0);
    for file in &files[..6] {
        let image = image::open(file).unwrap().to_rgb8();
        let (width, height) = image.dimensions();
        let pixels = Array3::from_shape_vec((height as usize, width as usize, 3), image.into_raw()).unwrap();
        let (before, after) = sharpness(&pixels.mapv(|p| f32::from(p) / 255.0), &mut deblur);
        println!("{}: {before:.2} dB, deblurred {after:.2} dB", file.display());
        sums = (sums.0 + before, sums.1 + after);
    }
    println!("mean: {:.2} dB, deblurred {:.2} dB", sums.0 / 6.0, sums.1 / 6.0);
    assert!(sums.1 / 6.0 >= 31.0);
}

#[test]
fn a_lens_that_does_nothing_changes_nothing() {
    let range = Range::new(8, 3.0).unwrap();
    let x = Array3::from_shape_fn((7, 20, 3), |(i, j, c)| (i * 31 + j * 17 + c) as f32);
    let mut deblur = Deblur::new(Psf::None);
    assert_eq!(deblur.linear8(&x, range), tone::linear8(&x, range));
}

#[test]
fn sharpens_an_edge_of_any_size_and_refuses_no_image() {
    let mut deblur = Deblur::new(Psf::Paper7);
    for (height, width, channels) in [(40, 60, 3), (17, 33, 1), (16, 619, 1)] {
        let edge = |(i, j, _): (usize, usize, usize)| if (i / 8 + j / 8) % 2 == 0 { 0.06 } else { 0.14 };
        let (before, after) = sharpness(&Array3::from_shape_fn((height, width, channels), edge), &mut deblur);
        assert!(after > before + 1.0, "{height} x {width}: {before:.1} dB, then {after:.1} dB");
    }
    assert!(deblur.linear8(&Array3::zeros((0, 4, 3)), Range::new(8, 2.0).unwrap()).is_err());
    assert!(deblur.linear8(&Array3::zeros((1, 1, 1)), Range::new(8, 2.0).unwrap()).is_ok());
}
