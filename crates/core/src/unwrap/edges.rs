//! Whether an edge of the scene could be as wrong as by a multiple of the peak without a trace, so that no result is to be trusted.
//!
//! Where all second differences of the scene are below half a peak, only one result has this property. Behind a lens, those of
//! an edge have an upper bound ([`sharpest`]):
//!
//! | edge | a result is trusted |
//! |---|---|
//! | up to half a peak | unless very many of its second differences are near half a peak or above it |
//! | up to [`READABLE`] | if hardly one is: where an edge may be wrong, its wrapped second differences are at least 3/16 of the peak |
//! | above | never |
//! | of an unknown lens | as up to half a peak, if the image has soft edges and hardly any as sharp as without a lens |
//!
//! On a mosaic, samples of one colour are two pixels apart, where edges bend more: there a result is trusted up to [`READABLE`] unless very many of these
//! second differences are near half a peak. With two gains, a result is trusted up to [`OF_TWO_GAINS`].
//!
//! An unknown lens is taken for one of at least 0.8 px (of at least 1.2 px on a mosaic) where the edges of the image show so: a lens blurs all of
//! them alike. Those of less than half a peak show it, since they cannot have wrapped. It is not seen where an edge differs from a multiple of the peak by less than a sixteenth of it or by the noise, while others are soft by themselves.

use ndarray::Array3;

use super::{Range, Recovered, Scene, Trust, fit_up_to, jumps};
use crate::frame::{Frame, in_order};
use crate::simd::widest;

/// The largest second difference, in peaks, of an edge that is read right.
pub(super) const SAFE: f64 = 0.5;

/// The largest one, in peaks, of an edge that betrays itself where it is read wrong: modulo the peak, it is 3/16 of it.
const READABLE: f64 = 13.0 / 16.0;

/// Second differences above so many eighths of the peak are near half of it. True ones at most as large are off by 5/8 where a count is wrong.
pub(super) const NEAR_HALF: u16 = 3;

/// The maximum number of them per sample: natural frames behind a lens of 1.4 px at alpha 4 have 0.001 to 0.013, also with noise.
const MANY_NEAR_HALF: f32 = 1.0 / 64.0;

/// Second differences above this share of the peak may be those of an edge that is read wrong.
const BENT: f32 = 0.25;

/// The maximum number of them per sample, where an edge may be read wrong. A region of wrong counts of 0.1 % of the pixels has as many.
const FEW_BENT: f32 = 1e-3;

/// The largest second difference of an edge, in peaks, with which two gains are trusted: the mean of two opposite neighbours of low gain is wrong by
/// half of it. Where a count is wrong without a trace, it is wrong by 5/8 of the peak.
const OF_TWO_GAINS: f64 = 1.25;

/// The most second differences of one colour of a mosaic near half a peak, per sample. Natural frames have up to 0.18, and sharp shapes that are
/// wrong without a trace 0.3 and more.
const MANY_IN_MOSAIC: f32 = 0.25;

/// The heights, as shares of the peak, from which edges are searched that no lens has blurred.
const STEPS: [f32; 3] = [1.0 / 16.0, 1.0 / 8.0, 1.0 / 4.0];

/// A step stands alone if the differences before and after it are below this share of it; behind a lens of 0.8 px they are 0.46 of it.
const BESIDE: f32 = 0.35;

/// The lone steps over the second differences of the same height: a perfect lens has 1/2, noise 0.17, lenses from 0.5 px on have at most 0.11.
const SHARP: f64 = 0.25;

/// A lone step counts from this share of a height on. Noise raises the second differences beside a step that is a little
/// lower than this height above it.
const LONE: f32 = 0.85;

/// The least share of the second differences of a height that soft edges have: natural frames behind 0.8 px have 0.45, and 0.25
/// with noise of 3 codes. Edges that wrap seem soft by chance only.
const SOFT: f64 = 0.2;

/// The least lone steps per sample, and the least soft ones.
const FEWEST_STEPS: f64 = 2e-4;

/// Where the next samples of the same gain and colour are.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Arrangement {
    /// At the next pixel.
    Next,
    /// Two pixels away, in a colour mosaic of one gain.
    Mosaic,
    /// Samples of a lower gain lie between them, which do not wrap.
    TwoGains,
}

/// Downgrades a result whose errors could be undetectable.
pub(super) fn withhold_trust(y: &Frame, out: &mut Recovered, arrangement: Arrangement, scene: &Scene) {
    let range = scene.range;
    let is_trusted = [Trust::Trusted, Trust::Relative].contains(&out.report.trust);
    if is_trusted
        && range.max_wraps() > 0
        && may_hide(y, out, arrangement, sharpest(scene, y, arrangement), range)
    {
        out.report.trust = Trust::Unobservable;
    }
}

/// Returns the largest second difference of an edge from black to the end of the range, in peaks. It is infinite above the
/// largest alpha for which such a sensor is fit ([`fit_up_to`]), and `None` behind an unknown lens.
fn sharpest(scene: &Scene, y: &Frame, arrangement: Arrangement) -> Option<f64> {
    let (psf, alpha) = (scene.lens?, scene.range.alpha());
    let fit = fit_up_to(psf, y.mosaic().is_some(), arrangement == Arrangement::TwoGains);
    Some(if alpha > fit { f64::INFINITY } else { alpha * psf.bend() })
}

fn may_hide(
    y: &Frame,
    out: &mut Recovered,
    arrangement: Arrangement,
    edge: Option<f64>,
    range: Range,
) -> bool {
    let has_two_gains = arrangement == Arrangement::TwoGains;
    let is_too_sharp = edge.is_some_and(|edge| edge > if has_two_gains { OF_TWO_GAINS } else { READABLE });
    if has_two_gains || is_too_sharp {
        return is_too_sharp;
    }
    // No radiance is needed where the method has counted second differences, and the lens is safe.
    if out.near_half.is_none() || edge.is_none_or(|edge| edge > SAFE) {
        out.fill(y, range);
    }
    let (x, limit) = (&out.x, f32::from(NEAR_HALF) / 8.0 * range.peak());
    let near_half = || match out.near_half {
        Some(count) => count as f32 / out.k.len() as f32,
        None => jumps::share_above(x, limit),
    };
    match (arrangement, edge) {
        (Arrangement::Mosaic, _) => {
            share_of_mosaic(x, limit) > MANY_IN_MOSAIC || edge.is_none() && !has_soft_edges(x, 2, range)
        }
        (_, Some(edge)) if edge > SAFE => jumps::share_above(x, BENT * range.peak()) > FEW_BENT,
        (_, Some(_)) => near_half() > MANY_NEAR_HALF,
        (_, None) => near_half() > MANY_NEAR_HALF || !has_soft_edges(x, 1, range),
    }
}

/// Returns the second differences of the mosaic `x` above `limit` code units, per sample, along rows and columns of one colour.
fn share_of_mosaic(x: &Array3<f32>, limit: f32) -> f32 {
    let (height, width, _) = x.dim();
    let rows: Vec<&[f32]> = in_order(x.view()).chunks_exact(width).collect();
    let along = rows.iter().filter(|row| row.len() > 4);
    let along: u64 =
        along.map(|row| jumps::steep(&row[..width - 4], &row[2..width - 2], &row[4..], limit)).sum();
    let across: u64 =
        (4..height).map(|row| jumps::steep(rows[row - 4], rows[row - 2], rows[row], limit)).sum();
    (along + across) as f32 / x.len() as f32
}

/// Returns whether the image has soft edges, and those of no height are mostly as sharp as without a lens, along rows and columns
/// together. The next samples of one colour are `apart` pixels away.
fn has_soft_edges(x: &Array3<f32>, apart: usize, range: Range) -> bool {
    let (height, width, channels) = x.dim();
    // The shade beside the black columns makes all edges of the scene soft.
    let first = range.shaded().min(width);
    let (samples, stride) = (in_order(x.view()), width * channels);
    let row = |at: usize| &samples[at * stride..][first * channels..stride];
    let mut counts = [[0u64; 3]; STEPS.len()];
    let mut add = |lines: [&[f32]; 4], of: [u64; 3]| {
        let more = widest!(steps(lines, range.peak()));
        for (sums, counts) in counts.iter_mut().zip(more) {
            (0..3).for_each(|kind| sums[kind] += of[kind] * u64::from(counts[kind]));
        }
    };
    for at in 0..height {
        let columns = |from: usize, count: usize| {
            [0, 1, 2, 3]
                .map(|next| &samples[at * stride + (from + apart * next) * channels..][..count * channels])
        };
        if width > first + 3 * apart {
            add(columns(first, width - first - 3 * apart), [1, 1, 1]);
        }
        // The first second differences that count are those of the step between these columns, too.
        if first >= apart && width > first + 2 * apart {
            add(columns(first - apart, apart), [1, 0, 0]);
        }
    }
    (3 * apart..height).for_each(|at| add([3, 2, 1, 0].map(|before| row(at - apart * before)), [1, 1, 1]));
    let least = FEWEST_STEPS * (height * (width - first) * channels) as f64;
    let counts = counts.map(|counts| counts.map(|count| count as f64));
    let is_sharp = |&[lone, bent, _]: &[f64; 3]| lone > least && lone > SHARP * bent;
    let is_soft = |&[lone, bent, soft]: &[f64; 3]| soft > least && soft > lone && soft > SOFT * bent;
    counts.iter().any(is_soft) && !counts.iter().any(is_sharp)
}

/// Returns, for each height of [`STEPS`], how many steps of about this height between the second and the third line stand
/// alone, modulo the peak; how many second differences at the second line are higher; and how many such steps are those of
/// a soft edge of less than half a peak.
#[inline(always)]
fn steps([a, b, c, d]: [&[f32]; 4], peak: f32) -> [[u32; 3]; STEPS.len()] {
    let per_peak = peak.recip();
    // Rounded by a sum, which is faster than a call.
    let wrapped = |difference: f32| {
        let peaks = difference * per_peak;
        peaks - ((peaks + ROUNDING) - ROUNDING)
    };
    let mut counts = [[0; 3]; STEPS.len()];
    for (((a, b), c), d) in a.iter().zip(b).zip(c).zip(d) {
        let (before, step, after) = (wrapped(b - a), wrapped(c - b), wrapped(d - c));
        let (here, bend) = (step.abs(), wrapped(a + c - b - b).abs());
        let is_alone = before.abs().max(after.abs()) < BESIDE * here;
        // The signs are those of the step.
        let (before, after) = (before * step.signum(), after * step.signum());
        let is_soft = (before.min(after) > BESIDE * here) & (before + here + after < 0.5);
        for ([lone, bent, soft], height) in counts.iter_mut().zip(STEPS) {
            let is_high = here > LONE * height;
            *lone += u32::from(is_alone & is_high);
            *soft += u32::from(is_soft & is_high);
            *bent += u32::from(bend > height);
        }
    }
    counts
}

/// Adding and subtracting 1.5 * 2^23 rounds a number of either sign to the nearest whole one.
const ROUNDING: f32 = 12_582_912.0;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::unwrap::{Lines, Method, Options, Unwrap as _};
    use crate::{Frame, Psf, Sensor, SensorConfig};

    /// An image of 60 x 80 pixels with an edge of `height` peaks behind a lens of `sigma` px.
    fn edge(height: f32, sigma: f64) -> Array3<f32> {
        let x =
            Array3::from_shape_fn((60, 80, 1), |(_, j, _)| if j < 40 { 10.0 } else { 10.0 + 256.0 * height });
        crate::optics::blurred(x, Psf::of_sigma(sigma))
    }

    #[test]
    fn the_bend_of_a_lens_is_that_of_its_edge() {
        for sigma in [0.0, 0.5, 0.8, 1.0, 1.4, 2.0] {
            let x = edge(1.0, sigma);
            let second =
                |j: usize| (x[(30, j - 1, 0)] + x[(30, j + 1, 0)] - 2.0 * x[(30, j, 0)]).abs() / 256.0;
            let largest = (1..79).map(second).fold(0.0, f32::max);
            assert!((f64::from(largest) - Psf::of_sigma(sigma).bend()).abs() < 1e-4, "{sigma} px: {largest}");
        }
    }

    #[test]
    fn edges_that_may_hide_a_peak_are_told_by_the_lens_and_without_it_by_their_sharpness() {
        let range = Range::new(8, 4.0).unwrap();
        let hides = |height, sigma, edge_of_lens| {
            let mut out = Recovered { x: edge(height, sigma), ..Recovered::default() };
            let y = Frame::from_u8(out.x.mapv(|x| x as u8)).unwrap();
            may_hide(&y, &mut out, Arrangement::Next, edge_of_lens, range)
        };
        // A soft edge of more than half a peak may be a sharp one that has wrapped.
        for (height, sigma, hidden) in [
            (0.3, 0.0, true),
            (0.3, 0.3, true),
            (0.3, 0.8, false),
            (0.6, 1.4, false),
            (0.9, 1.4, true),
            (0.5, 0.0, true),
        ] {
            assert_eq!(hides(height, sigma, None), hidden, "{height} peaks, {sigma} px");
        }
        let behind = Some;
        assert!(hides(0.0, 1.4, behind(f64::INFINITY)) && hides(0.0, 0.0, behind(4.0)));
        assert!(!hides(1.0, 1.0, behind(0.75)) && hides(2.0, 1.0, behind(0.75)), "an edge near half a peak");
        assert!(!hides(2.9, 1.4, behind(0.47)) && hides(3.9, 1.4, behind(0.47)), "many are near half a peak");
    }

    /// The shade beside the black columns makes the edge of a rectangle soft whose other edges are whole peaks.
    #[test]
    fn edges_in_the_shade_do_not_show_the_lens() {
        let config =
            SensorConfig { alpha: 3.0, psf: Psf::None, optical_black: 32, ..SensorConfig::default() };
        let light = Array3::from_shape_fn((64, 96, 1), |(i, j, _)| {
            let is_inside = (18..41).contains(&i) && (30..55).contains(&j);
            if is_inside { 215.0 / 255.0 } else { 40.0 / 255.0 }
        });
        let exposure = Sensor::new(config).unwrap().expose(light.view(), 0).unwrap();
        let mut out = Recovered::default();
        let scene = Scene { lens: None, ..exposure.scene() };
        Method::Auto
            .build(&Options::default())
            .unwrap()
            .unwrap(&exposure.modulo(), &scene, &mut out)
            .unwrap();
        assert!(
            exposure.exact_share(&out.k).is_some_and(|share| share < 0.95),
            "the codes show no edge of the rectangle"
        );
        assert!(!matches!(out.report.trust, Trust::Trusted | Trust::Relative), "{:?}", out.report.trust);
    }

    proptest! {
        #[test]
        fn lines_count_what_is_near_half_a_peak(
            (bits, most, rough) in (1u8..=16, 1u16..90, 0.0..2.0f32),
            (height, width, rgb) in (1usize..9, 1usize..200, any::<bool>()),
            seed in any::<u64>(),
        ) {
            let range = Range::new(bits, f64::from(most)).unwrap();
            let (limit, mut random) = (range.limit() as f32, seed | 1);
            let dim = (height, width, if rgb { 3 } else { 1 });
            let y = Array3::from_shape_fn(dim, |(i, j, _)| {
                random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                let noise = rough * (random >> 40) as f32 / (1u32 << 24) as f32 * range.peak();
                let smooth = limit * (0.5 + 0.4 * (j as f32 / 60.0 + i as f32 / 5.0).sin());
                ((smooth + noise) as u32 % (1 << bits)) as u16
            });
            let (y, mut out, mut left_out) = (Frame::from_u16(y).unwrap(), Recovered::default(), Recovered::default());
            Lines::default().unwrap(&y, &range.into(), &mut out).unwrap();
            let mut lines = Lines::default();
            let scene = Scene { radiance: false, ..range.into() };
            lines.unwrap(&y, &scene, &mut left_out).unwrap();
            prop_assert!(left_out.x.is_empty());
            left_out.fill(&y, range);
            prop_assert_eq!(&left_out, &out);
            let counted = out.near_half.expect("lines count") as f32 / out.x.len() as f32;
            prop_assert_eq!(counted, jumps::share_above(&out.x, f32::from(NEAR_HALF) / 8.0 * range.peak()));
            out.buffers();
            prop_assert_eq!(out.near_half, None, "radiance that may be changed has no count");
        }
    }
}
