//! Results against others: the phi of SPUD and of least squares against dense matrices and scipy
//! (`tests/peers/spud_reference.py`), and the metrics against scikit-image (`tests/peers/ssim_reference.py`).

use std::f64::consts::PI;

use modulo_core::metric::{LEAST_SIDE, mse, psnr_db, ssim};
use modulo_core::unwrap::{Options, Spud, ThresholdOn, by_name};
use modulo_core::{Frame, Range, Recovered, SamplePosition, UnwrapError};
use ndarray::{Array2, Array3, Axis};
use proptest::prelude::*;

/// A plane without symmetry, of whole numbers in [0, 256).
fn noise(height: usize, width: usize) -> Array3<f32> {
    let hash = |i: usize| ((i as u32).wrapping_mul(2_654_435_761) ^ 0x9E37).wrapping_mul(40503) >> 24;
    Array3::from_shape_fn((height, width, 1), |(i, j, _)| hash(i * width + j) as f32)
}

/// The scene of `spud_reference.py`, in code units.
fn scene(height: usize, width: usize, channels: usize) -> Array3<f32> {
    let triangle = |t: usize, p: usize| (t % (2 * p)).abs_diff(p);
    Array3::from_shape_fn((height, width, channels), |(i, j, c)| {
        let slopes = 2 * triangle(3 * i + j + 17 * c, 150) + 3 * triangle(2 * j + i + 40 * c, 97);
        let block = if (i / 9 + j / 13) % 7 == 3 { 200 } else { 0 };
        (slopes + (7919 * i + 104_729 * j + 1_299_709 * c) % 5 + block) as f32
    })
}

/// Returns the orthonormal DCT-II as a matrix.
fn dct_matrix(n: usize) -> Array2<f64> {
    Array2::from_shape_fn((n, n), |(k, i)| {
        let scale = if k == 0 { 1.0 } else { 2.0 } / n as f64;
        scale.sqrt() * (PI * k as f64 * (i as f64 + 0.5) / n as f64).cos()
    })
}

/// Computes eq. 3 with the threshold on phi by dense matrices in f64; `y` is one channel.
fn dense_spud(y: &Array2<f64>, peak: f64, tau: f64) -> Array2<f64> {
    let (h, w) = y.dim();
    let centred = |d: f64| (d + peak / 2.0).rem_euclid(peak) - peak / 2.0;
    let mut rho = Array2::<f64>::zeros((h, w));
    for ((i, j), &here) in y.indexed_iter() {
        // Each difference leaves one pixel and enters the other: the adjoint of the gradient.
        for (i2, j2) in [(i + 1, j), (i, j + 1)] {
            if let Some(&next) = y.get((i2, j2)) {
                let g = centred(next - here);
                rho[(i, j)] -= g;
                rho[(i2, j2)] += g;
            }
        }
    }
    let (down, across) = (dct_matrix(h), dct_matrix(w));
    let mut spectrum = down.dot(&rho).dot(&across.t());
    for ((u, v), coefficient) in spectrum.indexed_iter_mut() {
        let cosine = |k: usize, n: usize| (PI * k as f64 / n as f64).cos();
        let phi = *coefficient / (2.0 * (2.0 - cosine(u, h) - cosine(v, w)));
        *coefficient = if (u, v) != (0, 0) && phi.abs() > tau * peak { phi } else { 0.0 };
    }
    down.t().dot(&spectrum).dot(&across)
}

/// Returns how far the phi of `y`, of one channel, is from that of dense matrices.
fn apart(y: &Array3<f32>, bits: u8, tau: f64) -> f64 {
    let range = Range::new(bits, 4.0).unwrap();
    let phi = Spud::new(tau, ThresholdOn::Phi).unwrap().solve(y.view(), range).unwrap();
    let plane = y.index_axis(Axis(2), 0).mapv(f64::from);
    let want = dense_spud(&plane, f64::from(range.peak()), tau);
    phi.iter().zip(&want).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max)
}

#[test]
fn agrees_with_dense_matrices_at_every_size() {
    // The sizes of KITTI, sizes of all radices and of large primes.
    let kitti = [(375, 1242), (374, 1238), (370, 1226), (376, 1241), (370, 1224)];
    let small = [(1, 1), (1, 7), (7, 1), (2, 2), (3, 4), (5, 8), (9, 12), (13, 19), (23, 46), (64, 64)];
    for (h, w) in [&kitti[..], &small].concat() {
        for (bits, tau) in [(8, 0.1), (10, 0.0)] {
            let peak = f32::from(1u16 << bits);
            let worst = apart(&scene(h, w, 1).mapv(|x| x % peak), bits, tau);
            assert!(worst < 0.02, "{h} x {w}, {bits} bits, tau {tau}: off by {worst} code units");
        }
    }
    for (h, w) in [&kitti[..], &small, &[(73, 75), (121, 150), (1, 619), (613, 1)]].concat() {
        let worst = apart(&noise(h, w), 8, 0.0);
        assert!(worst < 0.05, "noise of {h} x {w}: off by {worst} code units");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn agrees_with_dense_matrices_at_any_size(height in 1usize..180, width in 1usize..180) {
        let worst = apart(&noise(height, width), 8, 0.0);
        prop_assert!(worst < 0.05, "off by {} code units", worst);
    }
}

#[test]
fn agrees_with_scipy() {
    let mut phi = Array3::<f32>::zeros((0, 0, 0));
    let mut compared = 0;
    for line in include_str!("../data/spud_golden.txt").lines() {
        let words: Vec<&str> = line.split(' ').collect();
        let number = |at: usize| words[at].parse::<usize>().unwrap();
        if words[0] == "case" {
            let range = Range::new(number(4) as u8, 4.0).unwrap();
            let y = scene(number(1), number(2), number(3)).mapv(|x| x % range.peak());
            let on = if words[5] == "phi" { ThresholdOn::Phi } else { ThresholdOn::Rho };
            phi = Spud::new(words[6].parse().unwrap(), on).unwrap().solve(y.view(), range).unwrap();
            continue;
        }
        let (want, got) =
            (words[3].parse::<f64>().unwrap(), f64::from(phi[(number(0), number(1), number(2))]));
        assert!((want - got).abs() < 0.02, "{line}: {got}");
        compared += 1;
    }
    assert_eq!(compared, 8 * 40);
}

#[test]
fn takes_the_peak_but_nothing_beyond_and_no_nan() {
    let range = Range::new(8, 2.0).unwrap();
    let mut spud = Spud::new(0.1, ThresholdOn::Phi).unwrap();
    let mut y = Array3::from_elem((2, 3, 1), 256.0);
    assert!(spud.solve(y.view(), range).is_ok());
    for value in [256.5, -0.5, f32::INFINITY] {
        y[(1, 2, 0)] = value;
        let error = spud.solve(y.view(), range).unwrap_err();
        let at = SamplePosition { row: 1, column: 2, channel: 0 };
        assert_eq!(error, UnwrapError::Code { at, value, most: 256.0, bits: 8 });
    }
    y[(1, 2, 0)] = f32::NAN;
    assert!(spud.solve(y.view(), range).is_err());
    assert!(Spud::new(f64::NAN, ThresholdOn::Phi).is_err() && Spud::new(-0.1, ThresholdOn::Rho).is_err());
}

#[test]
fn threads_change_nothing() {
    for (height, width, channels, bits) in [(1, 1, 1, 8), (33, 50, 3, 8), (70, 79, 3, 12), (5, 300, 1, 3)] {
        let range = Range::new(bits, 4.0).unwrap();
        let x = scene(height, width, channels).mapv(|x| x as u32 & ((1 << bits) - 1));
        let y = match bits {
            ..=8 => Frame::from_u8(x.mapv(|x| x as u8)),
            _ => Frame::from_u16(x.mapv(|x| x as u16)),
        }
        .unwrap();
        let recover = |threads| {
            let options = Options { threads, ..Options::default() };
            let mut out = Recovered::default();
            by_name("spud", &options).unwrap().unwrap(&y, &range.into(), &mut out).unwrap();
            (out, Spud::with_threads(0.1, ThresholdOn::Phi, threads).unwrap().solve(y.to_f32().view(), range))
        };
        let alone = recover(1);
        for threads in [2, 3, 7] {
            assert!(recover(threads) == alone, "{height} x {width} x {channels}: {threads} threads");
        }
    }
}

const METRICS: &str = include_str!("../data/metric_golden.txt");

type Dim = (usize, usize, usize);

/// The function `image` of the script.
fn image(dim: Dim) -> Array3<usize> {
    Array3::from_shape_fn(dim, |(i, j, c)| {
        let texture = (7919 * i + 104_729 * j + 1_299_709 * c) % 23;
        let block = usize::from((i / 5 + j / 7) % 3 == 1);
        (3 * i + 2 * j + 31 * c + texture + 60 * block).min(255)
    })
}

/// The function `partner` of the script.
fn partner(a: &Array3<usize>, kind: &str) -> Array3<usize> {
    Array3::from_shape_fn(a.dim(), |(i, j, c)| {
        let value = a[(i, j, c)];
        match kind {
            "noise" => (value + (31 * i + 17 * j + 7 * c) % 19).saturating_sub(9).min(255),
            "shift" => a[(i, j.saturating_sub(1), c)],
            "negative" => 255 - value,
            "wrap" if (i / 16 + j / 16) % 2 == 1 => value / 2,
            "wrap" => value,
            _ => 128,
        }
    })
}

fn codes(values: &Array3<usize>) -> Array3<u8> {
    values.mapv(|value| u8::try_from(value).expect("0 to 255"))
}

#[test]
fn metrics_agree_with_scikit_image() {
    let mut cases = 0;
    for line in METRICS.lines() {
        let words: Vec<&str> = line.split(' ').collect();
        let [height, width, channels, kind, psnr, similarity] = words[..] else { panic!("{line}") };
        let side = |text: &str| text.parse().expect("a whole number");
        let number = |text: &str| text.parse::<f64>().expect("a number");
        let a = image((side(height), side(width), side(channels)));
        let (a, b) = (codes(&a), codes(&partner(&a, kind)));
        let got = psnr_db(mse(&a, &b).unwrap()).unwrap();
        assert!((got - number(psnr)).abs() < 1e-8, "{line}: psnr {got}");
        let got = ssim(&a, &b).unwrap().unwrap();
        assert!((got - number(similarity)).abs() < 1e-8, "{line}: ssim {got}");
        cases += 1;
    }
    assert_eq!(cases, 7);
}

#[test]
fn ssim_of_equal_pictures_is_one_and_small_ones_have_none() {
    let a = codes(&image((20, 30, 3)));
    assert!((ssim(&a, &a).unwrap().unwrap() - 1.0).abs() < 1e-12);
    for dim in [(LEAST_SIDE - 1, 40, 3), (40, LEAST_SIDE - 1, 1), (1, 1, 1)] {
        let a = codes(&image(dim));
        assert_eq!(ssim(&a, &a), Ok(None), "{dim:?}");
    }
    assert!(ssim(&a, &codes(&image((20, 30, 1)))).is_err());
}
