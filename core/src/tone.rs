//! Converts radiance to integers for a screen, a detector or an HDR file.
//!
//! One scale serves all channels. It depends only on the sensor, never on the image: there is no automatic exposure.

use ndarray::{Array3, ArrayRef3};

use crate::frame::{Frame, FrameError};
use crate::range::Range;
use crate::simd::{floor, mapped, widest};

/// Returns `round(255 * x / (alpha * 2^b))`, clamped to 0..255, as a frame of 8 bits.
///
/// # Errors
/// [`FrameError`] when `x` (H x W x C, code units) does not have the shape of an image.
pub fn linear8(x: &ArrayRef3<f32>, range: Range) -> Result<Frame, FrameError> {
    // In double precision, since codes near a half would round differently in single precision.
    let scale = 255.0 / range.limit();
    Frame::from_u8(mapped(x, |x| to_u8(x, scale)))
}

/// Returns the HDR image in code units. Where all of the range fits 16 bits (`alpha * 2^b <= 65536`) it is
/// `round(x)`, clamped to 0..65535, as a frame of 16 bits, else x itself as a frame of floats.
///
/// # Errors
/// [`FrameError`] when `x` (H x W x C, code units) does not have the shape of an image or, if the range does not
/// fit 16 bits, is not finite.
pub fn hdr(x: &Array3<f32>, range: Range) -> Result<Frame, FrameError> {
    // `as` clamps and sends NaN to 0.
    if range.limit() <= 65536.0 {
        Frame::from_u16(x.mapv(|x| (f64::from(x) + 0.5) as u16))
    } else {
        Frame::from_f32(x.clone())
    }
}

/// Writes a row of 8-bit pixels, `W x 3` interleaved, as three planes of `W` samples in [0, 1]: `x / 255`.
///
/// Where a plane is shorter than the row, the rest of the row is left out.
pub fn unit_planes(row: &[u8], [red, green, blue]: [&mut [f32]; 3]) {
    widest!(for (pixel, ((red, green), blue)) in
        row.as_chunks::<3>().0.iter().zip(red.iter_mut().zip(green).zip(blue))
    {
        *red = f32::from(pixel[0]) / 255.0;
        *green = f32::from(pixel[1]) / 255.0;
        *blue = f32::from(pixel[2]) / 255.0;
    });
}

/// Scales one sample by `scale`, which is `255 / (alpha * 2^b)`, clamped to 0..255; NaN becomes 0, as `max` returns the number.
#[inline(always)]
#[expect(clippy::manual_clamp, reason = "`clamp` would keep NaN")]
pub(crate) fn to_u8(x: f32, scale: f64) -> u8 {
    floor((f64::from(x) * scale + 0.5).max(0.0).min(255.0)) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_linear_scale_for_all_channels() {
        let x = Array3::from_shape_vec((1, 2, 3), vec![0.0, 256.0, 511.9, 1024.0, 5000.0, -3.0]).unwrap();
        let got = linear8(&x, Range::new(8, 4.0).unwrap()).unwrap();
        assert_eq!(got.to_f32().into_raw_vec_and_offset().0, [0.0, 64.0, 127.0, 255.0, 255.0, 0.0]);
    }

    #[test]
    fn hdr_keeps_code_units_and_never_clips_the_range() {
        let x = Array3::from_shape_vec((1, 5, 1), vec![0.4, 0.5, 1023.0, 65_535.0, 262_143.0]).unwrap();
        for (bits, alpha, depth, want) in [
            (8, 256.0, 16, [0.0, 1.0, 1023.0, 65_535.0, 65_535.0]),
            (16, 1.0, 16, [0.0, 1.0, 1023.0, 65_535.0, 65_535.0]),
            (16, 1.001, 32, [0.4, 0.5, 1023.0, 65_535.0, 262_143.0]),
            (16, 4.0, 32, [0.4, 0.5, 1023.0, 65_535.0, 262_143.0]),
        ] {
            let got = hdr(&x, Range::new(bits, alpha).unwrap()).unwrap();
            assert_eq!((got.depth(), got.to_f32().into_raw_vec_and_offset().0), (depth, want.to_vec()));
        }
    }
}
