//! Radiance to integers for a screen, a detector or an HDR file.
//!
//! One scale serves all channels and depends on the sensor alone, never on the
//! image: no automatic exposure.

use ndarray::Array3;

use crate::frame::{Frame, FrameError};
use crate::range::Range;
use crate::simd::widest;

/// `round(255 * x / (alpha * 2^b))`, clamped to 0..255, as [`Frame::U8`].
///
/// # Errors
/// [`FrameError`] when `x` (H x W x C, code units) is not of an image's shape.
pub fn linear8(x: &Array3<f32>, range: Range) -> Result<Frame, FrameError> {
    let scale = 255.0 / range.limit();
    Frame::from_u8(widest(
        #[inline(always)]
        || x.mapv(|x| to_u8(x, scale)),
    ))
}

/// `round(x)`, clamped to 0..65535, as [`Frame::U16`]: the HDR image in code units.
///
/// # Errors
/// [`FrameError`] when `x` (H x W x C, code units) is not of an image's shape.
pub fn counts16(x: &Array3<f32>) -> Result<Frame, FrameError> {
    Frame::from_u16(x.mapv(to_u16))
}

/// `scale` is `255 / (alpha * 2^b)`; `as` clamps and sends NaN to 0.
#[inline(always)]
pub(crate) fn to_u8(x: f32, scale: f64) -> u8 {
    (f64::from(x) * scale + 0.5) as u8
}

/// `as` clamps and sends NaN to 0.
#[inline(always)]
pub(crate) fn to_u16(x: f32) -> u16 {
    (f64::from(x) + 0.5) as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_linear_scale_for_all_channels() {
        let x = Array3::from_shape_vec((1, 2, 3), vec![0.0, 256.0, 511.9, 1024.0, 5000.0, -3.0]).unwrap();
        let Ok(Frame::U8(got)) = linear8(&x, Range::new(8, 4.0).unwrap()) else {
            panic!("1 x 2 x 3 is a frame")
        };
        assert_eq!(got.into_raw_vec_and_offset().0, [0, 64, 127, 255, 255, 0]);
    }

    #[test]
    fn counts_keep_code_units() {
        let x = Array3::from_shape_vec((1, 5, 1), vec![0.4, 0.5, 1023.0, 70_000.0, f32::NAN]).unwrap();
        let Ok(Frame::U16(got)) = counts16(&x) else { panic!("1 x 5 x 1 is a frame") };
        assert_eq!(got.into_raw_vec_and_offset().0, [0, 1, 1023, 65535, 0]);
    }
}
