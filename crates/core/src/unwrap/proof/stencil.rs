//! [`Stencil`]: the values that a weighted sum of samples can have behind a lens, for every scene in the range.
//!
//! The radiance is `x = h * s` with the lens h and a scene `0 <= s <= A` of any shape. For weights f over a run of
//! samples and `g = f * h`, the sum of `f x` is at most A times the sum of the positive g, and at least -A times that
//! of the negative ones; scenes of black and white attain both. Rounding to codes moves it by at most half a code for
//! each weight of 1. Any f gives bounds that hold: one that was not found exactly only excludes fewer counts.

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

/// The standard deviations by which noise may move a sum. In a frame of a million samples, a sum is beyond by a chance
/// of 4e-4, also for the worst scene.
pub(super) const SIGMAS: f64 = 7.0;

/// How much of the noise of the samples a sum of them has, about.
const NOISE_OF_SUM: f64 = 0.45;

/// The pixels to each side of a sample that a corner has.
pub(super) const RADIUS: isize = 3;

/// The rows above a sample that a corner has.
pub(super) const ROWS: isize = 3;

/// The relative error of the width of a lens with which a proof holds.
pub(super) const LENS_ERROR: f64 = 0.02;

/// The relative error of a sum in `f32`.
const OF_FLOAT: f64 = 1e-6;

/// The weights of samples around one, whose own weight is 1, and the least and the greatest sum of a scene, in peaks.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Stencil {
    pub weights: Vec<f32>,
    pub least: f32,
    pub greatest: f32,
}

/// The stencils of the samples at the same places around one, by rows and columns from it.
#[derive(Clone, Debug)]
pub(super) struct Family {
    /// The lines of samples, in the order of the weights.
    pub lines: Vec<Line>,
    /// Their rows and columns from the one in the middle.
    pub places: Vec<[isize; 2]>,
    pub stencils: Vec<Stencil>,
}

/// Successive samples of a row: rows below, and columns to the right of the one in the middle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    pub row: isize,
    pub first: isize,
    pub count: usize,
}

impl Line {
    /// Returns the column of the last one.
    pub fn last(self) -> isize {
        self.first + self.count.cast_signed() - 1
    }
}

/// The range of the scene, and the errors by which a sum may leave it, in peaks.
#[derive(Clone, Copy)]
struct Bounds {
    top: f64,
    rounding: f64,
    noise: f64,
}

impl Family {
    /// Returns the stencils of a sensor whose noise has at most this standard deviation, in code units. The one for the
    /// middle of the range comes first.
    pub fn new(lines: Vec<Line>, lens: Psf, range: Range, noise: f64) -> Self {
        Self::within(LENS_ERROR, &LEVELS, lines, lens, range, noise)
    }

    /// Returns those for these levels, and for lenses whose width differs by at most a share of `error`.
    fn within(error: f64, levels: &[f64], lines: Vec<Line>, lens: Psf, range: Range, noise: f64) -> Self {
        let per_peak = f64::from(range.peak()).recip();
        let (top, rounding, noise) =
            (range.limit() * per_peak, ROUNDING * per_peak, SIGMAS * noise * per_peak);
        let bounds = Bounds { top, rounding, noise };
        let of_line = |line: &Line| {
            (line.first..=line.last()).map(move |column| [line.row, column]).collect::<Vec<_>>()
        };
        let places: Vec<_> = lines.iter().flat_map(of_line).collect();
        let seen = lenses(lens, error).map(|taps| seen(&places, &taps));
        let of_level = |&level: &f64| Stencil::new(&weights(&seen[0], bounds, level), &seen, bounds);
        Self { lines, places, stencils: levels.iter().map(of_level).collect() }
    }

    /// Returns the [`half_width`](Self::half_width) of such a family.
    pub fn half_width_of(lines: Vec<Line>, lens: Psf, range: Range, noise: f64) -> f32 {
        Self::within(LENS_ERROR, &LEVELS[..1], lines, lens, range, noise).half_width()
    }

    /// Returns half of the interval of residuals that prove a count, in peaks, for the middle of the range: above 1/2,
    /// each scene has one count; below 0, hardly any is proved.
    pub fn half_width(&self) -> f32 {
        1.0 - (self.stencils[0].greatest - self.stencils[0].least) / 2.0
    }
}

impl Stencil {
    /// Returns the stencil with these weights, of which the last is that of the sample itself.
    fn new(weights: &[f64], seen: &[Seen], Bounds { top, rounding, noise, .. }: Bounds) -> Self {
        // The bounds are those of the weights that are used.
        let weights: Vec<f32> = weights.iter().map(|&weight| weight as f32).collect();
        let f = || weights.iter().map(|&weight| f64::from(weight));
        let (mut least, mut greatest) = (0.0_f64, 0.0_f64);
        for seen in seen {
            let g = seen.iter().map(|row| row.iter().zip(f()).map(|(tap, f)| tap * f).sum::<f64>());
            least = least.min(top * g.clone().map(|g| g.min(0.0)).sum::<f64>());
            greatest = greatest.max(top * g.map(|g| g.max(0.0)).sum::<f64>());
        }
        let tolerance = f().map(f64::abs).sum::<f64>() * (rounding + OF_FLOAT * top)
            + f().map(|f| f * f).sum::<f64>().sqrt() * noise;
        let (least, greatest) = ((least - tolerance) as f32, (greatest + tolerance) as f32);
        let weights = weights[..weights.len() - 1].to_vec();
        Self { weights, least: least.next_down(), greatest: greatest.next_up() }
    }
}

/// Returns the run of samples behind one.
pub(super) fn run() -> Vec<Line> {
    vec![Line { row: 0, first: -RUN.cast_signed(), count: RUN }]
}

/// Returns those of a square around a sample that lie above it, and before it in its row. A corner excludes as much as
/// three quarters of the image would.
pub(super) fn corner() -> Vec<Line> {
    let line = |row| Line {
        row,
        first: -RADIUS,
        count: if row < 0 { 2 * RADIUS + 1 } else { RADIUS }.cast_unsigned(),
    };
    (-ROWS..=0).map(line).collect()
}

/// Returns the taps of a lens, and of those whose width is as much smaller or larger as it may be.
pub(super) fn lenses(lens: Psf, error: f64) -> [Vec<f64>; 3] {
    [0.0, -error, error].map(|error| {
        let lens = match lens {
            Psf::Gaussian { sigma } => Psf::Gaussian { sigma: (1.0 + error) * sigma },
            kernel => kernel,
        };
        lens.taps().into_iter().map(f64::from).collect()
    })
}

/// For each point of the scene, how much of it each sample sees.
type Seen = Vec<Vec<f64>>;

/// Returns what the samples at `places`, and the last one in their middle, see.
fn seen(places: &[[isize; 2]], taps: &[f64]) -> Seen {
    let radius = taps.len().cast_signed() / 2;
    // Samples of one row are sums over columns, of which each is a point in the range, too.
    let is_row = places.iter().all(|[i, _]| *i == 0);
    let reach = |axis: usize| places.iter().map(|place| place[axis].abs()).max().unwrap_or(0) + radius;
    let rows = if is_row { 0 } else { reach(0) };
    let tap =
        |away: isize| usize::try_from(away + radius).ok().and_then(|at| taps.get(at)).copied().unwrap_or(0.0);
    let points = (-rows..=rows).flat_map(|i| (-reach(1)..=reach(1)).map(move |j| [i, j]));
    let of_point = |[i, j]: [isize; 2]| {
        let share = |[row, column]: [isize; 2]| (if is_row { 1.0 } else { tap(i - row) }) * tap(j - column);
        places.iter().copied().chain([[0, 0]]).map(share).collect()
    };
    points.map(of_point).collect()
}

/// Returns the weights, of which the last is 1, that exclude best a count that is too large by one in a flat scene at
/// `level` of the range: those with the least `top / 2 |f * h| + error |f| + (1/2 - level) top sum f`, by least squares
/// whose weights are the inverses of the last residuals.
fn weights(seen: &[Vec<f64>], Bounds { top, rounding, noise, .. }: Bounds, level: f64) -> Vec<f64> {
    let (count, slope) = (seen[0].len(), (0.5 - level) * top);
    // The noise of a sum grows as the root of the sum of squares, which is about half of the sum.
    let error = rounding + NOISE_OF_SUM * noise;
    let scaled = seen.iter().map(|row| row.iter().map(|tap| top / 2.0 * tap).collect());
    let own = (0..count).map(|row| (0..count).map(|at| if at == row { error } else { 0.0 }).collect());
    let rows: Vec<Vec<f64>> = scaled.chain(own).collect();
    let (mut of_rows, mut least) = (vec![1.0; rows.len()], 1.0_f64);
    let (mut cost, mut best) = (f64::INFINITY, Vec::new());
    for _ in 0..STEPS {
        let mut m = vec![vec![0.0; count]; count];
        for (row, weight) in rows.iter().zip(&of_rows) {
            for (at, sums) in m.iter_mut().enumerate().filter(|(at, _)| row[*at] != 0.0) {
                sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * row[at] * value);
            }
        }
        let found = solved(m, slope);
        let residual = |row: &Vec<f64>| row.iter().zip(&found).map(|(value, f)| value * f).sum::<f64>().abs();
        let residuals: Vec<f64> = rows.iter().map(residual).collect();
        least = (0.7 * least).max(LEAST_RESIDUAL);
        of_rows = residuals.iter().map(|residual| residual.max(least).recip()).collect();
        let costs = residuals.iter().sum::<f64>() + slope * found.iter().sum::<f64>();
        if costs < cost {
            (cost, best) = (costs, found);
        }
    }
    best
}

/// Returns the f, of which the last is 1, at which the gradient of `f' m f / 2 + slope sum f` is 0 in all others. m is
/// symmetric and positive.
fn solved(mut m: Vec<Vec<f64>>, slope: f64) -> Vec<f64> {
    let last = m.len() - 1;
    // The last column becomes the right side.
    m.iter_mut().for_each(|row| row[last] = -row[last] - slope);
    for pivot in 0..last {
        let of_pivot = m[pivot][pivot];
        let row: Vec<f64> = m[pivot].iter().map(|value| value / of_pivot).collect();
        for (_, other) in m[..last].iter_mut().enumerate().filter(|(at, _)| *at != pivot) {
            let factor = other[pivot];
            other[pivot..].iter_mut().zip(&row[pivot..]).for_each(|(value, of)| *value -= factor * of);
        }
        m[pivot] = row;
    }
    m[..last].iter().map(|row| row[last]).chain([1.0]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn range(alpha: f64) -> Range {
        Range::new(8, 0.97 * alpha).expect("a range")
    }

    /// The half widths that linear programs find, for the middle of the range.
    #[test]
    fn the_half_width_is_that_of_the_best_stencil() {
        for (sigma, alpha, expected) in [
            (0.8, 2.0, 0.40),
            (0.8, 3.0, 0.11),
            (1.0, 4.0, 0.19),
            (1.4, 4.0, 0.70),
            (1.4, 8.0, 0.44),
            (2.0, 8.0, 0.80),
        ] {
            let found =
                Family::within(0.0, &LEVELS, run(), Psf::of_sigma(sigma), range(alpha), 0.0).half_width();
            assert!((found - expected).abs() < 0.011, "{sigma} px, alpha {alpha}: {found}");
        }
    }

    #[test]
    fn a_corner_proves_more() {
        for (sigma, alpha, expected) in [(1.0, 4.0, 0.51), (0.8, 2.0, 0.61), (1.4, 8.0, 0.73)] {
            let found =
                Family::within(0.0, &LEVELS, corner(), Psf::of_sigma(sigma), range(alpha), 0.0).half_width();
            assert!((found - expected).abs() < 0.015, "{sigma} px, alpha {alpha}: {found}");
        }
    }

    /// Scenes of black and white attain the bounds.
    #[test]
    fn the_bounds_are_no_wider_than_they_must_be() {
        for (sigma, alpha) in [(0.5, 2.0), (0.8, 2.0), (1.4, 8.0), (2.0, 4.0)] {
            let (psf, range) = (Psf::of_sigma(sigma), range(alpha));
            let (taps, top) = (psf.taps(), range.limit() / 256.0);
            for stencil in Family::within(0.0, &LEVELS, run(), psf, range, 0.0).stencils {
                let weights = || stencil.weights.iter().chain([&1.0]).map(|&f| f64::from(f));
                let mut seen = vec![0.0; RUN + taps.len()];
                for (at, weight) in weights().enumerate() {
                    taps.iter()
                        .enumerate()
                        .for_each(|(tap, share)| seen[at + tap] += weight * f64::from(*share));
                }
                let sum = |sign: f64| top * seen.iter().map(|g| (sign * g).max(0.0)).sum::<f64>();
                let tolerance = weights().map(f64::abs).sum::<f64>() * 0.52 / 256.0;
                let (over, under) =
                    (f64::from(stencil.greatest) - sum(1.0), -sum(-1.0) - f64::from(stencil.least));
                assert!(over > 0.0 && over < tolerance && under > 0.0 && under < tolerance, "{over} {under}");
            }
        }
    }
}
