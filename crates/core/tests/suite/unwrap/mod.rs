//! The properties of every method: congruence on any image, exactness under Itoh's condition. Some tests are of images
//! whose neighbours differ by more than half a peak, so that Itoh's condition fails: smooth bumps and edges of the
//! lens's width.

use modulo_core::unwrap::{METHODS, Options, Scene, Trust, by_name};
use modulo_core::{Frame, Mosaic, Psf, Range, Recovered, SamplePosition, UnwrapError};
use ndarray::{Array3, Axis, s};
use proptest::prelude::*;

mod circles;
mod trees;

/// Returns codes of noise without any scene.
fn noise(dim: (usize, usize, usize), bits: u8) -> Array3<u32> {
    let mut random = 1_u64;
    Array3::from_shape_simple_fn(dim, || {
        random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (random >> 40) as u32 % (1 << bits)
    })
}

/// Returns the modulo image of `x` in 16-bit samples.
fn wrap16(x: &Array3<u32>, bits: u8) -> Frame {
    Frame::from_u16(x.mapv(|x| (x & ((1 << bits) - 1)) as u16)).unwrap()
}

/// Returns the result of a method, which is the same where its radiance is left out at first.
fn recover(method: &str, options: &Options, y: &Frame, scene: impl Into<Scene>) -> Recovered {
    let scene = scene.into();
    let [out, left_out] = [true, false].map(|radiance| {
        let (mut method, mut out) = (by_name(method, options).unwrap(), Recovered::default());
        method.unwrap(y, &Scene { radiance, ..scene }, &mut out).unwrap();
        out.fill(y, scene.range);
        out
    });
    assert_eq!((&out.x, &out.k, out.report), (&left_out.x, &left_out.k, left_out.report));
    out
}

/// Returns the modulo image of `x` in samples of 8 bits if these suffice, else of 16.
fn wrap(x: &Array3<u32>, bits: u8) -> Frame {
    match bits {
        ..=8 => Frame::from_u8(x.mapv(|x| (x & ((1 << bits) - 1)) as u8)).unwrap(),
        _ => wrap16(x, bits),
    }
}

/// Returns the smallest alpha that holds `x`, and whether the offset is determined: in every channel more than 2
/// % of the pixels must have k = 0.
fn range_of(x: &Array3<u32>, bits: u8) -> (Range, bool) {
    let alpha = x.iter().max().map_or(1, |most| (most >> bits) + 1);
    let dark = |c| x.index_axis(Axis(2), c).iter().filter(|&&x| x >> bits == 0).count() * 50;
    let known = (0..x.dim().2).all(|c| dark(c) > x.dim().0 * x.dim().1);
    (Range::new(bits, f64::from(alpha)).unwrap(), known)
}

fn itoh_holds(x: &Array3<u32>, bits: u8) -> bool {
    let small = |axis| {
        x.axis_windows(Axis(axis), 2).into_iter().all(|pair| {
            let (a, b) = (pair.index_axis(Axis(axis), 0), pair.index_axis(Axis(axis), 1));
            a.iter().zip(&b).all(|(a, b)| a.abs_diff(*b) < 1 << (bits - 1))
        })
    };
    (x.dim().0 < 2 || small(0)) && (x.dim().1 < 2 || small(1))
}

/// Returns whether second differences along rows, along columns and mixed are below half the peak, too.
fn second_order_holds(x: &Array3<u32>, bits: u8) -> bool {
    let x = x.mapv(i64::from);
    let (h, w, _) = x.dim();
    let along = |x: &Array3<i64>, axis: usize| {
        let mut d = x.slice_axis(Axis(axis), (1..).into()).to_owned();
        d -= &x.slice_axis(Axis(axis), (..-1).into());
        d
    };
    let small = |d: &Array3<i64>| d.iter().all(|d| d.abs() < 1 << (bits - 1));
    (h < 3 || small(&along(&along(&x, 0), 0)))
        && (w < 3 || small(&along(&along(&x, 1), 1)))
        && (h < 2 || w < 2 || small(&along(&along(&x, 0), 1)))
}

fn assert_exact(method: &str, options: &Options, x: &Array3<u32>, bits: u8, range: Range) {
    let out = recover(method, options, &wrap(x, bits), range);
    assert_eq!(out.x, x.mapv(|x| x as f32), "{method}, {bits} bits, {range:?}");
    assert_eq!(out.k, x.mapv(|x| (x >> bits) as u8));
    if method != "auto" {
        assert_eq!((out.report.method, out.report.trust), (method, Trust::Unknown));
    }
}

/// Returns a walk whose steps are below half the peak, folded into three peaks.
fn walk(steps: &[u16], n: usize, bits: u8) -> Vec<u32> {
    let (half, most) = (1i64 << (bits - 1), 3i64 << bits);
    let mut at = 0;
    let next = |step: &u16| {
        // Reflected at both ends, so that the walk stays within three peaks.
        let step = i64::from(*step) % (2 * half - 1) - (half - 1);
        at = if (0..most).contains(&(at + step)) { at + step } else { at - step };
        at as u32
    };
    steps[..n].iter().map(next).collect()
}

fn shape() -> impl Strategy<Value = (usize, usize, usize)> {
    (1usize..=40, 1usize..=40, prop_oneof![Just(1usize), Just(3)])
}

/// Returns an image of this range behind a lens that makes each edge bend less than half a peak.
fn behind_a_soft_lens(range: Range) -> Scene {
    Scene { lens: Some(Psf::of_sigma(4.0)), ..range.into() }
}

#[test]
fn an_image_that_says_nothing_is_not_trusted() {
    let trust = |dim, code: u8, alpha| {
        let y = Frame::from_u8(Array3::from_elem(dim, code)).unwrap();
        recover("auto", &Options::default(), &y, behind_a_soft_lens(Range::new(8, alpha).unwrap()))
            .report
            .trust
    };
    for dim in [(1, 1, 1), (1, 1, 3), (2, 2, 3), (1, 64, 1), (64, 1, 3), (30, 40, 3)] {
        for code in [0, 44, 255] {
            // Only an image with enough lines could contradict itself.
            let expected = if dim == (30, 40, 3) { Trust::Relative } else { Trust::Unobservable };
            assert_eq!(trust(dim, code, 4.0), expected, "{dim:?} {code}");
            assert_eq!(trust(dim, code, 1.0), Trust::Trusted, "{dim:?} {code}: nothing can wrap");
        }
    }
    // A steep edge in so small an image: nothing tells 200 from -56.
    let y = Frame::from_u8(Array3::from_shape_fn((2, 2, 1), |(_, j, _)| [10, 210][j])).unwrap();
    let range = Range::new(8, 2.0).unwrap();
    assert_eq!(recover("auto", &Options::default(), &y, range).report.trust, Trust::Unobservable);
}

/// An island whose contour of 200 codes looks like one of -56 codes, but at two notches.
#[test]
fn hard_edges_in_a_single_colour_are_not_trusted() {
    let x = Array3::from_shape_fn((200, 200, 1), |(i, j, _)| {
        let island = (60..90).contains(&i) && (80..110).contains(&j);
        let notch = [60, 61, 88, 89].contains(&i) && (90..93).contains(&j);
        (j * 5 / 2) as u32 + if notch { 90 } else { 200 * u32::from(island) }
    });
    let range = Range::new(8, 2.0).unwrap();
    let out = recover("auto", &Options::default(), &wrap(&x, 8), range);
    let wrong = out.x.iter().zip(&x).filter(|(got, x)| **got != **x as f32).count();
    assert!(wrong > 800, "{wrong} of 40000");
    assert_eq!(
        (out.report.method, out.report.trust),
        ("gradient_tree", Trust::Unobservable),
        "{:?}",
        out.report
    );
}

proptest! {
    /// The sharpest images that Itoh's condition allows.
    #[test]
    fn undoes_the_wrap_of_any_walk(
        dim in shape(),
        bits in 4u8..=16,
        steps in proptest::collection::vec(any::<u16>(), 240),
    ) {
        let lines: Vec<_> = steps.chunks(40).collect();
        let down: Vec<_> = (0..3).map(|c| walk(lines[c], dim.0, bits)).collect();
        let across: Vec<_> = (0..3).map(|c| walk(lines[c + 3], dim.1, bits)).collect();
        let x = Array3::from_shape_fn(dim, |(i, j, c)| down[c][i] + across[c][j]);
        let (range, known) = range_of(&x, bits);
        prop_assume!(known && itoh_holds(&x, bits));
        // tau > 0 may flatten such rough images; least squares may not.
        assert_exact("spud", &Options { tau: 0.0, ..Options::default() }, &x, bits, range);
        for method in ["itoh", "tree"] {
            assert_exact(method, &Options::default(), &x, bits, range);
        }
    }

    /// The same y belongs to scenes that differ by whole peaks: none of them has a dark part that tells them apart.
    #[test]
    fn a_flat_scene_whose_offset_the_range_leaves_open_is_never_trusted(
        dim in shape(),
        bits in 2u8..=16,
        alpha in 2u8..=8,
        level in any::<u16>(),
        ripple in proptest::collection::vec(0u32..=u32::from(u16::MAX), 40),
    ) {
        let peak = 1u32 << bits;
        let range = Range::new(bits, f64::from(alpha)).unwrap();
        // The ripple is below a quarter of the peak, and may carry y over the end of a period.
        let x = Array3::from_shape_fn(dim, |(i, j, _)| u32::from(level) % peak + ripple[(i + j) % 40] % peak.div_ceil(4));
        let out = recover("auto", &Options::default(), &wrap(&x, bits), range);
        let filled = |c| {
            let k = out.k.index_axis(Axis(2), c);
            k.iter().max().unwrap() - k.iter().min().unwrap() == range.max_wraps()
        };
        prop_assume!(!(0..dim.2).all(filled));
        prop_assert_ne!(out.report.trust, Trust::Trusted);
    }

    /// A smooth scene with a dark part is recovered. It is trusted only if it is so bright that the range leaves no other offset.
    #[test]
    fn a_smooth_scene_is_trusted_if_it_reaches_the_end_of_the_range(
        (height, width, channels) in shape(),
        bits in 6u8..=16,
        spare in 0u8..3,
        rise in 0.3f64..2.9,
    ) {
        prop_assume!(height >= 8 && width >= 8);
        let peak = f64::from(1u32 << bits);
        let x = Array3::from_shape_fn((height, width, channels), |(i, j, _)| {
            let round = (i + j) as f64 / (height + width - 2) as f64 * std::f64::consts::PI;
            (peak * rise * (1.0 - round.cos()) / 2.0) as u32
        });
        prop_assume!(second_order_holds(&x, bits) && itoh_holds(&x, bits));
        let (range, known) = range_of(&x, bits);
        prop_assume!(known);
        let range = Range::new(bits, range.alpha() + f64::from(spare)).unwrap();
        // One more peak leaves the range even if alpha is 0.9 of the true one.
        let above = f64::from(*x.iter().max().unwrap()) - (range.limit() / 0.9 - peak);
        prop_assume!(above.abs() > 1.0);
        let trust = if above > 0.0 { Trust::Trusted } else { Trust::Relative };
        let out = recover("auto", &Options::default(), &wrap(&x, bits), behind_a_soft_lens(range));
        prop_assert_eq!((out.report.trust, out.x), (trust, x.mapv(|x| x as f32)));
    }

    #[test]
    fn undoes_the_wrap_of_smooth_images_as_the_paper_does(
        dim in shape(),
        bits in 4u8..=16,
        turns in (0f64..1.5, 0f64..1.5),
        phase in (0f64..6.3, 0f64..6.3),
        height in 0.2f64..4.0,
    ) {
        let peak = f64::from(1u32 << bits);
        let x = Array3::from_shape_fn(dim, |(i, j, c)| {
            let wave = |at: usize, n: usize, turns: f64, phase: f64| {
                0.5 + 0.5 * (6.3 * turns * at as f64 / n as f64 + phase + c as f64).sin()
            };
            (height * peak * wave(i, dim.0, turns.0, phase.0) * wave(j, dim.1, turns.1, phase.1)) as u32
        });
        let (range, known) = range_of(&x, bits);
        prop_assume!(known && itoh_holds(&x, bits) && second_order_holds(&x, bits));
        for method in METHODS {
            assert_exact(method, &Options::default(), &x, bits, range);
        }
    }

    #[test]
    fn any_image_gives_a_congruent_result(
        dim in (1usize..12, 1usize..12, prop_oneof![Just(1usize), Just(3)]),
        bits in 1u8..=16,
        alpha in 1e-3f64..=256.0,
        tau in prop_oneof![Just(0.0), 0f64..10.0],
        samples in proptest::collection::vec(any::<u16>(), 12 * 12 * 3),
    ) {
        let x = Array3::from_shape_fn(dim, |(i, j, c)| u32::from(samples[(i * 12 + j) * 3 + c]));
        let (y, range) = (wrap(&x, bits), Range::new(bits, alpha).unwrap());
        for method in METHODS {
            let out = recover(method, &Options { tau, ..Options::default() }, &y, range);
            prop_assert!(out.k.iter().all(|&k| k <= range.max_wraps()));
            prop_assert_eq!(&out.x, &(y.to_f32() + out.k.mapv(f32::from) * range.peak()));
        }
    }

    #[test]
    fn a_code_that_the_sensor_lacks_is_named(at in 0usize..35, bits in 1u8..=15) {
        let mut pixels = Array3::<u16>::zeros((5, 7, 1));
        pixels.as_slice_mut().unwrap()[at] = 1 << bits;
        let (y, range) = (Frame::from_u16(pixels).unwrap(), Range::new(bits, 2.0).unwrap());
        for method in METHODS {
            let mut out = Recovered::default();
            let error = by_name(method, &Options::default()).unwrap().unwrap(&y, &range.into(), &mut out).unwrap_err();
            let (value, most) = (range.peak(), range.peak() - 1.0);
            let at = SamplePosition { row: at / 7, column: at % 7, channel: 0 };
            let want = UnwrapError::Code { at, value, most, bits };
            prop_assert_eq!(error, want);
        }
    }
}

#[test]
fn buffers_are_reused_and_follow_the_shape() {
    let range = Range::new(8, 2.0).unwrap();
    for method in METHODS {
        let mut unwrap = by_name(method, &Options::default()).unwrap();
        let mut out = Recovered::default();
        let small = Frame::from_u8(Array3::from_elem((3, 4, 1), 9)).unwrap();
        let large = Frame::from_u8(Array3::from_elem((6, 5, 3), 200)).unwrap();
        unwrap.unwrap(&small, &range.into(), &mut out).unwrap();
        let before = (out.x.as_ptr(), out.k.as_ptr());
        // The same buffers must come back for the same shape.
        unwrap.unwrap(&small, &range.into(), &mut out).unwrap();
        assert_eq!(before, (out.x.as_ptr(), out.k.as_ptr()), "{method}");
        unwrap.unwrap(&large, &range.into(), &mut out).unwrap();
        assert_eq!((out.x.dim(), out.x.iter().all(|&x| x == 200.0)), ((6, 5, 3), true), "{method}");
    }
}

/// A node must not stand at a frame of noise. What is left out for that is said, and a limit that suffices changes nothing.
#[test]
fn work_beyond_the_limit_is_left_out_and_said() {
    let range = Range::new(8, 4.0).unwrap();
    let with = |work: f64, y: &Frame| recover("auto", &Options::default(), y, Scene { work, ..range.into() });
    let mosaic = |dim| wrap(&noise(dim, 8), 8).with_mosaic(Mosaic::Rggb).unwrap();
    for y in [wrap(&noise((96, 128, 1), 8), 8), wrap(&noise((96, 128, 3), 8), 8), mosaic((96, 128, 1))] {
        let free = with(f64::INFINITY, &y);
        assert!(!free.report.is_over_budget && free.report.method != "lines", "{:?}", free.report);
        assert_eq!(with(1e3, &y), free);
        for (work, method) in [(0.4, None), (0.0, Some("lines"))] {
            let bound = with(work, &y);
            assert!(method.is_none_or(|method| method == bound.report.method), "{:?}", bound.report);
            assert!(bound.report.is_over_budget && bound.report.trust == Trust::Untrusted);
            assert_eq!(with(work, &y), bound, "no clock is read");
            for ((x, k), y) in bound.x.iter().zip(&bound.k).zip(&y.to_f32()) {
                assert_eq!(*x, y + 256.0 * f32::from(*k));
            }
        }
    }
}

#[test]
fn a_frame_of_floats_is_no_modulo_image() {
    let y = Frame::from_f32(Array3::zeros((4, 5, 3))).unwrap();
    for method in METHODS {
        let mut unwrap = by_name(method, &Options::default()).unwrap();
        let error =
            unwrap.unwrap(&y, &Range::new(8, 2.0).unwrap().into(), &mut Recovered::default()).unwrap_err();
        assert_eq!(error, UnwrapError::Float, "{method}");
    }
}

#[test]
fn samples_of_8_bits_hold_no_codes_of_10() {
    let y = Frame::from_u8(Array3::from_shape_fn((8, 8, 1), |(i, j, _)| (97 * i + 31 * j) as u8)).unwrap();
    for method in METHODS {
        let mut unwrap = by_name(method, &Options::default()).unwrap();
        let error =
            unwrap.unwrap(&y, &Range::new(10, 4.0).unwrap().into(), &mut Recovered::default()).unwrap_err();
        assert_eq!(error, UnwrapError::Narrow { bits: 10 }, "{method}");
    }
}

#[test]
fn an_unknown_method_lists_the_known() {
    let Err(error) = by_name("snaphu", &Options::default()) else { panic!("there is no snaphu") };
    assert_eq!(
        error.to_string(),
        format!("method \"snaphu\" is unknown, possible are {}", METHODS.join(", "))
    );
}

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
