//! The 8-bit samples of a frame, as the metrics compare them.

use modulo_core::Frame;
use ndarray::Array3;

/// The samples of an 8-bit frame; of a 16-bit one the upper byte.
pub(crate) fn shown(frame: Frame) -> Array3<u8> {
    match frame {
        Frame::U8(samples) => samples,
        Frame::U16(samples) => samples.mapv(|sample| (sample >> 8) as u8),
    }
}
