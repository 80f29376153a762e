//! The cosine transform against the rustdct library, at the sizes of KITTI and at sizes with large prime factors.

// Helpers of tests may unwrap as tests do.
#![allow(clippy::unwrap_used)]

use modulo_core::dct::Dct2;
use proptest::prelude::*;

mod library;

use library::{Direction, Library};

/// The largest difference of two transforms in single precision.
const BOUND: f32 = 2e-5;

/// A plane without symmetry, in [-1, 1).
fn noise(n: usize) -> Vec<f32> {
    let hash = |i: u32| (i.wrapping_mul(2_654_435_761) ^ 0x9E37).wrapping_mul(40503) >> 8;
    (0..n as u32).map(|i| hash(i) as f32 / (1 << 23) as f32 - 1.0).collect()
}

/// Returns the largest difference, relative where a coefficient is large, as that of the mean is.
fn worst(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs() / b.abs().max(1.0)).fold(0.0, f32::max)
}

fn assert_agrees(height: usize, width: usize) {
    let plane = noise(height * width);
    let (mut ours, mut theirs) = (plane.clone(), plane.clone());
    let (mut dct, mut library) = (Dct2::new(height, width), Library::new(height, width));
    dct.forward(&mut ours).unwrap();
    library.transform(&mut theirs, Direction::Forward);
    assert!(worst(&ours, &theirs) < BOUND, "{height} x {width}, forward: off by {}", worst(&ours, &theirs));
    let energy = |p: &[f32]| p.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>();
    assert!((energy(&ours) / energy(&plane) - 1.0).abs() < 1e-5, "{height} x {width}: not orthonormal");
    // Each inverse on its own input: what a transform gets wrong, its own inverse could hide.
    let (mut ours, mut theirs) = (plane.clone(), plane.clone());
    dct.inverse(&mut ours).unwrap();
    library.transform(&mut theirs, Direction::Inverse);
    assert!(worst(&ours, &theirs) < BOUND, "{height} x {width}, inverse: off by {}", worst(&ours, &theirs));
    dct.forward(&mut ours).unwrap();
    assert!(worst(&ours, &plane) < BOUND, "{height} x {width}: no inverse");
}

#[test]
fn agrees_with_the_library_at_the_sizes_of_kitti_and_of_large_primes() {
    for (height, width) in
        [(375, 1242), (374, 1238), (370, 1226), (376, 1241), (370, 1224), (1, 619), (613, 1)]
    {
        assert_agrees(height, width);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn agrees_with_the_library_at_any_size(height in 1usize..180, width in 1usize..180) {
        assert_agrees(height, width);
    }
}
