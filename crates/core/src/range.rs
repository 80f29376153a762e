//! [`Range`]: the range of counts that a sensor represents. It is valid once it is made.

/// The mean rounding error of the converter, which rounds down, in code units.
pub(crate) const HALF_A_CODE: f32 = 0.5;

/// The bits and the saturation factor of a sensor: `x` lies in `[0, alpha * 2^bits)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    bits: u8,
    alpha: f64,
    /// The full scale of a picture over `alpha * 2^bits`.
    headroom: f64,
    /// The columns at the left border at which the radiance is 0.
    black: usize,
    /// The x of the darkest pixels of each frame, in code units, where it is promised.
    black_level: Option<f32>,
}

/// The relative error of alpha with which no count is lost.
const ALPHA_TOLERANCE: f64 = 0.02;

/// Error: these numbers cannot be a [`Range`].
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RangeError {
    /// The bits are out of range.
    #[error("bits is {0}, 1 to 16 are possible")]
    Bits(u8),
    /// The saturation factor is out of range.
    #[error("alpha is {0}, more than 0 and at most 256 is possible")]
    Alpha(f64),
    /// The full scale of a picture over `alpha * 2^bits` is out of range.
    #[error("headroom is {0}, more than 0 and at most 1 is possible")]
    Headroom(f64),
}

impl Range {
    /// Makes a range of `bits` in 1 to 16 and `alpha` in (0, 256], whose end is the full scale of pictures.
    ///
    /// # Errors
    /// [`RangeError`] when one of them is outside, NaN included.
    pub fn new(bits: u8, alpha: f64) -> Result<Self, RangeError> {
        if !(1..=16).contains(&bits) {
            return Err(RangeError::Bits(bits));
        }
        // The negation refuses NaN, too. 256 is the largest alpha whose wrap counts fit 8 bits.
        if !(alpha > 0.0 && alpha <= 256.0) {
            return Err(RangeError::Alpha(alpha));
        }
        Ok(Self { bits, alpha, headroom: 1.0, black: 0, black_level: None })
    }

    /// Returns this range for pictures whose full scale is `headroom` in (0, 1] of its end.
    ///
    /// # Errors
    /// [`RangeError::Headroom`] when it is outside, NaN included.
    pub fn with_headroom(self, headroom: f64) -> Result<Self, RangeError> {
        // The negation refuses NaN, too.
        if !(headroom > 0.0 && headroom <= 1.0) {
            return Err(RangeError::Headroom(headroom));
        }
        Ok(Self { headroom, ..self })
    }

    /// Returns this range for images of a sensor that shades so many columns at the left border: the radiance is 0 in the first quarter of
    /// them, at least in one column.
    pub fn with_optical_black(self, columns: usize) -> Self {
        Self { black: (columns / 4).max(columns.min(1)), ..self }
    }

    /// Returns this range for frames whose darkest pixels have the radiance `level` in code units, which the user promises.
    pub fn with_black_level(self, level: Option<f64>) -> Self {
        Self { black_level: level.map(|level| level as f32), ..self }
    }

    /// Returns the radiance that the darkest pixels of each frame are promised to have, in code units.
    pub fn black_level(self) -> Option<f32> {
        self.black_level
    }

    /// Returns the number of columns at the left border at which the radiance is 0.
    pub fn black(self) -> usize {
        self.black
    }

    /// Returns the number of columns at the left border that a field stop may shade, the black ones included.
    pub(crate) fn shaded(self) -> usize {
        // A quarter of the shaded columns is black, rounded down, but at least one.
        if self.black == 0 { 0 } else { 4 * self.black + 3 }
    }

    /// Returns b, the bits of the converter.
    pub fn bits(self) -> u8 {
        self.bits
    }

    /// Returns alpha, the saturation factor.
    pub fn alpha(self) -> f64 {
        self.alpha
    }

    /// Returns the peak 2^b, which is exact in `f32`.
    pub fn peak(self) -> f32 {
        peak(self.bits)
    }

    /// Returns the radiance of `code` that is nearest to `radiance` in this range, and its wrap count.
    pub(crate) fn nearest(self, code: f32, radiance: f32) -> (f32, u8) {
        let count = ((radiance - code) / self.peak()).round().clamp(0.0, f32::from(self.max_wraps()));
        (code + count * self.peak(), count as u8)
    }

    /// Returns `alpha * 2^b` in code units; radiance is strictly below it.
    pub fn limit(self) -> f64 {
        self.alpha * f64::from(self.peak())
    }

    /// Returns `headroom * alpha * 2^b` in code units, the full scale of pictures.
    pub fn white(self) -> f64 {
        self.headroom * self.limit()
    }

    /// Returns the range of the difference of two values of this range, as far as 256 peaks hold it.
    pub(crate) fn of_differences(self) -> Self {
        Self { alpha: (2.0 * self.alpha).min(256.0), ..self }
    }

    /// Returns the range whose alpha is as much larger as the true one may be.
    pub(crate) fn widened(self) -> Self {
        Self { alpha: ((1.0 + ALPHA_TOLERANCE) * self.alpha).min(256.0), ..self }
    }

    /// Returns `ceil(alpha) - 1`, the largest wrap count k of radiance in range.
    pub fn max_wraps(self) -> u8 {
        (self.alpha.ceil() - 1.0) as u8
    }
}

/// Returns 2^bits, for bits up to 32.
pub(crate) fn peak(bits: u8) -> f32 {
    (1u64 << bits.min(32)) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refuses_what_no_sensor_has() {
        assert_eq!(Range::new(0, 1.0), Err(RangeError::Bits(0)));
        assert_eq!(Range::new(17, 1.0), Err(RangeError::Bits(17)));
        for alpha in [0.0, -1.0, 256.1, f64::INFINITY, f64::NAN] {
            assert!(Range::new(8, alpha).is_err(), "alpha {alpha}");
        }
        let range = Range::new(8, 4.0).unwrap();
        for headroom in [0.0, -0.5, 1.01, f64::NAN] {
            let why = range.with_headroom(headroom).unwrap_err().to_string();
            assert_eq!(why, format!("headroom is {headroom}, more than 0 and at most 1 is possible"));
        }
    }

    #[test]
    fn counts_wraps_below_the_limit() {
        let wraps = |alpha| Range::new(8, alpha).unwrap().max_wraps();
        assert_eq!([wraps(0.3), wraps(1.0), wraps(1.5), wraps(2.0), wraps(256.0)], [0, 0, 1, 1, 255]);
        assert_eq!(
            (1..=16).map(peak).collect::<Vec<_>>(),
            (1..=16).map(|b| (1 << b) as f32).collect::<Vec<_>>()
        );
    }

    #[test]
    fn pictures_end_below_the_limit_by_the_headroom() {
        let range = Range::new(8, 4.0).unwrap();
        let with = range.with_headroom(0.75).unwrap();
        assert_eq!((range.white(), with.white(), with.limit()), (1024.0, 768.0, 1024.0));
    }
}
