//! The sensor's streams agree with each other and with eq. 1, and their noise depends only on the seed. The deblurring
//! filter restores images that the lens has blurred.

use crate::data;
use modulo_core::unwrap::{Options, Trust, by_name};
use modulo_core::{
    Deblur, Frame, Gains, Mosaic, Psf, Range, Recovered, SamplePosition, Sensor, SensorConfig, SensorError,
    Transfer, TwoGains, Unwrap as _, optics, tone,
};
use ndarray::Array3;
use proptest::prelude::*;

const PLAIN: SensorConfig = SensorConfig::PLAIN;

fn ramp(dim: (usize, usize, usize)) -> Array3<f32> {
    let n = dim.0 * dim.1 * dim.2;
    Array3::from_shape_fn(dim, |(i, j, c)| ((i * dim.1 + j) * dim.2 + c) as f32 / (n - 1).max(1) as f32)
}

fn numbers(frame: &Frame) -> Array3<u32> {
    frame.to_f32().mapv(|v| v as u32)
}

proptest! {
    #[test]
    fn streams_are_views_of_one_exposure(
        dim in (1usize..9, 1usize..9, prop_oneof![Just(1usize), Just(3)]),
        bits in 1u8..=16,
        alpha in prop_oneof![Just(1.0), Just(2.0), Just(4.0), Just(256.0), 1e-3f64..256.0],
        psf in prop_oneof![Just(Psf::None), Just(Psf::Paper7), (0.1f64..4.0).prop_map(|sigma| Psf::Gaussian { sigma })],
        noise in prop_oneof![Just((0.0, 0.0)), (0f64..100.0, 0f64..100.0)],
        seed in any::<u64>(),
    ) {
        let config = SensorConfig { bits, alpha, psf, read_noise: noise.0, shot_noise: noise.1, ..SensorConfig::default() };
        let exposure = Sensor::new(config).unwrap().expose((ramp(dim) * 1.2 - 0.1).view(), seed).unwrap();
        let (x, k) = (exposure.x(), exposure.wraps());
        let (modulo, saturated) = (exposure.modulo(), exposure.saturated());
        prop_assert_eq!((modulo.depth(), saturated.depth()), if bits <= 8 { (8, 8) } else { (16, 16) });
        let limit = alpha * f64::from(1u32 << bits);
        prop_assert!(x.iter().all(|&x| x >= 0.0 && f64::from(x) < limit));
        prop_assert!(k.iter().all(|&k| f64::from(k) < alpha.ceil()));
        let floor = x.mapv(|x| x.floor() as u32);
        prop_assert_eq!(&floor, &(numbers(&modulo) + k.mapv(|k| u32::from(k) << bits)));
        prop_assert_eq!(numbers(&saturated), floor.mapv(|v| v.min((1 << bits) - 1)));
        let ideal = floor.mapv(|v| (255.0 * f64::from(v) / limit).round().min(255.0) as u32);
        prop_assert!(numbers(&exposure.ideal()).iter().zip(&ideal).all(|(a, b)| a.abs_diff(*b) <= 1));
    }

    #[test]
    fn same_seed_same_bytes(seed in any::<u64>()) {
        let sensor = Sensor::new(SensorConfig { read_noise: 2.0, shot_noise: 0.1, ..PLAIN }).unwrap();
        let expose = |seed| sensor.expose(ramp((8, 8, 3)).view(), seed).unwrap().x().clone();
        prop_assert_eq!(expose(seed), expose(seed));
        prop_assert!(expose(seed) != expose(seed.wrapping_add(1)));
    }
}

#[test]
fn radiance_spans_alpha_peaks() {
    let radiance = Array3::from_shape_vec((1, 4, 1), vec![0.0, 0.25, 0.5 + 0.4 / 1024.0, 1.0]).unwrap();
    let exposure = Sensor::new(PLAIN).unwrap().expose(radiance.view(), 0).unwrap();
    assert_eq!(numbers(&exposure.modulo()).into_raw_vec_and_offset().0, [0, 0, 0, 255]);
    assert_eq!(numbers(&exposure.saturated()).into_raw_vec_and_offset().0, [0, 255, 255, 255]);
    assert_eq!(numbers(&exposure.ideal()).into_raw_vec_and_offset().0, [0, 64, 128, 255]);
    assert_eq!(exposure.wraps().into_raw_vec_and_offset().0, [0, 1, 2, 3]);
}

#[test]
fn blur_keeps_what_is_even_and_softens_edges() {
    let sensor = Sensor::new(SensorConfig { psf: Psf::Paper7, ..PLAIN }).unwrap();
    let even = sensor.expose(Array3::from_elem((5, 9, 3), 0.5).view(), 0).unwrap();
    assert!(even.x().iter().all(|&x| (x - 512.0).abs() < 1e-3));
    let edge = Array3::from_shape_fn((1, 20, 1), |(_, j, _)| if j < 10 { 0.0 } else { 0.5 });
    let soft = sensor.expose(edge.view(), 0).unwrap();
    let want = [0.0, 0.03125, 0.140625, 0.359375, 0.640625, 0.859375, 0.96875, 1.0];
    for (j, want) in (6..).zip(want) {
        assert!((soft.x()[(0, j, 0)] - 512.0 * want).abs() < 1e-3, "column {j}");
    }
}

#[test]
fn noise_shows_in_every_stream_alike() {
    let sensor = Sensor::new(SensorConfig { read_noise: 5.0, ..PLAIN }).unwrap();
    let exposure = sensor.expose(Array3::from_elem((40, 40, 1), 0.1).view(), 3).unwrap();
    assert_eq!(exposure.modulo(), exposure.saturated(), "nothing wraps at a tenth of the range");
    assert!(exposure.x().iter().any(|&x| x < 100.0) && exposure.x().iter().any(|&x| x > 105.0));
}

#[test]
fn bad_pixels_and_shapes_are_named() {
    let sensor = Sensor::new(PLAIN).unwrap();
    for value in [f32::INFINITY, f32::NEG_INFINITY] {
        let mut radiance = ramp((4, 5, 3));
        radiance[(2, 3, 1)] = value;
        let error = sensor.expose(radiance.view(), 0).unwrap_err();
        let at = SamplePosition { row: 2, column: 3, channel: 1 };
        assert_eq!(error, SensorError::NotFinite(at, value));
    }
    let mut radiance = ramp((4, 5, 3));
    radiance[(2, 3, 1)] = f32::NAN;
    let error = sensor.expose(radiance.view(), 0).unwrap_err();
    let want = "radiance at (row 2, column 3, channel 1) is NaN, finite numbers are needed";
    assert_eq!(error.to_string(), want);
    assert!(sensor.expose(Array3::zeros((0, 5, 3)).view(), 0).is_err());
    assert!(sensor.expose(Array3::zeros((5, 5, 4)).view(), 0).is_err());
}

/// A field stop shades the first columns before the lens, also those of an image that has no others.
#[test]
fn optical_black_rises_from_no_radiance_to_all_of_it() {
    let even = |width| Array3::from_elem((3, width, 3), 0.5);
    let expose = |config, width| Sensor::new(config).unwrap().expose(even(width).view(), 0).unwrap();
    for (columns, black) in [(1usize, 1usize), (3, 1), (8, 2), (32, 8), (64, 16)] {
        let config = SensorConfig { optical_black: columns, ..PLAIN };
        let full = expose(config, 80);
        for ((_, column, _), &x) in full.x().indexed_iter() {
            let share = (column as f64 + 1.0 - black as f64) / (columns - black + 1) as f64;
            let want = 512.0 * share.clamp(0.0, 1.0);
            assert!(
                (f64::from(x) - want).abs() < 1e-3,
                "{columns} columns, column {column}: {x}, not {want}"
            );
        }
        let narrow = expose(config, columns.min(5));
        assert_eq!(narrow.x()[(1, 0, 2)], 0.0);
        let sharp = full.x().mapv(|x| x / 1024.0);
        let lens = SensorConfig { psf: Psf::Paper7, ..PLAIN };
        let blurred = Sensor::new(lens).unwrap().expose(sharp.view(), 0).unwrap();
        let behind = expose(SensorConfig { psf: Psf::Paper7, ..config }, 80);
        assert!(behind.x().iter().zip(blurred.x()).all(|(x, want)| (x - want).abs() < 1e-2), "{columns}");
    }
    let steepest = |alpha| {
        let bright = Array3::from_elem((1, 80, 1), 1.0);
        let sensor = Sensor::new(SensorConfig { optical_black: 32, alpha, ..PLAIN }).unwrap();
        let x = sensor.expose(bright.view(), 0).unwrap().x().clone();
        x.windows((1, 2, 1)).into_iter().map(|pair| pair[(0, 1, 0)] - pair[(0, 0, 0)]).fold(0.0, f32::max)
    };
    assert!(steepest(8.0) < 128.0 && steepest(16.0) > 128.0, "half a peak is 128 codes");
}

#[test]
fn headroom_scales_the_radiance_and_the_images_undo_it() {
    for (bits, transfer, gains) in [
        (8, Transfer::Linear, Gains::One),
        (12, Transfer::Srgb, Gains::One),
        (12, Transfer::Linear, Gains::checkerboard(4.0)),
    ] {
        let radiance = |(_, code, _): (usize, usize, usize)| transfer.decode(code as f64 / 255.0) as f32;
        let picture = Array3::from_shape_fn((4, 256, 1), radiance);
        let expose = |headroom| {
            let config = SensorConfig { bits, transfer, gains, headroom, ..PLAIN };
            Sensor::new(config).unwrap().expose(picture.view(), 0).unwrap()
        };
        let (all, with) = (expose(1.0), expose(0.97));
        assert!(with.x().iter().zip(all.x()).all(|(with, all)| (with - 0.97 * all).abs() < 0.01));
        assert_eq!(
            (with.range().limit(), with.range().white()),
            (all.range().limit(), 0.97 * all.range().limit())
        );
        let ideal = numbers(&with.ideal());
        // Dark codes of sRGB are less than a count apart.
        let near = |(code, shown): (usize, &u32)| code < 16 || shown.abs_diff(code as u32) <= 1;
        assert!(ideal.iter().enumerate().all(|(at, shown)| near((at % 256, shown))), "{bits} {transfer:?}");
        if gains != Gains::One {
            // The picture of a saturating sensor of two gains has all of the range, too.
            let brightest = |exposure: &modulo_core::Exposure| exposure.saturated().to_f32()[(1, 255, 0)];
            assert!((brightest(&with) - brightest(&all)).abs() <= 5.0, "a step of the low gain is 4 codes");
            assert!(brightest(&all) > 4080.0);
        }
    }
}

#[test]
fn parameters_out_of_range_are_named() {
    for bad in [f64::NAN, -1.0, f64::INFINITY, 1e9] {
        for (name, config) in [
            ("alpha", SensorConfig { alpha: bad, ..PLAIN }),
            ("psf sigma", SensorConfig { psf: Psf::Gaussian { sigma: bad }, ..PLAIN }),
            ("read_noise", SensorConfig { read_noise: bad, ..PLAIN }),
            ("shot_noise", SensorConfig { shot_noise: bad, ..PLAIN }),
            ("modulus", SensorConfig { modulus: bad, ..PLAIN }),
            ("reset_loss", SensorConfig { reset_loss: bad, ..PLAIN }),
            ("reset_spread", SensorConfig { reset_spread: bad, ..PLAIN }),
        ] {
            let error = Sensor::new(config).unwrap_err().to_string();
            assert!(error.starts_with(&format!("{name} is {bad}")), "{error}");
        }
    }
    assert!(Sensor::new(SensorConfig { bits: 0, ..PLAIN }).is_err());
    let error = Sensor::new(SensorConfig { optical_black: 65, ..PLAIN }).unwrap_err().to_string();
    assert_eq!(error, "optical_black is 65 columns, 0 to 64 are possible");
}

/// Returns the PSNR of 8-bit frames in dB.
fn psnr(a: &Frame, b: &Frame) -> f64 {
    let (a, b) = (a.to_f32(), b.to_f32());
    let squares: f64 = a.iter().zip(&b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
    10.0 * (255.0f64.powi(2) * a.len() as f64 / squares).log10()
}

/// Returns the PSNR against the sharp ideal image before and after the filter.
fn sharpness(radiance: &Array3<f32>, deblur: &Deblur) -> (f64, f64) {
    let range = Range::new(8, 4.0).unwrap();
    let ideal = Sensor::new(PLAIN).unwrap().expose(radiance.view(), 0).unwrap().ideal();
    let config = SensorConfig { psf: Psf::Paper7, ..PLAIN };
    let exposure = Sensor::new(config).unwrap().expose(radiance.view(), 0).unwrap();
    let mut recovered = Recovered::default();
    let mut lines = by_name("lines", &Options::default()).unwrap();
    lines.unwrap(&exposure.modulo(), &range.into(), &mut recovered).unwrap();
    let blurred = tone::linear8(&recovered.x, range).unwrap();
    let sharp = deblur.picture(&recovered.x, range, Transfer::Linear).unwrap();
    (psnr(&blurred, &ideal), psnr(&sharp, &ideal))
}

/// Returns the radiance of a KITTI frame, of the first `count` ones. Each code stands for an interval, in which the radiance is
/// at random, so that the grid of 8 bits does not show the wrap count. `None` without the data.
fn kitti(count: usize) -> Option<Vec<Array3<f32>>> {
    let folder = data::shared("data/kitti_object/image_2")?;
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    let radiance = |file: &std::path::PathBuf| {
        let image = image::open(file).unwrap().to_rgb8();
        let (width, height) = image.dimensions();
        let codes = Array3::from_shape_vec((height as usize, width as usize, 3), image.into_raw()).unwrap();
        let mut random = 1u32;
        codes.mapv(|code| {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let shift = (random >> 8) as f32 / (1 << 24) as f32 - 0.5;
            if code == 255 { 1.0 } else { (f32::from(code) + shift).max(0.0) / 255.0 }
        })
    };
    Some(files.iter().take(count).map(radiance).collect())
}

#[test]
fn kitti_comes_within_29_decibels_of_the_sharp_image() {
    let Some(frames) = kitti(6) else { return };
    let deblur = Deblur::new(Psf::Paper7);
    let mut sums = (0.0, 0.0);
    for radiance in &frames {
        let (before, after) = sharpness(radiance, &deblur);
        println!("{before:.2} dB, deblurred {after:.2} dB");
        sums = (sums.0 + before, sums.1 + after);
    }
    println!("mean: {:.2} dB, deblurred {:.2} dB", sums.0 / 6.0, sums.1 / 6.0);
    assert!(sums.1 / 6.0 >= 29.0);
}

#[test]
fn two_gains_recover_kitti_without_a_lens() {
    let Some(frames) = kitti(20) else { return };
    for (sigma, least) in [(0.0, 0.988), (0.8, 0.999)] {
        let gains = Gains::checkerboard(4.0);
        let sensor = Sensor::new(SensorConfig { psf: Psf::of_sigma(sigma), gains, ..PLAIN }).unwrap();
        let (mut method, mut recovered) = (TwoGains::new(gains).unwrap(), Recovered::default());
        let exact = frames.iter().map(|radiance| {
            let exposure = sensor.expose(radiance.view(), 0).unwrap();
            method.unwrap(&exposure.modulo(), &exposure.range().into(), &mut recovered).unwrap();
            let exact = exposure.exact_share(&recovered.k).unwrap();
            assert!(exact >= 0.999 || recovered.report.trust != Trust::Trusted, "{exact}");
            exact
        });
        let mean = exact.sum::<f64>() / frames.len() as f64;
        println!("behind {sigma} px: {:.3} % exact", 100.0 * mean);
        assert!(mean >= least, "behind {sigma} px: {mean}");
    }
}

#[test]
fn the_ideal_and_the_saturated_image_are_pictures_and_the_modulo_image_is_not() {
    let radiance = Array3::from_shape_fn((4, 64, 1), |(_, column, _)| column as f32 / 64.0);
    for bits in [8, 12] {
        let expose = |transfer| {
            let config = SensorConfig { bits, transfer, ..PLAIN };
            Sensor::new(config).unwrap().expose(radiance.view(), 0).unwrap()
        };
        let (linear, coded) = (expose(Transfer::Linear), expose(Transfer::Srgb));
        assert_eq!((coded.modulo(), coded.wraps()), (linear.modulo(), linear.wraps()));
        let x = linear.x().mapv(f32::floor);
        assert_eq!(coded.ideal(), tone::picture(&x, linear.range(), Transfer::Srgb).unwrap());
        assert_ne!(coded.ideal(), linear.ideal());
        let most = f64::from(linear.range().peak()) - 1.0;
        let code = |code: f32| (most * Transfer::Srgb.encode(f64::from(code) / most)).round() as f32;
        assert_eq!(coded.saturated().to_f32(), linear.saturated().to_f32().mapv(code));
        assert_eq!(coded.saturated().depth(), linear.saturated().depth());
    }
}

#[test]
fn a_lens_is_undone_in_radiance_before_it_is_shown() {
    let x = Array3::from_shape_fn((20, 30, 3), |(i, j, c)| ((i * 31 + j * 17 + c * 5) % 900) as f32);
    let (range, deblur) = (Range::new(8, 4.0).unwrap(), Deblur::new(Psf::Paper7));
    let linear = deblur.picture(&x, range, Transfer::Linear).unwrap().to_f32();
    let shown = deblur.picture(&x, range, Transfer::Srgb).unwrap().to_f32();
    for (linear, shown) in linear.iter().zip(&shown) {
        let [least, most] =
            [-0.51, 0.51].map(|half| Transfer::Srgb.encode((f64::from(*linear) + half) / 255.0));
        let bounds = (255.0 * least - 0.51)..=(255.0 * most + 0.51);
        assert!(bounds.contains(&f64::from(*shown)), "{linear} is shown as {shown}, not within {bounds:?}");
    }
}

#[test]
fn a_lens_that_does_nothing_changes_nothing() {
    let range = Range::new(8, 3.0).unwrap();
    let x = Array3::from_shape_fn((7, 20, 3), |(i, j, c)| (i * 31 + j * 17 + c) as f32);
    let deblur = Deblur::new(Psf::None);
    assert_eq!(deblur.picture(&x, range, Transfer::Linear), tone::linear8(&x, range));
}

#[test]
fn sharpens_an_edge_of_any_size_and_refuses_no_image() {
    let deblur = Deblur::new(Psf::Paper7);
    for (height, width, channels) in [(40, 60, 3), (17, 33, 1), (16, 619, 1)] {
        let edge = |(i, j, _): (usize, usize, usize)| if (i / 8 + j / 8) % 2 == 0 { 0.06 } else { 0.14 };
        let (before, after) = sharpness(&Array3::from_shape_fn((height, width, channels), edge), &deblur);
        assert!(after > before + 1.0, "{height} x {width}: {before:.1} dB, then {after:.1} dB");
    }
    assert!(
        deblur.picture(&Array3::zeros((0, 4, 3)), Range::new(8, 2.0).unwrap(), Transfer::Linear).is_err()
    );
    assert!(deblur.picture(&Array3::zeros((1, 1, 1)), Range::new(8, 2.0).unwrap(), Transfer::Linear).is_ok());
}

#[test]
fn noise_of_five_codes_leaves_a_gain() {
    let edges = |(i, j, _): (usize, usize, usize)| if (i / 8 + j / 8) % 2 == 0 { 0.3 } else { 0.7 };
    let radiance = Array3::from_shape_fn((60, 80, 3), edges);
    let sharp = Sensor::new(PLAIN).unwrap().expose(radiance.view(), 0).unwrap().ideal();
    let config = SensorConfig { psf: Psf::Paper7, read_noise: 5.0, ..PLAIN };
    let exposure = Sensor::new(config).unwrap().expose(radiance.view(), 0).unwrap();
    let (x, range) = (exposure.x().mapv(f32::floor), exposure.range());
    let blurred = psnr(&tone::linear8(&x, range).unwrap(), &sharp);
    let deblurred = psnr(&Deblur::new(Psf::Paper7).picture(&x, range, Transfer::Linear).unwrap(), &sharp);
    println!("{blurred:.2} dB, deblurred {deblurred:.2} dB");
    assert!(deblurred > blurred + 1.0, "{blurred:.2} dB, deblurred {deblurred:.2} dB");
}

/// Returns the RMS error of the deblurred `x` against the sharp image, in 8-bit codes: within 4 px of the border, and
/// inside.
fn errors_at_border_and_inside(x: &Array3<f32>, sharp: &Array3<f32>, psf: Psf) -> [f64; 2] {
    let shown = Deblur::new(psf).picture(x, Range::new(8, 4.0).unwrap(), Transfer::Linear).unwrap().to_f32();
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

/// The sensor continues the image at its border as the filter does. OpenCV's border, which is that of
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
        let config = SensorConfig { psf, ..PLAIN };
        let exposure = Sensor::new(config).unwrap().expose(sharp.view(), 0).unwrap();
        let [border, inside] = errors_at_border_and_inside(&exposure.x().mapv(f32::floor), &sharp, psf);
        let opencv = optics::blurred(sharp.clone(), psf).mapv(|x| (1024.0 * x).floor());
        let [opencv, _] = errors_at_border_and_inside(&opencv, &sharp, psf);
        println!("{psf:?}: {border:.2} at the border, {inside:.2} inside, {opencv:.2} at OpenCV's border");
        assert!(border < 2.0 * inside, "{psf:?}: {border:.2} at the border, {inside:.2} inside");
        assert!(opencv > 2.5 * border, "{psf:?}: {opencv:.2} at OpenCV's border, {border:.2} at its own");
    }
}

#[test]
fn the_fixed_pattern_has_the_statistics_that_were_asked_for_and_stays() {
    let config = SensorConfig { prnu: 0.02, hot_pixels: 0.01, ..SensorConfig::default() };
    let sensor = Sensor::new(config).unwrap();
    let dark = Array3::zeros((200, 300, 1));
    let bright = Array3::from_elem((200, 300, 1), 0.5);
    let [dark, bright, again] = [(&dark, 1), (&bright, 2), (&bright, 3)]
        .map(|(radiance, seed)| sensor.expose(radiance.view(), seed).unwrap());
    assert_eq!(bright.x(), again.x(), "the pattern is that of the sensor, and not of an exposure");
    let hot: Vec<f64> = dark.x().iter().filter(|x| **x > 0.0).map(|x| f64::from(*x)).collect();
    let share = hot.len() as f64 / dark.x().len() as f64;
    assert!((share / 0.01 - 1.0).abs() < 0.1, "{share}");
    let mean = hot.iter().sum::<f64>() / hot.len() as f64;
    assert!((mean / 128.0 - 1.0).abs() < 0.1, "evenly distributed up to the peak of 256: {mean}");
    let gains: Vec<f64> =
        bright.x().iter().zip(dark.x()).map(|(x, dark)| f64::from(x - dark) / 512.0).collect();
    let sigma = (gains.iter().map(|gain| (gain - 1.0).powi(2)).sum::<f64>() / gains.len() as f64).sqrt();
    assert!((sigma / 0.02 - 1.0).abs() < 0.02, "{sigma}");
}

/// All light of the range on chips whose resets are not ideal.
#[test]
fn the_charge_rises_with_the_light_and_rests_while_it_is_reset() {
    let light = Array3::from_shape_fn((64, 512, 1), |(i, j, _)| (512 * i + j) as f32 / 32768.0);
    let ideal = Sensor::new(PLAIN).unwrap().expose(light.view(), 0).unwrap();
    for (modulus, reset_loss) in
        [(1.0, 2.56), (0.99, 0.0), (1.01, 0.0), (0.95, 12.8), (1.05, 12.8), (0.99, 2.56)]
    {
        let config = SensorConfig { modulus, reset_loss, ..PLAIN };
        let exposure = Sensor::new(config).unwrap().expose(light.view(), 0).unwrap();
        assert_eq!((exposure.x(), exposure.ideal()), (ideal.x(), ideal.ideal()), "the light is the same");
        assert_eq!(exposure.saturated(), ideal.saturated());
        let (charge, y, k) = (exposure.charge(), exposure.modulo().to_f32(), exposure.wraps());
        let all: Vec<f64> =
            charge.iter().zip(&k).map(|(c, k)| f64::from(*c) + f64::from(*k) * 256.0 * modulus).collect();
        let step = (256.0 * modulus + reset_loss) / 256.0 / 32.0;
        assert!(all.windows(2).all(|pair| (-1e-3..step + 1e-3).contains(&(pair[1] - pair[0]))), "{config:?}");
        let rest = all.windows(2).filter(|pair| pair[1] - pair[0] < step / 2.0).count() as f64 * step;
        // Light is lost in each reset, and at the end of the range.
        assert!((rest - 4.0 * reset_loss).abs() < 5.0 * step, "{config:?}: {rest} codes of light are lost");
        assert!(y.iter().zip(&charge).all(|(y, charge)| *y == charge.floor().min(255.0)));
        assert_eq!(k.iter().max(), Some(&3));
        // No error adds up.
        for ((y, k), x) in y.iter().zip(&k).zip(exposure.x()) {
            let error = f64::from(y + 256.0 * f32::from(*k) + 0.5 - x).abs();
            assert!(error < config.noise() + 0.6, "{config:?}: {error} at {x}");
        }
    }
    let config = SensorConfig { reset_spread: 0.01, ..PLAIN };
    let flat = Array3::from_elem((200, 300, 1), 0.9);
    let exposure = Sensor::new(config).unwrap().expose(flat.view(), 0).unwrap();
    let share = |k: u8| exposure.wraps().iter().filter(|found| **found == k).count() as f64 / 60_000.0;
    assert!(share(3) > 0.99 && exposure.x().iter().all(|x| *x == 0.9 * 1024.0));
    // x = 921.6 = 3 * 256 + 153.6, where a modulus that differs by 1 % moves the code by 7.7.
    let y = exposure.modulo().to_f32();
    let sigma = (y.iter().map(|y| f64::from(y - 153.1).powi(2)).sum::<f64>() / 60_000.0).sqrt();
    assert!((sigma / 7.68 - 1.0).abs() < 0.05, "{sigma}");
}

/// 2 x 2 pixels of a mosaic have one gain.
#[test]
fn two_gains_go_with_a_mosaic() {
    let radiance = Array3::from_shape_fn((64, 80, 3), |(i, j, c)| {
        0.5 + 0.45 * ((i as f32 / 23.0).sin() * (j as f32 / 29.0 + c as f32).cos())
    });
    let gains = Gains::checkerboard(4.0);
    let config = SensorConfig { gains, mosaic: Some(Mosaic::Grbg), ..PLAIN };
    let exposure = Sensor::new(config).unwrap().expose(radiance.view(), 0).unwrap();
    let low = |i: usize, j: usize| exposure.gain(i, j) < 1.0;
    assert!(low(2, 0) && low(3, 1) && !low(0, 0) && !low(1, 1), "pairs of rows and columns");
    let mut out = Recovered::default();
    let mut method = TwoGains::new(gains).unwrap();
    method.unwrap(&exposure.modulo(), &exposure.range().into(), &mut out).unwrap();
    assert_eq!((exposure.exact_share(&out.k), out.report.trust), (Some(1.0), Trust::Trusted));
    let saturated = exposure.saturated();
    let apart = (saturated.to_f32() - exposure.x().mapv(|x| x / 4.0)).mapv(f32::abs);
    // Beyond the border lies the mirror image, whose slope is another one: up to three pixels of 5 codes.
    for ((row, column, _), difference) in apart.indexed_iter() {
        let is_inside = (4..60).contains(&row) && (4..76).contains(&column);
        assert!(*difference <= if is_inside { 3.0 } else { 16.0 }, "({row}, {column}): {difference}");
    }
}
