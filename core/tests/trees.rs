//! The methods that grow from what is most certain: `tree`, `gradient_tree`, `quality_guided`.

// Helpers of tests may unwrap as tests do.
#![allow(clippy::unwrap_used)]

use modulo_core::unwrap::{Options, by_name};
use modulo_core::{Frame, Range, Recovered};
use ndarray::Array3;
use proptest::prelude::*;

fn unwrap(method: &str, options: &Options, y: &Frame, range: Range) -> Recovered {
    let mut out = Recovered::default();
    by_name(method, options).unwrap().unwrap(y, range, &mut out).unwrap();
    out
}

/// Herraez' sort as it is written down, in turns of one peak, groups relabelled pixel by pixel.
fn herraez(y: &[f64], height: usize, width: usize) -> Vec<i32> {
    let wrapped = |d: f64| (d + 0.5).rem_euclid(1.0) - 0.5;
    let at = |i: usize, j: usize| y[i * width + j];
    let bad = |i: usize, j: usize| {
        if i == 0 || j == 0 || i + 1 == height || j + 1 == width {
            return 1e6;
        }
        let lines = [
            [(i, j - 1), (i, j + 1)],
            [(i - 1, j), (i + 1, j)],
            [(i - 1, j - 1), (i + 1, j + 1)],
            [(i - 1, j + 1), (i + 1, j - 1)],
        ];
        let bend =
            |[a, b]: [(usize, usize); 2]| wrapped(at(a.0, a.1) - at(i, j)) - wrapped(at(i, j) - at(b.0, b.1));
        lines.map(|line| bend(line).powi(2)).iter().sum::<f64>()
    };
    let mut edges = Vec::new();
    for (i, j) in (0..height).flat_map(|i| (0..width).map(move |j| (i, j))) {
        let ends = [(i, j + 1), (i + 1, j)].into_iter().filter(|&(p, q)| p < height && q < width);
        edges.extend(ends.map(|(p, q)| (bad(i, j) + bad(p, q), i * width + j, p * width + q)));
    }
    edges.sort_by(|a, b| a.partial_cmp(b).unwrap());
    let (mut label, mut k): (Vec<usize>, Vec<i32>) = ((0..y.len()).collect(), vec![0; y.len()]);
    for (_, a, b) in edges {
        let (old, new) = (label[b], label[a]);
        let step = k[a] + (wrapped(y[b] - y[a]) - (y[b] - y[a])).round() as i32 - k[b];
        for pixel in (0..y.len()).filter(|&pixel| old != new && label[pixel] == old).collect::<Vec<_>>() {
            label[pixel] = new;
            k[pixel] += step;
        }
    }
    k
}

proptest! {
    /// On images that Itoh's condition does not hold for, so that the order is what counts.
    #[test]
    fn quality_guided_is_herraez_sort(
        dim in (1usize..14, 1usize..14),
        bits in 2u8..=10,
        rough in 1i32..40,
        steps in proptest::collection::vec(any::<u16>(), 14 * 14),
    ) {
        let (height, width) = dim;
        let peak = 1 << bits;
        let wave = |i: usize, j: usize| (peak as f64 * (1.0 + (0.5 * i as f64).sin() * (0.3 * j as f64).cos())) as i32;
        let x = Array3::from_shape_fn((height, width, 1), |(i, j, _)| {
            wave(i, j) + i32::from(steps[i * 14 + j]) % rough * peak / 40
        });
        let y = x.mapv(|x| (x % peak) as u16);
        // alpha so large that no count leaves the range.
        let range = Range::new(bits, 200.0).unwrap();
        let got = unwrap("quality_guided", &Options::default(), &Frame::from_u16(y.clone()).unwrap(), range);
        let turns: Vec<f64> = y.iter().map(|&y| f64::from(y) / f64::from(peak)).collect();
        let want = herraez(&turns, height, width);
        // The darkest 2 % may fall below 0 and be clamped.
        let shift = i32::from(*got.k.iter().max().unwrap()) - want.iter().max().unwrap();
        let want: Vec<_> = want.iter().map(|k| (k + shift).max(0)).collect();
        prop_assert_eq!(got.k.iter().map(|&k| i32::from(k)).collect::<Vec<_>>(), want);
    }
}
