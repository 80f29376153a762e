//! [`Frame`]: the pixels of one image as a sensor or a screen delivers them.
//!
//! A frame has no time stamp and no name; those belong to the message that carries it.

use std::borrow::Cow;
use std::fmt;

use ndarray::{Array3, ArrayView3};

use crate::mosaic::Mosaic;

/// An image that is valid by construction: `H x W x C` samples, `H`, `W` >= 1, `C` = 1 (mono) or 3 (red, green,
/// blue), row-major and interleaved; samples of 32 bits are finite. The one channel may be a colour mosaic.
///
/// ```
/// use modulo_core::Frame;
/// use ndarray::Array3;
///
/// let frame = Frame::from_u8(Array3::zeros((2, 3, 3)))?;
/// assert_eq!((frame.height(), frame.width(), frame.channels(), frame.depth()), (2, 3, 3, 8));
/// assert!(Frame::from_u8(Array3::zeros((2, 3, 4))).is_err(), "four channels are no image");
/// # Ok::<(), modulo_core::FrameError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    samples: Samples,
    mosaic: Option<Mosaic>,
}

/// The samples of a [`Frame`], `H x W x C`, in standard layout.
#[derive(Clone, Debug, PartialEq)]
pub enum Samples {
    /// 8-bit integers, range 0 to 255.
    U8(Array3<u8>),
    /// 16-bit integers, range 0 to 65535.
    U16(Array3<u16>),
    /// 32-bit floats, finite, of any range.
    F32(Array3<f32>),
}

/// The position of a sample in an image, each number from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SamplePosition {
    /// The row.
    pub row: usize,
    /// The column.
    pub column: usize,
    /// The channel.
    pub channel: usize,
}

impl fmt::Display for SamplePosition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "row {}, column {}, channel {}", self.row, self.column, self.channel)
    }
}

/// Error: these samples cannot be a [`Frame`].
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FrameError {
    /// The image has no pixel: the numbers of its rows and columns.
    #[error("image of {0} x {1} pixels is empty, at least 1 x 1 is needed")]
    Empty(usize, usize),
    /// The number of channels is neither 1 (mono) nor 3 (RGB).
    #[error("image has {0} channels, 1 (mono) or 3 (RGB) are possible")]
    Channels(usize),
    /// The image cannot be a colour mosaic: it is too small, has three colours at each pixel, or floats. The numbers of its rows, columns
    /// and channels, and the bits of a sample.
    #[error(
        "image of {0} x {1} pixels, {2} channels and {3} bits cannot be a colour mosaic, which has at least 2 x 2 \
         pixels, 1 channel, and integers of 8 or 16 bits"
    )]
    Mosaic(usize, usize, usize, u8),
    /// The float sample at this position is NaN or infinite.
    #[error("sample at ({0}) is {1}, finite numbers are needed")]
    NotFinite(SamplePosition, f32),
}

impl Frame {
    /// Makes a frame of 8-bit samples, `H x W x C`.
    ///
    /// # Errors
    /// [`FrameError`] when a side is 0 or `C` is neither 1 nor 3.
    pub fn from_u8(pixels: Array3<u8>) -> Result<Self, FrameError> {
        Ok(Self { samples: Samples::U8(checked(pixels)?), mosaic: None })
    }

    /// Makes a frame of 16-bit samples, `H x W x C`.
    ///
    /// # Errors
    /// [`FrameError`] when a side is 0 or `C` is neither 1 nor 3.
    pub fn from_u16(pixels: Array3<u16>) -> Result<Self, FrameError> {
        Ok(Self { samples: Samples::U16(checked(pixels)?), mosaic: None })
    }

    /// Makes a frame of float samples, `H x W x C`.
    ///
    /// # Errors
    /// [`FrameError`] when a side is 0, `C` is neither 1 nor 3, or a sample is NaN or infinite.
    pub fn from_f32(pixels: Array3<f32>) -> Result<Self, FrameError> {
        let pixels = checked(pixels)?;
        let samples = in_order(pixels.view());
        // Refused here once, so that no method has to expect NaN or infinity.
        if let Some(index) = samples.iter().position(|value| !value.is_finite()) {
            return Err(FrameError::NotFinite(position_of(index, pixels.dim()), samples[index]));
        }
        Ok(Self { samples: Samples::F32(pixels), mosaic: None })
    }

    /// Declares that the pixels are a colour mosaic.
    ///
    /// # Errors
    /// [`FrameError::Mosaic`] when the frame has three channels, float samples, or a side of one pixel.
    pub fn with_mosaic(self, mosaic: Mosaic) -> Result<Self, FrameError> {
        let ((height, width, channels), depth) = (self.dim(), self.depth());
        if channels != 1 || height.min(width) < 2 || depth == 32 {
            return Err(FrameError::Mosaic(height, width, channels, depth));
        }
        Ok(Self { mosaic: Some(mosaic), ..self })
    }

    /// Returns the colour mosaic that the pixels are, if they are one.
    pub fn mosaic(&self) -> Option<Mosaic> {
        self.mosaic
    }

    /// Returns the frame with three colours at each pixel: itself if it has no mosaic, else the colours by
    /// [`Mosaic::demosaic`], integers rounded and clamped to the range of their bits.
    pub fn demosaiced(&self) -> Cow<'_, Self> {
        let Some(mosaic) = self.mosaic() else { return Cow::Borrowed(self) };
        let colours = mosaic.demosaic(self.to_f32().view());
        // The filters sharpen, so that they leave the range of the samples at edges.
        // `as` clamps. A mosaic has integers.
        let frame = match self.depth() {
            8 => Self::from_u8(colours.mapv(|value| (value + 0.5) as u8)),
            _ => Self::from_u16(colours.mapv(|value| (value + 0.5) as u16)),
        };
        Cow::Owned(frame.expect("the shape is that of an image"))
    }

    /// Returns the samples, which have one of three types.
    pub fn samples(&self) -> &Samples {
        &self.samples
    }

    /// Returns the samples of a frame of integers, which may have any value, for changes.
    pub(crate) fn samples_mut(&mut self) -> &mut Samples {
        debug_assert!(self.depth() < 32, "floats have to stay finite");
        &mut self.samples
    }

    /// Becomes a copy of `other`, in the same memory where the shapes are equal.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        match (&mut self.samples, &other.samples) {
            (Samples::U8(to), Samples::U8(from)) if to.dim() == from.dim() => to.assign(from),
            (Samples::U16(to), Samples::U16(from)) if to.dim() == from.dim() => to.assign(from),
            _ => self.samples = other.samples.clone(),
        }
        self.mosaic = other.mosaic;
    }

    /// Takes the samples out of the frame without a copy.
    pub fn into_samples(self) -> Samples {
        self.samples
    }

    /// Returns the samples of an 8-bit frame, and `None` for any other frame.
    pub fn as_u8(&self) -> Option<&Array3<u8>> {
        match &self.samples {
            Samples::U8(pixels) => Some(pixels),
            Samples::U16(_) | Samples::F32(_) => None,
        }
    }

    /// Returns (height, width, channels).
    pub fn dim(&self) -> (usize, usize, usize) {
        match &self.samples {
            Samples::U8(pixels) => pixels.dim(),
            Samples::U16(pixels) => pixels.dim(),
            Samples::F32(pixels) => pixels.dim(),
        }
    }

    /// Returns the number of rows.
    pub fn height(&self) -> usize {
        self.dim().0
    }

    /// Returns the number of columns.
    pub fn width(&self) -> usize {
        self.dim().1
    }

    /// Returns the number of channels: 1 (mono) or 3 (red, green, blue).
    pub fn channels(&self) -> usize {
        self.dim().2
    }

    /// Returns the bits of one sample in memory: 8, 16 or 32.
    pub fn depth(&self) -> u8 {
        match &self.samples {
            Samples::U8(_) => 8,
            Samples::U16(_) => 16,
            Samples::F32(_) => 32,
        }
    }

    /// Returns a copy of the samples as `f32`, `H x W x C`, with the same values.
    pub fn to_f32(&self) -> Array3<f32> {
        match &self.samples {
            Samples::U8(pixels) => pixels.mapv(f32::from),
            Samples::U16(pixels) => pixels.mapv(f32::from),
            Samples::F32(pixels) => pixels.clone(),
        }
    }
}

/// Returns an error for a shape that no image has.
pub(crate) fn check_shape((height, width, channels): (usize, usize, usize)) -> Result<(), FrameError> {
    if height == 0 || width == 0 {
        return Err(FrameError::Empty(height, width));
    }
    if channels != 1 && channels != 3 {
        return Err(FrameError::Channels(channels));
    }
    Ok(())
}

/// Returns the array in standard layout.
fn checked<T: Clone>(pixels: Array3<T>) -> Result<Array3<T>, FrameError> {
    check_shape(pixels.dim())?;
    // All later code reads the samples as one slice; an array that is in order already is not copied.
    Ok(if pixels.is_standard_layout() { pixels } else { pixels.as_standard_layout().into_owned() })
}

/// Returns the samples of an array in standard layout, row-major and interleaved.
pub(crate) fn in_order<T>(pixels: ArrayView3<'_, T>) -> &[T] {
    pixels.to_slice().expect("the array is in standard layout")
}

/// Returns the position of the `index`-th sample in interleaved order.
pub(crate) fn position_of(index: usize, (_, width, channels): (usize, usize, usize)) -> SamplePosition {
    SamplePosition {
        row: index / channels / width,
        column: index / channels % width,
        channel: index % channels,
    }
}

/// Copies one channel of the interleaved `samples` into `plane`, row-major.
pub(crate) fn copy_channel<T: Copy + Into<f32>>(
    samples: &[T],
    channels: usize,
    channel: usize,
    plane: &mut Vec<f32>,
) {
    plane.clear();
    plane.extend(samples.iter().skip(channel).step_by(channels).map(|&sample| sample.into()));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refuses_empty_and_odd_channels() {
        assert_eq!(Frame::from_u8(Array3::zeros((0, 4, 3))), Err(FrameError::Empty(0, 4)));
        assert_eq!(Frame::from_u16(Array3::zeros((2, 4, 2))), Err(FrameError::Channels(2)));
        assert_eq!(Frame::from_f32(Array3::zeros((2, 0, 1))), Err(FrameError::Empty(2, 0)));
    }

    #[test]
    fn a_sample_that_is_not_finite_is_named() {
        let mut pixels = Array3::zeros((2, 4, 3));
        pixels[(1, 2, 0)] = f32::INFINITY;
        let at = SamplePosition { row: 1, column: 2, channel: 0 };
        let error = FrameError::NotFinite(at, f32::INFINITY);
        assert_eq!(Frame::from_f32(pixels), Err(error));
    }

    #[test]
    fn makes_the_layout_standard() {
        let reversed = Array3::from_shape_fn((2, 3, 1), |(i, j, _)| (3 * i + j) as u8)
            .reversed_axes()
            .permuted_axes([2, 1, 0]);
        let frame = Frame::from_u8(reversed).unwrap();
        assert_eq!(in_order(frame.as_u8().unwrap().view()), [0, 1, 2, 3, 4, 5]);
    }
}
