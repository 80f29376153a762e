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
    #[error("{}: {source}", path.display())]
    Io {
        /// Path of the file.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// An image that does not decode.
    #[error("{origin}: {why}")]
    Undecodable {
        /// The file, or topic and stamp.
        origin: String,
        /// Description of the fault.
        why: String,
    },
    /// A white that is no radiance.
    #[error("white = {white}: must be a finite number, 0 (automatic) or above")]
    White {
        /// The value that was offered.
        white: f32,
    },
}
