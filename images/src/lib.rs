//! Image files to pixels and back: PNG, JPEG, OpenEXR, Radiance HDR.
//!
//! Nothing here knows a source, a stream or a message; values are never
//! changed but by [`White`], which says how.

mod read;
mod white;
mod write;

pub use read::{EXTENSIONS, decode, read_image};
pub use white::White;
pub use write::{SaveError, save_png};

use std::path::PathBuf;

/// Why an image could not be had: the file, what was found, what is possible.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// The system refused.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// An image that does not decode.
    #[error("{origin}: {why}")]
    Undecodable {
        /// The file, or topic and stamp.
        origin: String,
        /// What is wrong with it.
        why: String,
    },
    /// A white that is no radiance.
    #[error("white = {white}: must be a finite number, 0 (automatic) or above")]
    White {
        /// The value that was offered.
        white: f32,
    },
}
