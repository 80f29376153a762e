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
    /// NaN or infinity in a float image.
    #[error("{origin}: {value} at x {x}, y {y}, channel {channel}; every sample must be finite")]
    NotFinite {
        /// The file, or topic and stamp.
        origin: String,
        /// Column.
        x: usize,
        /// Row.
        y: usize,
        /// Channel, 0 is red.
        channel: usize,
        /// NaN or an infinity.
        value: f32,
    },
    /// A white that is no radiance.
    #[error("white = {white}: must be a finite number, 0 (automatic) or above")]
    White {
        /// The value that was offered.
        white: f32,
    },
}
