//! Least squares on a gradient field by cosine transforms (eq. 3), with the
//! hard threshold of SPUD inside.

use std::f64::consts::PI;

use crate::dct::{Dct2, DctError};

/// Which coefficients SPUD's threshold looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum ThresholdOn {
    /// After the division: what the paper's scripts do.
    #[default]
    Phi,
    /// Before the division: what eq. 3 says.
    Rho,
}

/// A solver for planes of one size.
pub(super) struct Poisson {
    dct: Dct2,
    down: Vec<f32>,
    across: Vec<f32>,
}

impl Poisson {
    pub(super) fn new(height: usize, width: usize) -> Self {
        Self { dct: Dct2::new(height, width), down: eigenvalues(height), across: eigenvalues(width) }
    }

    pub(super) fn dim(&self) -> (usize, usize) {
        self.dct.dim()
    }

    /// `rho` (the divergence `D^T g`, row-major) becomes the phi of mean 0 with `D^T D phi = rho`.
    ///
    /// Coefficients of magnitude `tau` (code units) or less are dropped, before or after the division.
    pub(super) fn solve(&mut self, rho: &mut [f32], tau: f32, on: ThresholdOn) -> Result<(), DctError> {
        self.dct.forward(rho)?;
        let width = self.across.len();
        for (row, &vertical) in rho.chunks_exact_mut(width).zip(&self.down) {
            let coefficients =
                row.iter_mut().zip(&self.across).map(|(c, &horizontal)| (c, vertical + horizontal));
            match on {
                ThresholdOn::Phi => coefficients.for_each(|(c, value)| *c = above(*c / value, tau)),
                ThresholdOn::Rho => coefficients.for_each(|(c, value)| *c = above(*c, tau) / value),
            }
        }
        // 0/0 above: a gradient says nothing about the mean.
        rho[0] = 0.0;
        self.dct.inverse(rho)
    }
}

/// `2 - 2 cos(pi i / n)` = `4 sin^2(pi i / 2n)`, which keeps its digits at small i.
fn eigenvalues(n: usize) -> Vec<f32> {
    (0..n).map(|i| (4.0 * (PI * i as f64 / (2 * n) as f64).sin().powi(2)) as f32).collect()
}

fn above(coefficient: f32, tau: f32) -> f32 {
    if coefficient.abs() > tau { coefficient } else { 0.0 }
}
