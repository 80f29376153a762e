//! Tests how much radiance modulo pixels keep that pixels which saturate lose: on rendered scenes, and on HDR pictures if they are
//! available. Each sensor is compared with the one that has the same exposures and saturates.

use crate::data;
use modulo_core::unwrap::{Options, Trust, by_name, of_gains};
use modulo_core::{Exposure, Gains, Mosaic, Psf, Recovered, Sensor, SensorConfig};
use modulo_images::{Coding, White, read_image};
use modulo_scene::{Preset, Scene};
use ndarray::Array3;

/// Returns the root mean square error of a radiance in stops, `log2((x + 1) / (truth + 1))` of code units: of all samples, and of
/// those above the peak.
fn errors_in_stops(x: &Array3<f32>, truth: &Array3<f32>) -> [f64; 2] {
    [0.0, 256.0].map(|least| {
        let samples = x.iter().zip(truth).filter(|(_, truth)| **truth >= least);
        let (sum, count) = samples.fold((0.0, 0.0), |(sum, count), (x, truth)| {
            (sum + f64::from((x + 1.0) / (truth + 1.0)).log2().powi(2), count + 1.0)
        });
        f64::sqrt(sum / f64::max(count, 1.0))
    })
}

/// Exposes with noise of a real chip, and returns the errors in stops of modulo pixels and of pixels that saturate.
fn errors(radiance: &Array3<f32>, alpha: f64, has_two_gains: bool) -> [[f64; 2]; 2] {
    let gains = if has_two_gains { Gains::checkerboard(alpha) } else { Gains::One };
    let quiet = SensorConfig {
        alpha,
        gains,
        headroom: 0.97,
        psf: Psf::Gaussian { sigma: 0.8 },
        optical_black: 32,
        ..SensorConfig::PLAIN
    };
    // The chip of sensors/mosaic.yaml.
    let config = SensorConfig { read_noise: 0.06, shot_noise: 256.0 / 10_000.0, prnu: 0.005, ..quiet };
    let expose = |config| -> Exposure { Sensor::new(config).unwrap().expose(radiance.view(), 0).unwrap() };
    let (truth, exposure) = (expose(quiet), expose(config));
    let mut method = match of_gains(gains) {
        Some(method) => method,
        None => by_name("auto", &Options::default()).unwrap(),
    };
    let mut out = Recovered::default();
    method.unwrap(&exposure.modulo(), &exposure.range().into(), &mut out).unwrap();
    [&out.x, &exposure.saturated_radiance()].map(|x| errors_in_stops(x, truth.x()))
}

/// The mean errors over some pictures, of modulo pixels and of pixels that saturate: of all samples, and of those above the peak.
struct Row {
    alpha: f64,
    has_two_gains: bool,
    modulo: [f64; 2],
    saturating: [f64; 2],
}

/// Prints and returns the mean errors over `pictures`, by alpha and gains.
fn table(name: &str, pictures: &[Array3<f32>]) -> Vec<Row> {
    let mut rows = Vec::new();
    for alpha in [4.0, 16.0, 64.0] {
        for has_two_gains in [false, true] {
            let all: Vec<_> = pictures.iter().map(|picture| errors(picture, alpha, has_two_gains)).collect();
            let mean = |pixels: usize, part: usize| {
                all.iter().map(|errors| errors[pixels][part]).sum::<f64>() / all.len() as f64
            };
            let [modulo, saturating] = [0, 1].map(|pixels| [mean(pixels, 0), mean(pixels, 1)]);
            println!(
                "{name}, alpha {alpha}, two gains {has_two_gains}: {modulo:.3?} stops, saturating {saturating:.3?}"
            );
            rows.push(Row { alpha, has_two_gains, modulo, saturating });
        }
    }
    rows
}

/// Fails if modulo pixels of one gain do not measure radiance better than pixels that saturate.
fn check(rows: &[Row]) {
    for Row { alpha, modulo, saturating, .. } in rows.iter().filter(|row| !row.has_two_gains) {
        assert!(
            1.5 * modulo[0] < saturating[0],
            "alpha {alpha}: {modulo:?} stops, saturating {saturating:?}"
        );
    }
}

#[test]
fn modulo_pixels_keep_the_radiance_of_rendered_scenes() {
    check(&table("rendered", &Preset::ALL.map(|preset| Scene::new(preset, 0).render(0, 192, 640).radiance)));
}

#[test]
fn modulo_pixels_keep_the_radiance_of_hdr_pictures() {
    let Some(folder) = data::shared("data/hdr/polyhaven") else { return };
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|file| file.extension().is_some_and(|extension| extension == "hdr"));
    files.sort();
    let read = |file: &std::path::PathBuf| {
        let pixels = read_image(file).unwrap();
        White::new(Coding::default()).unwrap().radiance(&pixels, file.display()).unwrap()
    };
    check(&table("HDR", &files.iter().map(read).collect::<Vec<_>>()));
}

/// Unwraps the low bits of a raw frame of 16 bits with noise of so many codes; returns the share of the exact counts, and the trust.
fn from_low_bits(x: &Array3<f32>, bits: u8, read_noise: f64) -> (f64, Trust) {
    let alpha = f64::from(1 << (16 - bits));
    let config = SensorConfig { bits, alpha, read_noise, mosaic: Some(Mosaic::Grbg), ..SensorConfig::PLAIN };
    // Half a code more, so that no rounding changes a code.
    let radiance = x.mapv(|x| (x + 0.5) / 65536.0);
    let exposure = Sensor::new(config).unwrap().expose(radiance.view(), 0).unwrap();
    let mut out = Recovered::default();
    let mut method = by_name("auto", &Options::default()).unwrap();
    let range = exposure.range().with_black_level(Some(340.0));
    method.unwrap(&exposure.modulo(), &range.into(), &mut out).unwrap();
    let (exact, report) = (exposure.exact_share(&out.k).unwrap(), out.report);
    println!("{bits} bits, {read_noise} codes: {exact:.5}, {:?} by {}", report.trust, report.method);
    (exact, report.trust)
}

/// A raw frame of an automotive HDR chip: noise, lens and colour mosaic are those of the chip. Its darkest pixels have about 340. It is
/// not trusted, since nobody knows its lens, and its edges show a sharp one.
#[test]
fn a_real_raw_mosaic_of_16_bits_is_exact_from_its_low_bits() {
    let Some(file) = data::shared("data/hdr_raw/grey_street_linear16_mosaic_grbg.png") else { return };
    let x = read_image(&file).unwrap().to_f32();
    let knees = x.mapv(|x| x.min(4095.0) + 0.99 * (x.max(4095.0) - 4095.0));
    for (bits, noise, x, least) in [
        (12, 0.0, &x, 0.9990),
        (12, 60.0, &x, 0.9990),
        (12, 20.0, &knees, 0.9990),
        (13, 0.0, &x, 0.9999),
        (15, 0.0, &x, 0.9999),
    ] {
        let (exact, trust) = from_low_bits(x, bits, noise);
        assert!(exact >= least, "{bits} bits: {exact}");
        assert_eq!(trust, Trust::Unobservable, "{bits} bits");
    }
}
