//! Image files to pixels and back: PNG, JPEG, OpenEXR, Radiance HDR.
//!
//! This crate knows no source, stream or message. Only [`White`] changes values.

mod read;
mod white;
mod write;

pub use read::{EXTENSIONS, decode, read_image};
pub use white::White;
pub use write::{SaveError, save_png};

use std::path::PathBuf;

/// Error: an image could not be read. The message names the file, the fault and the possible values.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The system does not read the file.
    #[error("{file}: {1}", file = .0.display())]
    Io(PathBuf, #[source] std::io::Error),
    /// An image that does not decode.
    #[error("{0}: {1}")]
    Undecodable(String, String),
    /// A white that is no radiance.
    #[error("white = {0}: must be a finite number, 0 (automatic) or above")]
    White(f32),
}
