use modulo_core::sensor::BELOW_ONE;
use modulo_core::{Frame, Samples};
use ndarray::Array3;

use crate::ImageError;

/// Converts frames to radiance as a fraction of the peak. The value is the linear radiance of the peak; it is 0 until it
/// is known.
#[derive(Debug)]
pub struct White(f32);

impl White {
    /// `white` > 0 is used as it is; 0 stands for the largest value of the first float image that is not black.
    ///
    /// # Errors
    /// [`ImageError::White`] for a negative, infinite or NaN `white`.
    pub fn new(white: f32) -> Result<Self, ImageError> {
        if white.is_finite() && white >= 0.0 { Ok(Self(white)) } else { Err(ImageError::White(white)) }
    }

    /// Whether the white point was given, or has been taken from a float image.
    pub fn is_known(&self) -> bool {
        self.0 > 0.0
    }

    /// Radiance in `[0, 1)`, `H x W x C`: integers as fractions of their range, floats as linear radiance.
    pub fn radiance(&mut self, frame: &Frame) -> Array3<f32> {
        match frame.samples() {
            // Divided by the number of codes, not by the largest one: 255 stays below the peak.
            Samples::U8(codes) => codes.mapv(|v| f32::from(v) / 256.0),
            Samples::U16(codes) => codes.mapv(|v| f32::from(v) / 65536.0),
            Samples::F32(linear) => self.scale(linear),
        }
    }

    /// Divides `linear` by the white point, which is found first if it is not known.
    fn scale(&mut self, linear: &Array3<f32>) -> Array3<f32> {
        // A black image says nothing about the white point, so that the search goes on with the next image. Once found,
        // the white point stays: a new one for each frame of a sequence would make its brightness flicker.
        if self.0 == 0.0 {
            self.0 = linear.iter().copied().fold(0.0, f32::max);
        }
        if self.0 == 0.0 {
            return Array3::zeros(linear.dim());
        }
        // The division is done in f64, because a tiny white point would overflow f32. The radiance stays below 1,
        // because the full range of the sensor is half-open.
        let white = f64::from(self.0);
        linear.mapv(|v| ((f64::from(v) / white) as f32).clamp(0.0, BELOW_ONE))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn linear(values: [f32; 3]) -> Frame {
        let pixels = Array3::from_shape_vec((1, 3, 1), values.to_vec()).expect("1 x 3 x 1");
        Frame::from_f32(pixels).expect("a frame")
    }

    #[test]
    fn automatic_white_is_the_first_bright_image_and_stays() {
        let mut white = White::new(0.0).expect("0 is automatic");
        assert_eq!(white.radiance(&linear([0.0, 0.0, -1.0])).sum(), 0.0);
        assert_eq!(white.radiance(&linear([1.0, 2.0, 4.0])).as_slice(), Some(&[0.25, 0.5, BELOW_ONE][..]));
        assert_eq!(white.radiance(&linear([1.0, 8.0, 2.0])).as_slice(), Some(&[0.25, BELOW_ONE, 0.5][..]));
    }

    #[test]
    fn codes_are_fractions_of_the_peak() {
        let codes = |v: u16| {
            let frame = Frame::from_u16(Array3::from_elem((1, 1, 1), v)).expect("one pixel");
            White::new(1.0).expect("1 is possible").radiance(&frame)[(0, 0, 0)]
        };
        assert_eq!(codes(32768), 0.5);
        assert!(codes(65535) < 1.0);
    }

    #[test]
    fn white_must_be_finite_and_not_negative() {
        for white in [f32::NAN, f32::INFINITY, -1.0] {
            assert!(White::new(white).is_err(), "{white}");
        }
    }
}
