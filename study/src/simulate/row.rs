//! [`Row`]: one file, one alpha, one method.

use serde::{Deserialize, Serialize};

/// How a method did on a picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// The picture, as it was given.
    pub file: String,
    /// Saturation factor.
    pub alpha: f64,
    /// Blur of the lens, px.
    pub psf_sigma: f64,
    /// As in [`modulo_core::unwrap::METHODS`].
    pub method: String,
    /// `10 log10(255^2 / mse)` of the recovered 8-bit picture against the ideal one, over all samples;
    /// `None` (`null`) where they are equal and the ratio is infinite.
    pub psnr_db: Option<f64>,
    /// Mean SSIM of these two pictures, as [`modulo_core::metric::ssim`]; `None` below 11 px a side.
    pub ssim: Option<f64>,
    /// Share of the samples whose wrap count is the true one, 0 to 1.
    pub exact_k: f64,
    /// What did it: the method's own name, or the rung that it chose.
    pub rung: String,
    /// Whether the method vouches for its result; `None`: it makes no claim.
    pub trusted: Option<bool>,
    /// One call, ms on one thread; `bench unwrap` is for timing.
    pub ms: f64,
}
