//! [`Stencil`]: the values that a sum over a run of samples can have behind a lens, for every scene in the range of the sensor.
//!
//! The radiance is `x = h * s` with the lens h and a scene `0 <= s <= A` of any shape. For weights f over a run of samples and `g = f * h`, the sum
//! of `f x` is at most A times the sum of the positive g, and at least -A times that of the negative ones; scenes of black and white attain both.
//! Rounding to codes moves it by at most half a code for each weight of 1. Any f gives bounds that hold: one that was not found exactly only excludes
//! fewer counts.

use crate::optics::Psf;
use crate::range::Range;

/// The number of the samples behind the one whose count is sought.
pub(super) const RUN: usize = 8;

/// The shares of the range at which a flat scene excludes most. Near its ends, far more is excluded than in the middle.
const LEVELS: [f64; 5] = [0.5, 0.0, 0.25, 0.75, 1.0];

/// The steps of the reweighted least squares, and the least residual that is told from 0.
const STEPS: usize = 40;
const LEAST_RESIDUAL: f64 = 1e-4;

/// The error of a code, in codes, with a margin.
const ROUNDING: f64 = 0.51;

/// The relative error of a sum in `f32`.
const OF_FLOAT: f64 = 1e-6;

/// The weights of the samples behind one, whose own weight is 1, and the least and the greatest sum that a scene can give, in peaks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stencil {
    pub weights: [f32; RUN],
    pub least: f32,
    pub greatest: f32,
}

/// Returns the stencils for a sensor, the one for the middle of the range first.
pub(super) fn stencils(lens: Psf, range: Range) -> [Stencil; LEVELS.len()] {
    let taps: Vec<f64> = lens.taps().into_iter().map(f64::from).collect();
    let top = range.white() / f64::from(range.peak());
    let rounding = ROUNDING / f64::from(range.peak());
    LEVELS.map(|level| Stencil::new(weights(&taps, top, level, rounding), &taps, top, rounding))
}

impl Stencil {
    fn new(weights: [f64; RUN + 1], taps: &[f64], top: f64, rounding: f64) -> Self {
        let weights = weights.map(|weight| f64::from(weight as f32));
        let seen = behind(&weights, taps);
        let sum = |sign: f64| seen.iter().map(|g| (sign * g).max(0.0)).sum::<f64>();
        let all: f64 = weights.iter().map(|weight| weight.abs()).sum();
        let tolerance = all * (rounding + OF_FLOAT * top);
        let (least, greatest) = (-top * sum(-1.0) - tolerance, top * sum(1.0) + tolerance);
        Self {
            weights: std::array::from_fn(|at| weights[at] as f32),
            least: (least as f32).next_down(),
            greatest: (greatest as f32).next_up(),
        }
    }

    /// Returns half of the interval of residuals that prove a count, in peaks: above 1/2, each scene has one count; below 0, none is proved.
    pub fn half_width(&self) -> f32 {
        1.0 - (self.greatest - self.least) / 2.0
    }
}

/// Returns `f * h`.
fn behind(weights: &[f64], taps: &[f64]) -> Vec<f64> {
    let mut seen = vec![0.0; weights.len() + taps.len() - 1];
    for (at, weight) in weights.iter().enumerate() {
        seen[at..].iter_mut().zip(taps).for_each(|(seen, tap)| *seen += weight * tap);
    }
    seen
}

/// Returns the weights, of which the last is 1, that exclude best a count that is too large by one in a flat scene at `level` of `top`: those with the least
/// `top / 2 |f * h| + rounding |f| + (1/2 - level) top sum f`, by least squares whose weights are the last residuals' inverses.
fn weights(taps: &[f64], top: f64, level: f64, rounding: f64) -> [f64; RUN + 1] {
    let slope = (0.5 - level) * top;
    let mut best = (f64::INFINITY, [0.0; RUN + 1]);
    let mut weights = [0.0; RUN + 1];
    weights[RUN] = 1.0;
    let rows = RUN + taps.len();
    let (mut of_seen, mut of_weight, mut least) = (vec![1.0; rows], [1.0; RUN + 1], 1.0_f64);
    for _ in 0..STEPS {
        let mut equations = [[0.0; RUN + 1]; RUN];
        // A row of f * h has these weights of f.
        let tap = |row: usize, at: usize| row.checked_sub(at).and_then(|tap| taps.get(tap)).map_or(0.0, |tap| top / 2.0 * tap);
        for (row, weight) in of_seen.iter().enumerate() {
            for (at, equation) in equations.iter_mut().enumerate() {
                let scaled = weight * tap(row, at);
                equation.iter_mut().enumerate().for_each(|(other, sum)| *sum += scaled * tap(row, other));
            }
        }
        for (at, equation) in equations.iter_mut().enumerate() {
            equation[at] += rounding * rounding * of_weight[at];
            // The weight of the sample itself is 1.
            equation[RUN] = -equation[RUN] - slope;
        }
        weights[..RUN].copy_from_slice(&solved(equations));
        let seen = behind(&weights, taps).into_iter().map(|g| top / 2.0 * g);
        let seen: Vec<f64> = seen.collect();
        let cost = seen.iter().map(|g| g.abs()).sum::<f64>()
            + weights.iter().map(|f| rounding * f.abs() + slope * f).sum::<f64>();
        if cost < best.0 {
            best = (cost, weights);
        }
        least = (0.7 * least).max(LEAST_RESIDUAL);
        of_seen = seen.iter().map(|g| g.abs().max(least).recip()).collect();
        of_weight = weights.map(|f| (rounding * f.abs()).max(least).recip());
    }
    best.1
}

/// Returns the solution of linear equations whose matrix is symmetric and positive; the last column is the right side.
fn solved(mut equations: [[f64; RUN + 1]; RUN]) -> [f64; RUN] {
    for pivot in 0..RUN {
        let row = equations[pivot].map(|value| value / equations[pivot][pivot]);
        equations[pivot] = row;
        for (_, other) in equations.iter_mut().enumerate().filter(|(at, _)| *at != pivot) {
            let factor = other[pivot];
            other.iter_mut().zip(row).for_each(|(value, of)| *value -= factor * of);
        }
    }
    equations.map(|equation| equation[RUN])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn range(alpha: f64) -> Range {
        Range::new(8, alpha).and_then(|range| range.with_headroom(0.97)).expect("a range")
    }

    /// The half widths that linear programs find, for the middle of the range.
    #[test]
    fn the_half_width_is_that_of_the_best_stencil() {
        for (sigma, alpha, expected) in
            [(0.8, 2.0, 0.40), (0.8, 3.0, 0.11), (1.0, 4.0, 0.19), (1.4, 4.0, 0.70), (1.4, 8.0, 0.44), (2.0, 8.0, 0.80)]
        {
            let found = stencils(Psf::of_sigma(sigma), range(alpha))[0].half_width();
            assert!((found - expected).abs() < 0.011, "{sigma} px, alpha {alpha}: {found}");
        }
    }

    #[test]
    fn scenes_of_black_and_white_attain_the_bounds_and_none_leaves_them() {
        for (sigma, alpha) in [(0.5, 2.0), (0.8, 2.0), (1.4, 8.0), (2.0, 4.0)] {
            let (psf, range) = (Psf::of_sigma(sigma), range(alpha));
            let (taps, top) = (psf.taps(), range.white() / 256.0);
            for stencil in stencils(psf, range) {
                let weights: Vec<f64> = stencil.weights.iter().map(|&f| f.into()).chain([1.0]).collect();
                let taps: Vec<f64> = taps.iter().map(|&tap| tap.into()).collect();
                let seen = behind(&weights, &taps);
                let sum = |white: fn(f64) -> bool| top * seen.iter().filter(|g| white(**g)).sum::<f64>();
                let all: f64 = weights.iter().map(|f| f.abs()).sum();
                let tolerance = all * 0.52 / 256.0;
                let over = f64::from(stencil.greatest) - sum(|g| g > 0.0);
                let under = sum(|g| g < 0.0) - f64::from(stencil.least);
                assert!(over > 0.0 && over < tolerance && under > 0.0 && under < tolerance, "{over} {under} {tolerance}");
            }
        }
    }
}
