//! [`ImageError`]: why there are no pixels.

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
