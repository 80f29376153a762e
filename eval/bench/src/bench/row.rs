//! [`Row`]: one method at one alpha with one thread count, over all frames.

use serde::{Deserialize, Serialize};

use super::Request;
use super::frames::Sample;
use super::time::Measured;

/// Calls on one frame that differ by more than this share of their median make the figure doubtful.
const MOST_SPREAD: f64 = 0.1;

/// Time and accuracy.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// As in [`modulo_core::unwrap::METHODS`], or the name that a peer gave itself.
    pub method: String,
    /// Saturation factor.
    pub alpha: f64,
    /// Blur of the lens, px.
    pub psf_sigma: f64,
    /// Threads that the method was allowed.
    pub threads: usize,
    /// Median over frames and repeats of one call, ms of the wall clock.
    pub ms_p50: f64,
    /// 5th percentile of the same, ms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ms_p5: Option<f64>,
    /// 95th percentile of the same, ms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ms_p95: Option<f64>,
    /// Share of the samples of all frames whose wrap count is the true one, 0 to 1.
    pub exact_k: f64,
    /// `10 log10(255^2 / mse)`, the mse over the samples of all frames, recovered 8-bit pictures against the
    /// ideal ones; `None` (`null`) where all are equal and the ratio is infinite.
    pub psnr_db: Option<f64>,
    /// How many frames.
    pub frames: usize,
    /// Samples of all frames, pixels times channels: `exact_k` is a multiple of its reciprocal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub samples: Option<u64>,
}

impl Row {
    /// The figures of `measured` under the request's names.
    pub(super) fn new(
        request: &Request,
        method: &str,
        threads: usize,
        samples: &[Sample],
        measured: &Measured,
    ) -> Self {
        Self {
            method: method.to_owned(),
            alpha: samples.first().map_or(0.0, |sample| sample.range.alpha()),
            psf_sigma: request.psf.sigma(),
            threads,
            ms_p50: measured.ms(0.5),
            ms_p5: Some(measured.ms(0.05)),
            ms_p95: Some(measured.ms(0.95)),
            exact_k: measured.exact_k(),
            psnr_db: measured.psnr_db(),
            frames: samples.len(),
            samples: Some(measured.samples),
        }
    }

    /// What to say when the calls on one frame differ much: the machine was busy, or its clock changed.
    pub(super) fn doubt(&self, spread: f64) -> Option<String> {
        (spread > MOST_SPREAD).then(|| {
            format!(
                "{} at alpha {} with {} threads: half of the calls on one frame lie {:.0} % of their median \
                 apart; more repeats or a quieter machine would make the figure surer",
                self.method,
                self.alpha,
                self.threads,
                spread * 100.0
            )
        })
    }
}
