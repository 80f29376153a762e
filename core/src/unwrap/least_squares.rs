//! Least squares (Ghiglia and Romero): SPUD without its threshold, made congruent with y.
//!
//! D. C. Ghiglia and L. A. Romero, "Robust two-dimensional weighted and unweighted phase unwrapping that uses
//! fast transforms and iterative methods", JOSA A 11(1), 1994.

use super::{Range, Recovered, Spud, ThresholdOn, Unwrap, UnwrapError};
use crate::frame::Frame;

/// The method with its buffers.
pub struct LeastSquares {
    solver: Spud,
}

impl LeastSquares {
    /// Makes the method on `threads` threads, 1 to [`MAX_THREADS`](crate::MAX_THREADS).
    ///
    /// # Errors
    /// [`UnwrapError::Workers`] when the threads are not available.
    pub fn new(threads: usize) -> Result<Self, UnwrapError> {
        Ok(Self { solver: Spud::with_threads(0.0, ThresholdOn::Phi, threads)? })
    }
}

impl Unwrap for LeastSquares {
    fn name(&self) -> &'static str {
        "least_squares"
    }

    fn unwrap(&mut self, y: &Frame, range: Range, out: &mut Recovered) -> Result<(), UnwrapError> {
        self.solver.unwrap_as(self.name(), y, range, out)
    }
}
