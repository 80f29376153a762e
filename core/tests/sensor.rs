//! The sensor's streams agree with each other and with eq. 1, and their noise depends only on the seed.

// Helpers of tests may unwrap as tests do.
#![allow(clippy::unwrap_used)]

use modulo_core::{Frame, Psf, SamplePosition, Sensor, SensorConfig, SensorError};
use ndarray::Array3;
use proptest::prelude::*;

const PLAIN: SensorConfig =
    SensorConfig { bits: 8, alpha: 4.0, psf: Psf::None, read_noise: 0.0, shot_noise: 0.0 };

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
        let config = SensorConfig { bits, alpha, psf, read_noise: noise.0, shot_noise: noise.1 };
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
        assert_eq!(error, SensorError::NotFinite { at, value });
    }
    let mut radiance = ramp((4, 5, 3));
    radiance[(2, 3, 1)] = f32::NAN;
    let error = sensor.expose(radiance.view(), 0).unwrap_err();
    let want = "radiance at (row 2, column 3, channel 1) is NaN, finite numbers are needed";
    assert_eq!(error.to_string(), want);
    assert!(sensor.expose(Array3::zeros((0, 5, 3)).view(), 0).is_err());
    assert!(sensor.expose(Array3::zeros((5, 5, 4)).view(), 0).is_err());
}

#[test]
fn parameters_out_of_range_are_named() {
    for bad in [f64::NAN, -1.0, f64::INFINITY, 1e9] {
        for (name, config) in [
            ("alpha", SensorConfig { alpha: bad, ..PLAIN }),
            ("psf sigma", SensorConfig { psf: Psf::Gaussian { sigma: bad }, ..PLAIN }),
            ("read_noise", SensorConfig { read_noise: bad, ..PLAIN }),
            ("shot_noise", SensorConfig { shot_noise: bad, ..PLAIN }),
        ] {
            let error = Sensor::new(config).unwrap_err().to_string();
            assert!(error.starts_with(&format!("{name} is {bad}")), "{error}");
        }
    }
    assert!(Sensor::new(SensorConfig { bits: 0, ..PLAIN }).is_err());
}
