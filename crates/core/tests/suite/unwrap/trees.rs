//! The methods that grow regions from their most reliable pixels: `tree`, `gradient_tree`.

use modulo_core::Range;
use modulo_core::unwrap::Options;
use ndarray::Array3;
use proptest::prelude::*;

use super::{recover, wrap16};

/// Returns a grey scene: dark ground with texture, an object with an edge of the lens's width, noise of the sensor.
fn scene(dim: (usize, usize, usize), bits: u8, height: f64, noise: &[u16]) -> Array3<u32> {
    let peak = f64::from(1u32 << bits);
    Array3::from_shape_fn(dim, |(i, j, c)| {
        let edge = 1.0 / (1.0 + (-1.1 * (j as f64 - dim.1 as f64 * 0.4 - 0.2 * i as f64)).exp());
        let noise = f64::from(noise[(i * 64 + j) % noise.len()]) / 65536.0 / 16.0;
        (peak * (0.2 + 0.05 * c as f64 + height * edge + noise)) as u32
    })
}

proptest! {
    #[test]
    fn threads_change_nothing(
        dim in (1usize..=64, 1usize..=64, prop_oneof![Just(1usize), Just(3)]),
        bits in 4u8..=16,
        alpha in 0.5f64..=256.0,
        rough in 1u32..=1 << 16,
        samples in proptest::collection::vec(any::<u16>(), 64 * 64),
    ) {
        let mask = (1u32 << bits) - 1;
        let x = Array3::from_shape_fn(dim, |(i, j, c)| {
            (40 * i * i + 3 * j * j + 7 * c) as u32 + u32::from(samples[i * 64 + j]) % rough
        });
        let (y, range) = (wrap16(&x.mapv(|x| x & mask), bits), Range::new(bits, alpha).unwrap());
        let many = Options { threads: 3, ..Options::default() };
        for method in ["tree", "gradient_tree"] {
            let one = recover(method, &Options::default(), &y, range);
            prop_assert_eq!(&one, &recover(method, &many, &y, range));
            prop_assert!(one.k.iter().all(|&k| k <= range.max_wraps()));
        }
    }

    /// An edge of several peaks with the width of the lens: first differences wrap, second differences do not.
    #[test]
    fn gradient_tree_climbs_edges_of_the_lens(
        dim in (24usize..=64, 40usize..=64, prop_oneof![Just(1usize), Just(3)]),
        bits in 8u8..=16,
        height in 2.5f64..4.0,
        noise in proptest::collection::vec(any::<u16>(), 64 * 64),
    ) {
        let x = scene(dim, bits, height, &noise);
        let got = recover("gradient_tree", &Options::default(), &wrap16(&x, bits), Range::new(bits, 5.0).unwrap());
        prop_assert_eq!(got.x, x.mapv(|x| x as f32));
    }
}

/// Windows with a sky that clips, in a wall of known brightness: only the range tells how bright the windows are.
#[test]
fn plateaus_of_full_scale_stay_at_full_scale() {
    let x = Array3::from_shape_fn((40, 96, 3), |(i, j, c)| {
        let window = (10..30).contains(&i) && j % 32 > 10 && j % 32 < 24;
        if window { 383 } else { 10 + c as u32 + 323 * j as u32 / 96 }
    });
    for method in ["tree", "gradient_tree"] {
        let got = recover(method, &Options::default(), &wrap16(&x, 8), Range::new(8, 1.5).unwrap());
        assert_eq!(got.x, x.mapv(|x| x as f32), "{method}");
    }
}

/// At an edge of grey objects all channels jump alike. A step that is below half a peak in two channels and
/// wrapped in one must not be taken before the path around it.
#[test]
fn channels_that_jump_apart_are_trusted_last() {
    let x = Array3::from_shape_fn((40, 40, 3), |(i, j, c)| {
        let ramp = 3 * i as u32;
        if j < 20 { 20 } else { 20 + ramp + if c == 2 { ramp / 3 } else { 0 } }
    });
    let got = recover("tree", &Options::default(), &wrap16(&x, 8), Range::new(8, 2.0).unwrap());
    assert_eq!(got.x, x.mapv(|x| x as f32));
}
