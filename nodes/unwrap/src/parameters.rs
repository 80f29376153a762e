//! The parameters of the `unwrap` node, and the method that they describe.

use modulo_core::MAX_THREADS;
use modulo_core::unwrap::{Method, Options, ThresholdOn, TrustLimits, Unwrap, UnwrapError};
use modulo_runtime::sensor::parameters::SensorOverride;
use modulo_runtime::{ParameterError, ParameterSet as _};

modulo_runtime::parameters! {
    /// The parameters of the `unwrap` node.
    pub struct UnwrapParameters {
        /// Unwrapping method. auto starts with lines and takes gradient_tree where the image is too steep for lines.
        method: Method = Method::Auto => Method::ALL,
        /// Number of threads that unwrapping may use. The result does not depend on it.
        threads: usize = 1 => 1..=MAX_THREADS,
        /// Removes the blur of the lens (psf, psf_sigma) from the recovered image after unwrapping. The hdr image keeps
        /// it.
        deblur: bool = false,
        /// For auto: the largest fraction of steep 2 x 2 loops with which it trusts lines.
        trust_lines: f64 = TrustLimits::default().lines => 0.0..=1.0,
        /// For auto: the smallest fraction of each row and column that must agree before it trusts lines.
        trust_consensus: f64 = TrustLimits::default().consensus => 0.0..=1.0,
        /// For auto: the largest fraction of steep 2 x 2 loops with which it trusts gradient_tree.
        trust_gradient_tree: f64 = TrustLimits::default().gradient_tree => 0.0..=1.0,
        /// For spud: the hard threshold, in units of the peak.
        tau: f64 = Options::default().tau => 0.0..=1e6,
        /// For spud: the threshold acts on the coefficients after the division (phi) or before it (rho).
        threshold_on: ThresholdOn = ThresholdOn::Phi => [("phi", ThresholdOn::Phi), ("rho", ThresholdOn::Rho)],
        ..sensor: SensorOverride,
    }
}

impl UnwrapParameters {
    /// Returns the options of the unwrapping method.
    pub(crate) fn options(&self) -> Options {
        Options {
            tau: self.tau,
            threshold_on: self.threshold_on,
            threads: self.threads,
            trust: TrustLimits {
                lines: self.trust_lines,
                consensus: self.trust_consensus,
                gradient_tree: self.trust_gradient_tree,
            },
        }
    }

    /// Returns the unwrapping method with its options.
    pub(crate) fn method(&self) -> Result<Box<dyn Unwrap>, ParameterError> {
        self.check()?;
        // Only errors of the machine remain: it may have no more threads.
        let refuse = |why: UnwrapError| ParameterError::new("threads", self.threads, why.to_string());
        self.method.build(&self.options()).map_err(refuse)
    }
}
