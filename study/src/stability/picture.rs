//! Pictures for the eye: one gamma for all, so that dark scenes show.
//!
//! Radiance is shown as `255 sqrt(x / (alpha 2^b))`, codes as `255 y / 2^b`. Figures are never taken from pictures.

use modulo_core::{Frame, FrameError};
use ndarray::{Array3, Axis, concatenate};

/// Width of the white gap between the parts of a strip, px.
const GAP: usize = 4;

/// Radiance `x` (code units) of a sensor that reaches `limit`, as 8-bit pixels.
pub fn radiance(x: &Array3<f32>, limit: f64) -> Array3<u8> {
    let limit = limit as f32;
    x.mapv(|x| (255.0 * (x / limit).max(0.0).sqrt() + 0.5) as u8)
}

/// Codes of a sensor with this `peak`, as 8-bit pixels.
pub fn codes(y: &Frame, peak: f32) -> Array3<u8> {
    y.to_f32().mapv(|y| (255.0 * y / peak + 0.5) as u8)
}

/// Pictures of one height and as many channels side by side, on white.
///
/// # Errors
/// [`FrameError`] when the pictures do not fit each other: there is no such image.
pub fn strip(pictures: &[&Array3<u8>]) -> Result<Frame, FrameError> {
    let (height, _, channels) = pictures.first().map_or((0, 0, 0), |first| first.dim());
    let gap = Array3::from_elem((height, GAP, channels), 255);
    let mut parts = Vec::new();
    for picture in pictures {
        if !parts.is_empty() {
            parts.push(gap.view());
        }
        parts.push(picture.view());
    }
    Frame::from_u8(concatenate(Axis(1), &parts).unwrap_or_default())
}
