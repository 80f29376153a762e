//! Videos and live cameras to frames, by the programs `ffmpeg` and `ffprobe` of the system.
//!
//! Both run as processes of their own, and frames pass through a pipe. They are given one input, the protocols and the containers
//! that this input may have, and no playlist, so that no file can make them read another one.

mod address;
mod damage;
mod file;
mod index;
mod listen;
mod live;
mod pam;
mod program;

use std::fmt;

use modulo_core::Frame;
use modulo_images::{Coding, ImageError, White};
use ndarray::Array3;

pub use address::{LiveAddress, VideoAddress};
pub use file::{VideoFile, VideoFrame};
pub use live::{LiveCounts, LiveFrame, LiveVideo};
pub use program::version;

/// The pixels of a frame of a video.
#[derive(Clone, Debug, PartialEq)]
pub struct Pixels {
    /// Three channels; codes of 8 bits, or of `bits` bits in 16.
    pub frame: Frame,
    /// Bits of a sample, 8 to 16.
    pub bits: u32,
}

impl Pixels {
    /// Returns the radiance, `H x W x 3`, as a fraction of full scale in `[0, 1)`, by `coding`, but its white. As in images of 8 bits, the largest
    /// code stands for full scale and all beyond it. `origin` is the name of the frame in errors.
    ///
    /// # Errors
    /// [`ImageError`] as [`White::new`] and [`White::radiance`] have it.
    pub fn radiance(&self, coding: &Coding, origin: impl fmt::Display) -> Result<Array3<f32>, ImageError> {
        let is_known = self.frame.depth() == 8 || coding.knees.is_some();
        let white = if is_known { 0.0 } else { ((1_u32 << self.bits) - 1) as f32 };
        White::new(Coding { white, ..coding.clone() })?.radiance(&self.frame, origin)
    }
}

/// Error: a video cannot be read. The text has its name and the reason, and never a password.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct VideoError(String);

impl VideoError {
    fn failed(name: impl fmt::Display, why: impl fmt::Display) -> Self {
        Self(format!("{name}: {why}"))
    }
}
