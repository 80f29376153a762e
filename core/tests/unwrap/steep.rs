//! Tests where neighbours differ by more than half a peak, so that Itoh's condition fails: smooth bumps and edges
//! of the lens's width.

use modulo_core::Range;
use modulo_core::unwrap::Options;
use ndarray::{Array3, s};
use proptest::prelude::*;

use super::{recover, wrap16};

fn recovered(method: &str, x: &Array3<u32>, bits: u8, alpha: f64) -> Array3<f32> {
    recover(method, &Options::default(), &wrap16(x, bits), Range::new(bits, alpha).unwrap()).x
}

/// Returns whether all values of one difference, `(i, j) -> weights`, are below half the peak.
fn small(x: &Array3<u32>, bits: u8, weights: &[(usize, usize, i64)]) -> bool {
    let (h, w, _) = x.dim();
    let reach = |side: fn(&(usize, usize, i64)) -> usize| weights.iter().map(side).max().unwrap_or(0);
    let (down, across) = (reach(|t| t.0), reach(|t| t.1));
    if h <= down || w <= across {
        return true;
    }
    let mut sum = Array3::<i64>::zeros((h - down, w - across, x.dim().2));
    for &(i, j, weight) in weights {
        sum += &x.slice(s![i..h - down + i, j..w - across + j, ..]).mapv(|x| weight * i64::from(x));
    }
    sum.iter().all(|d| d.abs() < 1 << (bits - 1))
}

const MIXED: &[(usize, usize, i64)] = &[(0, 0, 1), (1, 1, 1), (0, 1, -1), (1, 0, -1)];
const ACROSS: &[(usize, usize, i64)] = &[(0, 0, -1), (0, 1, 1)];
const DOWN: &[(usize, usize, i64)] = &[(0, 0, -1), (1, 0, 1)];
const ACROSS_TWICE: &[(usize, usize, i64)] = &[(0, 0, 1), (0, 1, -2), (0, 2, 1)];
const DOWN_TWICE: &[(usize, usize, i64)] = &[(0, 0, 1), (1, 0, -2), (2, 0, 1)];

/// Returns a dark background and a bump of `height` peaks whose slope is steep and smooth.
fn bump(dim: (usize, usize, usize), bits: u8, centre: (f64, f64), radius: f64, height: f64) -> Array3<u32> {
    let peak = f64::from(1u32 << bits);
    Array3::from_shape_fn(dim, |(i, j, c)| {
        let (u, v) = (i as f64 / dim.0 as f64 - centre.0, j as f64 / dim.1 as f64 - centre.1);
        let square = (u * dim.0 as f64).powi(2) + (v * dim.1 as f64).powi(2);
        let bump = (-0.5 * square / (radius + c as f64 * 0.3).powi(2)).exp();
        ((0.1 + height * bump) * peak) as u32
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, max_global_rejects: 20_000, ..ProptestConfig::default() })]

    /// The condition of the method holds, at any size and any depth.
    #[test]
    fn lines_undoes_the_wrap_of_steep_bumps(
        dim in (1usize..=40, 1usize..=40, prop_oneof![Just(1usize), Just(3)]),
        bits in 4u8..=16,
        centre in (0f64..1.0, 0f64..1.0),
        radius in 1.5f64..8.0,
        height in 0f64..7.5,
    ) {
        let x = bump(dim, bits, centre, radius, height);
        let dark = |c| x.slice(s![.., .., c]).iter().filter(|&&x| x >> bits == 0).count() * 50 > dim.0 * dim.1;
        prop_assume!((0..dim.2).all(dark));
        prop_assume!([MIXED, ACROSS_TWICE, DOWN_TWICE].iter().all(|weights| small(&x, bits, weights)));
        // The first row and column have no neighbour to ask: their majority must be right.
        let flat = bump(dim, bits, centre, radius, height).slice(s![.., ..2.min(dim.1), ..]).to_owned();
        let even = bump(dim, bits, centre, radius, height).slice(s![..2.min(dim.0), .., ..]).to_owned();
        prop_assume!(small(&flat, bits, ACROSS) && small(&even, bits, DOWN));
        prop_assert_eq!(recovered("lines", &x, bits, 8.0), x.mapv(|x| x as f32));
    }
}

#[test]
fn second_order_is_exact_where_first_differences_fail() {
    let x = bump((96, 128, 3), 8, (0.5, 0.5), 6.0, 7.0);
    assert!(small(&x, 8, MIXED) && !small(&x, 8, ACROSS), "the example must be steep and smooth");
    let truth = x.mapv(|x| x as f32);
    for method in ["lines", "gradient_tree"] {
        assert_eq!(recovered(method, &x, 8, 8.0), truth, "{method}");
    }
    for method in ["spud", "itoh"] {
        assert_ne!(recovered(method, &x, 8, 8.0), truth, "{method}");
    }
}

/// An edge of the lens's width along the whole image: the vote of most columns is unanimous and wrong.
#[test]
fn second_order_crosses_edges_along_whole_lines() {
    let edge = |at: usize| (600.0 / (1.0 + (-1.2 * (at as f64 - 30.2)).exp())) as u32;
    for turned in [false, true] {
        let x = Array3::from_shape_fn((64, 64, 1), |(i, j, _)| 40 + edge(if turned { j } else { i }));
        let violated = if turned { ACROSS } else { DOWN };
        assert!(!small(&x, 8, violated), "the edge must be steep");
        for method in ["lines", "gradient_tree"] {
            assert_eq!(recovered(method, &x, 8, 3.0), x.mapv(|x| x as f32), "{method}, turned: {turned}");
        }
    }
}

/// A step that grows from 0 to more than two peaks, with a smooth path around its upper end.
#[test]
fn tree_goes_round_a_cliff() {
    let slope = [10, 7, 5];
    let x = Array3::from_shape_fn((64, 48, 3), |(i, j, c)| if j < 24 { 9 } else { 9 + slope[c] * i as u32 });
    assert!(!small(&x, 8, ACROSS), "the cliff must be steep");
    assert_eq!(recovered("tree", &x, 8, 3.0), x.mapv(|x| x as f32));
    assert_ne!(recovered("itoh", &x, 8, 3.0), x.mapv(|x| x as f32));
}

/// A merge that leaves the range is refused, so a hard edge below half of the range is recovered.
#[test]
fn tree_keeps_to_the_range() {
    let x =
        Array3::from_shape_fn((16, 16, 1), |(i, j, _)| if i > 3 && j > 4 { 300 } else { 20 + 8 * i as u32 });
    let flat = x.mapv(|x| if x == 300 { 300 } else { 200 });
    assert_eq!(recovered("tree", &flat, 8, 1.5), flat.mapv(|x| x as f32));
}
