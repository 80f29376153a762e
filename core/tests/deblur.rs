//! The deblurring filter restores images that the lens has blurred.

// Helpers of tests may unwrap as tests do.
#![allow(clippy::unwrap_used)]

#[path = "../../tests/harness/data.rs"]
mod data;

use modulo_core::sensor::SensorConfig;
use modulo_core::unwrap::{Options, by_name};
use modulo_core::{Deblur, Frame, Psf, Range, Recovered, Sensor, optics, tone};
use ndarray::Array3;

/// Returns the PSNR of 8-bit frames in dB.
fn psnr(a: &Frame, b: &Frame) -> f64 {
    let (a, b) = (a.to_f32(), b.to_f32());
    let squares: f64 = a.iter().zip(&b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    10.0 * (255.0f64.powi(2) * a.len() as f64 / squares).log10()
}

/// Returns the PSNR against the sharp ideal image before and after the filter.
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

/// Returns the RMS error of the deblurred `x` against the sharp image, in 8-bit codes: within 4 px of the border, and
/// inside.
fn errors_at_border_and_inside(x: &Array3<f32>, sharp: &Array3<f32>, psf: Psf) -> [f64; 2] {
    let shown = Deblur::new(psf).linear8(x, Range::new(8, 4.0).unwrap()).unwrap().to_f32();
    let (height, width, _) = sharp.dim();
    let mut squares = [(0.0, 0); 2];
    for ((i, j, c), &value) in shown.indexed_iter() {
        let depth = i.min(j).min(height - 1 - i).min(width - 1 - j);
        let (sum, count) = &mut squares[usize::from(depth >= 4)];
        *sum += f64::from(value - 255.0 * sharp[(i, j, c)]).powi(2);
        *count += 1;
    }
    squares.map(|(sum, count)| (sum / f64::from(count)).sqrt())
}

/// The sensor continues the image at its border as the filter's DCT-II does. OpenCV's border, which is that of
/// [`optics::blurred`], does not: the filter amplifies the difference.
#[test]
fn the_border_is_as_sharp_as_the_inside() {
    let (height, width) = (90, 130);
    // Waves of 8 to 13 px that are cut by the border at any phase.
    let wave =
        |at: usize, period: f32, phase: f32| (std::f32::consts::TAU * at as f32 / period + phase).sin();
    let sharp = Array3::from_shape_fn((height, width, 3), |(i, j, c)| {
        let phase = c as f32;
        0.5 + 0.12 * (wave(i, 9.3, phase) + wave(j, 11.7, phase) + wave(i + j, 12.9, 2.0 * phase))
    });
    for psf in [Psf::Paper7, Psf::Gaussian { sigma: 0.8 }, Psf::Gaussian { sigma: 1.2 }] {
        let config = SensorConfig { bits: 8, alpha: 4.0, psf, read_noise: 0.0, shot_noise: 0.0 };
        let exposure = Sensor::new(config).unwrap().expose(sharp.view(), 0).unwrap();
        let [border, inside] = errors_at_border_and_inside(&exposure.x().mapv(f32::floor), &sharp, psf);
        let opencv = optics::blurred(sharp.clone(), psf).mapv(|x| (1024.0 * x).floor());
        let [opencv, _] = errors_at_border_and_inside(&opencv, &sharp, psf);
        println!("{psf:?}: {border:.2} at the border, {inside:.2} inside, {opencv:.2} at OpenCV's border");
        assert!(border < 1.5 * inside, "{psf:?}: {border:.2} at the border, {inside:.2} inside");
        assert!(opencv > 4.0 * inside, "{psf:?}: {opencv:.2} at OpenCV's border, {inside:.2} inside");
    }
}
