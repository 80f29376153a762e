//! Conversion between [`Image`], which has rows of bytes, and [`Frame`], which has the pixels that the suite computes
//! with.
//!
//! Pixels are never scaled, converted between depths, or guessed: an encoding that is not in the table is refused.

mod decode;
mod encode;
mod encoding;

use modulo_core::{Frame, FrameError};

pub use self::encode::encode_frame;
use self::encoding::names;
use crate::sensor_msgs::Image;

/// Error: an [`Image`] is not a valid [`Frame`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ImageError {
    /// The encoding is not one of those that can be read.
    #[error("image encoding '{0}' cannot be read, possible are {known}", known = names())]
    Encoding(String),
    /// Rows would overlap.
    #[error("image step is {step} bytes, a row needs at least {row}")]
    Step {
        /// Bytes from row to row found.
        step: u32,
        /// Bytes of one row's pixels.
        row: u64,
    },
    /// Rows are missing.
    #[error("image data has {got} bytes, height * step = {expected} expected")]
    Short {
        /// `height * step`.
        expected: u64,
        /// Bytes found.
        got: usize,
    },
    /// The sizes are not those of a frame, or a float sample is not finite.
    #[error(transparent)]
    Frame(#[from] FrameError),
}

impl Image {
    /// Returns the pixels, red first.
    ///
    /// Reads `rgb8 bgr8 mono8 rgba8 bgra8 rgb16 bgr16 mono16 8UC1 8UC3 16UC1 16UC3 32FC1 32FC3` in either byte order with any `step` of at least one row. Alpha is dropped. `8UC3`, `16UC3` and `32FC3` do not define the order of their channels and are read as OpenCV's, blue first.
    ///
    /// # Errors
    /// [`ImageError`] for another encoding, a side of 0, a `step` below one
    /// row, fewer than `height * step` bytes, and floats that are NaN or infinite.
    pub fn to_frame(&self) -> Result<Frame, ImageError> {
        decode::frame(decode::PixelLayout::of(self)?, self.data.as_slice().into())
    }

    /// Converts the image as [`Image::to_frame`] does, but keeps the buffer of `rgb8` and `mono8` without padding instead of copying it.
    ///
    /// # Errors
    /// As [`Image::to_frame`].
    pub fn into_frame(self) -> Result<Frame, ImageError> {
        decode::frame(decode::PixelLayout::of(&self)?, self.data.into())
    }
}
