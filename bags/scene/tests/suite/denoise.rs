//! Tests how much denoising gains on rendered scenes, and on KITTI frames if they are available.

use crate::data;
use modulo_core::unwrap::{Options, by_name};
use modulo_core::{Denoise, Gains, Mosaic, Psf, Recovered, Sensor, SensorConfig, TwoGains, Unwrap as _};
use modulo_scene::{Preset, Scene};
use ndarray::Array3;

/// The sensor of all tests, without noise.
const SENSOR: SensorConfig = SensorConfig { psf: Psf::Gaussian { sigma: 1.4 }, ..SensorConfig::PLAIN };

/// Returns the PSNR of `x` against the exposure without noise, in dB of the full range.
fn psnr(x: &Array3<f32>, truth: &Array3<f32>, config: SensorConfig) -> f64 {
    let square = |(x, truth): (&f32, &f32)| f64::from(x - truth).powi(2);
    let error = x.iter().zip(truth).map(square).sum::<f64>() / x.len() as f64;
    let limit = config.alpha * 2f64.powi(i32::from(config.bits));
    10.0 * (limit * limit / error).log10()
}

/// Returns the PSNR of the recovered radiance before and after denoising.
fn gain(radiance: &Array3<f32>, config: SensorConfig) -> (f64, f64) {
    let quiet = SensorConfig { read_noise: 0.0, shot_noise: 0.0, prnu: 0.0, ..config };
    let truth = Sensor::new(quiet).unwrap().expose(radiance.view(), 0).unwrap();
    let exposure = Sensor::new(config).unwrap().expose(radiance.view(), 0).unwrap();
    let mut out = Recovered::default();
    match TwoGains::new(config.gains) {
        Some(mut method) => method.unwrap(&exposure.modulo(), exposure.range(), &mut out).unwrap(),
        None => by_name("auto", &Options::default())
            .unwrap()
            .unwrap(&exposure.modulo(), exposure.range(), &mut out)
            .unwrap(),
    }
    let denoised = Denoise::new(config).unwrap().apply(&out.x);
    let result = (psnr(&out.x, truth.x(), config), psnr(&denoised, truth.x(), config));
    println!("{:.2} dB, denoised {:.2} dB", result.0, result.1);
    result
}

#[test]
fn rendered_scenes_gain_by_denoising() {
    let two = Gains::checkerboard(4.0);
    for (name, config, least) in [
        ("read noise of 5", SensorConfig { read_noise: 5.0, ..SENSOR }, 4.0),
        ("read noise of 20", SensorConfig { read_noise: 20.0, ..SENSOR }, 4.0),
        ("shot noise", SensorConfig { shot_noise: 0.25, ..SENSOR }, 4.0),
        ("prnu", SensorConfig { prnu: 0.02, ..SENSOR }, 1.5),
        ("two gains", SensorConfig { read_noise: 5.0, gains: two, ..SENSOR }, 4.0),
        ("mosaic", SensorConfig { read_noise: 5.0, mosaic: Some(Mosaic::Rggb), ..SENSOR }, 2.0),
    ] {
        for preset in Preset::ALL {
            println!("{name}, {}", preset.name());
            let radiance = Scene::new(preset, 0).render(0, 96, 320).radiance;
            let (before, after) = gain(&radiance, config);
            assert!(after >= before + least, "{name}, {}: {before:.2}, then {after:.2} dB", preset.name());
        }
    }
}

#[test]
fn frames_of_kitti_gain_by_denoising() {
    let Some(folder) = data::shared("data/kitti_object/image_2") else { return };
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    for (read_noise, least) in [(5.0, 3.0), (20.0, 5.0)] {
        let mut sum = 0.0;
        for file in &files[..6] {
            let image = image::open(file).unwrap().to_rgb8();
            let dim = (image.height() as usize, image.width() as usize, 3);
            let samples = image.into_raw().iter().map(|&sample| f32::from(sample) / 255.0).collect();
            let radiance = Array3::from_shape_vec(dim, samples).unwrap();
            let (before, after) = gain(&radiance, SensorConfig { read_noise, ..SENSOR });
            sum += after - before;
        }
        println!("read noise of {read_noise}: {:.2} dB gained", sum / 6.0);
        assert!(sum / 6.0 >= least, "read noise of {read_noise}: {:.2} dB gained", sum / 6.0);
    }
}
