//! Solves the least-squares problem of a gradient field by cosine transforms (eq. 3), with the hard threshold of SPUD.

use std::f64::consts::PI;

use crate::dct::{ImageDct, LANES, SampleRun, SpectralFilter};
use crate::workers::Workers;

/// The coefficients that SPUD's threshold applies to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum ThresholdOn {
    /// Those after the division, as in the paper's scripts.
    #[default]
    Phi,
    /// Those before the division, as in eq. 3.
    Rho,
}

/// A solver for images of one size; `Out` is the output for a run of sixteen samples of phi.
pub(super) struct Poisson<Out> {
    pub grid: ImageDct<Out>,
    by_row: Vec<[f32; LANES]>,
    by_column: Vec<f32>,
}

impl<Out: Copy + Default + Send + Sync> Poisson<Out> {
    /// Plans for images of `dim`, (height, width, channels), all at least 1; each channel is solved separately.
    pub fn new(dim: (usize, usize, usize), workers: usize) -> Self {
        let mut by_row = vec![[0.0; LANES]; dim.0.div_ceil(LANES)];
        by_row.as_flattened_mut().iter_mut().zip(eigenvalues(dim.0)).for_each(|(to, value)| *to = value);
        Self { grid: ImageDct::new(dim, workers), by_row, by_column: eigenvalues(dim.1).collect() }
    }

    /// Solves `D^T D phi = rho` for the phi of mean 0, where `rho` is a divergence `D^T g`, and stores the output
    /// of `keep`.
    ///
    /// Coefficients of magnitude `tau` (in the unit of rho) or less are set to 0, before or after the division.
    pub fn solve(
        &mut self,
        workers: &Workers,
        rho: impl Fn(SampleRun) -> [f32; LANES] + Sync,
        (tau, on): (f32, ThresholdOn),
        keep: impl Fn(SampleRun, [f32; LANES]) -> Out + Sync,
    ) {
        let Self { grid, by_row, by_column } = self;
        let (by_row, by_column) = (&by_row[..], &by_column[..]);
        match on {
            // One closure for each order, so that no branch remains in the loop over coefficients.
            ThresholdOn::Phi => {
                let rule = move |v: f32, h: f32, c: f32| threshold(divide_or_zero(c, v + h), tau);
                grid.filter(workers, rho, &SpectralFilter { by_row, by_column, rule }, keep);
            }
            ThresholdOn::Rho => {
                let rule = move |v: f32, h: f32, c: f32| divide_or_zero(threshold(c, tau), v + h);
                grid.filter(workers, rho, &SpectralFilter { by_row, by_column, rule }, keep);
            }
        }
    }
}

/// Returns `2 - 2 cos(pi i / n)` as `4 sin^2(pi i / 2n)`, which is accurate at small i.
fn eigenvalues(n: usize) -> impl Iterator<Item = f32> {
    (0..n).map(move |i| (4.0 * (PI * i as f64 / (2 * n) as f64).sin().powi(2)) as f32)
}

/// Returns the quotient, or 0 for an eigenvalue of 0: a gradient does not contain the mean.
#[inline(always)]
fn divide_or_zero(coefficient: f32, eigenvalue: f32) -> f32 {
    // The quotient comes first: a selection afterwards needs no branch, and infinity is dropped.
    let quotient = coefficient / eigenvalue;
    if eigenvalue > 0.0 { quotient } else { 0.0 }
}

#[inline(always)]
fn threshold(coefficient: f32, tau: f32) -> f32 {
    if coefficient.abs() > tau { coefficient } else { 0.0 }
}
