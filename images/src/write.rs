//! A frame to a PNG file; samples are written as they are, 8 or 16 bits.

use std::path::{Path, PathBuf};

use image::error::{LimitError, LimitErrorKind, UnsupportedError, UnsupportedErrorKind};
use image::{ExtendedColorType, ImageError, ImageFormat};
use modulo_core::{Frame, Samples};

/// Error: a frame could not be written.
#[derive(Debug, thiserror::Error)]
#[error("{}: {source}", path.display())]
pub struct SaveError {
    /// Path of the file.
    pub path: PathBuf,
    /// The error of the encoder or the system.
    pub source: ImageError,
}

/// Writes `frame` to `path` as PNG, grey or RGB, 8 or 16 bits a sample.
///
/// # Errors
/// [`SaveError`] when the file cannot be written, and for a frame of floats, which PNG cannot hold.
pub fn save_png(path: &Path, frame: &Frame) -> Result<(), SaveError> {
    write(path, frame).map_err(|source| SaveError { path: path.to_owned(), source })
}

fn write(path: &Path, frame: &Frame) -> Result<(), ImageError> {
    let (height, width, channels) = frame.dim();
    let colour = |grey, rgb| if channels == 1 { grey } else { rgb };
    let (bytes, colour) = match frame.samples() {
        Samples::U8(codes) => {
            (codes.iter().copied().collect(), colour(ExtendedColorType::L8, ExtendedColorType::Rgb8))
        }
        Samples::U16(codes) => (
            codes.iter().flat_map(|code| code.to_ne_bytes()).collect::<Vec<u8>>(),
            colour(ExtendedColorType::L16, ExtendedColorType::Rgb16),
        ),
        Samples::F32(_) => {
            let kind = UnsupportedErrorKind::Color(ExtendedColorType::Rgb32F);
            let error = UnsupportedError::from_format_and_kind(ImageFormat::Png.into(), kind);
            return Err(ImageError::Unsupported(error));
        }
    };
    let too_long = |_| ImageError::Limits(LimitError::from_kind(LimitErrorKind::DimensionError));
    let side = |n: usize| u32::try_from(n).map_err(too_long);
    image::save_buffer_with_format(path, &bytes, side(width)?, side(height)?, colour, ImageFormat::Png)
}
