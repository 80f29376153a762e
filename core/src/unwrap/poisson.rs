//! Least squares on a gradient field by cosine transforms (eq. 3), with the
//! hard threshold of SPUD inside.

use std::f64::consts::PI;

use crate::dct::{Grid, LANES, Run, SpectralFilter};
use crate::workers::Workers;

/// Which coefficients SPUD's threshold looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum ThresholdOn {
    /// After the division: what the paper's scripts do.
    #[default]
    Phi,
    /// Before the division: what eq. 3 says.
    Rho,
}

/// A solver for images of one size; `Out` is what is kept of sixteen samples of phi.
pub(super) struct Poisson<Out> {
    pub grid: Grid<Out>,
    by_row: Vec<[f32; LANES]>,
    by_column: Vec<f32>,
}

impl<Out: Copy + Default + Send + Sync> Poisson<Out> {
    /// `dim` is (height, width, channels), all at least 1; each channel is solved on its own.
    pub fn new(dim: (usize, usize, usize), workers: usize) -> Self {
        let mut by_row = vec![[0.0; LANES]; dim.0.div_ceil(LANES)];
        by_row.as_flattened_mut().iter_mut().zip(eigenvalues(dim.0)).for_each(|(to, value)| *to = value);
        Self { grid: Grid::new(dim, workers), by_row, by_column: eigenvalues(dim.1).collect() }
    }

    /// Keeps the phi of mean 0 with `D^T D phi = rho` of the divergence `D^T g` that `rho` gives.
    ///
    /// Coefficients of magnitude `tau` (in the unit of rho) or less are dropped, before or after the division.
    pub fn solve(
        &mut self,
        workers: &Workers,
        rho: impl Fn(Run) -> [f32; LANES] + Sync,
        (tau, on): (f32, ThresholdOn),
        keep: impl Fn(Run, [f32; LANES]) -> Out + Sync,
    ) {
        let Self { grid, by_row, by_column } = self;
        let (by_row, by_column) = (&by_row[..], &by_column[..]);
        match on {
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

/// `2 - 2 cos(pi i / n)` = `4 sin^2(pi i / 2n)`, which keeps its digits at small i.
fn eigenvalues(n: usize) -> impl Iterator<Item = f32> {
    (0..n).map(move |i| (4.0 * (PI * i as f64 / (2 * n) as f64).sin().powi(2)) as f32)
}

/// 0/0 becomes 0: a gradient says nothing about the mean.
#[inline(always)]
fn divide_or_zero(coefficient: f32, eigenvalue: f32) -> f32 {
    let quotient = coefficient / eigenvalue;
    if eigenvalue > 0.0 { quotient } else { 0.0 }
}

#[inline(always)]
fn threshold(coefficient: f32, tau: f32) -> f32 {
    if coefficient.abs() > tau { coefficient } else { 0.0 }
}
