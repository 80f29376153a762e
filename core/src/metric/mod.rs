//! How near a recovered picture is to the true one.
//!
//! Pictures are compared as they are shown: 8 bits a sample, the same linear
//! scale for both ([`crate::tone::linear8`]). Nothing here knows a method.

mod exact;
mod psnr;
mod quantile;
mod ssim;

pub use exact::exact_share;
pub use psnr::{mse, psnr_db};
pub use quantile::quantile;
pub use ssim::{LEAST_SIDE, ssim};

/// Two pictures that cannot be compared.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("pictures of {left:?} and {right:?} (rows, columns, channels) cannot be compared")]
pub struct ShapesDiffer {
    /// Of the first.
    pub left: (usize, usize, usize),
    /// Of the second.
    pub right: (usize, usize, usize),
}

fn check_shapes(left: (usize, usize, usize), right: (usize, usize, usize)) -> Result<(), ShapesDiffer> {
    if left == right { Ok(()) } else { Err(ShapesDiffer { left, right }) }
}
