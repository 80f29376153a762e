//! The metrics against scikit-image (`tests/peers/ssim_reference.py`).

use modulo_core::metric::{LEAST_SIDE, mse, psnr_db, ssim};
use ndarray::Array3;

const GOLDEN: &str = include_str!("data/metric_golden.txt");

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
fn agree_with_scikit_image() {
    let mut cases = 0;
    for line in GOLDEN.lines() {
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
