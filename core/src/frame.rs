//! [`Frame`]: the pixels of one image as a sensor or a screen delivers them.
//!
//! A frame has no stamp and no name; those belong to the message that carries
//! it. A constructed frame is never empty, and always in standard layout.

use ndarray::Array3;

/// Integer pixels, `H x W x C`, row-major and interleaved, `C` = 1 (mono) or
/// 3 (red, green, blue); `H`, `W` >= 1.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Frame {
    /// 8-bit samples, range 0 to 255.
    U8(Array3<u8>),
    /// 16-bit samples, range 0 to 65535.
    U16(Array3<u16>),
}

/// Why pixels cannot be a [`Frame`].
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// An image needs at least one row and one column.
    #[error("image of {height} x {width} pixels is empty, at least 1 x 1 is needed")]
    Empty {
        /// Rows found.
        height: usize,
        /// Columns found.
        width: usize,
    },
    /// Only mono and RGB are images here.
    #[error("image has {channels} channels, 1 (mono) or 3 (RGB) are possible")]
    Channels {
        /// Channels found.
        channels: usize,
    },
}

impl Frame {
    /// Takes 8-bit pixels, `H x W x C`.
    ///
    /// # Errors
    /// [`FrameError`] when a side is 0 or `C` is neither 1 nor 3.
    pub fn from_u8(pixels: Array3<u8>) -> Result<Self, FrameError> {
        check(pixels.dim())?;
        Ok(Self::U8(standard(pixels)))
    }

    /// Takes 16-bit pixels, `H x W x C`.
    ///
    /// # Errors
    /// [`FrameError`] when a side is 0 or `C` is neither 1 nor 3.
    pub fn from_u16(pixels: Array3<u16>) -> Result<Self, FrameError> {
        check(pixels.dim())?;
        Ok(Self::U16(standard(pixels)))
    }

    /// (height, width, channels).
    pub fn dim(&self) -> (usize, usize, usize) {
        match self {
            Self::U8(pixels) => pixels.dim(),
            Self::U16(pixels) => pixels.dim(),
        }
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.dim().0
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.dim().1
    }

    /// 1 (mono) or 3 (red, green, blue).
    pub fn channels(&self) -> usize {
        self.dim().2
    }

    /// Bits of one sample as stored: 8 or 16.
    pub fn depth(&self) -> u8 {
        match self {
            Self::U8(_) => 8,
            Self::U16(_) => 16,
        }
    }

    /// The samples as `f32`, `H x W x C`, same values.
    pub fn to_f32(&self) -> Array3<f32> {
        match self {
            Self::U8(pixels) => pixels.mapv(f32::from),
            Self::U16(pixels) => pixels.mapv(f32::from),
        }
    }
}

fn check((height, width, channels): (usize, usize, usize)) -> Result<(), FrameError> {
    if height == 0 || width == 0 {
        return Err(FrameError::Empty { height, width });
    }
    if channels != 1 && channels != 3 {
        return Err(FrameError::Channels { channels });
    }
    Ok(())
}

fn standard<T: Clone>(pixels: Array3<T>) -> Array3<T> {
    if pixels.is_standard_layout() { pixels } else { pixels.as_standard_layout().into_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refuses_empty_and_odd_channels() {
        assert_eq!(Frame::from_u8(Array3::zeros((0, 4, 3))), Err(FrameError::Empty { height: 0, width: 4 }));
        assert_eq!(Frame::from_u16(Array3::zeros((2, 4, 2))), Err(FrameError::Channels { channels: 2 }));
    }

    #[test]
    fn makes_the_layout_standard() {
        let reversed = Array3::from_shape_fn((2, 3, 1), |(i, j, _)| (3 * i + j) as u8)
            .reversed_axes()
            .permuted_axes([2, 1, 0]);
        let Ok(Frame::U8(pixels)) = Frame::from_u8(reversed) else { panic!("2 x 3 x 1 is a frame") };
        assert_eq!(pixels.as_slice(), Some(&[0u8, 1, 2, 3, 4, 5][..]));
    }
}
