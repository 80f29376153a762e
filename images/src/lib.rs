//! Image files to pixels and back: PNG, JPEG, OpenEXR, Radiance HDR.
//!
//! Nothing here knows a source, a stream or a message; values are never
//! changed but by [`White`], which says how.

mod error;
mod read;
mod white;
mod write;

pub use error::ImageError;
pub use read::{EXTENSIONS, decode, read_image};
pub use white::White;
pub use write::{SaveError, save_png};
