//! A frame to a PNG file; samples are written as they are, 8 or 16 bits.

use std::path::{Path, PathBuf};

use image::{ExtendedColorType, ImageFormat};
use modulo_core::Frame;

/// Why a frame could not be written.
#[derive(Debug, thiserror::Error)]
#[error("{}: {source}", path.display())]
pub struct SaveError {
    /// The file.
    pub path: PathBuf,
    /// What the encoder or the system said.
    pub source: image::ImageError,
}

/// Writes `frame` to `path` as PNG, grey or RGB, 8 or 16 bits a sample.
///
/// # Errors
/// [`SaveError`] when the file cannot be written.
pub fn save_png(path: &Path, frame: &Frame) -> Result<(), SaveError> {
    let (height, width, channels) = frame.dim();
    let (bytes, colour) = match frame {
        Frame::U8(codes) => {
            let colour = if channels == 1 { ExtendedColorType::L8 } else { ExtendedColorType::Rgb8 };
            (codes.iter().copied().collect(), colour)
        }
        Frame::U16(codes) => {
            let colour = if channels == 1 { ExtendedColorType::L16 } else { ExtendedColorType::Rgb16 };
            (codes.iter().flat_map(|code| code.to_ne_bytes()).collect::<Vec<u8>>(), colour)
        }
    };
    // A side beyond 32 bits is far beyond what PNG and memory hold; the encoder refuses it.
    let side = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    image::save_buffer_with_format(path, &bytes, side(width), side(height), colour, ImageFormat::Png)
        .map_err(|source| SaveError { path: path.to_owned(), source })
}
